"""Standing at a table and reaching into a shelf."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import Placement
from imapper_prob.scenelets.procedural import furniture
from imapper_prob.scenelets.procedural.person import Person
from imapper_prob.scenelets.procedural.recipes.drawn import FACING_BACK, Drawn, moments
from imapper_prob.scenelets.procedural.standing import reach_and_hold

__all__ = ["reach_shelf", "stand_at_table"]

Array = NDArray[np.float64]


def _schedule(rng: np.random.Generator, times: Array) -> tuple[float, float | None]:
    """When hands set off and return: there already, setting off, or out and back."""
    choice = rng.integers(3)
    if choice == 0:
        return -1.0, None
    if choice == 1:
        return float(rng.uniform(0.0, 0.3)), None
    return float(rng.uniform(-0.3, 0.0)), float(times[-1] - rng.uniform(0.5, 0.7))


def stand_at_table(rng: np.random.Generator, person: Person) -> Drawn:
    """Standing at a table with one hand or both on it or just over it."""
    top = person.sees(furniture.table(rng))
    edge, height = rng.uniform(0.18, 0.28), float(top.bounds[1, 2])
    target = np.stack(
        [
            np.array([1, -1]) * rng.uniform(0.10, 0.25, 2),
            edge + rng.uniform(0.04, 0.20, 2),
            height + rng.uniform(0.05, 0.20, 2),
        ],
        -1,
    )
    hands = (True, True) if rng.random() < 0.6 else (True, False)
    half = top.bounds[1, 0] - 0.2
    at = Placement(rng.uniform(-half, half), edge + top.bounds[1, 1], FACING_BACK)
    times = moments(rng, 15, 20)
    start, finish = _schedule(rng, times)
    joints = reach_and_hold(rng, times, target=target, hands=hands, start=start, finish=finish)
    return Drawn(joints, (top.moved(at),))


def reach_shelf(rng: np.random.Generator, person: Person) -> Drawn:
    """Standing before a shelf and reaching for something on one of its boards."""
    piece = person.sees(furniture.shelf(rng))
    boards = [c.centre[2] + c.size[2] / 2 for c in piece.cuboids if c.part == "board"]
    board = rng.choice([z for z in boards if 0.35 < z < 1.65])
    front = rng.uniform(0.40, 0.52)
    half = piece.bounds[1, 0] - 0.2
    offset = rng.uniform(-half, half) * 0.7
    x = np.clip(np.array([0.14, -0.14]) + rng.uniform(-0.1, 0.1), offset - half, offset + half)
    target = np.stack(
        [x, np.full(2, front + rng.uniform(-0.03, 0.05)), np.full(2, board + 0.10)], -1
    )
    hands = (True, True) if rng.random() < 0.35 else (True, False)
    times = moments(rng, 15, 20)
    start, finish = _schedule(rng, times)
    joints = reach_and_hold(rng, times, target=target, hands=hands, start=start, finish=finish)
    at = Placement(offset, front + piece.bounds[1, 1], FACING_BACK)
    return Drawn(joints, (piece.moved(at),))
