"""The reference: a distribution of scenes, learnt from visits, that can be sampled directly.

It takes the place of the prior in tempering (Surjanovic, Syed, Bouchard-Côté & Campbell 2022,
NeurIPS): at inverse temperature beta chains sample reference^(1 - beta) posterior^beta. At beta = 0
scenes are drawn independently, so each replica that travels from there to the posterior brings an
independent scene. The quality of the reference affects only the speed of mixing, not the result.

A scene is drawn as follows.

1. Camera and body come from a multivariate t distribution with mean and covariance of the visits.
2. Scenelets are drawn one after another in time, as a semi-Markov chain. The next scenelet comes
   from a mixture: what followed furniture of the same kind that ended at about this frame
   (*followed*), whatever came next after this frame (*later*), a scenelet of similar motion instead
   of that (*similar*), one that explains the detections well (*fitting*,
   :mod:`imapper_prob.sampling.gains`), one of these that begins in this frame, often with furniture
   of the same kind (*adjoining*), and any scenelet at any start (*anywhere*). Each component but
   *adjoining* may end the scene. The shares of the components are those that best predict one half
   of the visits from the other.
3. The placement of a scenelet is given by the position of the pelvis in its first frame, in camera
   coordinates (:mod:`imapper_prob.models.view`). The visits of all scenelets determine the mean
   position in each frame; a displacement from it is drawn. A scenelet that begins where the one
   before it ends continues from its last pelvis. After a gap it has a part of the displacement of
   the one before, because the error of the path persists. Yaw and size are about those of visits
   of this scenelet and of similar ones. Means are transformed to the drawn camera
   (:mod:`imapper_prob.sampling.looks`). With a small probability the placement comes from the
   prior.
4. The latent variables of the path have their normal distribution, which the densities here do not
   include.

All densities are normalised over the scenes in which scenelets begin ahead of the camera.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.view import floor_point, log_area, seen_point
from imapper_prob.sampling.jit import compiled
from imapper_prob.sampling.looks import look, stand

__all__ = [
    "ADJOINING",
    "ANYWHERE",
    "ASTRAY",
    "COMPONENTS",
    "DOF",
    "ENDS",
    "FIRST",
    "FITTING",
    "FLUSH",
    "FOLLOWED",
    "GAP",
    "SAME_KIND",
    "SIMILAR",
    "START",
    "Reference",
    "carried",
    "displacements",
    "expected",
    "foretell",
    "leaves",
    "log_reference",
    "log_stretch",
    "next_probability",
    "shares_after",
    "usual_offsets",
]  # fmt: skip

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

START: Final[Any] = np.int64(0)
"""Index of the first scenelet. It is an int64, because numba compiles callers anew for a
literal."""
ENDS: Final = 0.2
"""Probability that the components fitting and anywhere end the scene; chosen."""
SAME_KIND: Final = 0.75
"""Probability that an adjoining scenelet has furniture of the kind of the one before; chosen."""
ASTRAY: Final = 0.05
"""Probability that a placement comes from the prior; chosen."""
DOF: Final = 5.0
"""Degrees of freedom for camera and placements: heavy tails for unvisited values; chosen."""
COMPONENTS: Final = 6
FOLLOWED, _LATER, SIMILAR, FITTING, ANYWHERE, ADJOINING = range(COMPONENTS)
"""Components of the mixture."""
FIRST, FLUSH, GAP = range(3)
"""Rows of the displacement factors: the first scenelet, one that begins where the one before it
ends, and one that begins later."""


class Reference(NamedTuple):
    """A distribution of scenes of L scenelets in T frames.

    The *code* of a next scenelet is start L + scenelet; the code of the end of the scene is T L.
    Rows hold codes in ascending order with their probabilities.

    Parameters
    ----------
    camera_mean, camera_factor : (5,), (5, 5) float
        Mean, and lower Cholesky factor of the scale matrix.
    camera_constant : float
        Log density at the mean, nats.
    library_camera : (5,) float
        Camera for which ``path`` holds.
    kinds, lengths : (L,) int
        Kind of furniture, from 1 (0 is the beginning of the scene), and number of frames.
    pelvis : (L, 2, 3) float
        Pelvis in the first and last frame, local frame, metres of the reference body.
    room : (T + 1,) int
        Number of frames from each frame to the end of its person's frames.
    path : (T, 2) float
        Mean bearing and log depth of the pelvis in each frame.
    yaw : (T, L) float
        Mean yaw of each scenelet by its start, radians.
    size : float
        Mean log size.
    habits : (L, 2, 4) float
        Deviation of each scenelet from these means in its first and in its last frame: bearing, log
        depth, yaw, log size.
    strange : (L,) int
        1 for scenelets with too few visits of their own.
    shares : (6,) float
        Shares of the mixture's components: followed, later, similar, fitting, anywhere,
        adjoining.
    followed_first, followed, followed_probability : (K (T + 1) + 1,), (E,), (E,)
        Rows by kind, then by the frame at which the scenelet before ended.
    later_first, later, later_probability : (T + 2,), (F,), (F,)
        Rows by that frame only.
    similarity : (L, L) float
        Weights for replacing each scenelet by each other one or itself, not normalised by row.
    alike : (L, N + 1) float
        Sums of these rows over scenelets of at most n frames, up to the longest.
    hazard, survival, fitting : (T + 1,), (T + 1,), (T + 1, L) float
        Sequences by gains, see :class:`imapper_prob.sampling.gains.Sequences`.
    fitting_kinds : (T + 1, K) float
        Sums of these over the scenelets of each kind, and over all in the first column; 0 where
        nothing fits.
    openings : (T + 2,) int
        Number of pairs of scenelet and start, from each frame on, that fit.
    by_length : (L,) int
        Scenelets in order of length.
    anywhere_mean, anywhere_deviation : (2,) float
        Mean and standard deviation of bearing and log depth in the prior.
    size_spread : float
        Prior standard deviation of the log size.
    onward : (2, 4, 4) float
        Regression of a displacement on that of the scenelet before, adjoining or after a gap.
    factors, constants : (3, 2, 4, 4), (3, 2) float
        Lower Cholesky factors of displacements, and log densities at their centres; the second
        column is for scenelets with too few visits.
    """

    camera_mean: Array
    camera_factor: Array
    camera_constant: float
    library_camera: Array
    kinds: Ints
    lengths: Ints
    pelvis: Array
    room: Ints
    path: Array
    yaw: Array
    size: float
    habits: Array
    strange: Ints
    shares: Array
    followed_first: Ints
    followed: Ints
    followed_probability: Array
    later_first: Ints
    later: Ints
    later_probability: Array
    similarity: Array
    alike: Array
    hazard: Array
    survival: Array
    fitting: Array
    fitting_kinds: Array
    openings: Ints
    by_length: Ints
    anywhere_mean: Array
    anywhere_deviation: Array
    size_spread: float
    onward: Array
    factors: Array
    constants: Array


# ------------------------------------------------------------------------------------------------
# The density, compiled.


@compiled
def carried(height: float, where: Array, before: Array, after: Array) -> Array:
    """Transform a position to another camera so that it looks the same; unchanged if impossible.

    See :mod:`imapper_prob.sampling.looks`.

    Parameters
    ----------
    height : float
        Height of the pelvis, metres of the reference body.
    where : (4,) float
        Bearing, log depth, yaw, log size.
    before : (5,) float
        Camera parameters.
    after : (5,) float
        Camera parameters.

    Returns
    -------
    (4,) float
        Bearing, log depth, yaw, log size.
    """
    x, y = floor_point(where[0], where[1])
    x, y, size = stand(after, look(before, x, y, where[3], height), height)
    if math.isnan(size):
        return where.copy()
    there = np.empty(4)
    there[0], there[1] = seen_point(x, y)
    there[2], there[3] = where[2], size
    return there


@compiled
def _find(codes: Ints, first: int, last: int, code: int) -> int:
    """Index of a code in a row; -1 if it is absent."""
    at = int(first + np.searchsorted(codes[first:last], code))
    return at if at < last and codes[at] == code else -1


@compiled
def _log_t(offset: Array, factor: Array, constant: float) -> float:
    """Log density of a multivariate t distribution at an offset from its centre."""
    n, square = len(offset), 0.0
    z = np.empty(n)
    for i in range(n):
        z[i] = offset[i]
        for j in range(i):
            z[i] -= factor[i, j] * z[j]
        z[i] /= factor[i, i]
        square += z[i] * z[i]
    return constant - 0.5 * (DOF + n) * math.log1p(square / DOF)


@compiled
def _turned(offset: Array) -> None:
    """Wrap the yaw of an offset to half a turn either way, in place."""
    offset[2] -= 2.0 * math.pi * math.floor(offset[2] / (2.0 * math.pi) + 0.5)


@compiled
def shares_after(reference: Reference, kind: int, end: int, shares: Array) -> None:
    """Shares of the mixture after a scenelet of a given kind that ended at a given frame.

    Parameters
    ----------
    reference : Reference
    kind : int
        Kind of the scenelet before, 0 at the beginning.
    end : int
        Frame after its last one.
    shares : (6,) float
        Output.
    """
    shares[:] = reference.shares
    if kind == 0 or reference.fitting_kinds[end, 0] == 0.0:
        shares[FITTING], shares[ADJOINING] = shares[FITTING] + shares[ADJOINING], 0.0
    row = kind * len(reference.room) + end
    if reference.followed_first[row] == reference.followed_first[row + 1]:
        shares[_LATER], shares[FOLLOWED] = shares[_LATER] + shares[FOLLOWED], 0.0
    if reference.later_first[end] == reference.later_first[end + 1]:
        shares[ANYWHERE] += shares[_LATER] + shares[SIMILAR]
        shares[_LATER], shares[SIMILAR] = 0.0, 0.0


@compiled
def _begins(reference: Reference, end: int, start: int) -> float:
    """Probability that the first fitting one from frame ``end`` on begins at ``start``; the end of
    the clip stands for none."""
    none = math.exp(reference.survival[start] - reference.survival[end])
    return none * reference.hazard[start] if start < len(reference.room) - 1 else none


@compiled
def _at_start(reference: Reference, end: int, start: int) -> tuple[int, int]:
    """Range of the later row whose codes have a given start: first index, and index after the
    last."""
    first, last = reference.later_first[end], reference.later_first[end + 1]
    n_scenelets = len(reference.kinds)
    row = reference.later[first:last]
    begin = first + np.searchsorted(row, start * n_scenelets)
    return int(begin), int(first + np.searchsorted(row, (start + 1) * n_scenelets))


@compiled
def _replaced(reference: Reference, at: int, scenelet: int) -> float:
    """Probability that an entry of the later rows is replaced by a scenelet that fits there."""
    n_scenelets = len(reference.kinds)
    start, other = reference.later[at] // n_scenelets, reference.later[at] % n_scenelets
    most = min(reference.room[start], reference.alike.shape[1] - 1)
    return float(reference.similarity[other, scenelet] / reference.alike[other, most])


@compiled
def _adjoins(reference: Reference, kind: int, end: int, scenelet: int) -> float:
    """Probability of a scenelet that adjoins one of a given kind."""
    of_kind = reference.fitting_kinds[end, kind]
    same = SAME_KIND if of_kind > 0.0 else 0.0
    total = 1.0 - same
    if same > 0.0 and reference.kinds[scenelet] == kind:
        total += same / of_kind
    return float(total * reference.fitting[end, scenelet])


@compiled
def next_probability(
    reference: Reference, kind: int, end: int, code: int, probability: Array
) -> None:
    """Probability of the next scenelet or the end, by component of the mixture.

    Parameters
    ----------
    reference : Reference
    kind, end : int
        Kind of the scenelet before (0 at the beginning), and the frame after its last one.
    code : int
        Code of what comes next.
    probability : (6,) float
        Output; the sum is the probability under the mixture.
    """
    shares_after(reference, kind, end, probability)
    n_scenelets, n_frames = len(reference.kinds), len(reference.room) - 1
    row = kind * (n_frames + 1) + end
    at = _find(
        reference.followed, reference.followed_first[row], reference.followed_first[row + 1], code
    )
    probability[FOLLOWED] *= reference.followed_probability[at] if at >= 0 else 0.0
    at = _find(reference.later, reference.later_first[end], reference.later_first[end + 1], code)
    met = reference.later_probability[at] if at >= 0 else 0.0
    probability[_LATER] *= met
    openings = reference.openings[end]
    if code == n_frames * n_scenelets:
        none = _begins(reference, end, n_frames)
        probability[SIMILAR] *= met
        probability[FITTING] *= ENDS + (1.0 - ENDS) * none
        probability[ANYWHERE] *= ENDS if openings > 0 else 1.0
        probability[ADJOINING] = 0.0
        return
    start, scenelet = code // n_scenelets, code % n_scenelets
    if start < end or reference.lengths[scenelet] > reference.room[start]:
        probability[:] = 0.0
        return
    alike, (first, last) = 0.0, _at_start(reference, end, start)
    for at in range(first, last):
        alike += reference.later_probability[at] * _replaced(reference, at, scenelet)
    probability[SIMILAR] *= alike
    begins = _begins(reference, end, start) if reference.fitting[start, scenelet] > 0.0 else 0.0
    probability[FITTING] *= (1.0 - ENDS) * begins * reference.fitting[start, scenelet]
    probability[ANYWHERE] *= (1.0 - ENDS) / openings
    probability[ADJOINING] *= _adjoins(reference, kind, end, scenelet) if start == end else 0.0


@compiled
def foretell(reference: Reference, counts: Ints, items: Ints) -> Array:
    """Probability of each scenelet of N states, and of their ends, by component of the mixture.

    Parameters
    ----------
    reference : Reference
    counts : (N,) int
        Scenelets of each state.
    items : (R, 2) int

    Returns
    -------
    (R + N, 6) float
        See :func:`next_probability`.
    """
    n_scenelets = len(reference.kinds)
    found = np.empty((len(items) + len(counts), COMPONENTS))
    k = 0
    for n in range(len(counts)):
        kind, end = 0, 0
        for i in range(counts[n] + 1):
            code = (len(reference.room) - 1) * n_scenelets
            if i < counts[n]:
                code = items[k, 1] * n_scenelets + items[k, 0]
            next_probability(reference, kind, end, code, found[k + n])
            if i < counts[n]:
                kind, end = (
                    reference.kinds[items[k, 0]],
                    items[k, 1] + reference.lengths[items[k, 0]],
                )
                k += 1
    return found


@compiled
def _pelvis_of(
    reference: Reference, camera: Array, scenelet: int, last: int, place: Array, size: float
) -> Array:
    """Position of a scenelet's pelvis in its first (0) or last (1) frame; its log depth is NaN
    behind the camera."""
    body = math.exp(camera[3] + size)
    c, s = body * math.cos(place[2]), body * math.sin(place[2])
    local = reference.pelvis[scenelet, last]
    x, y = place[0] + c * local[0] - s * local[1], place[1] + s * local[0] + c * local[1]
    where = np.empty(4)
    where[0], where[1] = (x / y, math.log(y)) if y > 0.0 else (0.0, math.nan)
    where[2], where[3] = place[2], size
    return where


@compiled
def _usual(reference: Reference, camera: Array, scenelet: int, start: int, last: int) -> Array:
    """Mean position of a scenelet's pelvis over visits, transformed to a camera."""
    where = np.empty(4)
    frame = start + (reference.lengths[scenelet] - 1) * last
    where[0], where[1] = reference.path[frame]
    where[2], where[3] = reference.yaw[start, scenelet], reference.size
    where += reference.habits[scenelet, last]
    height = reference.pelvis[scenelet, last, 2]
    return carried(height, where, reference.library_camera, camera)


@compiled
def expected(
    reference: Reference, camera: Array, scenelet: int, start: int, end: int, before: Array
) -> tuple[int, Array]:
    """Centre of the distribution of a scenelet's pelvis in its first frame, and its factor's row.

    For a scenelet that adjoins the one before, the position continues from that one's last pelvis.

    Parameters
    ----------
    reference : Reference
    camera : (5,) float
    scenelet : int
    start : int
        Start frame.
    end : int
        Frame after the last of the scenelet before, -1 if there is none.
    before : (2, 4) float
        Pelvis of the scenelet before in its last frame, and its displacement from the mean.

    Returns
    -------
    row : int
        Row of the displacement factors.
    middle : (4,) float
        Bearing, log depth, yaw, log size.
    """
    middle = _usual(reference, camera, scenelet, start, 0)
    if end < 0:
        return FIRST, middle
    row = FLUSH if start == end else GAP
    if row == FLUSH:
        for i in range(2):
            step = reference.path[start, i] - reference.path[end - 1, i]
            middle[i] = before[0, i] + step
    middle += reference.onward[row - 1] @ before[1]
    return row, middle


@compiled
def leaves(
    reference: Reference,
    camera: Array,
    scenelet: int,
    start: int,
    place: Array,
    size: float,
    before: Array,
) -> int:
    """Write the last pelvis of a scenelet and its displacement to ``before``; returns its end.

    Parameters
    ----------
    reference : Reference
    camera : (5,) float
    scenelet : int
    start : int
        Start frame.
    place : (3,) float
    size : float
    before : (2, 4) float
        Output, see :func:`expected`.

    Returns
    -------
    int
        Frame after the last one; -1 if the pelvis is behind the camera.
    """
    before[0] = _pelvis_of(reference, camera, scenelet, 1, place, size)
    if math.isnan(before[0, 1]):
        return -1
    before[1] = before[0] - _usual(reference, camera, scenelet, start, 1)
    _turned(before[1])
    return int(start + reference.lengths[scenelet])


@compiled
def usual_offsets(
    reference: Reference, cameras: Array, counts: Ints, items: Ints, places: Array, sizes: Array
) -> Array:
    """Deviations of the scenelets of N states from their mean positions.

    Parameters
    ----------
    reference : Reference
    cameras, counts, items, places, sizes
        See :func:`displacements`.

    Returns
    -------
    (R, 2, 4) float
        In their first and last frames; NaN behind the camera.
    """
    offsets = np.empty((len(items), 2, 4))
    k = 0
    for n in range(len(counts)):
        for _ in range(counts[n]):
            scenelet, start = items[k]
            for last in range(2):
                where = _pelvis_of(reference, cameras[n], scenelet, last, places[k], sizes[k])
                offsets[k, last] = where - _usual(reference, cameras[n], scenelet, start, last)
                _turned(offsets[k, last])
            k += 1
    return offsets


@compiled
def displacements(
    reference: Reference, cameras: Array, counts: Ints, items: Ints, places: Array, sizes: Array
) -> tuple[Ints, Array, Array]:
    """Displacements of the scenelets of N states from their expected positions.

    Parameters
    ----------
    reference : Reference
    cameras : (N, 5) float
    counts : (N,) int
        Number of scenelets of each state.
    items : (R, 2) int
    places : (R, 3) float
    sizes : (R,) float

    Returns
    -------
    rows : (R,) int
        Row of the displacement factors; -1 behind the camera.
    before : (R, 4) float
        Displacement of the scenelet before in its last frame; 0 if there is none.
    offsets : (R, 4) float
        Displacement of each scenelet from its expected position.
    """
    rows, before, offsets = (
        np.empty(len(items), np.int64),
        np.zeros((2, 4)),
        np.zeros((len(items), 4)),
    )
    displaced = np.zeros((len(items), 4))
    k = 0
    for n in range(len(counts)):
        end = -1
        for _ in range(counts[n]):
            scenelet, start = items[k]
            where = _pelvis_of(reference, cameras[n], scenelet, 0, places[k], sizes[k])
            row, middle = expected(reference, cameras[n], scenelet, start, end, before)
            rows[k] = -1 if math.isnan(where[1]) else row
            if end >= 0:
                displaced[k] = before[1]
            offsets[k] = where - middle
            _turned(offsets[k])
            end = leaves(reference, cameras[n], scenelet, start, places[k], sizes[k], before)
            k += 1
    return rows, displaced, offsets


@compiled
def _log_anywhere(reference: Reference, where: Array) -> float:
    """Log density of a position under the prior."""
    total = -math.log(2.0 * math.pi) - 0.5 * (where[3] / reference.size_spread) ** 2
    total -= math.log(reference.size_spread) + 1.5 * math.log(2.0 * math.pi)
    for i in range(2):
        deviation = reference.anywhere_deviation[i]
        total -= 0.5 * ((where[i] - reference.anywhere_mean[i]) / deviation) ** 2
        total -= math.log(deviation)
    return float(total)


@compiled
def _stops(reference: Reference, kind: int, end: int, start: int) -> float:
    """Probability that nothing begins before ``start``; for the end of the clip, that the scene
    ends."""
    shares = np.empty(COMPONENTS)
    shares_after(reference, kind, end, shares)
    n_scenelets, n_frames = len(reference.kinds), len(reference.room) - 1
    code = start * n_scenelets
    row = kind * (n_frames + 1) + end
    first, last = reference.followed_first[row], reference.followed_first[row + 1]
    begin = first + np.searchsorted(reference.followed[first:last], code)
    followed = reference.followed_probability[begin:last].sum()
    first, last = reference.later_first[end], reference.later_first[end + 1]
    begin = first + np.searchsorted(reference.later[first:last], code)
    later = reference.later_probability[begin:last].sum()
    none = math.exp(reference.survival[start] - reference.survival[end])
    empty = 1.0
    if reference.openings[end] > 0:
        empty = ENDS + (1.0 - ENDS) * reference.openings[start] / reference.openings[end]
    total = shares[FOLLOWED] * followed + (shares[_LATER] + shares[SIMILAR]) * later
    total += shares[FITTING] * (ENDS + (1.0 - ENDS) * none) + shares[ANYWHERE] * empty
    if start == end:
        total += shares[ADJOINING]
    return float(total)


@compiled
def log_stretch(
    reference: Reference,
    camera: Array,
    items: Ints,
    placements: Array,
    sizes: Array,
    first: int,
    last: int,
) -> float:
    """Log density of consecutive scenelets of a scene, given the others and the camera.

    Scenelets are drawn one after the other until one begins no earlier than the scenelet after the
    run, or until the scene ends if there is none.

    Parameters
    ----------
    reference : Reference
    camera : (5,) float
    items : (k, 2) int
    placements : (k, 3) float
    sizes : (k,) float
    first, last : int
        Index of the first one, and the index after the last.

    Returns
    -------
    float
        Nats, per square metre, radian and unit of log size of each of them; -inf behind the
        camera, or where they overlap.
    """
    n_scenelets, n_frames = len(reference.kinds), len(reference.room) - 1
    probability, before = np.empty(COMPONENTS), np.empty((2, 4))
    kind, end, left, total = 0, 0, -1, 0.0
    for k in range(max(first - 1, 0), last):
        scenelet, start = items[k]
        if k >= first:
            where = _pelvis_of(reference, camera, scenelet, 0, placements[k], sizes[k])
            next_probability(reference, kind, end, start * n_scenelets + scenelet, probability)
            if math.isnan(where[1]) or probability[ANYWHERE] == 0.0:
                return -math.inf
            row, middle = expected(reference, camera, scenelet, start, left, before)
            offset = where - middle
            _turned(offset)
            new = reference.strange[scenelet]
            near = _log_t(offset, reference.factors[row, new], reference.constants[row, new])
            far = _log_anywhere(reference, where)
            most = max(near, far)
            density = (1.0 - ASTRAY) * math.exp(near - most) + ASTRAY * math.exp(far - most)
            total += math.log(probability.sum() * density) + most - log_area(where[1])
        left = leaves(reference, camera, scenelet, start, placements[k], sizes[k], before)
        kind, end = reference.kinds[scenelet], start + reference.lengths[scenelet]
    stop = items[last, 1] if last < len(items) else n_frames
    if end > stop:
        return -math.inf
    return float(total + math.log(_stops(reference, kind, end, stop)))


@compiled
def log_reference(
    reference: Reference, camera: Array, items: Ints, placements: Array, sizes: Array
) -> float:
    """Log density of a scene, without the latent variables.

    Parameters
    ----------
    reference : Reference
    camera : (5,) float
    items : (k, 2) int
    placements : (k, 3) float
    sizes : (k,) float

    Returns
    -------
    float
        Nats, per square metre, radian and unit of log size of each scenelet, and in the units
        of the camera; -inf behind the camera, or where scenelets overlap.
    """
    log_camera = _log_t(
        camera - reference.camera_mean, reference.camera_factor, reference.camera_constant
    )
    return log_camera + log_stretch(
        reference, camera, items, placements, sizes, START, len(items)
    )  # fmt: skip
