"""Furniture as unions of cuboids, with the sizes people live with.

Every piece stands on the floor with its origin below the middle of its bounding box in top
view and its front towards +y. All lengths are metres. Ranges of sizes are those of the
furniture annotated in i3DB (seats .40-.48 high, couches about 2.4 x .8, tables about
1.2 x .6, bookshelves 1.4-2.25 high); what it does not hold (armrests, low tables, depths of
seats) follows Panero and Zelnik, *Human Dimension and Interior Space* (1979).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from imapper_prob.models.scene import Cuboid, Placement, SceneObject

__all__ = [
    "ORIGIN",
    "chair",
    "couch",
    "couch_place",
    "low_table",
    "seat_front",
    "seat_height",
    "shelf",
    "stool",
    "table",
]

ORIGIN: Final = Placement(0.0, 0.0, 0.0)

LEG: Final = 0.04
"""Side of a wooden leg."""

BOARD: Final = 0.025
"""Thickness of table tops and shelves."""


def _box(part: str, *corners: tuple[float, float, float]) -> Cuboid:
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    return Cuboid(part, (low + high) / 2, high - low)


def _legs(width: float, depth: float, height: float) -> tuple[Cuboid, ...]:
    x, y = width / 2, depth / 2
    return tuple(
        _box("leg", (sx * x, sy * y, 0.0), (sx * (x - LEG), sy * (y - LEG), height))
        for sx in (-1, 1)
        for sy in (-1, 1)
    )


def chair(rng: np.random.Generator, *, arms: bool) -> SceneObject:
    """A chair with four legs and a back, with or without armrests."""
    width = rng.uniform(0.52, 0.60) if arms else rng.uniform(0.42, 0.48)
    depth, height = rng.uniform(0.44, 0.52), rng.uniform(0.42, 0.48)
    back = rng.uniform(0.80, 0.95)
    x, y = width / 2, depth / 2
    parts = [
        _box("seat", (-x, -y, height - 0.05), (x, y, height)),
        _box("back", (-x, -y, height), (x, -y + LEG, back)),
        *_legs(width, depth, height - 0.05),
    ]
    if arms:
        rest = height + rng.uniform(0.18, 0.24)
        parts += [
            _box("arm", (side * x, -y + LEG, height), (side * (x - 0.05), 0.7 * y, rest))
            for side in (-1, 1)
        ]
    return SceneObject("chair", ORIGIN, tuple(parts))


def stool(rng: np.random.Generator) -> SceneObject:
    """A seat on four legs."""
    side, height = rng.uniform(0.34, 0.42), rng.uniform(0.43, 0.50)
    seat = _box("seat", (-side / 2, -side / 2, height - 0.05), (side / 2, side / 2, height))
    return SceneObject("stool", ORIGIN, (seat, *_legs(side, side, height - 0.05)))


def couch(rng: np.random.Generator, *, seats: int) -> SceneObject:
    """An armchair (one seat) or a couch, upholstered down to the floor."""
    cushion, arm = rng.uniform(0.62, 0.72), rng.uniform(0.12, 0.18)
    depth, height = rng.uniform(0.80, 0.92), rng.uniform(0.40, 0.45)
    back, rest = rng.uniform(0.76, 0.90), rng.uniform(0.56, 0.62)
    x, y = seats * cushion / 2, depth / 2
    thick = rng.uniform(0.18, 0.24)
    return SceneObject(
        "couch",
        ORIGIN,
        (
            _box("seat", (-x, -y + thick, 0.0), (x, y, height)),
            _box("back", (-x, -y, 0.0), (x, -y + thick, back)),
            _box("arm", (-x - arm, -y, 0.0), (-x, y, rest)),
            _box("arm", (x, -y, 0.0), (x + arm, y, rest)),
        ),
    )


def couch_place(piece: SceneObject, *, seats: int, place: int) -> float:
    """Sideways position of the middle of one of a couch's seats, counted from the left (-x)."""
    seat = _part(piece, "seat")
    return float((place + 0.5) / seats * seat.size[0] - seat.size[0] / 2)


def table(rng: np.random.Generator) -> SceneObject:
    """A table to sit or stand at."""
    width, depth = rng.uniform(1.0, 1.6), rng.uniform(0.60, 0.80)
    return _flat_top(width, depth, rng.uniform(0.72, 0.75))


def low_table(rng: np.random.Generator) -> SceneObject:
    """A coffee table, on four legs or with drawers down to the floor."""
    width, depth = rng.uniform(0.9, 1.2), rng.uniform(0.5, 0.6)
    height = rng.uniform(0.40, 0.45)
    if rng.random() < 0.5:
        return _flat_top(width, depth, height)
    x, y = width / 2, depth / 2
    top = _box("top", (-x, -y, height - BOARD), (x, y, height))
    inset = 0.04
    base = _box("base", (inset - x, inset - y, 0.0), (x - inset, y - inset, height - BOARD))
    return SceneObject("table", ORIGIN, (top, base))


def _flat_top(width: float, depth: float, height: float) -> SceneObject:
    x, y = width / 2, depth / 2
    top = _box("top", (-x, -y, height - BOARD), (x, y, height))
    return SceneObject("table", ORIGIN, (top, *_legs(width, depth, height - BOARD)))


def shelf(rng: np.random.Generator) -> SceneObject:
    """A bookshelf: sides, a back and boards, open to the front."""
    width, depth = rng.uniform(0.8, 1.2), rng.uniform(0.28, 0.38)
    height = rng.uniform(1.40, 2.25)
    x, y = width / 2, depth / 2
    levels = np.linspace(BOARD, height, round(height / 0.36) + 1)
    return SceneObject(
        "shelf",
        ORIGIN,
        (
            _box("side", (-x, -y, 0.0), (-x + BOARD, y, height)),
            _box("side", (x - BOARD, -y, 0.0), (x, y, height)),
            _box("back", (-x, -y, 0.0), (x, -y + BOARD, height)),
            *(
                _box("board", (-x + BOARD, -y + BOARD, z - BOARD), (x - BOARD, y, z))
                for z in levels
            ),
        ),
    )


def _part(piece: SceneObject, part: str) -> Cuboid:
    return next(c for c in piece.cuboids if c.part == part)


def seat_height(piece: SceneObject) -> float:
    """Height of the surface one sits on."""
    seat = _part(piece, "seat")
    return float(seat.centre[2] + seat.size[2] / 2)


def seat_front(piece: SceneObject) -> float:
    """The y of the front edge of the seat."""
    seat = _part(piece, "seat")
    return float(seat.centre[1] + seat.size[1] / 2)
