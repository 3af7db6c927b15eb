"""What one sits or stands at."""

from __future__ import annotations

import numpy as np

from imapper_prob.models.scene import SceneObject
from imapper_prob.scenelets.procedural.furniture.parts import (
    BOARD,
    ORIGIN,
    box,
    four_legs,
    top_on,
)

__all__ = ["counter", "desk", "knee_room", "low_table", "table"]


def table(rng: np.random.Generator) -> SceneObject:
    """A table on four legs to sit or stand at.

    .72-.75 high; 1.2 by .6 is what is annotated in i3DB, up to 1.6 by .8 for six diners
    (Neufert, *Architects' Data*).
    """
    width, depth = rng.uniform(1.0, 1.6), rng.uniform(0.60, 0.80)
    height = rng.uniform(0.72, 0.75)
    parts = (top_on(width, depth, height), *four_legs(width, depth, height - BOARD))
    return SceneObject("table", ORIGIN, parts)


def low_table(rng: np.random.Generator) -> SceneObject:
    """A coffee table, on four legs or with drawers down to the floor.

    .40-.45 high, the height of the seats around it (Panero and Zelnik 1979).
    """
    width, depth = rng.uniform(0.9, 1.2), rng.uniform(0.5, 0.6)
    height = rng.uniform(0.40, 0.45)
    top = top_on(width, depth, height)
    if rng.random() < 0.5:
        return SceneObject("table", ORIGIN, (top, *four_legs(width, depth, height - BOARD)))
    x, y = width / 2 - 0.04, depth / 2 - 0.04
    base = box("base", (-x, -y, 0.0), (x, y, height - BOARD))
    return SceneObject("table", ORIGIN, (top, base))


def desk(rng: np.random.Generator) -> SceneObject:
    """A desk: on four legs, on panels, or with a chest of drawers at one side.

    EN 527-1: .72-.76 high, at least 1.20 wide and .80 deep, though many at home are .60.
    """
    width, depth = rng.uniform(1.20, 1.80), rng.uniform(0.60, 0.80)
    height = rng.uniform(0.72, 0.76)
    x, y, below = width / 2, depth / 2, height - BOARD
    top = top_on(width, depth, height)
    style = rng.integers(3)
    if style == 0:
        return SceneObject("table", ORIGIN, (top, *four_legs(width, depth, below)))
    left, right = (
        box("side", (side * x, -y, 0.0), (side * (x - BOARD), y, below)) for side in (-1, 1)
    )
    screen = box("back", (BOARD - x, -y, 0.30), (x - BOARD, -y + BOARD, below))
    if style == 1:
        return SceneObject("table", ORIGIN, (top, left, right, screen))
    drawers = box("drawers", (x - 0.42, -y + 0.05, 0.0), (x, y, below))
    return SceneObject("table", ORIGIN, (top, left, drawers, screen))


def counter(rng: np.random.Generator) -> SceneObject:
    """A kitchen counter, closed down to the floor.

    .85-.95 high, .60 deep, in cupboards of .60 (EN 1116; Neufert, *Architects' Data*).
    """
    width, depth = 0.60 * float(rng.integers(2, 5)), 0.60
    height = rng.uniform(0.85, 0.95)
    x, y, thick = width / 2, depth / 2, 0.04
    top = box("top", (-x, -y, height - thick), (x, y, height))
    base = box("base", (-x, -y, 0.0), (x, y - 0.03, height - thick))
    return SceneObject("counter", ORIGIN, (top, base))


def knee_room(piece: SceneObject) -> tuple[float, float]:
    """The x, from and to, of the gap between the two things that carry a table's front edge."""
    front = piece.bounds[1, 1]
    carriers = [
        c for c in piece.cuboids if c.part != "top" and c.centre[1] + c.size[1] / 2 > front - 0.05
    ]
    left, right = sorted(carriers, key=lambda c: float(c.centre[0]))
    return float(left.centre[0] + left.size[0] / 2), float(right.centre[0] - right.size[0] / 2)
