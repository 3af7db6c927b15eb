"""Walking and standing about with nothing near."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import Placement
from imapper_prob.scenelets.procedural.body import pose_body
from imapper_prob.scenelets.procedural.gait import (
    GATHER,
    WALK_RATIO,
    Route,
    Walk,
    arc,
    settle,
    starting,
    steady,
    stopping,
    walk_along,
)
from imapper_prob.scenelets.procedural.person import Person
from imapper_prob.scenelets.procedural.recipes.drawn import Drawn, moments
from imapper_prob.scenelets.procedural.standing import (
    HELD,
    draw_pastime,
    held,
    stand_idle,
)

__all__ = [
    "carry",
    "idle",
    "shuffle",
    "side_step",
    "start_walking",
    "stop_walking",
    "turn_on_spot",
    "walk",
]

Array = NDArray[np.float64]


def _speed(rng: np.random.Generator) -> float:
    """Metres a second; indoors people walk slower than the 1.3 of a street."""
    return float(np.clip(rng.normal(0.95, 0.22), 0.4, 1.4))


def _curvature(rng: np.random.Generator) -> float:
    """Radians a metre; half of the ways are straight."""
    return float(rng.choice([0.0, rng.uniform(-1.3, 1.3)]))


def _step_time(speed: float, *, ratio: float = WALK_RATIO) -> float:
    """Seconds a step takes at a speed, from the walk ratio: length and rate grow alike."""
    return float(np.sqrt(60 * ratio / speed))


def _gait(rng: np.random.Generator, route: Route, times: Array, *, step_time: float) -> Walk:
    return walk_along(
        route,
        times,
        step_time=step_time * rng.uniform(0.93, 1.07),
        phase=rng.uniform(0, 2 * step_time),
        lean=rng.uniform(0.02, 0.08),
        half_width=rng.uniform(0.06, 0.10),
        vigour=rng.uniform(0.5, 1.3),
    )


def _bare(walk: Walk) -> Drawn:
    return Drawn(pose_body(walk.trunk, ankles=walk.ankles, wrists=walk.wrists), ())


def walk(rng: np.random.Generator, person: Person) -> Drawn:
    """About a metre or two of walking, straight or in a curve."""
    speed, times = _speed(rng), moments(rng, 15, 20)
    route = arc(steady(speed), _curvature(rng))
    return _bare(_gait(rng, route, times, step_time=_step_time(speed)))


def shuffle(rng: np.random.Generator, person: Person) -> Drawn:
    """Short, quick steps, as of the old and the careful."""
    speed, times = rng.uniform(0.4, 0.6), moments(rng, 17, 20)
    route = arc(steady(speed), _curvature(rng))
    step_time = _step_time(speed, ratio=rng.uniform(0.5, 0.7) * WALK_RATIO)
    return _bare(_gait(rng, route, times, step_time=step_time))


def start_walking(rng: np.random.Generator, person: Person) -> Drawn:
    """From standing to walking."""
    speed, times = _speed(rng), moments(rng, 17, 20)
    route = arc(starting(speed, at=rng.uniform(-0.1, 0.5)), _curvature(rng))
    return _bare(_gait(rng, route, times, step_time=_step_time(speed)))


def stop_walking(rng: np.random.Generator, person: Person) -> Drawn:
    """From walking to standing."""
    speed, times = _speed(rng), moments(rng, 17, 20)
    route = arc(stopping(speed, by=float(times[-1]) - rng.uniform(0.1, 0.6)), _curvature(rng))
    return _bare(_gait(rng, route, times, step_time=_step_time(speed)))


def turn_on_spot(rng: np.random.Generator, person: Person) -> Drawn:
    """Turning round by small steps: 60 to 180 degrees."""
    times = moments(rng, 15, 20)
    turn = rng.uniform(1.05, np.pi)
    end = Placement(rng.uniform(-0.15, 0.15), rng.uniform(-0.15, 0.15), turn)
    # Half a turn in 1.8 seconds, as in four steps of .45 seconds.
    route = settle(Placement(0.0, 0.0, 0.0), end, arrival=max(turn / 1.75, GATHER))
    return _bare(_gait(rng, route, times, step_time=rng.uniform(0.38, 0.46)))


def side_step(rng: np.random.Generator, person: Person) -> Drawn:
    """Steps to the side, as one passes between a couch and its table."""
    times = moments(rng, 15, 20)
    speed, step_time = rng.uniform(0.30, 0.45), rng.uniform(0.38, 0.45)
    forward = rng.uniform(-0.1, 0.1)

    def route(at: Array) -> Array:
        return np.stack([speed * at, forward * at, np.zeros_like(at)], -1)

    # The feet stay further apart than a step is long, or they would cross.
    half_width = 0.5 * speed * step_time + rng.uniform(0.06, 0.09)
    walk = walk_along(
        route,
        times,
        step_time=step_time,
        phase=rng.uniform(0, 2 * step_time),
        lean=rng.uniform(0.0, 0.08),
        half_width=half_width,
        vigour=0.0,
    )
    return _bare(walk)


def carry(rng: np.random.Generator, person: Person) -> Drawn:
    """Walking with something in one hand or both."""
    speed, times = min(_speed(rng), 1.1), moments(rng, 15, 20)
    route = arc(steady(speed), _curvature(rng))
    walk = _gait(rng, route, times, step_time=_step_time(speed))
    load = draw_pastime(rng, HELD)
    # Arms that hold something go with the pelvis, and shoulders keep still for them.
    trunk = replace(walk.trunk, twist=0.4 * walk.trunk.twist)
    wrists = held(load, trunk, walk.wrists)
    return Drawn(pose_body(trunk, ankles=walk.ankles, wrists=wrists, elbows=load.elbows), ())


def idle(rng: np.random.Generator, person: Person) -> Drawn:
    """Standing with nothing near, hands wherever they are while people wait."""
    return Drawn(stand_idle(rng, moments(rng, 15, 18)), ())
