"""Learn a reference distribution from visited scenes, see
:mod:`imapper_prob.sampling.reference`."""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.linalg import block_diag
from scipy.signal import fftconvolve

from imapper_prob.layouts import furniture_kinds
from imapper_prob.models.kernels.placement import expected_facing
from imapper_prob.models.problem import Problem
from imapper_prob.models.skeleton import PELV
from imapper_prob.models.view import to_floor
from imapper_prob.sampling.gains import (
    Gains,
    frames_left_of,
    gains_about,
    sequences_of,
    static_pelvis_on_floor,
)
from imapper_prob.sampling.image_pelvis import reproject_pelvis
from imapper_prob.sampling.jit import compiled
from imapper_prob.sampling.reference import DOF, FIRST, FLUSH, GAP, Reference
from imapper_prob.sampling.reference_density import component_probabilities
from imapper_prob.sampling.reference_placement import displacements, mean_offsets
from imapper_prob.sampling.visits import Visits, camera_covariance

__all__ = ["learn"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_SHIFTS: Final = {0: 0.6, -1: 0.15, 1: 0.15, -2: 0.05, 2: 0.05}
"""Shifts in frames by which visited ends and starts are smoothed, with their weights; chosen."""
_INITIAL_WEIGHTS: Final = np.array([0.15, 0.1, 0.25, 0.2, 0.05, 0.25])
"""Initial weights of the components followed, later, similar, fitting, anywhere and flush;
chosen."""
_KEPT: Final = 0.5
"""Share of the initial weights in the learnt ones, so that unvisited scenes stay possible;
chosen."""
_ROUNDS: Final = 30
"""Largest number of EM iterations for the weights."""
_SETTLED: Final = 0.005
"""Change of the weights at which EM stops; chosen."""
_PREDICTED: Final = 1000
"""About how many states of one half of the visits are predicted from the other half; chosen: with
so many, the learnt weights have an error of about .01."""
_NEAR: Final = 2.0
"""Width in frames of the kernel (1 + (dt / width)^2)^-2 with which visits determine the person's
position in other frames; chosen."""
_ALL_FRAMES: Final = 100_000
"""Number of visited scenelets from which on only every second of their frames is used, of twice as
many every third, and so on; chosen: more frames take longer and add little."""
_PSEUDO_VISITS: Final = np.array([0.02, 5.0])
"""Numbers of pseudo-visits: in each frame, of a person on the static path; and of each scenelet,
with the mean deviation of similar ones, or by start with its own. A scenelet with fewer visits
than the latter counts as rarely visited. Chosen."""
_PRIOR_COVARIANCE: Final = np.diag([0.006, 0.04, 0.12, 0.03]) ** 2
"""Prior covariance of bearing (tangent), log depth, yaw (radians) and log size of a scenelet:
standard deviations of long chains on the demo, rounded."""
_PRIOR_FLUSH_COVARIANCE: Final = np.diag([0.004, 0.015, 0.12, 0.03]) ** 2
"""The same for a scenelet that is flush with the one before, relative to that one."""
_COVARIANCE_VISITS: Final = 20.0
"""Number of pseudo-visits with these prior covariances, where the scatter of visits is learnt;
chosen."""
_COVARIANCE_SCENELETS: Final = 5.0
"""Number of pseudo-scenelets with ``_PRIOR_COVARIANCE``, where the covariance of the differences
between scenelets is learnt; chosen."""


def learn(problem: Problem, gains: Gains, similarity: Array, visits: Visits) -> Reference:
    """Learn the reference distribution from visits.

    Parameters
    ----------
    problem : Problem
    gains : Gains
        See :func:`imapper_prob.sampling.gains.gains_of`.
    similarity : (L, L) float
        Probabilities of exchanging one scenelet for another.
    visits : Visits

    Returns
    -------
    Reference
    """
    kinds = furniture_kinds(problem)
    numbers = {kind: number for number, kind in enumerate(sorted(set(kinds)), start=1)}
    lengths = problem.lengths
    own = np.array([numbers[kind] for kind in kinds])
    frames_left = frames_left_of(problem)
    fitting, by_length = (
        (lengths[:, None] <= frames_left).sum(0),
        np.argsort(lengths, kind="stable"),
    )
    camera_mean, covariance = np.array(problem.camera_mean), camera_covariance(visits)
    if covariance is None:
        covariance = np.linalg.inv(problem.camera_precision).astype(np.float64)
    else:
        camera_mean = visits.arrays()["cameras"].mean(0)
    camera_factor = np.linalg.cholesky(covariance).astype(np.float64)
    followed, later = _rows(visits, own, lengths, frames_left, len(numbers) + 1)
    # A scenelet replaces itself as often as the one most similar to it.
    alike = np.array(similarity)
    np.fill_diagonal(alike, alike.max(1))
    sums = np.cumsum(alike[:, by_length], 1)
    path, yaw = _expectations(problem, visits)
    sizes = visits.arrays()["where"][:, 3]
    ends = np.stack([problem.joint_first[:-1], problem.joint_first[1:] - 1], -1)
    reference = Reference(
        camera_mean=camera_mean,
        camera_factor=camera_factor,
        camera_constant=_log_peak(camera_factor),
        library_camera=np.array(problem.camera_mean),
        kinds=own,
        lengths=np.array(lengths),
        pelvis=np.ascontiguousarray(problem.joints[ends, PELV]),
        frames_left=frames_left,
        path=path,
        yaw=yaw,
        size=float(sizes.mean()) if len(sizes) else 0.0,
        scenelet_deviations=np.zeros((len(lengths), 2, 4)),
        start_deviations=np.zeros((problem.n_frames, len(lengths), 4), np.float32),
        rarely_visited=np.zeros(len(lengths), np.int64),
        weights=_INITIAL_WEIGHTS,
        **_fields(followed, later, fitting, sums),
        similar_to=np.ascontiguousarray(alike.T),
        similar_sums=sums,
        hazard=np.zeros(len(frames_left)),
        survival=np.zeros(len(frames_left)),
        fitting=np.zeros((len(frames_left), len(lengths))),
        fitting_sums=np.zeros((len(frames_left), len(lengths))),
        fitting_kinds=np.zeros((len(frames_left), len(numbers) + 1)),
        n_fitting_starts=np.append(fitting[::-1].cumsum()[::-1], 0),
        by_length=by_length,
        anywhere_mean=np.array(problem.start_mean),
        anywhere_deviation=np.sqrt(problem.start_variance),
        size_spread=float(problem.size_spread),
        displacement_regression=np.zeros((2, 4, 4)),
        camera_regression=np.zeros((3, 4, 5)),
        factors=np.tile(np.eye(4), (3, 2, 1, 1)),
        constants=np.zeros((3, 2)),
    )
    deviations = _scenelet_deviations(reference, visits, alike)
    reference = reference._replace(
        scenelet_deviations=deviations.mean,
        rarely_visited=deviations.rarely_visited,
    )
    reference = reference._replace(
        start_deviations=_start_deviations(reference, visits, gains.sizes)
    )
    sequences = sequences_of(problem, gains_about(problem, gains.values, reference))
    of_kind = np.eye(len(numbers) + 1)[own]
    of_kind[:, 0] = 1.0
    reference = reference._replace(
        hazard=sequences.hazard,
        survival=sequences.survival,
        fitting=sequences.scenelets,
        fitting_sums=np.cumsum(sequences.scenelets, 1),
        fitting_kinds=sequences.scenelets @ of_kind,
    )
    reference = reference._replace(weights=_component_weights(reference, visits))
    of_before, of_camera, factors = _scatter(reference, visits, deviations.spread, covariance)
    peaks = np.array([[_log_peak(factor, yaw=True) for factor in row] for row in factors])
    return reference._replace(
        displacement_regression=of_before,
        camera_regression=of_camera,
        factors=factors,
        constants=peaks,
    )


def _log_peak(factor: Array, *, yaw: bool = False) -> float:
    """Log density of a t distribution at its centre; with ``yaw``, the third coordinate is
    truncated to half a turn either way."""
    n = len(factor)
    log_peak = math.lgamma(0.5 * (DOF + n)) - math.lgamma(0.5 * DOF)
    log_peak -= 0.5 * n * math.log(DOF * math.pi) + float(np.log(np.diag(factor)).sum())
    if yaw:
        deviation = float(np.linalg.norm(factor[2]))
        log_peak -= math.log(2.0 * float(stats.t.cdf(math.pi / deviation, DOF)) - 1.0)
    return log_peak


Rows = tuple[Ints, Ints, Array]


def _fields(followed: Rows, later: Rows, fitting: Ints, sums: Array) -> dict[str, Any]:
    """Rows as fields of a reference.

    ``fitting`` is the number of scenelets that fit at each frame, ``sums`` the reference's
    ``similar_sums``.
    """
    names = ("first", "", "probability")
    _, codes, probability = later
    starts, scenelets = np.divmod(codes, len(sums))
    totals = sums[scenelets, np.maximum(fitting[starts], 1) - 1]
    similar = np.where(starts == len(fitting) - 1, 0.0, probability / totals)
    return {"later_similar": similar} | {
        "_".join(filter(None, (of, name))): values
        for of, rows in (("followed", followed), ("later", later))
        for name, values in zip(names, rows, strict=True)
    }


def _component_weights(reference: Reference, visits: Visits) -> Array:
    """Weights of the components that best predict one half of the visits from the other, by EM.

    Visits come chain by chain, so the halves are from different chains.
    """
    halves = visits.halves()
    if min(half.n_states for half in halves) == 0:
        return _INITIAL_WEIGHTS
    halves_predicted = []
    for known, other in (halves, halves[::-1]):
        followed, later = _rows(
            known,
            reference.kinds,
            reference.lengths,
            reference.frames_left,
            int(reference.kinds.max()) + 1,
        )
        visited = other.arrays()
        counts = visited["counts"]
        some = np.arange(len(counts)) % max(1, len(counts) // _PREDICTED) == 0
        rows = _fields(
            followed, later, -np.diff(reference.n_fitting_starts), reference.similar_sums
        )
        of_half = reference._replace(**rows)
        halves_predicted.append((of_half, counts[some], visited["items"][np.repeat(some, counts)]))
    weights = _INITIAL_WEIGHTS
    for _ in range(_ROUNDS):
        joint = np.concatenate(
            [
                component_probabilities(of._replace(weights=weights), counts, items)
                for of, counts, items in halves_predicted
            ]
        )
        before, weights = weights, (joint / joint.sum(1, keepdims=True)).mean(0)
        if np.abs(weights - before).max() < _SETTLED:
            break
    return _KEPT * _INITIAL_WEIGHTS + (1.0 - _KEPT) * weights


def _rows(
    visits: Visits, kinds: Ints, lengths: Ints, frames_left: Ints, n_kinds: int
) -> tuple[Rows, Rows]:
    """Rows of what followed (by kind and end of the scenelet before) and of what came later (by
    frame)."""
    n_scenelets, n_frames = len(kinds), len(frames_left) - 1
    visited = visits.arrays()
    items, counts = visited["items"], visited["counts"]
    ends = np.cumsum(counts + 1)  # for each state its scenelets and the end of the scene
    codes = np.full(len(items) + len(counts), n_frames * n_scenelets)
    inside = np.ones(len(codes), bool)
    inside[ends - 1] = False
    codes[inside] = items[:, 1] * n_scenelets + items[:, 0]
    # Of what comes before: the kind, the frame after the last one, and that after the first one.
    kind, end, begun = np.zeros((3, len(codes)), np.int64)
    after_item = np.flatnonzero(inside) + 1
    kind[after_item] = kinds[items[:, 0]]
    end[after_item] = items[:, 1] + lengths[items[:, 0]]
    begun[after_item] = items[:, 1] + 1
    followed = _followed(*_counted(kind, end, codes), lengths, frames_left)
    later = _later(*_counted(codes, begun), lengths, frames_left)
    return _rows_of(followed, n_kinds * (n_frames + 1)), _rows_of(later, n_frames + 1)


def _counted(*columns: Ints) -> tuple[tuple[Ints, ...], Array]:
    """Distinct rows of columns of integers from 0 on, in ascending order, and how often each
    occurs."""
    # Numbers instead of rows, because these take three times as long.
    base = tuple(int(column.max(initial=0)) + 1 for column in columns)
    met, times = np.unique(np.ravel_multi_index(columns, base), return_counts=True)
    return np.unravel_index(met, base), times.astype(np.float64)


Entries = list[tuple[Ints, Ints, Array]]


def _followed(met: tuple[Ints, ...], weight: Array, lengths: Ints, frames_left: Ints) -> Entries:
    """Entries (row, code, weight) by kind and end of the scenelet before, smoothed in time."""
    kind, end_before, code = met
    n_frames = len(frames_left) - 1
    start, scenelet = np.divmod(code, len(lengths))
    ending = start == n_frames
    flush = ~ending & (start == end_before) & (kind > 0)
    entries: Entries = []
    for by, share in _SHIFTS.items():
        end = end_before + np.where(kind > 0, by, 0)
        sound = (end >= 0) & (end <= n_frames)
        row = kind * (n_frames + 1) + end
        last = sound & ending
        parts = [(row[last], code[last], share * weight[last])]
        _add(parts, row, end, scenelet, share * weight, sound & flush, lengths, frames_left)
        for off, part in _SHIFTS.items():
            where = sound & ~flush & ~ending & (start + off >= end)
            _add(
                parts,
                row,
                start + off,
                scenelet,
                share * part * weight,
                where,
                lengths,
                frames_left,
            )
        entries.append(_merged(parts))
    return entries


def _later(met: tuple[Ints, ...], weight: Array, lengths: Ints, frames_left: Ints) -> Entries:
    """Entries (frame, code, weight) for each frame from ``begun`` up to the start of the code,
    smoothed in time."""
    code, begun = met
    n_frames = len(frames_left) - 1
    start, scenelet = np.divmod(code, len(lengths))
    # The same code counts in each frame as often as it was met with an earlier ``begun``.
    first = np.flatnonzero(np.diff(code, prepend=-1))
    sums = weight.cumsum()
    sums -= np.repeat((sums - weight)[first], np.diff(first, append=len(code)))
    until = np.append(begun[1:], 0)
    until[np.append(first[1:], len(code)) - 1] = n_frames + 1
    entries: Entries = []
    for by, share in _SHIFTS.items():
        begins = np.where(start == n_frames, n_frames, start + by)
        fits = (begins >= 0) & (begins <= n_frames)
        fits &= (start == n_frames) | (lengths[scenelet] <= frames_left[begins.clip(0, n_frames)])
        span = np.where(fits, np.minimum(until, begins + 1) - begun, 0).clip(0)
        of = np.repeat(np.arange(len(code)), span)
        frame = np.arange(len(of)) - np.repeat(span.cumsum() - span, span) + begun[of]
        shifted = np.where(start == n_frames, code, begins * len(lengths) + scenelet)
        entries.append((frame, shifted[of], share * sums[of]))
    return entries


def _add(
    entries: Entries,
    row: Ints,
    start: Ints,
    scenelet: Ints,
    weight: Array,
    sound: NDArray[np.bool_],
    lengths: Ints,
    frames_left: Ints,
) -> None:
    """Append entries (row, code, weight) for scenelets that fit before the end of their frames."""
    n_frames = len(frames_left) - 1
    fits = sound & (start >= 0) & (start < n_frames)
    fits &= lengths[scenelet] <= frames_left[start.clip(0, n_frames)]
    codes = start * len(lengths) + scenelet
    entries.append((row[fits], codes[fits], weight[fits]))


def _merged(entries: Entries) -> tuple[Ints, Ints, Array]:
    """Entries by row, each code once, with the sum of its weights."""
    row, code, weight = (np.concatenate(parts) for parts in zip(*entries, strict=True))
    base = int(code.max(initial=0)) + 1
    number = row * base + code
    # Entries come in long ascending runs, which a stable sort merges.
    order = np.argsort(number, kind="stable")
    number = number[order]
    begins = np.diff(number, prepend=-1) > 0
    total = np.bincount(begins.cumsum() - 1, weight[order]).astype(np.float64)
    return number[begins] // base, number[begins] % base, total


def _rows_of(entries: Entries, n_rows: int) -> Rows:
    """Rows of probabilities that sum to one in each row."""
    row, code, total = _merged(entries)
    by_row = np.bincount(row, total, n_rows)
    first = np.searchsorted(row, np.arange(n_rows + 1)).astype(np.int64)
    return first, code, total / by_row[row]


@compiled
def _pelvis_by_frame(
    problem: Problem, cameras: Array, items: Ints, places: Array, sizes: Array, every: int
) -> Array:
    """(T, 3) sums over scenelets of the bearing and log depth of their pelvis in each frame,
    transformed from their cameras (R, 5) to the mean one, and the number of scenelets.

    Of each scenelet every ``every``-th frame counts, from a different one on in the next one."""
    sums = np.zeros((len(problem.lift), 3))
    where = np.empty(4)
    for k in range(len(items)):
        scenelet, start = items[k]
        body = math.exp(cameras[k, 3] + sizes[k])
        c, s = body * math.cos(places[k, 2]), body * math.sin(places[k, 2])
        first = problem.joint_first[scenelet]
        for n in range(first + k % every, problem.joint_first[scenelet + 1], every):
            x, y, height = problem.joints[n, PELV]
            x, y = places[k, 0] + c * x - s * y, places[k, 1] + s * x + c * y
            if y <= 0.0:
                continue
            where[0], where[1] = x / y, math.log(y)
            where[2], where[3] = places[k, 2], sizes[k]
            reproject_pelvis(height, where, cameras[k], problem.camera_mean)
            sums[start + n - first, 0] += where[0]
            sums[start + n - first, 1] += where[1]
            sums[start + n - first, 2] += 1.0
    return sums


@compiled
def _expected_yaws(problem: Problem, frames_left: Ints, yaws: Array) -> None:
    """Write to ``yaws`` (T, L) the yaw at which a scenelet with a given start faces as the static
    path."""
    for scenelet in range(yaws.shape[1]):
        length = problem.joint_first[scenelet + 1] - problem.joint_first[scenelet]
        for start in range(len(yaws)):
            if length <= frames_left[start]:
                along, aside = expected_facing(problem, scenelet, start)
                yaws[start, scenelet] = math.atan2(aside, along)


def _smoothed(sums: Array, weights: Array) -> Array:
    """(T, ...) kernel-weighted means over neighbouring frames, shrunk to 0 where there are no
    visits."""
    dt = np.arange(1 - len(sums), len(sums))
    kernel = (1.0 + (dt / _NEAR) ** 2) ** -2
    total = fftconvolve(sums, kernel[:, None], "same", axes=0)
    weight = fftconvolve(weights, kernel, "same")
    mean: Array = total / (np.maximum(weight, 0.0) + _PSEUDO_VISITS[0])[:, None]
    return mean


def _expectations(problem: Problem, visits: Visits) -> tuple[Array, Array]:
    """Mean path (T, 2), and mean yaws (T, L) by start, from visits of all scenelets."""
    visited = visits.arrays()
    items, (places, sizes) = visited["items"], to_floor(visited["where"])
    scenelet, start = items.T
    cameras = np.repeat(visited["cameras"], visited["counts"], axis=0)
    every = 1 + len(items) // _ALL_FRAMES
    sums = _pelvis_by_frame(problem, cameras, items, places, sizes, every)
    static = static_pelvis_on_floor(problem)
    path = static + _smoothed(sums[:, :2] - static * sums[:, 2:], sums[:, 2])
    yaws = np.zeros((problem.n_frames, len(problem.lengths)))
    _expected_yaws(problem, frames_left_of(problem), yaws)
    middle = start + problem.lengths[scenelet] // 2
    turn = visited["where"][:, 2] - yaws[start, scenelet]
    seen: Array = np.stack(
        [np.bincount(middle, f(turn), problem.n_frames) for f in (np.cos, np.sin)], -1
    ).astype(np.float64)
    number = np.bincount(middle, minlength=problem.n_frames).astype(np.float64)
    along, aside = _smoothed(seen, number).T
    middles = np.arange(problem.n_frames)[:, None] + problem.lengths // 2
    yaws += np.arctan2(aside, along)[middles.clip(0, problem.n_frames - 1)]
    return path, yaws


def _sums(index: Ints, values: Array, n: int) -> Array:
    """(n, K) sums of the rows of ``values`` (M, K) with the same ``index`` (M,)."""
    columns = [np.bincount(index, column, n) for column in values.T]
    return np.stack(columns, -1).astype(np.float64)


class _SceneletDeviations(NamedTuple):
    """Mean deviation of each scenelet from the others, in its first and its last frame.

    Parameters
    ----------
    mean : (L, 2, 4) float
    rarely_visited : (L,) int
        1 for scenelets with too few visits of their own.
    spread : (4, 4) float
        Covariance of the unknown deviation of these, in addition to the scatter.
    """

    mean: Array
    rarely_visited: Ints
    spread: Array


def _scenelet_deviations(reference: Reference, visits: Visits, alike: Array) -> _SceneletDeviations:
    visited = visits.arrays()
    places, sizes = to_floor(visited["where"])
    scenelet = visited["items"][:, 0]
    offsets = mean_offsets(
        reference, visited["cameras"], visited["counts"], visited["items"], places, sizes
    ).reshape(-1, 8)
    sound = np.isfinite(offsets).all(1)
    number = np.bincount(scenelet[sound], minlength=len(alike)).astype(np.float64)
    total = _sums(scenelet[sound], offsets[sound], len(alike))
    weights = alike / alike.max(1)[:, None]
    np.fill_diagonal(weights, 0.0)
    similar = weights @ total / (weights @ number + _PSEUDO_VISITS[1])[:, None]
    mean = (total + _PSEUDO_VISITS[1] * similar) / (number + _PSEUDO_VISITS[1])[:, None]
    known = number >= _PSEUDO_VISITS[1]
    off = (total[known] / number[known, None] - similar[known])[:, :4]
    spread = (_COVARIANCE_SCENELETS * _PRIOR_COVARIANCE + off.T @ off) / (
        _COVARIANCE_SCENELETS + len(off)
    )
    return _SceneletDeviations(mean.reshape(-1, 2, 4), (~known).astype(np.int64), spread)


def _start_deviations(
    reference: Reference, visits: Visits, fitted_sizes: Array
) -> NDArray[np.float32]:
    """(T, L, 4) mean deviations of visits of each scenelet with nearly each start.

    They are shrunk to 0, sizes to a multiple of those that fit the detections at the static path.
    """
    visited = visits.arrays()
    places, sizes = to_floor(visited["where"])
    offsets = mean_offsets(
        reference, visited["cameras"], visited["counts"], visited["items"], places, sizes
    )[:, 0]
    sound = np.isfinite(offsets).all(1)
    offsets = offsets[sound]
    scenelet, start = visited["items"][sound].T
    fitted = fitted_sizes[start, scenelet]
    pseudo = _COVARIANCE_VISITS * _PRIOR_COVARIANCE[3, 3]
    slope = (fitted @ offsets[:, 3] + pseudo) / (fitted @ fitted + pseudo)
    offsets[:, 3] -= slope * fitted
    last = len(reference.path) - 1
    shape = (last + 1, len(reference.lengths))
    counted = np.column_stack([offsets, np.ones(len(offsets))])
    sums = np.zeros((math.prod(shape), 5))
    for by, share in _SHIFTS.items():
        at = np.ravel_multi_index(((start + by).clip(0, last), scenelet), shape)
        sums += share * _sums(at, counted, len(sums))
    mean = sums[:, :4] / (sums[:, 4:] + _PSEUDO_VISITS[1])
    mean[:, 3] += slope * fitted_sizes.ravel()
    deviations: NDArray[np.float32] = mean.reshape(*shape, 4).astype(np.float32)
    return deviations


def _scatter(
    reference: Reference, visits: Visits, spread: Array, of_cameras: Array
) -> tuple[Array, Array, Array]:
    """Regressions of displacements on earlier ones (2, 4, 4) and on cameras (3, 4, 5) of given
    covariance, and Cholesky factors (3, 2, 4, 4) of what remains."""
    visited = visits.arrays()
    places, sizes = to_floor(visited["where"])
    rows, before, offsets = displacements(
        reference, visited["cameras"], visited["counts"], visited["items"], places, sizes
    )
    cameras = np.repeat(visited["cameras"] - reference.camera_mean, visited["counts"], axis=0)
    known = reference.rarely_visited[visited["items"][:, 0]] == 0
    of_before, of_camera, factors = np.zeros((2, 4, 4)), np.zeros((3, 4, 5)), np.empty((3, 2, 4, 4))
    ridge = _COVARIANCE_VISITS * block_diag(_PRIOR_COVARIANCE, of_cameras)
    for row, prior in (
        (FIRST, _PRIOR_COVARIANCE),
        (FLUSH, _PRIOR_FLUSH_COVARIANCE),
        (GAP, _PRIOR_COVARIANCE),
    ):
        of_row = known & (rows == row)
        x, y = np.hstack([before[of_row], cameras[of_row]]), offsets[of_row]
        by = np.linalg.solve(x.T @ x + ridge, x.T @ y).T
        y = y - x @ by.T
        of_camera[row] = by[:, 4:]
        beyond = np.array(spread)
        if row != FIRST:
            of_before[row - 1] = by[:, :4]
        if row == FLUSH:
            beyond[:2], beyond[:, :2] = 0.0, 0.0
        scatter = (_COVARIANCE_VISITS * prior + y.T @ y) / (_COVARIANCE_VISITS + len(y))
        factors[row] = np.linalg.cholesky(np.stack([scatter, scatter + beyond]))
    return of_before, of_camera, factors
