"""Draws of recipes, and how bodies and furniture lie to each other in them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import SceneObject
from imapper_prob.models.skeleton import (
    LANK,
    LHIP,
    LKNE,
    PELV,
    RANK,
    RHIP,
    RKNE,
    THRX,
)
from imapper_prob.scenelets.procedural.body import Drawn, Person, Recipe, draw_person

__all__ = ["draws", "knee_flexion", "legs_apart", "spine_from_vertical", "surface", "within"]

Array = NDArray[np.float64]

LEGS = ((RHIP, RKNE, RANK), (LHIP, LKNE, LANK))


def draws(recipe: Recipe, count: int, *, person: Person | None = None) -> list[Drawn]:
    streams = [np.random.default_rng([5, i]) for i in range(count)]
    return [recipe(rng, person or draw_person(rng)) for rng in streams]


def surface(piece: SceneObject) -> tuple[Array, Array]:
    """Lower and upper corner of the seat in the object's frame."""
    seat = next(c for c in piece.cuboids if c.part == "seat")
    return seat.centre - seat.size / 2, seat.centre + seat.size / 2


def within(piece: SceneObject, points: Array) -> Array:
    """Points (..., 3) of the parent frame in the frame of the piece."""
    flat = (points[..., :2] - (piece.placement.x, piece.placement.y)) @ piece.placement.rotation
    return np.concatenate([flat, points[..., 2:]], -1)


def knee_flexion(joints: Array) -> Array:
    """(n, 2) degrees by which the right and the left knee are bent."""
    found = []
    for hip, knee, ankle in LEGS:
        thigh, shin = joints[:, knee] - joints[:, hip], joints[:, ankle] - joints[:, knee]
        size = np.linalg.norm(thigh, axis=-1) * np.linalg.norm(shin, axis=-1)
        found.append(np.degrees(np.arccos(np.clip((thigh * shin).sum(-1) / size, -1, 1))))
    return np.stack(found, -1)


def legs_apart(pose: Array) -> float:
    """Smallest distance in metres between the lines of the two legs of a pose (16, 3)."""
    weights = np.linspace(0, 1, 15)[:, None]
    sides = []
    for hip, knee, ankle in LEGS:
        a, b, c = pose[[hip, knee, ankle]]
        sides.append(np.concatenate([a + weights * (b - a), b + weights * (c - b)]))
    return float(np.linalg.norm(sides[0][:, None] - sides[1][None], axis=-1).min())


def spine_from_vertical(joints: Array) -> Array:
    """(n,) degrees."""
    spine = joints[:, THRX] - joints[:, PELV]
    return np.degrees(np.arccos(spine[:, 2] / np.linalg.norm(spine, axis=-1)))
