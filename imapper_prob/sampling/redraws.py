"""Drawing from the reference, and moves that draw a scene anew from it, or a part of it.

What is drawn does not depend on what it replaces. At an inverse temperature beta the acceptance
probability is the ratio of the weights (posterior / reference)^beta: hot chains change with nearly
every draw, and even at the posterior some draws are good enough.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.view import floor_point
from imapper_prob.sampling.jit import compiled
from imapper_prob.sampling.reference import (
    ANYWHERE,
    ASTRAY,
    CANDIDATE,
    DOF,
    ENDS,
    FOLLOWED,
    SIMILAR,
    START,
    Reference,
    expected,
    leaves,
    log_reference,
    log_stretch,
    shares_after,
)
from imapper_prob.sampling.scene import Scene

__all__ = ["draw_scene", "redraw_scene", "redraw_stretch", "set_placement"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_INSERTED: Final = 0.1
"""How often a place between scenelets is chosen, over a run of them; chosen: mostly nothing is put
there."""
_NOTHING: Final = -1
"""In place of a code: nothing more comes."""


# ------------------------------------------------------------------------------------------------
# Drawing.


@compiled
def draw_scene(reference: Reference, rng: np.random.Generator) -> Scene:
    """A scene.

    Parameters
    ----------
    reference : Reference
    rng : numpy.random.Generator

    Returns
    -------
    Scene
        It may lie outside the support of the posterior.
    """
    n_frames = len(reference.room) - 1
    camera = reference.camera_mean + _draw_t(reference.camera_factor, rng)
    latent = rng.standard_normal((n_frames, 2))
    empty = Scene(camera, np.empty((0, 2), np.int64), np.empty((0, 3)), np.empty(0), latent)
    return _with_stretch(reference, rng, empty, START, START)[0]


@compiled
def _with_stretch(
    reference: Reference, rng: np.random.Generator, scene: Scene, first: int, last: int
) -> tuple[Scene, int]:
    """A scene with others in place of the scenelets from ``first`` up to before ``last``, and how
    many; the last of them may overlap with the one that follows. See `log_stretch`."""
    camera = scene.camera
    n_scenelets, n_frames = len(reference.kinds), len(reference.room) - 1
    stop = scene.items[last, 1] if last < len(scene.items) else n_frames
    most = n_frames // reference.lengths[reference.by_length[0]] + 1
    items, placements, sizes = np.empty((most, 2), np.int64), np.empty((most, 3)), np.empty(most)
    kind, end, left, n = 0, 0, -1, 0
    before, shares = np.empty((2, 4)), np.empty(5)
    if first > 0:
        scenelet, start = scene.items[first - 1]
        place, size = scene.placements[first - 1], scene.sizes[first - 1]
        left = leaves(reference, camera, scenelet, start, place, size, before)
        kind, end = reference.kinds[scenelet], start + reference.lengths[scenelet]
    while end <= stop:
        shares_after(reference, kind, end, shares)
        of = _draw(shares, rng)
        code = _draw_next(reference, rng, of, kind, end)
        if code == _NOTHING or code >= stop * n_scenelets:
            break
        if of == SIMILAR:
            code = _draw_similar(reference, rng, code)
        start, scenelet = code // n_scenelets, code % n_scenelets
        row, middle = expected(reference, camera, scenelet, start, left, before)
        where = _draw_where(reference, rng, row, scenelet, middle)
        items[n, 0], items[n, 1], sizes[n] = scenelet, start, where[3]
        set_placement(reference, camera, scenelet, where, placements[n])
        left = leaves(reference, camera, scenelet, start, placements[n], sizes[n], before)
        kind, end = reference.kinds[scenelet], start + reference.lengths[scenelet]
        n += 1
    changed = Scene(
        camera,
        np.concatenate((scene.items[:first], items[:n], scene.items[last:])),
        np.concatenate((scene.placements[:first], placements[:n], scene.placements[last:])),
        np.concatenate((scene.sizes[:first], sizes[:n], scene.sizes[last:])),
        scene.latent,
    )
    return changed, n


@compiled
def _draw(weights: Array, rng: np.random.Generator) -> int:
    """The number of a weight, drawn by it; never one that is 0."""
    left, found = rng.random() * weights.sum(), 0
    for i in range(len(weights)):
        if weights[i] > 0.0:
            found = i
            left -= weights[i]
            if left < 0.0:
                break
    return found


@compiled
def _draw_t(factor: Array, rng: np.random.Generator) -> Array:
    """An offset of the t distribution of a factor."""
    z, offset = rng.standard_normal(len(factor)), np.zeros(len(factor))
    by = 1.0 / math.sqrt(rng.chisquare(DOF) / DOF)
    for i in range(len(factor)):
        for j in range(i + 1):
            offset[i] += by * factor[i, j] * z[j]
    return offset


@compiled
def _draw_next(reference: Reference, rng: np.random.Generator, of: int, kind: int, end: int) -> int:
    """What comes next by one component of the mixture, or what it is similar to."""
    n_scenelets, n_frames = len(reference.kinds), len(reference.room) - 1
    if of == FOLLOWED:
        row = kind * (n_frames + 1) + end
        low, high = reference.followed_first[row], reference.followed_first[row + 1]
        code = reference.followed[low + _draw(reference.followed_probability[low:high], rng)]
        return _NOTHING if code == n_frames * n_scenelets else code
    if of < CANDIDATE:
        low, high = reference.later_first[end], reference.later_first[end + 1]
        code = reference.later[low + _draw(reference.later_probability[low:high], rng)]
        return _NOTHING if code == n_frames * n_scenelets else code
    if rng.random() < ENDS:
        return _NOTHING
    if of == CANDIDATE:
        for start in range(end, n_frames):
            if rng.random() < reference.hazard[start]:
                return start * n_scenelets + _draw(reference.candidates[start], rng)
        return _NOTHING
    if of != ANYWHERE or reference.openings[end] == 0:
        return _NOTHING
    left = rng.integers(0, reference.openings[end])
    # The start with that many openings or more, but not with the next one, left behind it.
    start = np.searchsorted(-reference.openings, -left, "left") - 1
    return int(start * n_scenelets + reference.by_length[left - reference.openings[start + 1]])


@compiled
def _draw_similar(reference: Reference, rng: np.random.Generator, code: int) -> int:
    """A scenelet of similar motion in place of another, at the same start."""
    n_scenelets = len(reference.kinds)
    start, scenelet = code // n_scenelets, code % n_scenelets
    weights = reference.similarity[scenelet].copy()
    for other in range(n_scenelets):
        if reference.lengths[other] > reference.room[start]:
            weights[other] = 0.0
    return start * n_scenelets + _draw(weights, rng)


@compiled
def _draw_where(
    reference: Reference, rng: np.random.Generator, row: int, scenelet: int, middle: Array
) -> Array:
    """Where the pelvis is in the first frame."""
    where = middle.copy()
    if rng.random() < ASTRAY:
        for i in range(2):
            where[i] = reference.anywhere_mean[i]
            where[i] += reference.anywhere_deviation[i] * rng.standard_normal()
        where[2] = rng.uniform(-math.pi, math.pi)
        where[3] = reference.size_spread * rng.standard_normal()
        return where
    offset = _draw_t(reference.factors[row, reference.strange[scenelet]], rng)
    while abs(offset[2]) > math.pi:
        offset = _draw_t(reference.factors[row, reference.strange[scenelet]], rng)
    return where + offset


@compiled
def set_placement(
    reference: Reference, camera: Array, scenelet: int, where: Array, placement: Array
) -> None:
    """Put into ``placement`` that with which the pelvis is there.

    Parameters
    ----------
    reference : Reference
    camera : (5,) float
    scenelet : int
    where : (4,) float
        Bearing, log depth, yaw and log size of its pelvis in the first frame.
    placement : (3,) float
        Out.
    """
    x, y = floor_point(where[0], where[1])
    body = math.exp(camera[3] + where[3])
    c, s = body * math.cos(where[2]), body * math.sin(where[2])
    local = reference.pelvis[scenelet, 0]
    placement[0] = x - c * local[0] + s * local[1]
    placement[1] = y - s * local[0] - c * local[1]
    placement[2] = where[2]


# ------------------------------------------------------------------------------------------------
# Moves.


@compiled
def redraw_scene(
    reference: Reference, rng: np.random.Generator, scene: Scene
) -> tuple[Scene, float]:
    """Everything anew: camera, scenelets and latent numbers.

    Parameters
    ----------
    reference : Reference
    rng : numpy.random.Generator
    scene : Scene

    Returns
    -------
    Scene, float
    """
    new = draw_scene(reference, rng)
    there = log_reference(reference, new.camera, new.items, new.placements, new.sizes)
    back = log_reference(reference, scene.camera, scene.items, scene.placements, scene.sizes)
    return new, back - there if there > -math.inf else -math.inf


@compiled
def redraw_stretch(
    reference: Reference, rng: np.random.Generator, scene: Scene
) -> tuple[Scene, float]:
    """Some scenelets in a row anew, none to all of them, and their number with them.

    All runs of one or more are as likely; a place where nothing is taken away is chosen less often,
    for nothing is put there most of the time.

    Parameters
    ----------
    reference : Reference
    rng : numpy.random.Generator
    scene : Scene

    Returns
    -------
    Scene, float
        Impossible where what is put there overlaps with what follows.
    """
    k = len(scene.items)
    runs, places = k * (k + 1) / 2, _INSERTED * (k + 1)
    first = int(rng.integers(0, k + 1))
    last = first
    if rng.random() * (runs + places) >= places:
        # Another one of the k + 1 places before, between and after the scenelets.
        last = int(rng.integers(0, k))
        if last >= first:
            last += 1
        first, last = min(first, last), max(first, last)
    new, n = _with_stretch(reference, rng, scene, first, last)
    if first == last and n == 0:
        return scene, -math.inf
    there = _log_choice(k, last - first) + log_stretch(
        reference, new.camera, new.items, new.placements, new.sizes, first, first + n
    )
    if there == -math.inf:
        return scene, -math.inf
    back = _log_choice(len(new.items), n) + log_stretch(
        reference, scene.camera, scene.items, scene.placements, scene.sizes, first, last
    )
    return new, back - there


@compiled
def _log_choice(k: int, n: int) -> float:
    """Log probability of choosing one run of n among k scenelets."""
    weight = 1.0 if n > 0 else _INSERTED
    return math.log(weight / (k * (k + 1) / 2 + _INSERTED * (k + 1)))
