"""Draw scenes from the reference, and independence moves that redraw a scene or a part of it.

A redraw does not depend on what it replaces. At inverse temperature beta the acceptance probability
is the ratio of the weights (posterior / reference)^beta. So hot chains accept nearly every redraw,
and at the posterior some are still accepted.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.view import floor_point
from imapper_prob.sampling.jit import compiled, inner
from imapper_prob.sampling.reference import (
    ANYWHERE,
    COMPONENTS,
    DOF,
    END_PROBABILITY,
    FITTING,
    FLUSH_NEXT,
    FOLLOWED,
    NONE_BEFORE,
    PRIOR_PLACEMENT_WEIGHT,
    SAME_KIND,
    SIMILAR,
    START,
    Reference,
    draw_summed,
)
from imapper_prob.sampling.reference_density import log_reference, log_stretch, weights_after
from imapper_prob.sampling.reference_placement import end_pose, placement_centre
from imapper_prob.sampling.scene import StateArrays

__all__ = ["draw_scene", "redraw_scene", "redraw_stretch", "set_placement", "with_stretch"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_INSERTED: Final = 0.05
"""Weight of redrawing a gap between scenelets, where a single scenelet has 1/2; chosen: in most
gaps nothing is drawn."""
_GROUP: Final = 0.5
"""Additional weight of redrawing a whole group of flush scenelets; chosen: some can only be
exchanged for others together."""
_NOTHING: Final = -1
"""Code for the end of the scene."""


# ------------------------------------------------------------------------------------------------
# Drawing.


@compiled
def draw_scene(reference: Reference, rng: np.random.Generator) -> StateArrays:
    """Draw a scene from the reference.

    Parameters
    ----------
    reference : Reference
    rng : numpy.random.Generator

    Returns
    -------
    StateArrays
        It may lie outside the support of the posterior.
    """
    n_frames = len(reference.frames_left) - 1
    camera = reference.camera_mean + _draw_t(reference.camera_factor, rng)
    latent = rng.standard_normal((n_frames, 2))
    empty = StateArrays(camera, np.empty((0, 2), np.int64), np.empty((0, 3)), np.empty(0), latent)
    return with_stretch(reference, rng, empty, START, START)[0]


@inner
def with_stretch(
    reference: Reference, rng: np.random.Generator, scene: StateArrays, first: int, last: int
) -> tuple[StateArrays, int]:
    """Redraw consecutive scenelets of a scene, given the others and the camera.

    See :func:`imapper_prob.sampling.reference_density.log_stretch`.

    Parameters
    ----------
    reference : Reference
    rng : numpy.random.Generator
    scene : StateArrays
    first, last : int
        Index of the first one, and the index after the last.

    Returns
    -------
    StateArrays
        The last new scenelet may overlap the next one.
    int
        Number of new scenelets.
    """
    camera = scene.camera
    n_scenelets, n_frames = len(reference.kinds), len(reference.frames_left) - 1
    stop = scene.items[last, 1] if last < len(scene.items) else n_frames
    most = n_frames // reference.lengths[reference.by_length[0]] + 1
    items, placements, sizes = np.empty((most, 2), np.int64), np.empty((most, 3)), np.empty(most)
    kind, end, left, n = START, START, NONE_BEFORE, 0
    before, middle, weights = np.empty((2, 4)), np.empty((2, 4)), np.empty(COMPONENTS)
    if first > 0:
        scenelet, start = scene.items[first - 1]
        place, size = scene.placements[first - 1], scene.sizes[first - 1]
        left = end_pose(reference, camera, scenelet, start, place, size, before)
        kind, end = reference.kinds[scenelet], start + reference.lengths[scenelet]
    while end <= stop:
        weights_after(reference, kind, end, weights)
        of = _draw(weights, rng)
        code = _draw_next(reference, rng, of, kind, end)
        if code == _NOTHING or code >= stop * n_scenelets:
            break
        if of == SIMILAR:
            code = _draw_similar(reference, rng, code)
        start, scenelet = code // n_scenelets, code % n_scenelets
        row = placement_centre(reference, camera, scenelet, start, left, before, middle)
        where = _draw_where(reference, rng, row, scenelet, middle[0])
        items[n, 0], items[n, 1], sizes[n] = scenelet, start, where[3]
        set_placement(reference, camera, scenelet, where, placements[n])
        left = end_pose(reference, camera, scenelet, start, placements[n], sizes[n], before)
        kind, end = reference.kinds[scenelet], start + reference.lengths[scenelet]
        n += 1
    changed = StateArrays(
        camera,
        np.concatenate((scene.items[:first], items[:n], scene.items[last:])),
        np.concatenate((scene.placements[:first], placements[:n], scene.placements[last:])),
        np.concatenate((scene.sizes[:first], sizes[:n], scene.sizes[last:])),
        scene.latent,
    )
    return changed, n


@compiled
def _draw(weights: Array, rng: np.random.Generator) -> int:
    """Draw an index with the given weights; never one of weight 0."""
    left, found = rng.random() * weights.sum(), 0
    for i in range(len(weights)):
        if weights[i] > 0.0:
            found = i
            left -= weights[i]
            if left < 0.0:
                break
    return found


@inner
def _draw_t(factor: Array, rng: np.random.Generator) -> Array:
    """Draw an offset from the centre of a multivariate t distribution with a Cholesky factor."""
    z, offset = rng.standard_normal(len(factor)), np.zeros(len(factor))
    by = 1.0 / math.sqrt(rng.chisquare(DOF) / DOF)
    for i in range(len(factor)):
        for j in range(i + 1):
            offset[i] += by * factor[i, j] * z[j]
    return offset


@inner
def _draw_next(reference: Reference, rng: np.random.Generator, of: int, kind: int, end: int) -> int:
    """Draw the code of the next scenelet from a component; for SIMILAR, that of the one it
    resembles."""
    n_scenelets, n_frames = len(reference.kinds), len(reference.frames_left) - 1
    if of == FOLLOWED:
        row = kind * (n_frames + 1) + end
        low, high = reference.followed_first[row], reference.followed_first[row + 1]
        code = reference.followed[low + _draw(reference.followed_probability[low:high], rng)]
        return _NOTHING if code == n_frames * n_scenelets else code
    if of < FITTING:
        low, high = reference.later_first[end], reference.later_first[end + 1]
        code = reference.later[low + _draw(reference.later_probability[low:high], rng)]
        return _NOTHING if code == n_frames * n_scenelets else code
    if of == FLUSH_NEXT:
        if reference.fitting_kinds[end, kind] > 0.0 and rng.random() < SAME_KIND:
            return end * n_scenelets + _draw_of_kind(reference, rng, kind, end)
        return end * n_scenelets + draw_summed(reference.fitting_sums, end, n_scenelets, rng)
    if rng.random() < END_PROBABILITY:
        return _NOTHING
    if of == FITTING:
        for start in range(end, n_frames):
            if rng.random() < reference.hazard[start]:
                chosen = draw_summed(reference.fitting_sums, start, n_scenelets, rng)
                return start * n_scenelets + chosen
        return _NOTHING
    if of != ANYWHERE or reference.n_fitting_starts[end] == 0:
        return _NOTHING
    left = rng.integers(0, reference.n_fitting_starts[end])
    # The last start from which there are more than `left` fitting starts.
    start = np.searchsorted(-reference.n_fitting_starts, -left, "left") - 1
    return int(
        start * n_scenelets + reference.by_length[left - reference.n_fitting_starts[start + 1]]
    )


@inner
def _draw_similar(reference: Reference, rng: np.random.Generator, code: int) -> int:
    """Draw a scenelet of similar motion at the same start."""
    n_scenelets = len(reference.kinds)
    start, scenelet = code // n_scenelets, code % n_scenelets
    # The scenelets that fit there are the first ones by length.
    n = reference.n_fitting_starts[start] - reference.n_fitting_starts[start + 1]
    other = reference.by_length[draw_summed(reference.similar_sums, scenelet, n, rng)]
    return int(start * n_scenelets + other)


@inner
def _draw_of_kind(reference: Reference, rng: np.random.Generator, kind: int, end: int) -> int:
    """Draw a scenelet with furniture of a kind from those that fit at a frame."""
    left, found = rng.random() * reference.fitting_kinds[end, kind], 0
    for i in range(len(reference.kinds)):
        if reference.kinds[i] == kind and reference.fitting[end, i] > 0.0:
            found = i
            left -= reference.fitting[end, i]
            if left < 0.0:
                break
    return found


@inner
def _draw_where(
    reference: Reference, rng: np.random.Generator, row: int, scenelet: int, middle: Array
) -> Array:
    """Draw bearing, log depth, yaw and log size of the pelvis in the first frame."""
    where = middle.copy()
    if rng.random() < PRIOR_PLACEMENT_WEIGHT:
        for i in range(2):
            where[i] = reference.anywhere_mean[i]
            where[i] += reference.anywhere_deviation[i] * rng.standard_normal()
        where[2] = rng.uniform(-math.pi, math.pi)
        where[3] = reference.size_spread * rng.standard_normal()
        return where
    offset = _draw_t(reference.factors[row, reference.rarely_visited[scenelet]], rng)
    while abs(offset[2]) > math.pi:
        offset = _draw_t(reference.factors[row, reference.rarely_visited[scenelet]], rng)
    return where + offset


@inner
def set_placement(
    reference: Reference, camera: Array, scenelet: int, where: Array, placement: Array
) -> None:
    """Write the placement for which the pelvis of the first frame is at a position.

    Parameters
    ----------
    reference : Reference
    camera : (5,) float
    scenelet : int
    where : (4,) float
        Bearing, log depth, yaw and log size of its pelvis in the first frame.
    placement : (3,) float
        Output.
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


@inner
def redraw_scene(
    reference: Reference, rng: np.random.Generator, scene: StateArrays
) -> tuple[StateArrays, float]:
    """Redraw everything: camera, scenelets and latent variables.

    Parameters
    ----------
    reference : Reference
    rng : numpy.random.Generator
    scene : StateArrays

    Returns
    -------
    StateArrays, float
    """
    new = draw_scene(reference, rng)
    there = log_reference(reference, new.camera, new.items, new.placements, new.sizes)
    back = log_reference(reference, scene.camera, scene.items, scene.placements, scene.sizes)
    return new, back - there if there > -math.inf else -math.inf


@inner
def redraw_stretch(
    reference: Reference, rng: np.random.Generator, scene: StateArrays
) -> tuple[StateArrays, float]:
    """Redraw a run of consecutive scenelets or a gap, which may change their number.

    A run of n scenelets has weight 2^-n, because long ones are seldom accepted and cost more. Whole
    groups of flush scenelets have more. Gaps have less, because nothing is drawn in most of
    them.

    Parameters
    ----------
    reference : Reference
    rng : numpy.random.Generator
    scene : StateArrays

    Returns
    -------
    StateArrays, float
        The move is impossible if a new scenelet overlaps the one after the run.
    """
    first, last = _draw_run(reference.lengths, scene.items, rng)
    new, n = with_stretch(reference, rng, scene, first, last)
    if first == last and n == 0:
        return scene, -math.inf
    there = _log_run(reference.lengths, scene.items, first, last) + log_stretch(
        reference, new.camera, new.items, new.placements, new.sizes, first, first + n
    )
    if there == -math.inf:
        return scene, -math.inf
    back = _log_run(reference.lengths, new.items, first, first + n) + log_stretch(
        reference, scene.camera, scene.items, scene.placements, scene.sizes, first, last
    )
    return new, back - there


@compiled
def _groups(lengths: Ints, items: Ints) -> Ints:
    """(G, 2) index of the first, and after the last, of each group of two or more flush
    scenelets."""
    groups, n, first = np.empty((len(items) // 2, 2), np.int64), 0, 0
    for i in range(1, len(items) + 1):
        if i < len(items) and items[i, 1] == items[i - 1, 1] + lengths[items[i - 1, 0]]:
            continue
        if i - first > 1:
            groups[n] = first, i
            n += 1
        first = i
    return groups[:n]


@compiled
def _draw_run(lengths: Ints, items: Ints, rng: np.random.Generator) -> tuple[int, int]:
    """Choose a run of scenelets to redraw: its first, and the one after its last; equal for a
    gap."""
    k, groups = len(items), _groups(lengths, items)
    left = rng.random() * _run_weights(k, len(groups))
    left -= _INSERTED * (k + 1)
    if left < 0.0 or k == 0:
        first = int(rng.integers(0, k + 1))
        return first, first
    left -= _GROUP * len(groups)
    if left < 0.0:
        g = int(rng.integers(0, len(groups)))
        return int(groups[g, 0]), int(groups[g, 1])
    n = 1
    while n < k:
        left -= (k - n + 1) * 0.5**n
        if left < 0.0:
            break
        n += 1
    first = int(rng.integers(0, k - n + 1))
    return first, first + n


@inner
def _run_weights(k: int, n_groups: int) -> float:
    """Sum of the weights of all runs and gaps of k scenelets."""
    return float(_INSERTED * (k + 1) + _GROUP * n_groups + k - 1 + 0.5**k)


@compiled
def _log_run(lengths: Ints, items: Ints, first: int, last: int) -> float:
    """Log probability of choosing a run."""
    groups = _groups(lengths, items)
    weight = 0.5 ** (last - first) if last > first else _INSERTED
    for g in range(len(groups)):
        if groups[g, 0] == first and groups[g, 1] == last:
            weight += _GROUP
    return math.log(weight / _run_weights(len(items), len(groups)))
