"""The reference: a distribution of scenes, learnt from visits, that is drawn from at once.

Chains are tempered towards it (Surjanovic, Syed, Bouchard-Côté & Campbell 2022, NeurIPS): at the
inverse temperature beta they sample reference^(1 - beta) posterior^beta. At beta = 0 a scene is
drawn that has nothing to do with the one before, so that each journey of a replica from there to
the posterior brings an independent scene. How good the reference is decides how fast chains mix,
and nothing else.

A scene is drawn as follows.

1. Camera and body from a multivariate t distribution with mean and covariance of the visits.
2. Scenelets one after another in time, a semi-Markov chain. What comes after a scenelet is drawn
   from a mixture: what followed upon furniture of its kind that ended about then (*followed*),
   whatever came next after that frame (*later*), one of similar motion in place of that
   (*similar*), the solver's candidates (*candidates*), and any scenelet at any start (*anywhere*).
   Each of them may end the scene. Their shares are those with which one half of the visits is best
   foretold by the other.
3. Where each one stands, by where the pelvis is in its first frame, as it looks
   (:mod:`imapper_prob.models.view`). All that was visited says where the person is in each frame,
   whatever the scenelet; what is drawn is a displacement from there. A scenelet that begins as
   the one before it ends goes on from its last pelvis; after a gap it is displaced in part as that
   one is, for the error of the path goes on. Yaw and size are about those of visits of the
   scenelet and of similar ones. Means are carried to the camera that was drawn
   (:mod:`imapper_prob.sampling.camera_moves`). Now and then one stands anywhere, as in the prior.
4. Latent numbers of the path from their normal distribution, which no density here includes.

All densities are normalised over the space of scenes in which scenelets begin ahead of the camera.
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
    "ANYWHERE", "ASTRAY", "CANDIDATE", "DOF", "ENDS", "FIRST", "FLUSH", "FOLLOWED", "GAP",
    "SIMILAR", "START", "Reference", "carried", "displacements", "expected", "foretell", "leaves",
    "log_reference", "log_stretch", "next_probability", "shares_after", "usual_offsets",
]  # fmt: skip

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

START: Final[Any] = np.int64(0)
"""The first scenelet of a scene. A plain number would have whatever takes it compiled once more."""
ENDS: Final = 0.2
"""Probability that candidates, or anywhere, end the scene; chosen."""
ASTRAY: Final = 0.05
"""Probability that a scenelet stands anywhere; chosen."""
DOF: Final = 5.0
"""Degrees of freedom of camera and places: tails for what was not visited yet; chosen."""
FOLLOWED, _LATER, SIMILAR, CANDIDATE, ANYWHERE = range(5)
"""Components of the mixture."""
FIRST, FLUSH, GAP = range(3)
"""Rows of the scatter of displacements: of a scenelet with none before it, of one that begins as
the one before it ends, and of one that begins later."""


class Reference(NamedTuple):
    """A distribution of scenes of L scenelets in T frames.

    What may come next has a *code*, start L + scenelet; the end of the scene has T L. Rows of
    what may come next hold codes in ascending order with their probabilities.

    Parameters
    ----------
    camera_mean, camera_factor : (5,), (5, 5) float
        And the lower Cholesky factor of the scale matrix.
    camera_constant : float
        Log density at the mean, nats.
    library_camera : (5,) float
        The camera in which the path below is.
    kinds, lengths : (L,) int
        Kind of furniture, from 1 on (0 is the beginning), and frames.
    pelvis : (L, 2, 3) float
        In its first and last frame, metres of the reference body, local frame.
    room : (T + 1,) int
        Frames from each to the end of its film.
    path : (T, 2) float
        Bearing and log depth of the pelvis in each frame.
    yaw : (T, L) float
        Of each scenelet by its start, radians.
    size : float
        Log size of their persons.
    habits : (L, 2, 4) float
        By how much each differs from that in its first and in its last frame: bearing, log depth,
        yaw, log size.
    strange : (L,) int
        1 for those that were not visited themselves.
    shares : (5,) float
        Of the components of the mixture: followed, later, similar, candidates, anywhere.
    followed_first, followed, followed_probability : (K (T + 1) + 1,), (E,), (E,)
        Rows by kind, then frame at which the scenelet before ended.
    later_first, later, later_probability : (T + 2,), (F,), (F,)
        Rows by that frame alone.
    similarity : (L, L) float
        How often each is replaced by each scenelet, itself included, up to a factor of the row.
    alike : (L, N + 1) float
        Sums of these rows over scenelets of no more than n frames, up to the longest.
    hazard : (T + 1,) float
        Probability that a candidate begins at a frame if none did before.
    survival : (T + 1,) float
        Log probability that none began before each frame.
    candidates : (T + 1, L) float
        Probability of each scenelet where a candidate begins.
    openings : (T + 2,) int
        How many scenelets at starts from each frame on fit into their films.
    by_length : (L,) int
        Scenelets, short ones first.
    anywhere_mean, anywhere_deviation : (2,) float
        Of bearing and log depth.
    size_spread : float
        Standard deviation of the log size anywhere.
    onward : (2, 4, 4) float
        How much of a displacement at its end the next scenelet has, flush with it or later.
    factors, constants : (3, 2, 4, 4), (3, 2) float
        Lower Cholesky factors of displacements, and log densities in their middles; of strange
        scenelets in the second column.
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
    candidates: Array
    openings: Ints
    by_length: Ints
    anywhere_mean: Array
    anywhere_deviation: Array
    size_spread: float
    onward: Array
    factors: Array
    constants: Array


# ------------------------------------------------------------------------------------------------
# Its density, compiled.


@compiled
def carried(height: float, where: Array, before: Array, after: Array) -> Array:
    """Where a scenelet looks through one camera as it did through another; as it is if nowhere.

    See :mod:`imapper_prob.sampling.looks`; ``height`` is that of the pelvis.

    Parameters
    ----------
    height : float
        Of the pelvis, metres of the reference body.
    where : (4,) float
        Bearing, log depth, yaw, log size.
    before : (5,) float
        Camera.
    after : (5,) float
        Camera.

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
    """Where a code is in a row; -1 where it is not."""
    at = int(first + np.searchsorted(codes[first:last], code))
    return at if at < last and codes[at] == code else -1


@compiled
def _log_t(offset: Array, factor: Array, constant: float) -> float:
    """Log density of a multivariate t distribution at an offset from its middle."""
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
    """Take the yaw of an offset within half a turn, in place."""
    offset[2] -= 2.0 * math.pi * math.floor(offset[2] / (2.0 * math.pi) + 0.5)


@compiled
def shares_after(reference: Reference, kind: int, end: int, shares: Array) -> None:
    """Shares of the mixture after a scenelet of a kind that ended at a frame.

    Parameters
    ----------
    reference : Reference
    kind : int
        Of the scenelet before, 0 at the beginning.
    end : int
        Frame after its last.
    shares : (5,) float
        Out.
    """
    shares[:] = reference.shares
    row = kind * len(reference.room) + end
    if reference.followed_first[row] == reference.followed_first[row + 1]:
        shares[_LATER], shares[FOLLOWED] = shares[_LATER] + shares[FOLLOWED], 0.0
    if reference.later_first[end] == reference.later_first[end + 1]:
        shares[ANYWHERE] += shares[_LATER] + shares[SIMILAR]
        shares[_LATER], shares[SIMILAR] = 0.0, 0.0


@compiled
def _begins(reference: Reference, end: int, start: int) -> float:
    """Probability that, from a frame on, the first candidate begins at a start; the end of the
    clip stands for none."""
    none = math.exp(reference.survival[start] - reference.survival[end])
    return none * reference.hazard[start] if start < len(reference.room) - 1 else none


@compiled
def _at_start(reference: Reference, end: int, start: int) -> tuple[int, int]:
    """What may come later at a start: the first one in the rows, and the one after the last."""
    first, last = reference.later_first[end], reference.later_first[end + 1]
    n_scenelets = len(reference.kinds)
    row = reference.later[first:last]
    begin = first + np.searchsorted(row, start * n_scenelets)
    return int(begin), int(first + np.searchsorted(row, (start + 1) * n_scenelets))


@compiled
def _replaced(reference: Reference, at: int, scenelet: int) -> float:
    """Probability that something of the later rows is replaced by a scenelet that fits there."""
    n_scenelets = len(reference.kinds)
    start, other = reference.later[at] // n_scenelets, reference.later[at] % n_scenelets
    most = min(reference.room[start], reference.alike.shape[1] - 1)
    return float(reference.similarity[other, scenelet] / reference.alike[other, most])


@compiled
def next_probability(
    reference: Reference, kind: int, end: int, code: int, probability: Array
) -> None:
    """Probability of what comes next, by component of the mixture.

    Parameters
    ----------
    reference : Reference
    kind, end : int
        Kind of the scenelet before, 0 at the beginning, and the frame after its last.
    code : int
        What comes next.
    probability : (5,) float
        Out; their sum is that of the mixture.
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
        probability[CANDIDATE] *= ENDS + (1.0 - ENDS) * none
        probability[ANYWHERE] *= ENDS if openings > 0 else 1.0
        return
    start, scenelet = code // n_scenelets, code % n_scenelets
    if start < end or reference.lengths[scenelet] > reference.room[start]:
        probability[:] = 0.0
        return
    alike, (first, last) = 0.0, _at_start(reference, end, start)
    for at in range(first, last):
        alike += reference.later_probability[at] * _replaced(reference, at, scenelet)
    probability[SIMILAR] *= alike
    begins = _begins(reference, end, start) if reference.candidates[start, scenelet] > 0.0 else 0.0
    probability[CANDIDATE] *= (1.0 - ENDS) * begins * reference.candidates[start, scenelet]
    probability[ANYWHERE] *= (1.0 - ENDS) / openings


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
    (R + N, 5) float
        See :func:`next_probability`.
    """
    n_scenelets = len(reference.kinds)
    found = np.empty((len(items) + len(counts), 5))
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
    """Where the pelvis of a placed scenelet is in its first (0) or last (1) frame; its log depth is
    not a number behind the camera."""
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
    """Where its pelvis is on average of visits, through another camera."""
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
    """The middle of what is drawn of its pelvis in the first frame, and the row of its scatter.

    ``end`` is the frame after the last of the scenelet before, -1 where there is none; ``before``
    (2, 4) has that one's pelvis in its last frame, and how far that is from the usual.

    Parameters
    ----------
    reference : Reference
    camera : (5,) float
    scenelet : int
    start : int
        Its first frame.
    end : int
        Frame after the last of the scenelet before, -1 where there is none.
    before : (2, 4) float
        That one's pelvis in its last frame, and how far that is from the usual.

    Returns
    -------
    row : int
        Of the scatter.
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
    """Put into ``before`` what the next scenelet goes on from, see :func:`expected`; its end.

    Parameters
    ----------
    reference : Reference
    camera : (5,) float
    scenelet : int
    start : int
        Its first frame.
    place : (3,) float
    size : float
    before : (2, 4) float
        Out.

    Returns
    -------
    int
        Frame after its last; -1 behind the camera.
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
    """How far the scenelets of N states are from where they usually are.

    Parameters
    ----------
    reference : Reference
    cameras, counts, items, places, sizes
        See :func:`displacements`.

    Returns
    -------
    (R, 2, 4) float
        In their first and last frames; not a number behind the camera.
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
    """Of the scenelets of N states, one state after the other.

    Parameters
    ----------
    reference : Reference
    cameras : (N, 5) float
    counts : (N,) int
        Scenelets of each.
    items : (R, 2) int
    places : (R, 3) float
    sizes : (R,) float

    Returns
    -------
    rows : (R,) int
        Of the scatter; -1 behind the camera.
    before : (R, 4) float
        How the scenelet before is displaced in its last frame; 0 where there is none.
    offsets : (R, 4) float
        How far each is from where it is expected.
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
    """Log density of a place of which nothing is known."""
    total = -math.log(2.0 * math.pi) - 0.5 * (where[3] / reference.size_spread) ** 2
    total -= math.log(reference.size_spread) + 1.5 * math.log(2.0 * math.pi)
    for i in range(2):
        deviation = reference.anywhere_deviation[i]
        total -= 0.5 * ((where[i] - reference.anywhere_mean[i]) / deviation) ** 2
        total -= math.log(deviation)
    return float(total)


@compiled
def _stops(reference: Reference, kind: int, end: int, start: int) -> float:
    """Probability that nothing begins before a start; the end of the clip is that of the scene."""
    shares = np.empty(5)
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
    total += shares[CANDIDATE] * (ENDS + (1.0 - ENDS) * none) + shares[ANYWHERE] * empty
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
    """Log density of some scenelets of a scene in a row, given the others and the camera.

    That is with which they would be drawn one after the other until one begins as late as the
    scenelet that follows upon them does, or nothing more comes where none follows.

    Parameters
    ----------
    reference : Reference
    camera : (5,) float
    items : (k, 2) int
    placements : (k, 3) float
    sizes : (k,) float
    first, last : int
        The first of them and the one after the last.

    Returns
    -------
    float
        Nats, per square metre, radian and unit of log size of each of them; -inf behind the
        camera, or where they overlap.
    """
    n_scenelets, n_frames = len(reference.kinds), len(reference.room) - 1
    probability, before = np.empty(5), np.empty((2, 4))
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
    """Log density of a scene, latent numbers aside.

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
