"""What several pieces of furniture are made of."""

from __future__ import annotations

from typing import Final

import numpy as np

from imapper_prob.models.scene import Cuboid, Placement

__all__ = ["BOARD", "LEG", "ORIGIN", "box", "four_legs", "top_on"]

ORIGIN: Final = Placement(0.0, 0.0, 0.0)

LEG: Final = 0.04
"""Side in metres of a wooden leg."""

BOARD: Final = 0.025
"""Thickness in metres of table tops, shelves and panels: the common chipboard."""


def box(
    part: str, corner: tuple[float, float, float], opposite: tuple[float, float, float]
) -> Cuboid:
    """A cuboid between two opposite corners, in any order."""
    a, b = np.array(corner), np.array(opposite)
    return Cuboid(part, (a + b) / 2, abs(b - a))


def four_legs(width: float, depth: float, height: float) -> tuple[Cuboid, ...]:
    """Legs at the corners of a rectangle, from the floor up to ``height``."""
    x, y = width / 2, depth / 2
    return tuple(
        box("leg", (sx * x, sy * y, 0.0), (sx * (x - LEG), sy * (y - LEG), height))
        for sx in (-1, 1)
        for sy in (-1, 1)
    )


def top_on(width: float, depth: float, height: float) -> Cuboid:
    """A table top whose upper face is at ``height``."""
    return box("top", (-width / 2, -depth / 2, height - BOARD), (width / 2, depth / 2, height))
