"""Density of scenes under the reference, see :mod:`imapper_prob.sampling.reference`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.sampling.jit import compiled, inner, inner_inlined
from imapper_prob.sampling.reference import (
    ANYWHERE,
    COMPONENTS,
    END_PROBABILITY,
    FITTING,
    FLUSH_NEXT,
    FOLLOWED,
    LATER,
    NONE_BEFORE,
    SAME_KIND,
    SIMILAR,
    START,
    Reference,
    log_t,
)  # fmt: skip
from imapper_prob.sampling.reference_placement import end_pose, log_placement

__all__ = [
    "component_probabilities",
    "log_reference",
    "log_stretch",
    "next_probability",
    "weights_after",
]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@inner_inlined
def _first_from(codes: Ints, first: int, last: int, code: int) -> int:
    """Index of the first code of a row that is no less than a given one; ``last`` if none is."""
    while first < last:
        middle = (first + last) // 2
        if codes[middle] < code:
            first = middle + 1
        else:
            last = middle
    return int(first)


@inner_inlined
def _find(codes: Ints, first: int, last: int, code: int) -> int:
    """Index of a code in a row; -1 if it is absent."""
    at = _first_from(codes, first, last, code)
    return at if at < last and codes[at] == code else -1


@inner_inlined
def weights_after(reference: Reference, kind: int, end: int, weights: Array) -> None:
    """Weights of the components after a scenelet of a given kind that ended at a given frame.

    Parameters
    ----------
    reference : Reference
    kind : int
        Kind of the scenelet before, 0 at the beginning.
    end : int
        Frame after its last one.
    weights : (6,) float
        Output.
    """
    for c in range(COMPONENTS):
        weights[c] = reference.weights[c]
    if kind == 0 or reference.fitting_kinds[end, 0] == 0.0:
        weights[FITTING], weights[FLUSH_NEXT] = weights[FITTING] + weights[FLUSH_NEXT], 0.0
    row = kind * len(reference.frames_left) + end
    if reference.followed_first[row] == reference.followed_first[row + 1]:
        weights[LATER], weights[FOLLOWED] = weights[LATER] + weights[FOLLOWED], 0.0
    if reference.later_first[end] == reference.later_first[end + 1]:
        weights[ANYWHERE] += weights[LATER] + weights[SIMILAR]
        weights[LATER], weights[SIMILAR] = 0.0, 0.0


@inner_inlined
def _start_probability(reference: Reference, end: int, start: int) -> float:
    """Probability that the first fitting one from frame ``end`` on begins at ``start``; the end of
    the clip stands for none."""
    none = math.exp(reference.survival[start] - reference.survival[end])
    return none * reference.hazard[start] if start < len(reference.frames_left) - 1 else none


@inner_inlined
def _at_start(reference: Reference, end: int, start: int) -> tuple[int, int]:
    """Range of the later row whose codes have a given start: first index, and index after the
    last."""
    first, last = reference.later_first[end], reference.later_first[end + 1]
    n_scenelets = len(reference.kinds)
    begin = _first_from(reference.later, first, last, start * n_scenelets)
    return begin, _first_from(reference.later, begin, last, (start + 1) * n_scenelets)


@inner_inlined
def _flush_probability(reference: Reference, kind: int, end: int, scenelet: int) -> float:
    """Probability under the component flush of a scenelet after one of a given kind."""
    of_kind = reference.fitting_kinds[end, kind]
    same = SAME_KIND if of_kind > 0.0 else 0.0
    total = 1.0 - same
    if same > 0.0 and reference.kinds[scenelet] == kind:
        total += same / of_kind
    return float(total * reference.fitting[end, scenelet])


@inner_inlined
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
    weights_after(reference, kind, end, probability)
    n_scenelets, n_frames = len(reference.kinds), len(reference.frames_left) - 1
    row = kind * (n_frames + 1) + end
    at = _find(
        reference.followed, reference.followed_first[row], reference.followed_first[row + 1], code
    )
    probability[FOLLOWED] *= reference.followed_probability[at] if at >= 0 else 0.0
    at = _find(reference.later, reference.later_first[end], reference.later_first[end + 1], code)
    met = reference.later_probability[at] if at >= 0 else 0.0
    probability[LATER] *= met
    n_fitting_starts = reference.n_fitting_starts[end]
    if code == n_frames * n_scenelets:
        none = _start_probability(reference, end, n_frames)
        probability[SIMILAR] *= met
        probability[FITTING] *= END_PROBABILITY + (1.0 - END_PROBABILITY) * none
        probability[ANYWHERE] *= END_PROBABILITY if n_fitting_starts > 0 else 1.0
        probability[FLUSH_NEXT] = 0.0
        return
    start, scenelet = code // n_scenelets, code % n_scenelets
    if start < end or reference.lengths[scenelet] > reference.frames_left[start]:
        for c in range(COMPONENTS):
            probability[c] = 0.0
        return
    alike, (first, last) = 0.0, _at_start(reference, end, start)
    for at in range(first, last):
        other = reference.later[at] - start * n_scenelets
        alike += reference.later_similar[at] * reference.similar_to[scenelet, other]
    probability[SIMILAR] *= alike
    begins = (
        _start_probability(reference, end, start)
        if reference.fitting[start, scenelet] > 0.0
        else 0.0
    )
    probability[FITTING] *= (1.0 - END_PROBABILITY) * begins * reference.fitting[start, scenelet]
    probability[ANYWHERE] *= (1.0 - END_PROBABILITY) / n_fitting_starts
    probability[FLUSH_NEXT] *= (
        _flush_probability(reference, kind, end, scenelet) if start == end else 0.0
    )


@compiled
def component_probabilities(reference: Reference, counts: Ints, items: Ints) -> Array:
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
        kind, end = START, START
        for i in range(counts[n] + 1):
            code = (len(reference.frames_left) - 1) * n_scenelets
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


@inner_inlined
def _stop_probability(
    reference: Reference, kind: int, end: int, start: int, weights: Array
) -> float:
    """Probability that nothing begins before ``start``; for the end of the clip, that the scene
    ends. The weights are a workspace."""
    weights_after(reference, kind, end, weights)
    n_scenelets, n_frames = len(reference.kinds), len(reference.frames_left) - 1
    code = start * n_scenelets
    row = kind * (n_frames + 1) + end
    first, last = reference.followed_first[row], reference.followed_first[row + 1]
    followed, later = 0.0, 0.0
    for at in range(_first_from(reference.followed, first, last, code), last):
        followed += reference.followed_probability[at]
    first, last = reference.later_first[end], reference.later_first[end + 1]
    for at in range(_first_from(reference.later, first, last, code), last):
        later += reference.later_probability[at]
    none = math.exp(reference.survival[start] - reference.survival[end])
    empty = 1.0
    if reference.n_fitting_starts[end] > 0:
        empty = (
            END_PROBABILITY
            + (1.0 - END_PROBABILITY)
            * reference.n_fitting_starts[start]
            / reference.n_fitting_starts[end]
        )
    total = weights[FOLLOWED] * followed + (weights[LATER] + weights[SIMILAR]) * later
    total += (
        weights[FITTING] * (END_PROBABILITY + (1.0 - END_PROBABILITY) * none)
        + weights[ANYWHERE] * empty
    )
    if start == end:
        total += weights[FLUSH_NEXT]
    return float(total)


@inner
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
    probability, before, work = np.empty(COMPONENTS), np.empty((2, 4)), np.empty((4, 4))
    return _log_stretch(
        reference, camera, items, placements, sizes, first, last, probability, before, work
    )


@inner_inlined
def _log_stretch(
    reference: Reference,
    camera: Array,
    items: Ints,
    placements: Array,
    sizes: Array,
    first: int,
    last: int,
    probability: Array,
    before: Array,
    work: Array,
) -> float:
    """The body of :func:`log_stretch`; inlined kernels cannot allocate, so it gets workspaces."""
    n_scenelets, n_frames = len(reference.kinds), len(reference.frames_left) - 1
    kind, end, left, total = START, START, NONE_BEFORE, 0.0
    for k in range(max(first - 1, 0), last):
        scenelet, start = items[k, 0], items[k, 1]
        if k >= first:
            next_probability(reference, kind, end, start * n_scenelets + scenelet, probability)
            if probability[ANYWHERE] == 0.0:
                return -math.inf
            of_mixture = 0.0
            for c in range(COMPONENTS):
                of_mixture += probability[c]
            total += math.log(of_mixture) + log_placement(
                reference, camera, scenelet, start, placements[k], sizes[k], left, before, work
            )
            if total == -math.inf:
                return total
        left = end_pose(reference, camera, scenelet, start, placements[k], sizes[k], before)
        kind, end = reference.kinds[scenelet], start + reference.lengths[scenelet]
    stop = items[last, 1] if last < len(items) else n_frames
    if end > stop:
        return -math.inf
    return float(total + math.log(_stop_probability(reference, kind, end, stop, probability)))


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
    log_camera = log_t(
        camera - reference.camera_mean, reference.camera_factor, reference.camera_constant
    )
    return log_camera + log_stretch(
        reference, camera, items, placements, sizes, START, len(items)
    )  # fmt: skip
