"""Furniture as unions of cuboids with common sizes: seats, beds, tables and storage.

Every object stands on the floor, with its origin below the middle of its bounding box and its front
towards +y: people leave a seat towards +y, use a table or shelf from there, and a bed's foot end
points there. All lengths are metres; each piece names the source of its sizes.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from imapper_prob.models.scene import Cuboid, Placement, SceneObject

__all__ = [
    "ORIGIN",
    "bed",
    "bench",
    "box",
    "chair",
    "couch",
    "counter",
    "desk",
    "facing_back",
    "knee_room",
    "low_table",
    "office_chair",
    "seat_part",
    "shelf",
    "stool",
    "table",
]

ORIGIN: Final = Placement(0.0, 0.0, 0.0)
_LEG: Final = 0.04
"""Side of a wooden leg, metres."""
_BOARD: Final = 0.025
"""Thickness of table tops, shelves and panels of chipboard, metres."""


def box(
    part: str, corner: tuple[float, float, float], opposite: tuple[float, float, float]
) -> Cuboid:
    """A cuboid from two opposite corners, in any order.

    Parameters
    ----------
    part : str
    corner : (float, float, float)
        Metres.
    opposite : (float, float, float)
        Metres.

    Returns
    -------
    Cuboid
    """
    a, b = np.array(corner), np.array(opposite)
    return Cuboid(part, (a + b) / 2, abs(b - a))


def _four_legs(width: float, depth: float, height: float) -> tuple[Cuboid, ...]:
    """Legs at the corners of a rectangle, from the floor up to ``height``."""
    x, y = width / 2, depth / 2
    return tuple(
        box("leg", (sx * x, sy * y, 0.0), (sx * (x - _LEG), sy * (y - _LEG), height))
        for sx in (-1, 1)
        for sy in (-1, 1)
    )


def _top_on(width: float, depth: float, height: float) -> Cuboid:
    """A table top whose upper face is at ``height``."""
    return box("top", (-width / 2, -depth / 2, height - _BOARD), (width / 2, depth / 2, height))


# ------------------------------------------------------------------------------------------------
# Seats and beds. The part ``seat`` is the surface that supports the body.


def _armrests(
    half_width: float, *, back: float, front: float, seat: float, rest: float
) -> tuple[Cuboid, Cuboid]:
    """Two rests 5 cm wide between ``back`` and ``front`` (y), from the seat up to ``rest``."""
    left, right = (
        box("arm", (side * half_width, back, seat), (side * (half_width - 0.05), front, rest))
        for side in (-1, 1)
    )
    return left, right


def chair(rng: np.random.Generator, *, arms: bool) -> SceneObject:
    """A chair on four legs with a back, with or without armrests.

    Seat .42-.48 high and back to .95 as annotated in i3DB; armrests .18-.24 above the seat
    and depths after Panero and Zelnik, *Human Dimension and Interior Space* (1979).

    Parameters
    ----------
    rng : numpy.random.Generator
    arms : bool
        Whether it has armrests.

    Returns
    -------
    SceneObject
    """
    width = rng.uniform(0.52, 0.60) if arms else rng.uniform(0.42, 0.48)
    depth, height = rng.uniform(0.44, 0.52), rng.uniform(0.42, 0.48)
    x, y = width / 2, depth / 2
    parts = [
        box("seat", (-x, -y, height - 0.05), (x, y, height)),
        box("back", (-x, -y, height), (x, -y + _LEG, rng.uniform(0.80, 0.95))),
        *_four_legs(width, depth, height - 0.05),
    ]
    if arms:
        rest = height + rng.uniform(0.18, 0.24)
        parts += _armrests(x, back=-y + _LEG, front=0.7 * y, seat=height, rest=rest)
    return SceneObject("chair", ORIGIN, tuple(parts))


def office_chair(rng: np.random.Generator) -> SceneObject:
    """A swivel chair: a column on a star of castors, mostly with armrests.

    EN 1335-1: seat .42-.51 high, at least .40 wide, armrests .20-.25 above it. The star is
    a flat box of the area that five spokes of .32 m cover.

    Parameters
    ----------
    rng : numpy.random.Generator

    Returns
    -------
    SceneObject
    """
    width, depth = rng.uniform(0.46, 0.52), rng.uniform(0.44, 0.48)
    height, back = rng.uniform(0.42, 0.51), rng.uniform(0.90, 1.10)
    x, y = width / 2, depth / 2
    star, pole = 0.22, 0.03
    parts = [
        box("seat", (-x, -y, height - 0.08), (x, y, height)),
        box("back", (-x, -y, height), (x, -y + 0.06, back)),
        box("column", (-pole, -pole, 0.08), (pole, pole, height - 0.08)),
        box("base", (-star, -star, 0.0), (star, star, 0.08)),
    ]
    if rng.random() < 0.7:
        rest = height + rng.uniform(0.20, 0.25)
        parts += _armrests(x + 0.05, back=-0.6 * y, front=0.6 * y, seat=height, rest=rest)
    return SceneObject("chair", ORIGIN, tuple(parts))


def stool(rng: np.random.Generator) -> SceneObject:
    """A square seat on four legs, .43-.50 high (Neufert, *Architects' Data*).

    Parameters
    ----------
    rng : numpy.random.Generator

    Returns
    -------
    SceneObject
    """
    side, height = rng.uniform(0.34, 0.42), rng.uniform(0.43, 0.50)
    seat = box("seat", (-side / 2, -side / 2, height - 0.05), (side / 2, side / 2, height))
    return SceneObject("stool", ORIGIN, (seat, *_four_legs(side, side, height - 0.05)))


def bench(rng: np.random.Generator) -> SceneObject:
    """A bench on two panels, with or without a back.

    Seat .42-.47 high and .36-.44 deep, .90-1.50 long: for two or three at the .60 m each
    that Neufert gives a diner.

    Parameters
    ----------
    rng : numpy.random.Generator

    Returns
    -------
    SceneObject
    """
    width, depth = rng.uniform(0.90, 1.50), rng.uniform(0.36, 0.44)
    height = rng.uniform(0.42, 0.47)
    x, y = width / 2, depth / 2
    parts = [
        box("seat", (-x, -y, height - _LEG), (x, y, height)),
        *(
            box("leg", (side * (x - 0.05), -y, 0.0), (side * (x - 0.05 - _LEG), y, height - _LEG))
            for side in (-1, 1)
        ),
    ]
    if rng.random() < 0.4:
        parts.append(box("back", (-x, -y, height), (x, -y + _BOARD, rng.uniform(0.78, 0.90))))
    return SceneObject("bench", ORIGIN, tuple(parts))


def couch(rng: np.random.Generator, *, seats: int) -> SceneObject:
    """An armchair (one seat) or a couch, upholstered down to the floor.

    Overall .80 deep and .40-.45 high as annotated in i3DB; .62-.72 of width a seat, arms of
    .12-.18 after Panero and Zelnik (1979).

    Parameters
    ----------
    rng : numpy.random.Generator
    seats : int

    Returns
    -------
    SceneObject
    """
    cushion, arm = rng.uniform(0.62, 0.72), rng.uniform(0.12, 0.18)
    depth, height = rng.uniform(0.80, 0.92), rng.uniform(0.40, 0.45)
    back, rest = rng.uniform(0.76, 0.90), rng.uniform(0.56, 0.62)
    x, y = seats * cushion / 2, depth / 2
    thick = rng.uniform(0.18, 0.24)
    return SceneObject(
        "couch",
        ORIGIN,
        (
            box("seat", (-x, -y + thick, 0.0), (x, y, height)),
            box("back", (-x, -y, 0.0), (x, -y + thick, back)),
            box("arm", (-x - arm, -y, 0.0), (-x, y, rest)),
            box("arm", (x, -y, 0.0), (x + arm, y, rest)),
        ),
    )


def bed(rng: np.random.Generator) -> SceneObject:
    """A bed with its headboard at -y, on legs or on a box.

    Mattresses of the usual sizes, .90-1.80 by 1.90-2.00, their tops .40-.55 above the floor
    (Neufert, *Architects' Data*).

    Parameters
    ----------
    rng : numpy.random.Generator

    Returns
    -------
    SceneObject
    """
    width = float(rng.choice([0.90, 1.20, 1.40, 1.60, 1.80]))
    length = float(rng.choice([1.90, 2.00]))
    height, board = rng.uniform(0.40, 0.55), rng.uniform(0.03, 0.05)
    x, y = width / 2, (length + board) / 2
    headboard = box("headboard", (-x, -y, 0.0), (x, -y + board, rng.uniform(0.85, 1.10)))
    if rng.random() < 0.5:
        seat = box("seat", (-x, -y + board, 0.0), (x, y, height))
        return SceneObject("bed", ORIGIN, (headboard, seat))
    seat = box("seat", (-x, -y + board, height - 0.30), (x, y, height))  # frame and mattress
    legs = _four_legs(width, length + board, height - 0.30)
    return SceneObject("bed", ORIGIN, (headboard, seat, *legs))


# ------------------------------------------------------------------------------------------------
# Storage.


def shelf(rng: np.random.Generator) -> SceneObject:
    """A bookshelf: sides, a back and boards, open to the front.

    1.40-2.25 high as annotated in i3DB; boards .36 apart, .28-.38 deep, for folders and
    tall books (Neufert, *Architects' Data*).

    Parameters
    ----------
    rng : numpy.random.Generator

    Returns
    -------
    SceneObject
    """
    width, depth = rng.uniform(0.8, 1.2), rng.uniform(0.28, 0.38)
    height = rng.uniform(1.40, 2.25)
    x, y = width / 2, depth / 2
    levels = np.linspace(_BOARD, height, round(height / 0.36) + 1)
    return SceneObject(
        "shelf",
        ORIGIN,
        (
            box("side", (-x, -y, 0.0), (-x + _BOARD, y, height)),
            box("side", (x - _BOARD, -y, 0.0), (x, y, height)),
            box("back", (-x, -y, 0.0), (x, -y + _BOARD, height)),
            *(
                box("board", (-x + _BOARD, -y + _BOARD, z - _BOARD), (x - _BOARD, y, z))
                for z in levels
            ),
        ),
    )


# ------------------------------------------------------------------------------------------------
# Tables and counters.


def table(rng: np.random.Generator) -> SceneObject:
    """A table on four legs to sit or stand at.

    .72-.75 high; 1.2 by .6 is what is annotated in i3DB, up to 1.6 by .8 for six diners
    (Neufert, *Architects' Data*).

    Parameters
    ----------
    rng : numpy.random.Generator

    Returns
    -------
    SceneObject
    """
    width, depth = rng.uniform(1.0, 1.6), rng.uniform(0.60, 0.80)
    height = rng.uniform(0.72, 0.75)
    parts = (_top_on(width, depth, height), *_four_legs(width, depth, height - _BOARD))
    return SceneObject("table", ORIGIN, parts)


def low_table(rng: np.random.Generator) -> SceneObject:
    """A coffee table, on four legs or with drawers down to the floor.

    .40-.45 high, the height of the seats around it (Panero and Zelnik 1979).

    Parameters
    ----------
    rng : numpy.random.Generator

    Returns
    -------
    SceneObject
    """
    width, depth = rng.uniform(0.9, 1.2), rng.uniform(0.5, 0.6)
    height = rng.uniform(0.40, 0.45)
    top = _top_on(width, depth, height)
    if rng.random() < 0.5:
        return SceneObject("table", ORIGIN, (top, *_four_legs(width, depth, height - _BOARD)))
    x, y = width / 2 - 0.04, depth / 2 - 0.04
    base = box("base", (-x, -y, 0.0), (x, y, height - _BOARD))
    return SceneObject("table", ORIGIN, (top, base))


def desk(rng: np.random.Generator) -> SceneObject:
    """A desk: on four legs, on panels, or with a chest of drawers at one side.

    EN 527-1: .72-.76 high, at least 1.20 wide and .80 deep, though many at home are .60.

    Parameters
    ----------
    rng : numpy.random.Generator

    Returns
    -------
    SceneObject
    """
    width, depth = rng.uniform(1.20, 1.80), rng.uniform(0.60, 0.80)
    height = rng.uniform(0.72, 0.76)
    x, y, below = width / 2, depth / 2, height - _BOARD
    top = _top_on(width, depth, height)
    style = rng.integers(3)
    if style == 0:
        return SceneObject("table", ORIGIN, (top, *_four_legs(width, depth, below)))
    left, right = (
        box("side", (side * x, -y, 0.0), (side * (x - _BOARD), y, below)) for side in (-1, 1)
    )
    screen = box("back", (_BOARD - x, -y, 0.30), (x - _BOARD, -y + _BOARD, below))
    if style == 1:
        return SceneObject("table", ORIGIN, (top, left, right, screen))
    drawers = box("drawers", (x - 0.42, -y + 0.05, 0.0), (x, y, below))
    return SceneObject("table", ORIGIN, (top, left, drawers, screen))


def counter(rng: np.random.Generator) -> SceneObject:
    """A kitchen counter, closed down to the floor.

    .85-.95 high, .60 deep, in cupboards of .60 (EN 1116; Neufert, *Architects' Data*).

    Parameters
    ----------
    rng : numpy.random.Generator

    Returns
    -------
    SceneObject
    """
    width, depth = 0.60 * float(rng.integers(2, 5)), 0.60
    height = rng.uniform(0.85, 0.95)
    x, y, thick = width / 2, depth / 2, 0.04
    top = box("top", (-x, -y, height - thick), (x, y, height))
    base = box("base", (-x, -y, 0.0), (x, y - 0.03, height - thick))
    return SceneObject("counter", ORIGIN, (top, base))


def seat_part(piece: SceneObject) -> Cuboid:
    """The part of a piece of furniture that carries a person who sits or lies on it.

    Parameters
    ----------
    piece : SceneObject
        Has a part named ``seat``.

    Returns
    -------
    Cuboid
    """
    return next(c for c in piece.cuboids if c.part == "seat")


def facing_back(piece: SceneObject, x: float, *, edge: float) -> SceneObject:
    """A piece of furniture placed in front of a person at the origin, facing that person.

    Parameters
    ----------
    piece : SceneObject
    x : float
        The x of its middle, metres.
    edge : float
        The y of its front edge, metres.

    Returns
    -------
    SceneObject
    """
    return piece.moved(Placement(x, edge + piece.bounds[1, 1], np.pi))


def knee_room(piece: SceneObject) -> tuple[float, float]:
    """Lower and upper end in x of the gap between the two supports at a table's front edge.

    Parameters
    ----------
    piece : SceneObject

    Returns
    -------
    float, float
        Metres.
    """
    front = piece.bounds[1, 1]
    carriers = [
        c for c in piece.cuboids if c.part != "top" and c.centre[1] + c.size[1] / 2 > front - 0.05
    ]
    left, right = sorted(carriers, key=lambda c: float(c.centre[0]))
    return float(left.centre[0] + left.size[0] / 2), float(right.centre[0] - right.size[0] / 2)
