"""The reference of what chains have visited, see :mod:`imapper_prob.sampling.reference`."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from imapper_prob.layouts import furniture_kinds
from imapper_prob.models.problem import Problem
from imapper_prob.models.view import to_view
from imapper_prob.sampling.camera_moves import middle_heights
from imapper_prob.sampling.proposals import Candidates
from imapper_prob.sampling.reference import DOF, Reference, carried
from imapper_prob.sampling.visits import Visits, camera_covariance

__all__ = ["learn"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_SHIFTS: Final = {0: 0.6, -1: 0.15, 1: 0.15, -2: 0.05, 2: 0.05}
"""Frames by which ends and starts are taken to be earlier or later than they were met, and how
often; chosen."""
_OFTEN: Final = 3
"""Visits of one scenelet from which on they tell how places scatter; chosen."""
_LEAST: Final = np.array([0.002, 0.01, 0.03, 0.01])
"""Standard deviations of bearing (tangent), log depth, yaw (radians) and log size below which
none is taken to scatter; chosen, a few times less than they scatter on the demo."""
_FITTED: Final = np.array([0.01, 0.05, 0.2, 0.05])
"""The same of candidates about their fits, and how much wider those scatter that stand where one
of similar motion did; chosen, between the two blurs of births."""
_RIDGE: Final = 10.0
"""Visits without any displacement that are added where it is learnt how displacements go on."""


def learn(problem: Problem, candidates: Candidates, similarity: Array, visits: Visits) -> Reference:
    """The reference of what was visited.

    Parameters
    ----------
    problem : Problem
    candidates : Candidates
    similarity : (L, L) float
        Probabilities of exchanging one scenelet for another.
    visits : Visits

    Returns
    -------
    Reference
    """
    kinds = furniture_kinds(problem)
    numbers = {kind: number for number, kind in enumerate(sorted(set(kinds)), start=1)}
    lengths, n_frames = problem.lengths, problem.n_frames
    own = np.array([numbers[kind] for kind in kinds])
    heights = middle_heights(problem)
    begins = np.append(np.flatnonzero(problem.path_starts), n_frames)
    room = begins[np.searchsorted(begins, np.arange(n_frames), "right")] - np.arange(n_frames)
    room = np.append(room, 0)
    fitting = (lengths[:, None] <= room).sum(0)
    camera_mean, covariance = np.array(problem.camera_mean), camera_covariance(visits)
    if covariance is None:
        covariance = np.linalg.inv(problem.camera_precision).astype(np.float64)
    else:
        camera_mean = visits.arrays()["cameras"].mean(0)
    camera_factor = np.linalg.cholesky(covariance).astype(np.float64)
    followed, later = _rows(visits, own, lengths, room, len(numbers) + 1)
    places = _places(problem, visits, heights, room, np.concatenate([followed[1], later[1]]))
    # In place of itself a scenelet is as frequent as the one most like it.
    alike = np.array(similarity)
    np.fill_diagonal(alike, alike.max(1))
    hazard, scenelets, window = _fits(candidates, lengths, room)
    return Reference(
        camera_mean=camera_mean,
        camera_factor=camera_factor,
        camera_constant=_log_peak(camera_factor),
        library_camera=np.array(problem.camera_mean),
        kinds=own,
        lengths=np.array(lengths),
        heights=np.array(heights),
        room=room,
        met=places.met,
        met_where=places.where,
        followed_first=followed[0],
        followed=followed[1],
        followed_probability=followed[2],
        later_first=later[0],
        later=later[1],
        later_probability=later[2],
        similarity=alike,
        alike=_sums_by_length(alike, lengths),
        hazard=hazard,
        survival=np.append(0.0, np.log1p(-hazard[:-1]).cumsum()),
        candidates=scenelets,
        window=window,
        candidate_where=_candidate_places(candidates),
        openings=np.append(fitting[::-1].cumsum()[::-1], 0),
        by_length=np.argsort(lengths, kind="stable"),
        anywhere_mean=np.array(problem.start_mean),
        anywhere_deviation=np.sqrt(problem.start_variance),
        size_spread=float(problem.size_spread),
        onward=places.onward,
        factors=places.factors,
        constants=np.array([_log_peak(factor, yaw=True) for factor in places.factors]),
    )


def _sums_by_length(similarity: Array, lengths: Ints) -> Array:
    """(L, N + 1) sums of rows over the scenelets of no more than n frames, up to the longest."""
    sums = np.zeros((len(lengths), int(lengths.max()) + 1))
    for length in np.unique(lengths):
        sums[:, length] = similarity[:, lengths == length].sum(1)
    return sums.cumsum(1)


def _log_peak(factor: Array, *, yaw: bool = False) -> float:
    """Log density of a t distribution in its middle; its third number may be an angle within half
    a turn."""
    n = len(factor)
    log_peak = math.lgamma(0.5 * (DOF + n)) - math.lgamma(0.5 * DOF)
    log_peak -= 0.5 * n * math.log(DOF * math.pi) + float(np.log(np.diag(factor)).sum())
    if yaw:
        deviation = float(np.linalg.norm(factor[2]))
        log_peak -= math.log(2.0 * float(stats.t.cdf(math.pi / deviation, DOF)) - 1.0)
    return log_peak


Rows = tuple[Ints, Ints, Array]


def _rows(
    visits: Visits, kinds: Ints, lengths: Ints, room: Ints, n_kinds: int
) -> tuple[Rows, Rows]:
    """What followed, by kind and end of the scenelet before, and what came later, by frame."""
    n_scenelets, n_frames = len(kinds), len(room) - 1
    visited = visits.arrays()
    items, counts = visited["items"], visited["counts"]
    ends = np.cumsum(counts + 1)  # of states, each with an end of the scene
    codes = np.full(len(items) + len(counts), n_frames * n_scenelets)
    inside = np.ones(len(codes), bool)
    inside[ends - 1] = False
    codes[inside] = items[:, 1] * n_scenelets + items[:, 0]
    # Before each of these: the start, end and kind of a scenelet, or the beginning.
    before = np.zeros((len(codes), 3), np.int64)
    before[:, 0] = -1
    after_item = np.flatnonzero(inside) + 1
    before[after_item, 0] = items[:, 1]
    before[after_item, 1] = items[:, 1] + lengths[items[:, 0]]
    before[after_item, 2] = kinds[items[:, 0]]
    met, times = np.unique(np.column_stack([before, codes]), axis=0, return_counts=True)
    start_before, end_before, kind, code = met.T
    weight = times.astype(float)
    ending = code == n_frames * n_scenelets
    start, scenelet = np.where(ending, n_frames, code // n_scenelets), code % n_scenelets
    followed: list[tuple[Ints, Ints, Array]] = []
    later: list[tuple[Ints, Ints, Array]] = []
    flush = ~ending & (start == end_before) & (kind > 0)
    for by, share in _SHIFTS.items():
        end = end_before + np.where(kind > 0, by, 0)
        sound = (end >= 0) & (end <= n_frames)
        row = kind * (n_frames + 1) + end
        last = sound & ending
        followed.append((row[last], code[last], share * weight[last]))
        _add(followed, row, end, scenelet, share * weight, sound & flush, lengths, room)
        for off, part in _SHIFTS.items():
            where = sound & ~flush & ~ending & (start + off >= end)
            _add(
                followed, row, start + off, scenelet, share * part * weight, where, lengths, room
            )  # fmt: skip
        # From each frame after the start of the scenelet before up to this one's.
        low, high = start_before + 1, np.where(ending, n_frames, start + by)
        span = np.maximum(high + 1 - low, 0)
        of = np.repeat(np.arange(len(met)), span)
        frame = np.arange(len(of)) - np.repeat(span.cumsum() - span, span) + low[of]
        begins = np.where(ending, n_frames, start + by)
        sound = ending[of] | (
            (begins[of] >= 0) & (lengths[scenelet[of]] <= room[begins[of].clip(0, n_frames)])
        )
        frame, of = frame[sound], of[sound]
        shifted = np.where(ending, code, begins * n_scenelets + scenelet)
        later.append((frame, shifted[of], share * weight[of]))
    return _gathered(followed, n_kinds * (n_frames + 1)), _gathered(later, n_frames + 1)


def _add(
    entries: list[tuple[Ints, Ints, Array]],
    row: Ints,
    start: Ints,
    scenelet: Ints,
    weight: Array,
    sound: NDArray[np.bool_],
    lengths: Ints,
    room: Ints,
) -> None:
    """Enter scenelets at starts into rows, where they fit into their film."""
    n_frames = len(room) - 1
    fits = sound & (start >= 0) & (start < n_frames)
    fits &= lengths[scenelet] <= room[start.clip(0, n_frames)]
    codes = start * len(lengths) + scenelet
    entries.append((row[fits], codes[fits], weight[fits]))


def _gathered(entries: list[tuple[Ints, Ints, Array]], n_rows: int) -> Rows:
    """Entries by row, each code once, with probabilities that sum to one in each row."""
    row, code, weight = (np.concatenate(parts) for parts in zip(*entries, strict=True))
    base = int(code.max(initial=0)) + 1
    found, of = np.unique(row * base + code, return_inverse=True)
    row, code = found // base, found % base
    total = np.bincount(of, weight, len(found))
    by_row = np.bincount(row, total, n_rows)
    first = np.searchsorted(row, np.arange(n_rows + 1)).astype(np.int64)
    return first, code, total / by_row[row]


class _Places(NamedTuple):
    """Where visited scenelets stand, and how they scatter."""

    met: Ints
    where: Array
    onward: Array
    factors: Array


def _places(problem: Problem, visits: Visits, heights: Array, room: Ints, codes: Ints) -> _Places:
    """Where scenelets of some codes stand; the code at the end of the scene is left out."""
    n_scenelets, n_frames = len(heights), len(room) - 1
    visited = visits.arrays()
    items, counts = visited["items"], visited["counts"]
    cameras = np.repeat(visited["cameras"], counts, axis=0)
    where = carried(heights[items[:, 0]], visited["where"], cameras, np.array(problem.camera_mean))
    code = items[:, 1] * n_scenelets + items[:, 0]
    found, first, of, times = np.unique(
        code, return_index=True, return_inverse=True, return_counts=True
    )
    # Yaws within half a turn of the first one of the same scenelet.
    yaw = where[first, 2][of]
    where[:, 2] = yaw + np.remainder(where[:, 2] - yaw + np.pi, 2 * np.pi) - np.pi
    total = np.stack([np.bincount(of, column, len(found)) for column in where.T], -1)
    mean = total / times[:, None]
    onward, factors = _scatter(where - mean[of], times[of], counts)
    met = np.unique(codes[codes < n_frames * n_scenelets])
    # The nearest visit of the same scenelet, the more frequent of two.
    nearest, best = np.zeros(len(met), np.int64), np.full(len(met), -1.0)
    for by, share in _SHIFTS.items():
        at = np.searchsorted(found, met - by * n_scenelets).clip(0, max(len(found) - 1, 0))
        there = found[at] == met - by * n_scenelets if len(found) else np.zeros(len(met), bool)
        worth = np.where(there, share * times[at] if len(found) else 0.0, -1.0)
        nearest, best = np.where(worth > best, at, nearest), np.maximum(worth, best)
    return _Places(met, mean[nearest].reshape(-1, 4), onward, factors)


def _scatter(offsets: Array, times: Ints, counts: Ints) -> tuple[Array, Array]:
    """How displacements go on, and factors of how they scatter."""
    often = times >= _OFTEN
    least = np.diag(_LEAST**2)
    own = offsets[often] * np.sqrt(times[often] / (times[often] - 1.0))[:, None]
    alone = least + own.T @ own / max(len(own), 1)
    place = np.concatenate([np.arange(count) for count in counts.tolist()] or [np.empty(0)])
    pairs = np.flatnonzero((place[1:] > 0) & often[1:] & often[:-1]) + 1
    before, after = offsets[pairs - 1], offsets[pairs]
    gram = before.T @ before + _RIDGE * least
    onward = np.linalg.solve(gram, before.T @ after).T.astype(np.float64)
    left = after - before @ onward.T
    linked = least + left.T @ left / len(pairs) if len(pairs) else alone
    fitted = np.diag(_FITTED**2)
    return onward, np.linalg.cholesky(np.stack([alone, linked, alone + fitted, fitted]))


def _fits(candidates: Candidates, lengths: Ints, room: Ints) -> tuple[Array, Array, Ints]:
    """How probable it is that a candidate begins at a frame, with which scenelet, and the window
    of each middle frame.

    Where the solver's weights are best, one begins within the length of a scenelet on average.
    """
    n_frames = len(room) - 1
    frames, centres = np.arange(n_frames + 1), candidates.centres
    right = np.searchsorted(centres, frames).clip(1, max(len(centres) - 1, 1))
    left = right - 1
    right = right.clip(0, len(centres) - 1)
    nearer_left = np.abs(frames - centres[left]) <= np.abs(centres[right] - frames)
    window = np.where(nearer_left, left, right)
    scenelets = np.zeros((n_frames + 1, len(lengths)))
    for scenelet, length in enumerate(lengths.tolist()):
        starts = np.flatnonzero(length <= room)
        of = window[starts + length // 2]
        scenelets[starts, scenelet] = candidates.weights[of, scenelet]
    by_start = scenelets.sum(1)
    known = by_start > 0
    scenelets[known] /= by_start[known, None]
    usual = float(np.median(lengths))
    most = float(by_start.max())
    hazard: Array = by_start / (most * usual) if most > 0 else np.zeros(n_frames + 1)
    return hazard, scenelets, window


def _candidate_places(candidates: Candidates) -> Array:
    """Where candidates stand; those without weight are nowhere, and are not looked at."""
    ahead = candidates.placements[..., 1] > 0
    placements = np.where(ahead[..., None], candidates.placements, [0.0, 1.0, 0.0])
    return to_view(placements, candidates.sizes)
