"""How far apart two scenes are: what it costs to turn one set of objects into the other.

Objects are moved, turned or renamed where that is cheap, and taken away or put there where it is
not: optimal transport of unit masses with a price for those that are left over, with the optimal
pairing in place of a plan. With squared costs this is the generalised optimal sub-pattern
assignment metric (Rahmathullah, Garcia-Fernandez & Svensson 2017, alpha = 2): a metric, in
metres, that is 1 for one object too many and grows with the number of differences.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from imapper_prob.models.scene import SceneObject
from imapper_prob.sampling.layouts import SEATS

__all__ = ["Pairing", "group_of", "object_distance", "pair_objects"]

Array = NDArray[np.float64]

_LEFT_OVER: Final = 1.0
"""Metres: what an object without a partner costs; the unit of the distance."""
_RENAMED: Final = 0.5
"""Metres: another label of the same group. Which seat it is, is hardly in the data."""
_TURNED: Final = 0.3
"""Metres a radian, so that a seat turned round is nearly another seat."""
_LOOKS_ALIKE: Final = {"table": 2, "stool": 4}
"""In how many orientations a thing looks the same; most have a front."""


@dataclass(frozen=True)
class Pairing:
    """The cheapest way to turn one set of objects into another.

    Parameters
    ----------
    pairs : tuple of (int, int)
        Objects of the first and of the second set that are one.
    only_first, only_second : tuple of int
        Those without a partner.
    distance : float
        Metres.
    """

    pairs: tuple[tuple[int, int], ...]
    only_first: tuple[int, ...]
    only_second: tuple[int, ...]
    distance: float


def group_of(label: str) -> str:
    """The group of labels that stand for each other: any seat for another, else its own."""
    return "seat" if label in SEATS else label


def object_distance(first: SceneObject, second: SceneObject) -> float:
    """Metres between two objects on the floor; infinite between groups."""
    if group_of(first.label) != group_of(second.label):
        return float("inf")
    away = np.hypot(*(first.centre - second.centre)[:2])
    renamed = _RENAMED if first.label != second.label else 0.0
    return float(np.sqrt(away**2 + renamed**2 + (_TURNED * turn(first, second)) ** 2))


def turn(first: SceneObject, second: SceneObject) -> float:
    """Radians from 0 to pi between two orientations, those that look alike being one."""
    fold = 2 * np.pi / max(_LOOKS_ALIKE.get(o.label, 1) for o in (first, second))
    angle = (second.placement.yaw - first.placement.yaw) % fold
    return float(min(angle, fold - angle))


def pair_objects(first: Sequence[SceneObject], second: Sequence[SceneObject]) -> Pairing:
    """Pair two sets of objects so that the distance is least."""
    dearest = 2 * _LEFT_OVER**2  # two left over cost as much as the dearest pair
    cost = np.array([[min(object_distance(a, b) ** 2, dearest) for b in second] for a in first])
    cost = cost.reshape(len(first), len(second))
    rows, columns = linear_sum_assignment(cost)
    kept = cost[rows, columns] < dearest
    pairs = tuple(zip(rows[kept].tolist(), columns[kept].tolist(), strict=True))
    alone = (
        tuple(sorted(set(range(len(first))) - {i for i, _ in pairs})),
        tuple(sorted(set(range(len(second))) - {j for _, j in pairs})),
    )
    left = _LEFT_OVER**2 * (len(alone[0]) + len(alone[1]))
    return Pairing(pairs, *alone, float(np.sqrt(cost[rows, columns][kept].sum() + left)))
