"""Errors of furniture against ground truth: the scores of the paper's table 1 and others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from shapely import MultiPoint, Polygon, unary_union

from imapper_prob.evaluate.truth import Outline, TruthInView
from imapper_prob.models.skeleton import PELV

__all__ = ["ObjectScore", "Pair", "object_scores", "pair_up", "yaw_error"]

Array = NDArray[np.float64]

_FOUND: Final = 1.0
"""Metres in top view within which a true object counts as found (the paper's value)."""

_WALKED: Final = 0.5
"""Metres around the true path within which the chance level places furniture."""
_THROWS: Final = 400
"""Random placements for a chance level, which is then accurate to .02."""

_APART: Final = 1e6
"""Cost that replaces the distance of two objects that may not be paired."""


@dataclass(frozen=True)
class Pair:
    """A true object and the predicted object it is paired with.

    Parameters
    ----------
    truth, found : Outline
    distance : float
        Distance between centres in top view, metres.
    yaw : float
        Angle between fronts, degrees; modulo half a turn if either object has no front.
    """

    truth: Outline
    found: Outline
    distance: float
    yaw: float

    @property
    def apart(self) -> float:
        """Distance between centres in 3D, metres."""
        return float(np.linalg.norm(self.truth.middle - self.found.middle))

    @property
    def near(self) -> bool:
        """Whether the true object counts as found."""
        return self.distance < _FOUND


@dataclass(frozen=True, eq=False)
class ObjectScore:
    """Scores of the furniture of one prediction against the used objects of one clip.

    Parameters
    ----------
    pairs : tuple of Pair
        Every true object that has a partner, at any distance.
    truths : tuple of Outline
        The used objects.
    predicted : int
        Number of predicted objects.
    chance : float
        Expected fraction of the true objects found if the predicted objects were placed at random
        along the true path.
    shared, covered : float
        Square metres of floor in the intersection, and in the union, of true and predicted
        footprints.
    """

    pairs: tuple[Pair, ...]
    truths: tuple[Outline, ...]
    predicted: int
    chance: float
    shared: float
    covered: float

    @property
    def true(self) -> int:
        """Number of used objects."""
        return len(self.truths)

    @property
    def distances(self) -> Array:
        """(n_pairs,) distances in metres."""
        return np.array([p.distance for p in self.pairs])

    @property
    def losses(self) -> Array:
        """(true,) distances to the partner in metres, capped at one metre, which is also the loss
        of a missed object. In the order of the truth."""
        losses = np.full(self.true, _FOUND)
        where = {id(o): k for k, o in enumerate(self.truths)}
        for pair in self.pairs:
            losses[where[id(pair.truth)]] = min(pair.distance, _FOUND)
        return losses

    @property
    def yaws(self) -> Array:
        """Angles in degrees between fronts or axes, of the objects that were found."""
        return np.array([p.yaw for p in self.pairs if p.near])

    @property
    def seat_yaws(self) -> Array:
        """Angles in degrees between fronts, modulo a full turn, of the seats that were found."""
        return np.array(
            [_turn(p) for p in self.pairs if p.near and p.truth.group == "seat"], dtype=float
        )

    @property
    def found(self) -> int:
        """Number of true objects whose partner is within a metre."""
        return sum(p.near for p in self.pairs)

    @property
    def spurious(self) -> int:
        """Number of predicted objects that do not match a true one."""
        return self.predicted - self.found

    @property
    def overlap(self) -> float:
        """Intersection over union of the two footprints in top view."""
        return self.shared / self.covered if self.covered else float("nan")


def object_scores(
    objects: Sequence[Outline], truth: TruthInView, rng: np.random.Generator
) -> ObjectScore:
    """Score predicted furniture against the used objects of a clip.

    Parameters
    ----------
    objects : sequence of Outline
    truth : TruthInView
    rng : numpy.random.Generator
        Used only for the chance level.

    Returns
    -------
    ObjectScore
    """
    true = truth.used_objects
    one = unary_union([o.hull for o in true])
    other = unary_union([o.hull for o in objects])
    return ObjectScore(
        pairs=pair_up(true, objects),
        truths=tuple(true),
        predicted=len(objects),
        chance=_chance(objects, truth, rng),
        shared=one.intersection(other).area,
        covered=one.union(other).area,
    )


def pair_up(true: Sequence[Outline], found: Sequence[Outline]) -> tuple[Pair, ...]:
    """Pair true and predicted objects of equal groups so that the sum of distances is least.

    Parameters
    ----------
    true, found : sequence of Outline

    Returns
    -------
    tuple of Pair
    """
    if not true or not found:
        return ()
    distance = _distances([o.centre for o in true], [o.centre for o in found])
    other = np.array([[t.group != f.group for f in found] for t in true])
    rows, columns = linear_sum_assignment(np.where(other, _APART, distance))
    return tuple(
        Pair(true[i], found[j], float(distance[i, j]), yaw_error(true[i], found[j]))
        for i, j in zip(rows, columns, strict=True)
        if not other[i, j]
    )


def yaw_error(true: Outline, found: Outline) -> float:
    """Angle in degrees between two fronts; between axes if either object has no front.

    Parameters
    ----------
    true, found : Outline

    Returns
    -------
    float
    """
    angle = abs((np.degrees(found.yaw - true.yaw) + 180) % 360 - 180)
    return float(angle if true.has_front and found.has_front else min(angle, 180 - angle))


def _turn(pair: Pair) -> float:
    return float(abs((np.degrees(pair.found.yaw - pair.truth.yaw) + 180) % 360 - 180))


def _distances(true: Sequence[Array], found: Sequence[Array]) -> Array:
    gap = np.array(true)[:, None] - np.array(found)[None]
    distance: Array = np.linalg.norm(gap, axis=-1)
    return distance


def _chance(objects: Sequence[Outline], truth: TruthInView, rng: np.random.Generator) -> float:
    """Fraction of true objects found by equally many objects of the same labels at random
    positions."""
    true = truth.used_objects
    path = truth.joints[truth.known, PELV, :2]
    if not true or not len(path):
        return float("nan")
    if not objects:
        return 0.0
    floor = MultiPoint(path).convex_hull.buffer(_WALKED)
    places = _points_in(floor, _THROWS * len(objects), rng).reshape(_THROWS, len(objects), 2)
    other = np.array([[t.group != o.group for o in objects] for t in true])
    centres = [t.centre for t in true]
    hits = 0
    for thrown in places:
        cost = np.where(other, _APART, _distances(centres, list(thrown)))
        rows, columns = linear_sum_assignment(cost)
        hits += int((cost[rows, columns] < _FOUND).sum())
    return hits / (_THROWS * len(true))


def _points_in(area: Polygon, count: int, rng: np.random.Generator) -> Array:
    """(count, 2) points, uniformly distributed over an area."""
    from shapely import contains_xy

    low_x, low_y, high_x, high_y = area.bounds
    kept: list[Array] = []
    while sum(map(len, kept)) < count:
        points = rng.uniform((low_x, low_y), (high_x, high_y), (count, 2))
        kept.append(points[contains_xy(area, points[:, 0], points[:, 1])])
    return np.concatenate(kept)[:count]
