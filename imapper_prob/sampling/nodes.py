"""Scenelets at their starts, each with a Gaussian of where it stands: what stretches are made of.

A node is a scenelet at a start frame. Alone in the scene, in the mean camera, it is expanded to
second order around its best place (:mod:`imapper_prob.models.expansion`), what tempering keeps
apart from what it flattens: so one expansion gives weight, mean and covariance at any power.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.expansion import expand, judge
from imapper_prob.models.posterior import empty_state, motion
from imapper_prob.models.problem import Problem
from imapper_prob.models.view import to_view
from imapper_prob.sampling.join_kernels import loose_jumps
from imapper_prob.sampling.proposals import Candidates

__all__ = ["Nodes", "find_nodes"]

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
        See :class:`imapper_prob.models.expansion.Expansions`.
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
