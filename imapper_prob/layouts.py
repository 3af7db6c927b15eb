"""Layouts: the objects of a draw, grouping of draws that agree, and distances of scenes.

Processes of chains import this module. It imports nothing that loads torch, so that they start in
half the time.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import networkx as nx
import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from imapper_prob.models.log_posterior import State, log_posterior_near
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import FRONTLESS, SEATS, Placement, SceneObject
from imapper_prob.models.scenelet import Library

__all__ = [
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
    """Sorted category numbers of each scenelet's objects.

    Parameters
    ----------
    problem : Problem

    Returns
    -------
    tuple of tuple of int
        One tuple of category numbers for each scenelet.
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
_SHARED: Final = 0.5
"""Fraction of the smaller footprint that two objects must share to count as one in any orientation.
With less overlap, they are two objects that stand too close together."""


def merged_objects(problem: Problem, library: Library, state: State) -> tuple[SceneObject, ...]:
    """The furniture of a state in world coordinates, with duplicate objects merged.

    Objects of the same label are duplicates if their footprints overlap and, unless they have no
    front, their orientations agree within the model's merge angle. Objects that share half of the
    smaller footprint are duplicates if they have one label or both are seats. Of each group of
    duplicates, the object is kept whose scenelet improves the log-posterior most.

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
    """For each group of duplicates, the object whose scenelet improves the log-posterior most.

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
    if all(len(group) == 1 for group in groups):
        return [group[0] for group in groups]
    value = log_posterior_near(problem, state)

    def rest(k: int) -> float:
        return value(state.without_item(placed[k][0]))

    return [min(group, key=rest) if len(group) > 1 else group[0] for group in groups]


def placed_objects(
    state: State, library: Library, *, only: Iterable[tuple[int, int]] | None = None
) -> list[tuple[int, SceneObject]]:
    """All objects of a state in world coordinates, with the index of each one's scenelet.

    Parameters
    ----------
    state : State
    library : Library
    only : iterable of (int, int), optional
        Index of a scenelet in the state, and of one of its objects; all objects if not given.

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
    """Groups of indices of :func:`placed_objects` that are one object, each in order.

    Two objects are one if they have the same label, orientations within ``angle`` radians (unless
    without a front) and overlapping footprints; or if they share half of the smaller footprint and
    have one label or are both seats.

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
    later, earlier = _near(placed)
    one = _same([o for _, o in placed], later, earlier, angle)
    graph.add_edges_from(zip(later[one].tolist(), earlier[one].tolist(), strict=True))
    return [sorted(group) for group in nx.connected_components(graph)]


def _near(placed: Sequence[tuple[int, SceneObject]]) -> tuple[Ints, Ints]:
    """Pairs of objects of different scenelets whose footprints can overlap: later, earlier."""
    items = np.array([item for item, _ in placed], np.int64)
    centres = np.array([o.centre[:2] for _, o in placed]).reshape(-1, 2)
    reach = np.array([np.hypot(*np.ptp(o.bounds, axis=0)[:2]) / 2 for _, o in placed])
    apart = np.hypot(*(centres[:, None] - centres).T)
    can = (apart <= reach[:, None] + reach) & (items[:, None] != items)
    later, earlier = np.nonzero(np.tril(can))
    return later, earlier


def _same(
    objects: Sequence[SceneObject], first: Ints, second: Ints, angle: float
) -> NDArray[np.bool_]:
    """Whether the objects of each pair are one, see :func:`same_objects`."""
    if not len(first):
        return np.zeros(0, np.bool_)
    labels = np.array([o.label for o in objects])
    seats = np.array([o.label in SEATS for o in objects])
    frontless = np.array([o.label in FRONTLESS for o in objects])
    yaws = np.array([o.placement.yaw for o in objects])
    outlines = shapely.polygons(np.array([o.footprint for o in objects]))
    areas = shapely.area(outlines)
    alike = labels[first] == labels[second]
    turned = np.cos(yaws[first] - yaws[second]) <= np.cos(angle)
    anywhere = alike & (frontless[first] | ~turned)
    much = ~anywhere & (alike | (seats[first] & seats[second]))
    one = np.zeros(len(first), np.bool_)
    a, b = first[anywhere], second[anywhere]
    one[anywhere] = shapely.intersects(outlines[a], outlines[b])
    a, b = first[much], second[much]
    shared = shapely.area(shapely.intersection(outlines[a], outlines[b]))
    one[much] = shared / np.minimum(areas[a], areas[b]) > _SHARED
    return one


def match_objects(
    first: Sequence[SceneObject], second: Sequence[SceneObject], *, radius: float
) -> list[int] | None:
    """Indices in ``second`` of the partners of ``first``; None unless all objects pair up.

    Partners have the same label or are both seats, and their centres are at most ``radius`` metres
    apart in top view.

    Parameters
    ----------
    first, second : sequence of SceneObject
    radius : float
        Distance in top view, metres.

    Returns
    -------
    list of int or None
        Indices in ``second``.
    """
    groups, others = ([group_of(o.label) for o in own] for own in (first, second))
    if sorted(groups) != sorted(others):
        return None
    if not first:
        return []
    a = np.array([o.centre[:2] for o in first])
    b = np.array([o.centre[:2] for o in second])
    distance = np.linalg.norm(a[:, None] - b[None], axis=-1)
    other = np.array(groups)[:, None] != np.array(others)
    distance = np.where(other | (distance > radius), 1e6, distance)
    rows, columns = linear_sum_assignment(distance)
    if distance[rows, columns].max() >= 1e6:
        return None
    return [int(c) for c in columns]


def through_one_lens(
    objects: Sequence[Sequence[SceneObject]], log_focal: Sequence[float]
) -> tuple[tuple[SceneObject, ...], ...]:
    """Move the furniture of draws to where it would be with one common focal length.

    ``log_focal`` is the log ratio of each draw's focal length to the common one.

    With a longer focal length, the same image corresponds to a proportionally deeper room. The data
    hardly distinguish the two, so draws are compared after this change, but reported without it.

    Parameters
    ----------
    objects : sequence of N sequence of SceneObject
        Furniture of each draw in its world.
    log_focal : sequence of N float
        Log ratio of each draw's focal length to the common one.

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
    """An assignment of draws to layouts.

    Parameters
    ----------
    indicator : (N,) int
        Layout of each draw; 0 is the most frequent layout.
    leaders : tuple of int
        Draw that founded each layout.
    """

    indicator: Ints
    leaders: tuple[int, ...]


def group_layouts(
    objects: Sequence[Sequence[SceneObject]], log_posteriors: Array, *, radius: float
) -> Layouts:
    """Assign draws to layouts around leaders, in order of decreasing log-posterior.

    Parameters
    ----------
    objects : sequence of N object sets
        Merged furniture of each draw.
    log_posteriors : (N,) float
        Draws are taken in decreasing order of it.
    radius : float
        Distance in metres within which objects must pair up with those of the leader.

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
# The distance of two scenes is the least cost of transforming one set of objects into the other.
#
# Objects are moved and turned if that is cheaper than removing and adding them. This is optimal
# transport of unit masses with a price for unpaired ones, restricted to pairings. With squared
# costs it is the generalised optimal sub-pattern assignment metric (Rahmathullah, Garcia-Fernandez
# & Svensson 2017, alpha = 2). It is in metres, is 1 for one spurious object, and grows with the
# number of differences.

_LEFT_OVER: Final = 1.0
"""Cost in metres of an object without a partner; the unit of the distance."""
_TURNED: Final = 0.3
"""Cost in metres a radian of rotation; half a turn costs almost as much as another object."""


@dataclass(frozen=True)
class Pairing:
    """The cheapest transformation of one set of objects into another.

    Parameters
    ----------
    pairs : tuple of (int, int)
        Indices of paired objects in the first and in the second set.
    only_first, only_second : tuple of int
        Indices of objects without a partner.
    distance : float
        Metres.
    """

    pairs: tuple[tuple[int, int], ...]
    only_first: tuple[int, ...]
    only_second: tuple[int, ...]
    distance: float


def group_of(label: str) -> str:
    """The group of labels that may be paired: ``seat`` for all seats, else the label itself.

    The kind of a seat is no part of a layout: in the model, only a small part of its probability
    comes from its scenelet (docs/explanation/model.md, 11a).

    Parameters
    ----------
    label : str

    Returns
    -------
    str
    """
    return "seat" if label in SEATS else label


def object_distance(first: SceneObject, second: SceneObject) -> float:
    """Distance in metres of two objects on the floor; infinite between groups.

    Parameters
    ----------
    first, second : SceneObject
        In a common world frame.

    Returns
    -------
    float
    """
    if group_of(first.label) != group_of(second.label):
        return float("inf")
    away = np.hypot(*(first.centre - second.centre)[:2])
    return float(np.hypot(away, _TURNED * turn(first, second)))


def turn(first: SceneObject, second: SceneObject) -> float:
    """Angle in radians, 0 to pi, of two orientations, modulo pi for objects without a front."""
    fold = np.pi if first.label in FRONTLESS else 2 * np.pi
    angle = (second.placement.yaw - first.placement.yaw) % fold
    return float(min(angle, fold - angle))


def pair_objects(first: Sequence[SceneObject], second: Sequence[SceneObject]) -> Pairing:
    """Pair two sets of objects with the least distance.

    Parameters
    ----------
    first, second : sequence of SceneObject
        In a common world frame.

    Returns
    -------
    Pairing
    """
    dearest = 2 * _LEFT_OVER**2  # cost of two unpaired objects, the most that a pair may cost
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
