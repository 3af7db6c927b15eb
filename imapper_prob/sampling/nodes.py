"""Nodes of the redraw move: scenelets at starts with Gaussian placements, and their joins.

A node is a scenelet at a start frame. Alone in the scene, in the mean camera, it is expanded to
second order around its best place (:mod:`imapper_prob.models.single_scenelet`). What tempering
keeps is apart from what it flattens, so one expansion gives weight, mean and covariance at any
power.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.kernels.placement import place_boxes
from imapper_prob.models.log_posterior import empty_state, motion
from imapper_prob.models.problem import Problem
from imapper_prob.models.single_scenelet import STEPS, expand, judge
from imapper_prob.models.skeleton import PELV
from imapper_prob.models.view import to_floor, to_view
from imapper_prob.samplers.segments import Segments
from imapper_prob.sampling.join_kernels import loose_jumps, pair_costs, pair_factors, path_errors
from imapper_prob.sampling.proposals import Candidates

__all__ = ["Common", "Nodes", "Table", "Tables", "find_nodes", "tables_of"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
_EXPANDED = 100
"""Scenelets of a window that are expanded, the best where they were fitted; chosen: a fit is some
nats off its best place, and the time is some seconds for a clip of ten."""
_OF_WINDOW = 60
"""Of these, how many become nodes, chosen."""
_WORTH = 25.0
"""Nats by which one may be worth less than the best of its window, cold or hot."""
_HOT = 0.3
"""The hot power."""
_NEIGHBOUR = 20
"""Frames of a neighbour, about."""


class Nodes(NamedTuple):
    """N nodes in order of start, then scenelet.

    Parameters
    ----------
    items : (N, 2) int
        Scenelet and start frame.
    where : (N, 4) float
        Bearing (tangent), log depth (log m), yaw (radians) and log size, where it is expanded.
    values, gradients, hessians, beside : (N, 2), (N, 2, 4), (N, 2, 4, 4), (N, 2, REACH) float
        See :class:`imapper_prob.models.single_scenelet.Expansions`.
    """

    items: Ints
    where: Array
    values: Array
    gradients: Array
    hessians: Array
    beside: Array


def find_nodes(problem: Problem, candidates: Candidates) -> Nodes:
    """The best scenelets of every window, at the starts that are nearest to it.

    Every fit is judged in the middle of its window, and the best are expanded there. A frame
    earlier or later they stand where the static path has gone meanwhile; there they are judged,
    and otherwise alike.
    """
    loose = np.ascontiguousarray(motion(problem, empty_state(problem)).transpose(0, 2, 1))
    parts = [_best_of(problem, candidates, w, loose) for w in range(len(candidates.centres))]
    items, where, values, gradients, hessians, beside = (
        np.concatenate(part) for part in zip(*parts, strict=True)
    )
    window = _window_of(problem, candidates, items)
    found = [(items, where, values, beside, np.arange(len(items)))]
    reach = int(np.diff(candidates.centres).max(initial=1) // 2 + 1)
    for shift in range(-reach, reach + 1):
        moved, there = _moved(problem, items, where, shift)
        inside = _fits(problem, moved)
        inside &= _window_of(problem, candidates, moved) == window
        if shift != 0 and inside.any():
            judged = judge(problem, moved[inside], there[inside])
            found.append((moved[inside], there[inside], *judged, np.flatnonzero(inside)))
    items, where, values, beside, of = (np.concatenate(part) for part in zip(*found, strict=True))
    order = np.lexsort((items[:, 0], items[:, 1]))
    order = order[np.isfinite(values[order]).all(1)]
    of = of[order]
    return Nodes(
        items[order], where[order], values[order], gradients[of], hessians[of], beside[order]
    )


def _best_of(
    problem: Problem, candidates: Candidates, window: int, loose: Array
) -> tuple[Ints, Array, Array, Array, Array, Array]:
    """Items, places and expansions of the best scenelets of a window."""
    fitted = np.flatnonzero(candidates.weights[window] > 0)
    start = candidates.centres[window] - problem.lengths[fitted] // 2
    items = np.stack([fitted, start], -1)
    items = items[_fits(problem, items)]
    fitted = items[:, 0]
    where = to_view(candidates.placements[window, fitted], candidates.sizes[window, fitted])
    jumps = _jumps(problem, items, where, loose)
    best = _ranked(*judge(problem, items, where), jumps)[:_EXPANDED]
    items = items[best]
    found = expand(problem, items, where[best])
    jumps = _jumps(problem, items, found.where, loose)
    kept = _ranked(found.values, found.beside, jumps)[:_OF_WINDOW]
    where, values, gradients, hessians, beside = (part[kept] for part in found)
    return items[kept], where, values, gradients, hessians, beside


def _ranked(values: Array, beside: Array, jumps: Array) -> Ints:
    """Those worth nearly as much as the best, cold, hot, or between others; in turn the next best
    of each.

    Between others that use the same furniture the pose jumps less, and what is behind that
    furniture is their merit.
    """
    sound = np.flatnonzero(np.isfinite(values).all(1))
    ranks, worthy = np.full(len(values), len(values)), np.zeros(len(values), dtype=bool)
    kept, flattened = values[sound].T
    between = kept + flattened + jumps[sound] - beside[sound, :, :_NEIGHBOUR].sum((1, 2))
    for worth in (kept + flattened, kept + _HOT * flattened, between):
        order = sound[np.argsort(-worth, kind="stable")]
        ranks[order] = np.minimum(ranks[order], np.arange(len(order)))
        worthy[sound] |= worth >= worth.max(initial=-np.inf) - _WORTH
    return np.argsort(np.where(worthy, ranks, len(values)), kind="stable")[: worthy.sum()]


def _jumps(problem: Problem, items: Ints, where: Array, loose: Array) -> Array:
    """(n,) nats that the pose's jumps cost at both ends of scenelets alone."""
    jumps = np.empty((len(items), 2))
    film = np.cumsum(problem.path_starts).astype(np.int64)
    joints = np.empty((2 * len(items), 3, 16))
    loose_jumps(problem, film, items, where, loose, joints, jumps)
    result: Array = problem.smoothness_cost * problem.likelihood * jumps.sum(1)
    return result


def _fits(problem: Problem, items: Ints) -> NDArray[np.bool_]:
    """Whether scenelets lie in the film of one person."""
    first = items[:, 1]
    last = first + problem.lengths[items[:, 0]] - 1
    inside = (first >= 0) & (last < problem.n_frames)
    film = np.cumsum(problem.path_starts)
    inside[inside] &= film[first[inside]] == film[last[inside]]
    return inside


def _window_of(problem: Problem, candidates: Candidates, items: Ints) -> Ints:
    """The window whose middle is nearest to that of each item, the earlier of two."""
    middles = items[:, 1] + problem.lengths[items[:, 0]] // 2
    result: Ints = np.abs(middles[:, None] - candidates.centres).argmin(1)
    return result


def _moved(problem: Problem, items: Ints, where: Array, shift: int) -> tuple[Ints, Array]:
    """Items some frames later, and where the static path has taken them by then."""
    last = problem.n_frames - 1
    middle = items[:, 1] + problem.lengths[items[:, 0]] // 2
    path = problem.path_centre
    gone = path[np.clip(middle + shift, 0, last)] - path[np.clip(middle, 0, last)]
    there = where.copy()
    there[:, :2] += gone
    return items + np.array([0, shift]), there


# ------------------------------------------------------------------------------------------------
# Nodes at one power of the likelihood: Gaussians, weights, and factors of those that join.
#
# What ties a node to others is the path of the person. In a node's Gaussian the path's own pull on
# its first frame is left out; it comes back as that of whatever is before: nothing known, a
# scenelet that stays, or another node, however long ago. All that is linear in a node's place
# and Gaussian, so that places of a whole sequence are one Gaussian, drawn and evaluated at once
# (:mod:`imapper_prob.sampling.redraw_kernels`), and what two that join gain is known beforehand.

pass
_FLAT = 0.05
"""Least precision of a node's Gaussian along any direction, of a unit step (4.5 steps of
standard deviation): beyond, an expansion says nothing."""
_LONG_WAY = 3.0
"""Steps by which a node's mean may be off its expansion."""
_GAP = 5.0
"""Nats that two in one stretch with a gap between them are worth less than both alone. Their
furniture is in each other, and they share what it hides: of such draws of a stretch of one real
clip the median was worth seven less than of those without a gap."""
_LEAST_JOIN = -5.0
"""Log factor below which no join is taken to be worth: how far off a table may be."""


class Common(NamedTuple):
    """What all powers share of N nodes.

    Parameters
    ----------
    items : (N, 2) int
    where : (N, 4) float
        See :class:`~imapper_prob.sampling.nodes.Nodes`.
    heights : (N,) float
        Of the pelvis in the middle frame, metres of the reference body.
    pull : (N, 6, 4) float
        Derivatives of path errors, a unit step each, see
        :func:`~imapper_prob.sampling.join_kernels.path_errors`.
    credit : (N, 2, REACH + 1) float
        Nats that a node alone gains in so many frames before it, and after it.
    film : (T,) int
        Which film a frame is of.
    loose : (T, 3, 16) float
        Joints of free frames in the mean camera, metres.
    steps, inverse : (4, 4) float
        Unit steps as columns, and the inverse.
    """

    items: Ints
    where: Array
    heights: Array
    pull: Array
    credit: Array
    film: Ints
    loose: Array
    steps: Array
    inverse: Array


class Table(NamedTuple):
    """Nodes at one power.

    Parameters
    ----------
    power : float
    precision : (N, 4, 4) float
        Of each node's Gaussian in unit steps, without the path's pull.
    pull : (N, 4) float
        Its gradient where it is expanded.
    bend : (N, 4, 4) float
        The part of the precision that goes where the camera sees the scenelet.
    first : (N, 2, 2) float
        Mean and variance of the path errors of the first frame, by axis.
    last : (N, 2, 5) float
        Means of the path errors of the last frame and the one before, their variances and
        covariance.
    """

    power: float
    precision: Array
    pull: Array
    bend: Array
    first: Array
    last: Array


@dataclass(frozen=True)
class Tables:
    """Nodes at all powers, the coldest first.

    Parameters
    ----------
    common : Common
    gaussians : tuple of Table
    segments : tuple of Segments
        Kinds are 1 + the stay in which a node's person is first off their feet, or 0.
    """

    common: Common
    gaussians: tuple[Table, ...]
    segments: tuple[Segments, ...]


def tables_of(problem: Problem, nodes: Nodes, powers: tuple[float, ...]) -> Tables:
    """Tables of ``nodes`` at each of ``powers``."""
    items, where = nodes.items, nodes.where
    camera = np.array(problem.camera_mean)
    errors = _errors(problem, camera, items, where)
    pull = np.stack(
        [
            _errors(problem, camera, items, where + 0.5 * step)
            - _errors(problem, camera, items, where - 0.5 * step)
            for step in STEPS
        ],
        -1,
    )
    common = Common(
        items=items,
        where=where,
        heights=problem.joints[
            problem.joint_first[items[:, 0]] + problem.lengths[items[:, 0]] // 2, PELV, 2
        ],
        pull=pull,
        credit=np.pad(nodes.beside, ((0, 0), (0, 0), (1, 0))).cumsum(2),
        film=np.cumsum(problem.path_starts).astype(np.int64),
        loose=np.ascontiguousarray(motion(problem, empty_state(problem)).transpose(0, 2, 1)),
        steps=np.ascontiguousarray(STEPS.T),
        inverse=np.linalg.inv(STEPS.T),
    )
    frame = _frame(problem, items)
    costs = _costs(problem, common, frame)
    gaussians, segments = [], []
    for power in powers:
        table, weight = _table(nodes, errors, pull, power)
        factors = np.empty(len(costs), np.float32)
        pair_factors(
            problem, common.film, frame, table.first, table.last, power, costs, _LEAST_JOIN, factors
        )
        gaussians.append(table)
        segments.append(
            frame._replace(
                log_weight=weight, gap=math.exp(-_GAP * power * problem.likelihood), flush=factors
            )
        )
    return Tables(common, tuple(gaussians), tuple(segments))


def _errors(problem: Problem, camera: Array, items: Ints, where: Array) -> Array:
    result = np.empty((len(items), 6))
    path_errors(problem, camera, items, where, result)
    return result


def _frame(problem: Problem, items: Ints) -> Segments:
    """The segments without their weights."""
    start = np.ascontiguousarray(items[:, 1])
    end = start + problem.lengths[items[:, 0]]
    by_end = np.argsort(end, kind="stable")
    times = np.arange(problem.n_frames + 2)
    starting, ending = np.searchsorted(start, times), np.searchsorted(end[by_end], times)
    count = np.diff(starting) * np.diff(ending)
    kinds = 1 + len(problem.stays)
    low, high = (start + problem.lowered[items[:, 0], k] for k in (0, 1))
    kind = np.zeros(len(items), np.int64)
    for k in range(len(problem.stays) - 1, -1, -1):
        first, last, _ = problem.stays[k]
        kind[(low < high) & (low < last) & (high > first)] = 1 + k
    return Segments(
        start, end, kind, by_end, starting, ending, np.zeros(len(items)), np.ones((kinds, kinds)),
        1.0, np.concatenate([[0], np.cumsum(count)]), np.zeros(0, np.float32),
    )  # fmt: skip


def _costs(problem: Problem, common: Common, frame: Segments) -> Singles:
    """(P,) nats that two that join gain, over both alone, by poses and furniture."""
    items, where = common.items, common.where
    placements, sizes = to_floor(where)
    boxes, turns, owner, yaws = place_boxes(
        problem, np.array(problem.camera_mean), items, placements, np.ascontiguousarray(sizes)
    )
    first = np.searchsorted(owner[:, 0], np.arange(len(items) + 1))
    result = np.empty(int(frame.pairs[-1]), np.float32)
    pair_costs(
        problem, common.film, frame, items, where, common.loose,
        first, boxes, turns, np.ascontiguousarray(owner[:, 2]), yaws, common.credit, result,
    )  # fmt: skip
    return result


Singles = NDArray[np.float32]


def _table(nodes: Nodes, errors: Array, pull: Array, power: float) -> tuple[Table, Array]:
    """The nodes at a power, and their log weights alone."""
    first = pull[:, :2]
    # Without the path's pull on the first frame, whose errors are standard normal if nothing
    # is known.
    kept = -_symmetric(nodes.hessians[:, 0]) - np.einsum("nia,nib->nab", first, first)
    bend = power * _at_least(-_symmetric(nodes.hessians[:, 1]), 0.0)
    precision = _at_least(kept + bend, _FLAT)
    gradient = nodes.gradients[:, 0] + np.einsum("ni,nia->na", errors[:, :2], first)
    gradient = gradient + power * nodes.gradients[:, 1]
    covariance = np.linalg.inv(precision)
    mean = np.einsum("nab,nb->na", covariance, gradient)
    shrink = np.minimum(1.0, _LONG_WAY / np.maximum(np.abs(mean).max(1), 1e-9))
    gradient, mean = gradient * shrink[:, None], mean * shrink[:, None]
    found = errors + np.einsum("nia,na->ni", pull, mean)
    spread = np.einsum("nia,nab,njb->nij", pull, covariance, pull)
    entry = np.stack([found[:, :2], spread[:, (0, 1), (0, 1)]], -1)
    last = np.stack(
        [
            found[:, 2:4], found[:, 4:6], spread[:, (2, 3), (2, 3)], spread[:, (4, 5), (4, 5)],
            spread[:, (2, 3), (4, 5)],
        ],
        -1,
    )  # fmt: skip
    weight = nodes.values[:, 0] + 0.5 * (errors[:, :2] ** 2).sum(1) + power * nodes.values[:, 1]
    weight += 0.5 * np.einsum("na,na->n", gradient, mean)
    weight += 2 * math.log(2 * math.pi) - 0.5 * np.linalg.slogdet(precision)[1]
    weight += math.log(abs(np.linalg.det(STEPS)))
    # Where nothing is known of what was before.
    variance = 1.0 + entry[..., 1]
    weight -= 0.5 * (np.log(variance) + entry[..., 0] ** 2 / variance).sum(1)
    arrays = (np.ascontiguousarray(a) for a in (precision, gradient, bend, entry, last))
    return Table(power, *arrays), np.ascontiguousarray(weight)


def _symmetric(matrices: Array) -> Array:
    result: Array = 0.5 * (matrices + matrices.transpose(0, 2, 1))
    return result


def _at_least(matrices: Array, least: float) -> Array:
    """Symmetric matrices with no eigenvalue below ``least``."""
    values, vectors = np.linalg.eigh(matrices)
    result: Array = np.einsum("nij,nj,nkj->nik", vectors, np.maximum(values, least), vectors)
    return result
