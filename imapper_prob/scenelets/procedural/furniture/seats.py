"""What one sits or lies on. The part ``seat`` is the surface that carries the body."""

from __future__ import annotations

import numpy as np

from imapper_prob.models.scene import Cuboid, SceneObject
from imapper_prob.scenelets.procedural.furniture.parts import BOARD, LEG, ORIGIN, box, four_legs

__all__ = ["bed", "bench", "chair", "couch", "office_chair", "stool"]


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
    """
    width = rng.uniform(0.52, 0.60) if arms else rng.uniform(0.42, 0.48)
    depth, height = rng.uniform(0.44, 0.52), rng.uniform(0.42, 0.48)
    x, y = width / 2, depth / 2
    parts = [
        box("seat", (-x, -y, height - 0.05), (x, y, height)),
        box("back", (-x, -y, height), (x, -y + LEG, rng.uniform(0.80, 0.95))),
        *four_legs(width, depth, height - 0.05),
    ]
    if arms:
        rest = height + rng.uniform(0.18, 0.24)
        parts += _armrests(x, back=-y + LEG, front=0.7 * y, seat=height, rest=rest)
    return SceneObject("chair", ORIGIN, tuple(parts))


def office_chair(rng: np.random.Generator) -> SceneObject:
    """A swivel chair: a column on a star of castors, mostly with armrests.

    EN 1335-1: seat .42-.51 high, at least .40 wide, armrests .20-.25 above it. The star is
    a flat box of the area that five spokes of .32 m cover.
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
    """A square seat on four legs, .43-.50 high (Neufert, *Architects' Data*)."""
    side, height = rng.uniform(0.34, 0.42), rng.uniform(0.43, 0.50)
    seat = box("seat", (-side / 2, -side / 2, height - 0.05), (side / 2, side / 2, height))
    return SceneObject("stool", ORIGIN, (seat, *four_legs(side, side, height - 0.05)))


def bench(rng: np.random.Generator) -> SceneObject:
    """A bench on two panels, with or without a back.

    Seat .42-.47 high and .36-.44 deep, .90-1.50 long: for two or three at the .60 m each
    that Neufert gives a diner.
    """
    width, depth = rng.uniform(0.90, 1.50), rng.uniform(0.36, 0.44)
    height = rng.uniform(0.42, 0.47)
    x, y = width / 2, depth / 2
    parts = [
        box("seat", (-x, -y, height - LEG), (x, y, height)),
        *(
            box("leg", (side * (x - 0.05), -y, 0.0), (side * (x - 0.05 - LEG), y, height - LEG))
            for side in (-1, 1)
        ),
    ]
    if rng.random() < 0.4:
        parts.append(box("back", (-x, -y, height), (x, -y + BOARD, rng.uniform(0.78, 0.90))))
    return SceneObject("bench", ORIGIN, tuple(parts))


def couch(rng: np.random.Generator, *, seats: int) -> SceneObject:
    """An armchair (one seat) or a couch, upholstered down to the floor.

    Overall .80 deep and .40-.45 high as annotated in i3DB; .62-.72 of width a seat, arms of
    .12-.18 after Panero and Zelnik (1979).
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
    legs = four_legs(width, length + board, height - 0.30)
    return SceneObject("bed", ORIGIN, (headboard, seat, *legs))
