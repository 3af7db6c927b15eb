"""Layouts: which objects a draw has, which draws agree, and how far apart scenes are.

Chains group their draws in processes of their own, which start in half the time where nothing has
to load torch; so this module imports nothing that does.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import networkx as nx
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from shapely import Polygon

from imapper_prob.models.log_posterior import State, log_posterior
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import FRONTLESS, Placement, SceneObject
from imapper_prob.models.scenelet import Library

__all__ = [
    "SEATS",
    "Layouts",
    "furniture_kinds",
    "group_layouts",
    "group_of",
    "match_objects",
    "merged_objects",
    "object_distance",
    "pair_objects",
    "placed_objects",
    "representatives",
    "same_objects",
    "through_one_lens",
]


def furniture_kinds(problem: Problem) -> tuple[tuple[int, ...], ...]:
    """The sorted categories of each scenelet's objects.

    Parameters
    ----------
    problem : Problem

    Returns
    -------
    tuple of tuple of int
        By scenelet, numbers of categories.
    """
    kinds = []
    for first, last in zip(problem.box_first[:-1], problem.box_first[1:], strict=True):
        label_of = dict(
            zip(
                problem.box_object[first:last].tolist(),
                problem.box_label[first:last].tolist(),
                strict=True,
            )
        )
        kinds.append(tuple(sorted(label_of.values())))
    return tuple(kinds)


# ------------------------------------------------------------------------------------------------
# From draws to layouts.

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
SEATS: Final = frozenset({"armchair", "bench", "chair", "couch", "sofa", "stool"})
"""What one sits on. Motion hardly tells one from another."""
_SHARED: Final = 0.5
"""Part of the smaller footprint that two must share to be one whichever way they are turned: what
stands half in another is no other, and what only stands too near is."""


def merged_objects(problem: Problem, library: Library, state: State) -> tuple[SceneObject, ...]:
    """The furniture of a state in its world, objects that are one merged.

    Objects of the same label whose footprints overlap and whose orientation, if they have a front,
    agrees within the model's merge angle are the same object met twice. So are those that share
    half of the smaller footprint, if they are of one label or seats, whatever each scenelet calls
    them. Of each such group the one is kept whose scenelet improves the scene most.

    Parameters
    ----------
    problem : Problem
    library : Library
    state : State

    Returns
    -------
    tuple of SceneObject
    """
    placed = placed_objects(state, library)
    groups = same_objects(placed, problem.merge_angle)
    return tuple(placed[k][1] for k in sorted(representatives(problem, state, placed, groups)))


def representatives(
    problem: Problem,
    state: State,
    placed: Sequence[tuple[int, SceneObject]],
    groups: Sequence[Sequence[int]],
) -> list[int]:
    """Of each group of objects that are one, that whose scenelet improves the scene most.

    Parameters
    ----------
    problem : Problem
    state : State
    placed : sequence of (int, SceneObject)
        See :func:`placed_objects`.
    groups : sequence of sequence of int
        See :func:`same_objects`.

    Returns
    -------
    list of int
        Indices in ``placed``.
    """

    def rest(k: int) -> float:
        return log_posterior(problem, state.without_item(placed[k][0]))

    return [min(group, key=rest) if len(group) > 1 else group[0] for group in groups]


def placed_objects(
    state: State, library: Library, *, only: Iterable[tuple[int, int]] | None = None
) -> list[tuple[int, SceneObject]]:
    """Each scenelet's objects in the world, with the index of the item that brings them.

    Parameters
    ----------
    state : State
    library : Library
    only : iterable of (int, int), optional
        Indices of items, and which of their objects; all if not given.

    Returns
    -------
    list of (int, SceneObject)
    """
    bodies = np.exp(state.camera[3] + state.sizes).tolist()
    placements = [Placement(*placement) for placement in state.placements.tolist()]
    objects = [library[scenelet].objects for scenelet in state.items[:, 0].tolist()]
    if only is None:
        only = [(index, k) for index, own in enumerate(objects) for k in range(len(own))]
    return [(i, objects[i][k].scaled(bodies[i]).moved(placements[i])) for i, k in only]


def same_objects(placed: Sequence[tuple[int, SceneObject]], angle: float) -> list[list[int]]:
    """Which of :func:`placed_objects` are one: groups of their indices, each in order.

    Same label, orientations within ``angle`` radians if it has a front, and footprints that
    overlap; or footprints that share half of the smaller one, of the same label or of seats of any.

    Parameters
    ----------
    placed : sequence of (int, SceneObject)
        See :func:`placed_objects`.
    angle : float
        Radians.

    Returns
    -------
    list of list of int
    """
    graph = nx.Graph()
    graph.add_nodes_from(range(len(placed)))
    outlines = [Polygon(o.footprint) for _, o in placed]
    for a, (item_a, first) in enumerate(placed):
        for b, (item_b, second) in enumerate(placed[:a]):
            turned = np.cos(first.placement.yaw - second.placement.yaw) <= np.cos(angle)
            alike = first.label == second.label
            if alike and (first.label in FRONTLESS or not turned):
                one = outlines[a].intersects(outlines[b])
            else:
                seats = {first.label, second.label} <= SEATS
                one = (alike or seats) and _shared(outlines[a], outlines[b]) > _SHARED
            if one and item_a != item_b:
                graph.add_edge(a, b)
    return [sorted(group) for group in nx.connected_components(graph)]


def _shared(first: Polygon, second: Polygon) -> float:
    """Part of the smaller of two outlines that they share."""
    return float(first.intersection(second).area / min(first.area, second.area))


def match_objects(
    first: Sequence[SceneObject], second: Sequence[SceneObject], *, radius: float
) -> list[int] | None:
    """For each object of ``first`` its partner in ``second``; None unless all pair up.

    Partners have the same label and centres at most ``radius`` metres apart in top view.

    Parameters
    ----------
    first, second : sequence of SceneObject
    radius : float
        Metres in top view.

    Returns
    -------
    list of int or None
        Indices in ``second``.
    """
    if sorted(o.label for o in first) != sorted(o.label for o in second):
        return None
    if not first:
        return []
    a = np.array([o.centre[:2] for o in first])
    b = np.array([o.centre[:2] for o in second])
    distance = np.linalg.norm(a[:, None] - b[None], axis=-1)
    other = np.array([[f.label != s.label for s in second] for f in first])
    distance = np.where(other | (distance > radius), 1e6, distance)
    rows, columns = linear_sum_assignment(distance)
    if distance[rows, columns].max() >= 1e6:
        return None
    return [int(c) for c in columns]


def through_one_lens(
    objects: Sequence[Sequence[SceneObject]], log_focal: Sequence[float]
) -> tuple[tuple[SceneObject, ...], ...]:
    """Furniture of draws where it would stand if all had the same focal length.

    ``log_focal`` is by how much that of each draw is longer.

    With a longer lens the same picture is of a room that much deeper. It is the same room as
    far as anybody can tell: what draws say is compared like this, and reported as it is.

    Parameters
    ----------
    objects : sequence of N sequence of SceneObject
        Of each draw, in its world.
    log_focal : sequence of N float
        Log of how much longer each draw's focal length is.

    Returns
    -------
    tuple of N tuple of SceneObject
    """
    return tuple(
        tuple(o.moved(Placement(0.0, float(o.centre[1] * np.expm1(-longer)), 0.0)) for o in own)
        for own, longer in zip(objects, log_focal, strict=True)
    )


@dataclass(frozen=True)
class Layouts:
    """Draws sorted into layouts.

    Parameters
    ----------
    indicator : (N,) int
        Layout of each draw; 0 is the most frequent.
    leaders : tuple of int
        The draw each layout was founded by.
    """

    indicator: Ints
    leaders: tuple[int, ...]


def group_layouts(
    objects: Sequence[Sequence[SceneObject]], log_posteriors: Array, *, radius: float
) -> Layouts:
    """Sort draws into layouts around leaders, the most probable draws first.

    Parameters
    ----------
    objects : sequence of N object sets
        Merged furniture of each draw.
    log_posteriors : (N,) float
        Order in which draws may found a layout.
    radius : float
        Metres within which objects must pair up with those of the leader.

    Returns
    -------
    Layouts
    """
    leaders: list[int] = []
    member = np.empty(len(objects), dtype=np.int64)
    for draw in np.argsort(-np.asarray(log_posteriors), kind="stable"):
        for k, leader in enumerate(leaders):
            if match_objects(objects[leader], objects[draw], radius=radius) is not None:
                member[draw] = k
                break
        else:
            member[draw] = len(leaders)
            leaders.append(int(draw))
    counts = np.bincount(member, minlength=len(leaders))
    order = np.argsort(-counts, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return Layouts(rank[member], tuple(leaders[k] for k in order))


# ------------------------------------------------------------------------------------------------
# The distance of two scenes: what it costs to turn one set of objects into the other.
#
# Objects are moved, turned or renamed where that is cheap, and taken away or put there where it is
# not: optimal transport of unit masses with a price for those that are left over, with the optimal
# pairing in place of a plan. With squared costs this is the generalised optimal sub-pattern
# assignment metric (Rahmathullah, Garcia-Fernandez & Svensson 2017, alpha = 2): a metric, in
# metres, that is 1 for one object too many and grows with the number of differences.

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
    """The group of labels that stand for each other: any seat for another, else its own.

    Parameters
    ----------
    label : str

    Returns
    -------
    str
    """
    return "seat" if label in SEATS else label


def object_distance(first: SceneObject, second: SceneObject) -> float:
    """Metres between two objects on the floor; infinite between groups.

    Parameters
    ----------
    first, second : SceneObject
        In one world.

    Returns
    -------
    float
    """
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
    """Pair two sets of objects so that the distance is least.

    Parameters
    ----------
    first, second : sequence of SceneObject
        In one world.

    Returns
    -------
    Pairing
    """
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
