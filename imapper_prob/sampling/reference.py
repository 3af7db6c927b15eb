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
   Each of them may end the scene.
3. Where each one stands, as it looks (:mod:`imapper_prob.models.view`): a visited one about the
   mean of its visits, displaced in part as the scenelet before it is, for the error of the path
   goes on; a similar one about the same mean, less closely; a candidate about its fit; any other
   as in the prior. Means are carried to the camera that was drawn
   (:mod:`imapper_prob.sampling.camera_moves`).
4. Latent numbers of the path from their normal distribution, which no density here includes.

All densities are normalised over the space of scenes (with y > 0).
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled
from imapper_prob.models.log_posterior import State
from imapper_prob.models.view import floor_point, log_area, to_floor, to_view

__all__ = [
    "DOF", "Reference", "carried", "draw_scene", "draw_stretch", "log_reference", "log_stretch",
    "next_probability",
]  # fmt: skip

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_SHARES: Final = np.array([0.2, 0.1, 0.5, 0.15, 0.05])
"""Of followed, later, similar, candidates and anywhere. Half goes to what was not met itself: with
two thousand scenelets a posterior is wider than what was met of it. Chosen on draws of Scene04, by
the mean of posterior over reference."""
_ENDS: Final = 0.2
"""Probability that candidates, or anywhere, end the scene; chosen."""
DOF: Final = 5.0
"""Degrees of freedom of camera and places: tails for what was not visited yet; chosen."""
_FOLLOWED, _LATER, _SIMILAR, _CANDIDATE, _ANYWHERE = range(5)
"""Components of the mixture."""
_FIRST, _NEXT, _ALIKE, _FIT = range(4)
"""Rows of the scatter of places: nothing known of a displacement before, something, about the
place of one of similar motion, about a fit."""


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
        The camera in which places below are.
    kinds, lengths : (L,) int
        Kind of furniture, from 1 on (0 is the beginning), and frames.
    heights : (L,) float
        Of the pelvis in the middle frame, metres of the reference body.
    room : (T + 1,) int
        Frames from each to the end of its film.
    met, met_where : (M,) int, (M, 4) float
        Codes of visited scenelets and their neighbours in time, ascending, and where they stand.
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
    window : (T + 1,) int
        Of a middle frame, the window of its fits.
    candidate_where : (W, L, 4) float
    openings : (T + 2,) int
        How many scenelets at starts from each frame on fit into their films.
    by_length : (L,) int
        Scenelets, short ones first.
    anywhere_mean, anywhere_deviation : (2,) float
        Of bearing and log depth.
    size_spread : float
        Standard deviation of the log size anywhere.
    onward : (4, 4) float
        How much of a displacement the next scenelet has.
    factors, constants : (4, 4, 4), (4,) float
        Lower Cholesky factors of places, and log densities in their middles.
    """

    camera_mean: Array
    camera_factor: Array
    camera_constant: float
    library_camera: Array
    kinds: Ints
    lengths: Ints
    heights: Array
    room: Ints
    met: Ints
    met_where: Array
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
    window: Ints
    candidate_where: Array
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
def _carried(height: float, where: Array, before: Array, after: Array) -> Array:
    """Where a scenelet looks through one camera as it did through another; as it is if nowhere.

    See :mod:`imapper_prob.sampling.camera_moves`; ``height`` is that of the pelvis.
    """
    x, y = floor_point(where[0], where[1])
    cp, sp, cr, sr = (
        math.cos(before[0]), math.sin(before[0]), math.cos(before[4]), math.sin(before[4]),
    )  # fmt: skip
    body = math.exp(before[3] + where[3])
    z = body * height - before[1]
    depth = cp * y + sp * z
    if depth <= 0.0:
        return where.copy()
    by = math.exp(before[2] - after[2]) / depth
    right = by * (cr * x + sr * (cp * z - sp * y))
    up = by * (cr * (cp * z - sp * y) - sr * x)
    apparent = by * body
    cp, sp, cr, sr = math.cos(after[0]), math.sin(after[0]), math.cos(after[4]), math.sin(after[4])
    rise = sr * right + cr * up
    ahead, drop = cp - sp * rise, apparent * height - (sp + cp * rise)
    if not drop * after[1] > 0.0 or ahead <= 0.0:
        return where.copy()
    depth = after[1] / drop
    there = np.empty(4)
    there[0] = (cr * right - sr * up) / ahead
    there[1] = math.log(depth * ahead)
    there[2] = where[2]
    there[3] = math.log(apparent * depth) - after[3]
    return there


@compiled
def carried(heights: Array, where: Array, cameras: Array, to: Array) -> Array:
    """Places (n, 4) seen by cameras (n, 5), as :func:`_carried` for each."""
    result = np.empty_like(where)
    for i in range(len(where)):
        result[i] = _carried(heights[i], where[i], cameras[i], to)
    return result


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
def _shares(reference: Reference, kind: int, end: int, shares: Array) -> None:
    """Shares of the mixture after a scenelet of a kind that ended at a frame."""
    shares[:] = _SHARES
    row = kind * len(reference.room) + end
    if reference.followed_first[row] == reference.followed_first[row + 1]:
        shares[_LATER], shares[_FOLLOWED] = shares[_LATER] + shares[_FOLLOWED], 0.0
    if reference.later_first[end] == reference.later_first[end + 1]:
        shares[_ANYWHERE] += shares[_LATER] + shares[_SIMILAR]
        shares[_LATER], shares[_SIMILAR] = 0.0, 0.0


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
    _shares(reference, kind, end, probability)
    n_scenelets, n_frames = len(reference.kinds), len(reference.room) - 1
    row = kind * (n_frames + 1) + end
    at = _find(
        reference.followed, reference.followed_first[row], reference.followed_first[row + 1], code
    )
    probability[_FOLLOWED] *= reference.followed_probability[at] if at >= 0 else 0.0
    at = _find(reference.later, reference.later_first[end], reference.later_first[end + 1], code)
    met = reference.later_probability[at] if at >= 0 else 0.0
    probability[_LATER] *= met
    openings = reference.openings[end]
    if code == n_frames * n_scenelets:
        none = _begins(reference, end, n_frames)
        probability[_SIMILAR] *= met
        probability[_CANDIDATE] *= _ENDS + (1.0 - _ENDS) * none
        probability[_ANYWHERE] *= _ENDS if openings > 0 else 1.0
        return
    start, scenelet = code // n_scenelets, code % n_scenelets
    if start < end or reference.lengths[scenelet] > reference.room[start]:
        probability[:] = 0.0
        return
    alike, (first, last) = 0.0, _at_start(reference, end, start)
    for at in range(first, last):
        alike += reference.later_probability[at] * _replaced(reference, at, scenelet)
    probability[_SIMILAR] *= alike
    begins = _begins(reference, end, start) if reference.candidates[start, scenelet] > 0.0 else 0.0
    probability[_CANDIDATE] *= (1.0 - _ENDS) * begins * reference.candidates[start, scenelet]
    probability[_ANYWHERE] *= (1.0 - _ENDS) / openings


@compiled
def _displacement(
    reference: Reference, camera: Array, code: int, where: Array, offset: Array
) -> bool:
    """How far a scenelet stands from where it was met; False where it was not."""
    at = _find(reference.met, 0, len(reference.met), code)
    if at < 0:
        return False
    scenelet = code % len(reference.kinds)
    offset[:] = where - _carried(
        reference.heights[scenelet], reference.met_where[at], reference.library_camera, camera
    )
    _turned(offset)
    return True


@compiled
def _log_about(
    reference: Reference, camera: Array, scenelet: int, middle: Array, where: Array, of: int
) -> float:
    """Log density of a place about another one, by a row of the scatter."""
    height = reference.heights[scenelet]
    off = where - _carried(height, middle, reference.library_camera, camera)
    _turned(off)
    return _log_t(off, reference.factors[of], reference.constants[of])


@compiled
def _log_similar(
    reference: Reference, camera: Array, end: int, start: int, scenelet: int, where: Array
) -> float:
    """Log density of a place, where it is about that of whatever the scenelet replaces."""
    first, last = _at_start(reference, end, start)
    density, total = 0.0, 0.0
    for at in range(first, last):
        share = reference.later_probability[at] * _replaced(reference, at, scenelet)
        if share > 0.0:
            met = np.searchsorted(reference.met, reference.later[at])
            middle = reference.met_where[met]
            log_place = _log_about(reference, camera, scenelet, middle, where, _ALIKE)
            density += share * math.exp(log_place)
            total += share
    return math.log(density / total) if density > 0.0 else -math.inf


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
    _shares(reference, kind, end, shares)
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
        empty = _ENDS + (1.0 - _ENDS) * reference.openings[start] / reference.openings[end]
    total = shares[_FOLLOWED] * followed + (shares[_LATER] + shares[_SIMILAR]) * later
    total += shares[_CANDIDATE] * (_ENDS + (1.0 - _ENDS) * none) + shares[_ANYWHERE] * empty
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
    probability, log_place = np.empty(5), np.empty(5)
    before, offset, where = np.empty(4), np.empty(4), np.empty(4)
    kind, end, known, total = 0, 0, False, 0.0
    for k in range(max(first - 1, 0), last):
        scenelet, start = items[k]
        if placements[k, 1] <= 0.0:
            return -math.inf
        code = start * n_scenelets + scenelet
        where[0], where[1] = placements[k, 0] / placements[k, 1], math.log(placements[k, 1])
        where[2], where[3] = placements[k, 2], sizes[k]
        met = _displacement(reference, camera, code, where, offset)
        if k >= first:
            next_probability(reference, kind, end, code, probability)
            if probability[_ANYWHERE] == 0.0:
                return -math.inf
            log_place[:] = -math.inf
            if probability[_FOLLOWED] + probability[_LATER] > 0.0:
                of, off = _FIRST, offset.copy()
                if known:
                    of = _NEXT
                    off -= reference.onward @ before
                    _turned(off)
                log_place[_FOLLOWED] = _log_t(off, reference.factors[of], reference.constants[of])
                log_place[_LATER] = log_place[_FOLLOWED]
            if probability[_SIMILAR] > 0.0:
                log_place[_SIMILAR] = _log_similar(reference, camera, end, start, scenelet, where)
            if probability[_CANDIDATE] > 0.0:
                window = reference.window[start + reference.lengths[scenelet] // 2]
                middle = reference.candidate_where[window, scenelet]
                log_place[_CANDIDATE] = _log_about(reference, camera, scenelet, middle, where, _FIT)
            log_place[_ANYWHERE] = _log_anywhere(reference, where)
            most, density = log_place.max(), 0.0
            for of in range(5):
                density += probability[of] * math.exp(log_place[of] - most)
            total += most + math.log(density) - log_area(where[1])
        known = met
        before[:] = offset
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
        reference, camera, items, placements, sizes, 0, len(items)
    )  # fmt: skip


# ------------------------------------------------------------------------------------------------
# Drawing from it.


def draw_scene(reference: Reference, rng: np.random.Generator) -> State:
    """A scene.

    Parameters
    ----------
    reference : Reference
    rng : numpy.random.Generator

    Returns
    -------
    State
        It may lie outside the support of the posterior.
    """
    n_frames = len(reference.room) - 1
    camera = reference.camera_mean + _draw_t(rng, reference.camera_factor)
    nothing = np.empty((0, 2), np.int64)
    empty = State(camera, nothing, np.empty((0, 3)), np.empty(0), np.empty((n_frames, 2)))
    items, placements, sizes = draw_stretch(reference, rng, empty, 0, 0)
    latent = rng.standard_normal((n_frames, 2))
    return State(camera, items, placements, sizes, latent)


def draw_stretch(
    reference: Reference, rng: np.random.Generator, state: State, first: int, last: int
) -> tuple[Ints, Array, Array]:
    """Scenelets in place of some of a state in a row, see :func:`log_stretch`.

    Parameters
    ----------
    reference : Reference
    rng : numpy.random.Generator
    state : State
    first, last : int
        The first of them and the one after the last.

    Returns
    -------
    items : (n, 2) int
    placements : (n, 3) float
    sizes : (n,) float
        The last one may overlap with the scenelet that follows.
    """
    n_scenelets, n_frames = len(reference.kinds), len(reference.room) - 1
    stop = int(state.items[last, 1]) if last < state.n_scenelets else n_frames
    items, places = [], []
    kind, end, known = 0, 0, False
    before, shares = np.empty(4), np.empty(5)
    if first > 0:
        scenelet, start = state.items[first - 1].tolist()
        where = to_view(state.placements[first - 1], state.sizes[first - 1])
        known = _displacement(
            reference, state.camera, start * n_scenelets + scenelet, where, before
        )  # fmt: skip
        kind, end = int(reference.kinds[scenelet]), start + int(reference.lengths[scenelet])
    while True:
        _shares(reference, kind, end, shares)
        of = int(np.searchsorted(shares.cumsum(), rng.random() * shares.sum(), "right"))
        of = min(of, _ANYWHERE)
        code = _draw_next(reference, rng, of, kind, end)
        if code is None or code >= stop * n_scenelets:
            break
        alike = code
        if of == _SIMILAR:
            code = _draw_alike(reference, rng, alike)
        start, scenelet = divmod(code, n_scenelets)
        onward = reference.onward @ before if known else None
        where = _draw_place(reference, rng, of, state.camera, code, alike, onward)
        known = _displacement(reference, state.camera, code, where, before)
        items.append((scenelet, start))
        places.append(where)
        kind, end = int(reference.kinds[scenelet]), start + int(reference.lengths[scenelet])
        if end > stop:
            break
    placements, sizes = to_floor(np.reshape(places, (-1, 4)))
    return np.reshape(items, (-1, 2)).astype(np.int64), placements, sizes


def _draw_t(rng: np.random.Generator, factor: Array) -> Array:
    offset: Array = factor @ rng.standard_normal(len(factor))
    return offset / math.sqrt(float(rng.chisquare(DOF)) / DOF)


def _draw_next(
    reference: Reference, rng: np.random.Generator, of: int, kind: int, end: int
) -> int | None:
    """What comes next by one component of the mixture, or what it is similar to; None for the end
    of the scene."""
    n_scenelets, n_frames = len(reference.kinds), len(reference.room) - 1
    if of in (_FOLLOWED, _LATER, _SIMILAR):
        first, codes, chances = (
            (reference.followed_first, reference.followed, reference.followed_probability)
            if of == _FOLLOWED
            else (reference.later_first, reference.later, reference.later_probability)
        )
        row = kind * (n_frames + 1) + end if of == _FOLLOWED else end
        low, high = int(first[row]), int(first[row + 1])
        at = low + int(np.searchsorted(chances[low:high].cumsum(), rng.random(), "right"))
        code = int(codes[min(at, high - 1)])
        return None if code == n_frames * n_scenelets else code
    if rng.random() < _ENDS:
        return None
    if of == _CANDIDATE:
        for start in range(end, n_frames):
            if rng.random() < reference.hazard[start]:
                row = reference.candidates[start].cumsum()
                scenelet = int(np.searchsorted(row, rng.random() * row[-1], "right"))
                return start * n_scenelets + min(scenelet, n_scenelets - 1)
        return None
    if reference.openings[end] == 0:
        return None
    left = int(rng.integers(reference.openings[end]))
    # The start with that many openings or more, but not with the next one, left behind it.
    start = int(np.searchsorted(-reference.openings, -left, "left")) - 1
    scenelet = int(reference.by_length[left - int(reference.openings[start + 1])])
    return start * n_scenelets + scenelet


def _draw_alike(reference: Reference, rng: np.random.Generator, code: int) -> int:
    """A scenelet of similar motion in place of another."""
    start, scenelet = divmod(code, len(reference.kinds))
    fitting = np.flatnonzero(reference.lengths <= reference.room[start])
    weights = reference.similarity[scenelet, fitting].cumsum()
    at = int(np.searchsorted(weights, rng.random() * weights[-1], "right"))
    return start * len(reference.kinds) + int(fitting[min(at, len(fitting) - 1)])


def _draw_place(
    reference: Reference,
    rng: np.random.Generator,
    of: int,
    camera: Array,
    code: int,
    alike: int,
    onward: Array | None,
) -> Array:
    """Where it stands, by the same component.

    If it is ``alike`` another one, where that was met; ``onward`` is how far it is displaced as
    the one before is, where that is known.
    """
    start, scenelet = divmod(code, len(reference.kinds))
    if of == _ANYWHERE:
        seen = reference.anywhere_mean + reference.anywhere_deviation * rng.standard_normal(2)
        yaw, size = rng.uniform(-math.pi, math.pi), reference.size_spread * rng.standard_normal()
        return np.array([*seen, yaw, size])
    if of == _CANDIDATE:
        row = _FIT
        window = reference.window[start + int(reference.lengths[scenelet]) // 2]
        middle = reference.candidate_where[window, scenelet]
    else:
        row = _ALIKE if of == _SIMILAR else _FIRST if onward is None else _NEXT
        middle = reference.met_where[np.searchsorted(reference.met, alike)]
    height = float(reference.heights[scenelet])
    where: Array = _carried(height, middle, reference.library_camera, camera)
    if row == _NEXT and onward is not None:
        where = where + onward
    while True:
        offset = _draw_t(rng, reference.factors[row])
        if abs(offset[2]) <= math.pi:
            return where + offset
