"""On one's feet at tables and counters: working, leaning, picking up and putting down."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import Placement, SceneObject
from imapper_prob.scenelets.procedural import furniture
from imapper_prob.scenelets.procedural.gait import settle, walk_along
from imapper_prob.scenelets.procedural.person import Person
from imapper_prob.scenelets.procedural.reaching import TRAVEL, extent, reach
from imapper_prob.scenelets.procedural.recipes.drawn import FACING_BACK, Drawn, Recipe, moments
from imapper_prob.scenelets.procedural.standing import (
    HELD,
    draw_pastime,
    lean_against,
    lean_on,
    stand,
)

__all__ = ["lean_back_against", "lean_on_top", "pick_up", "stand_at"]

Array = NDArray[np.float64]

FROM_ABOVE = (0.0, -0.06, 0.14)
"""Metres from a thing on a table to where the hand is just before."""


def _top(rng: np.random.Generator, person: Person, kind: str) -> tuple[SceneObject, float]:
    """A table or counter and the height of its surface as the person sees them."""
    make = {
        "table": furniture.table,
        "low table": furniture.low_table,
        "counter": furniture.counter,
    }[kind]
    piece = person.sees(make(rng))
    return piece, float(piece.bounds[1, 2])


def _before(rng: np.random.Generator, piece: SceneObject, edge: float) -> SceneObject:
    """The piece with its front edge at y = ``edge``, somewhere along it before the person."""
    half = max(piece.bounds[1, 0] - 0.3, 0.0)
    at = Placement(rng.uniform(-half, half), edge + piece.bounds[1, 1], FACING_BACK)
    return piece.moved(at)


def stand_at(kind: str) -> Recipe:
    """Standing at a table or counter, hands on it or at work just above."""

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
    """Leaning on a table or counter with straight arms."""

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, height = _top(rng, person, kind)
        joints, edge = lean_on(rng, moments(rng, 15, 20), top=height)
        return Drawn(joints, (_before(rng, piece, edge),))

    return draw


def lean_back_against(kind: str) -> Recipe:
    """Leaning against a table or counter, facing away."""

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, height = _top(rng, person, kind)
        joints, edge = lean_against(rng, moments(rng, 15, 20), top=height)
        half = max(piece.bounds[1, 0] - 0.3, 0.0)
        behind = Placement(rng.uniform(-half, half), edge - piece.bounds[1, 1], 0.0)
        return Drawn(joints, (piece.moved(behind),))

    return draw


def pick_up(kind: str, *, backwards: bool = False) -> Recipe:
    """Taking something from a table, low table or counter; backwards, putting it down."""

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
        if rng.random() < 0.4:  # comes a step nearer first
            start = rng.uniform(0.2, 0.3)
            begin = Placement(
                rng.uniform(-0.2, 0.2), -rng.uniform(0.2, 0.45), rng.uniform(-0.5, 0.5)
            )
            body = walk_along(
                settle(begin, Placement(0.0, 0.0, 0.0), arrival=0.8),
                times,
                step_time=0.38,
                phase=rng.uniform(-0.1, 0.4),
                lean=0.03,
                half_width=rng.uniform(0.09, 0.14),
            )
        joints = reach(
            body,
            targets=targets,
            hands=hands,
            part=extent(times, start=start, finish=start + TRAVEL + rng.uniform(0.0, 0.1)),
            via=FROM_ABOVE,
            deepest=0.12 if low else 0.3,
            after=load,
        )
        if backwards:
            joints = joints[::-1]
        return Drawn(joints, (_before(rng, piece, edge),))

    return draw
