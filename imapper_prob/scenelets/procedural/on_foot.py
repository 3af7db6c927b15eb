"""Recipes of people on their feet: walking, standing about, at tables and counters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import Placement, SceneObject
from imapper_prob.scenelets.procedural import furniture
from imapper_prob.scenelets.procedural.body import Drawn, Person, Recipe, moments, pose_body
from imapper_prob.scenelets.procedural.gait import (
    GATHER,
    WALK_RATIO,
    Gait,
    Route,
    Walk,
    arc,
    come_nearer,
    settle,
    starting,
    steady,
    stopping,
    walk_along,
)
from imapper_prob.scenelets.procedural.reaching import TRAVEL, extent, reach
from imapper_prob.scenelets.procedural.standing import (
    HELD,
    draw_pastime,
    held,
    lean_against,
    lean_on,
    stand,
    stand_idle,
)

__all__ = [
    "carry",
    "idle",
    "lean_back_against",
    "lean_on_top",
    "pick_up",
    "shuffle",
    "side_step",
    "stand_at",
    "start_walking",
    "stop_walking",
    "turn_on_spot",
    "walk",
]

Array = NDArray[np.float64]


def _speed(rng: np.random.Generator) -> float:
    """Walking speed in metres a second, slower indoors than the 1.3 of a street."""
    return float(np.clip(rng.normal(0.95, 0.22), 0.4, 1.4))


def _curvature(rng: np.random.Generator) -> float:
    """Curvature of a walk in radians a metre; half of the walks are straight."""
    return float(rng.choice([0.0, rng.uniform(-1.3, 1.3)]))


def _step_time(speed: float, *, ratio: float = WALK_RATIO) -> float:
    """Seconds a step takes at a speed, from the walk ratio of step length to cadence."""
    return float(np.sqrt(60 * ratio / speed))


def _gait(rng: np.random.Generator, route: Route, times: Array, *, step_time: float) -> Walk:
    gait = Gait(
        step_time=step_time * rng.uniform(0.93, 1.07),
        phase=rng.uniform(0, 2 * step_time),
        lean=rng.uniform(0.02, 0.08),
        half_width=rng.uniform(0.06, 0.10),
        vigour=rng.uniform(0.5, 1.3),
    )
    return walk_along(route, times, gait)


def _bare(walk: Walk) -> Drawn:
    return Drawn(pose_body(walk.trunk, ankles=walk.ankles, wrists=walk.wrists), ())


def walk(rng: np.random.Generator, person: Person) -> Drawn:
    """About a metre or two of walking, straight or in a curve.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person

    Returns
    -------
    Drawn
    """
    speed, times = _speed(rng), moments(rng, 15, 20)
    route = arc(steady(speed), _curvature(rng))
    return _bare(_gait(rng, route, times, step_time=_step_time(speed)))


def shuffle(rng: np.random.Generator, person: Person) -> Drawn:
    """Walking with short, quick steps, as old or careful people do.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person

    Returns
    -------
    Drawn
    """
    speed, times = rng.uniform(0.4, 0.6), moments(rng, 17, 20)
    route = arc(steady(speed), _curvature(rng))
    step_time = _step_time(speed, ratio=rng.uniform(0.5, 0.7) * WALK_RATIO)
    return _bare(_gait(rng, route, times, step_time=step_time))


def start_walking(rng: np.random.Generator, person: Person) -> Drawn:
    """Starting to walk from standing.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person

    Returns
    -------
    Drawn
    """
    speed, times = _speed(rng), moments(rng, 17, 20)
    route = arc(starting(speed, at=rng.uniform(-0.1, 0.5)), _curvature(rng))
    return _bare(_gait(rng, route, times, step_time=_step_time(speed)))


def stop_walking(rng: np.random.Generator, person: Person) -> Drawn:
    """Walking and coming to a halt.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person

    Returns
    -------
    Drawn
    """
    speed, times = _speed(rng), moments(rng, 17, 20)
    route = arc(stopping(speed, by=float(times[-1]) - rng.uniform(0.1, 0.6)), _curvature(rng))
    return _bare(_gait(rng, route, times, step_time=_step_time(speed)))


def turn_on_spot(rng: np.random.Generator, person: Person) -> Drawn:
    """Turning round on the spot in small steps, by 60 to 180 degrees.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person

    Returns
    -------
    Drawn
    """
    times = moments(rng, 15, 20)
    turn = rng.uniform(1.05, np.pi)
    end = Placement(rng.uniform(-0.15, 0.15), rng.uniform(-0.15, 0.15), turn)
    # Half a turn takes 1.8 seconds, as in four steps of .45 seconds.
    route = settle(Placement(0.0, 0.0, 0.0), end, arrival=max(turn / 1.75, GATHER))
    return _bare(_gait(rng, route, times, step_time=rng.uniform(0.38, 0.46)))


def side_step(rng: np.random.Generator, person: Person) -> Drawn:
    """Stepping sideways, as between a couch and its table.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person

    Returns
    -------
    Drawn
    """
    times = moments(rng, 15, 20)
    speed, step_time = rng.uniform(0.30, 0.45), rng.uniform(0.38, 0.45)
    forward = rng.uniform(-0.1, 0.1)

    def route(at: Array) -> Array:
        return np.stack([speed * at, forward * at, np.zeros_like(at)], -1)

    # The feet stay further apart than the length of a step; otherwise they would cross.
    half_width = 0.5 * speed * step_time + rng.uniform(0.06, 0.09)
    gait = Gait(
        step_time=step_time,
        phase=rng.uniform(0, 2 * step_time),
        lean=rng.uniform(0.0, 0.08),
        half_width=half_width,
        vigour=0.0,
    )
    return _bare(walk_along(route, times, gait))


def carry(rng: np.random.Generator, person: Person) -> Drawn:
    """Walking with something in one hand or both.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person

    Returns
    -------
    Drawn
    """
    speed, times = min(_speed(rng), 1.1), moments(rng, 15, 20)
    route = arc(steady(speed), _curvature(rng))
    walk = _gait(rng, route, times, step_time=_step_time(speed))
    load = draw_pastime(rng, HELD)
    # Arms that hold something move with the pelvis, and the shoulders twist less.
    trunk = replace(walk.trunk, twist=0.4 * walk.trunk.twist)
    wrists = held(load, trunk, walk.wrists)
    return Drawn(pose_body(trunk, ankles=walk.ankles, wrists=wrists, elbows=load.elbows), ())


def idle(rng: np.random.Generator, person: Person) -> Drawn:
    """Standing and waiting with nothing near, in one of the ways people hold their hands.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person

    Returns
    -------
    Drawn
    """
    return Drawn(stand_idle(rng, moments(rng, 15, 18)), ())


# ------------------------------------------------------------------------------------------------
# At tables and counters: working, leaning, picking up and putting down.

FROM_ABOVE = (0.0, -0.06, 0.14)
"""Metres from a thing on a table to the point from which the hand approaches it."""


def _top(rng: np.random.Generator, person: Person, kind: str) -> tuple[SceneObject, float]:
    """A table or counter as the person sees it, and the height of its surface."""
    make = {
        "table": furniture.table,
        "low table": furniture.low_table,
        "counter": furniture.counter,
    }[kind]
    piece = person.sees(make(rng))
    return piece, float(piece.bounds[1, 2])


def _before(rng: np.random.Generator, piece: SceneObject, edge: float) -> SceneObject:
    """The piece with its front edge at y = ``edge``, shifted at random along that edge."""
    half = max(piece.bounds[1, 0] - 0.3, 0.0)
    return furniture.facing_back(piece, rng.uniform(-half, half), edge=edge)


def stand_at(kind: str) -> Recipe:
    """Recipe: standing at a table or counter, hands on it or working just above it.

    Parameters
    ----------
    kind : str
        Kind of furniture, such as ``"table"``.

    Returns
    -------
    callable
        Maps rng and person to :class:`~imapper_prob.scenelets.procedural.body.Drawn`.
    """

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, height = _top(rng, person, kind)
        times = moments(rng, 15, 20)
        edge = rng.uniform(0.18, 0.28)
        hands = (True, True) if rng.random() < 0.6 else (True, False)
        apart = rng.uniform(0.10, 0.25, 2) * (1, -1)
        depth = edge + rng.uniform(0.04, 0.20, 2)
        work = 0.02 * np.sin(2 * np.pi * times / rng.uniform(1.5, 3.0))
        targets = np.zeros((len(times), 2, 3))
        targets[..., 0] = apart + work[:, None]
        targets[..., 1] = depth
        targets[..., 2] = height + rng.uniform(0.05, 0.20, 2)
        start = -1.0 if rng.random() < 0.5 else rng.uniform(0.0, 0.3)
        finish = np.inf if rng.random() < 0.7 else times[-1] - TRAVEL * rng.uniform(0.7, 1.0)
        joints = reach(
            stand(rng, times, one_leg=bool(rng.random() < 0.3)),
            targets=targets,
            hands=hands,
            part=extent(times, start=start, finish=finish),
            via=FROM_ABOVE,
        )
        return Drawn(joints, (_before(rng, piece, edge),))

    return draw


def lean_on_top(kind: str) -> Recipe:
    """Recipe: leaning on a table or counter with straight arms.

    Parameters
    ----------
    kind : str
        Kind of furniture, such as ``"table"``.

    Returns
    -------
    callable
        Maps rng and person to :class:`~imapper_prob.scenelets.procedural.body.Drawn`.
    """

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, height = _top(rng, person, kind)
        joints, edge = lean_on(rng, moments(rng, 15, 20), top=height)
        return Drawn(joints, (_before(rng, piece, edge),))

    return draw


def lean_back_against(kind: str) -> Recipe:
    """Recipe: leaning back against a table or counter, facing away from it.

    Parameters
    ----------
    kind : str
        Kind of furniture, such as ``"table"``.

    Returns
    -------
    callable
        Maps rng and person to :class:`~imapper_prob.scenelets.procedural.body.Drawn`.
    """

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, height = _top(rng, person, kind)
        joints, edge = lean_against(rng, moments(rng, 15, 20), top=height)
        half = max(piece.bounds[1, 0] - 0.3, 0.0)
        behind = Placement(rng.uniform(-half, half), edge - piece.bounds[1, 1], 0.0)
        return Drawn(joints, (piece.moved(behind),))

    return draw


def pick_up(kind: str) -> Recipe:
    """Recipe: taking something from a table, low table or counter.

    Parameters
    ----------
    kind : str
        Kind of furniture, such as ``"table"``.

    Returns
    -------
    callable
        Maps rng and person to :class:`~imapper_prob.scenelets.procedural.body.Drawn`.
    """

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, height = _top(rng, person, kind)
        times = moments(rng, 18, 20)
        low = kind == "low table"
        edge = rng.uniform(0.22, 0.32) if low else rng.uniform(0.18, 0.28)
        load = draw_pastime(rng, {name: HELD[name] for name in ("tray", "box", "cup", "book")})
        hands = ~np.isnan(load.hands[:, 0])
        middle = rng.uniform(-0.15, 0.15)
        targets = np.stack(
            [
                middle + np.array([0.14, -0.14]) * hands.mean(),
                np.full(2, edge + rng.uniform(0.06, 0.18)),
                np.full(2, height + rng.uniform(0.06, 0.12)),
            ],
            -1,
        )
        start = rng.uniform(-0.2, 0.15)
        body = stand(rng, times)
        if rng.random() < 0.4:  # the person first comes a step nearer
            start = rng.uniform(0.2, 0.3)
            begin = Placement(
                rng.uniform(-0.2, 0.2), -rng.uniform(0.2, 0.45), rng.uniform(-0.5, 0.5)
            )
            body = come_nearer(rng, begin, times, arrival=0.8)
        joints = reach(
            body,
            targets=targets,
            hands=hands,
            part=extent(times, start=start, finish=start + TRAVEL + rng.uniform(0.0, 0.1)),
            via=FROM_ABOVE,
            deepest=0.12 if low else 0.3,
            after=load,
        )
        return Drawn(joints, (_before(rng, piece, edge),))

    return draw
