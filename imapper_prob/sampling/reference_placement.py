"""Placements of scenelets under the reference: step 3 of
:mod:`imapper_prob.sampling.reference`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.view import log_area
from imapper_prob.sampling.image_pelvis import reproject_pelvis
from imapper_prob.sampling.jit import compiled, inner, inner_inlined
from imapper_prob.sampling.reference import (
    FIRST,
    FLUSH,
    GAP,
    NONE_BEFORE,
    PRIOR_PLACEMENT_WEIGHT,
    Reference,
    log_t,
)

__all__ = ["displacements", "end_pose", "log_placement", "mean_offsets", "placement_centre"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@inner_inlined
def _pelvis_of(
    reference: Reference,
    camera: Array,
    scenelet: int,
    last: int,
    place: Array,
    size: float,
    where: Array,
) -> None:
    """Write the position of a scenelet's pelvis in its first (0) or last (1) frame to ``where``
    (4,); its log depth is NaN behind the camera."""
    body = math.exp(camera[3] + size)
    c, s = body * math.cos(place[2]), body * math.sin(place[2])
    local = reference.pelvis[scenelet, last]
    x, y = place[0] + c * local[0] - s * local[1], place[1] + s * local[0] + c * local[1]
    where[0], where[1] = (x / y, math.log(y)) if y > 0.0 else (0.0, math.nan)
    where[2], where[3] = place[2], size


@inner_inlined
def _mean_position(
    reference: Reference, camera: Array, scenelet: int, start: int, last: int, where: Array
) -> None:
    """Write the mean position of a scenelet's pelvis over visits, transformed to a camera."""
    frame = start + (reference.lengths[scenelet] - 1) * last
    where[0], where[1] = reference.path[frame, 0], reference.path[frame, 1]
    where[2], where[3] = reference.yaw[start, scenelet], reference.size
    for i in range(4):
        where[i] += reference.scenelet_deviations[scenelet, last, i]
        where[i] += reference.start_deviations[start, scenelet, i]
    height = reference.pelvis[scenelet, last, 2]
    reproject_pelvis(height, where, reference.library_camera, camera)


@inner_inlined
def _subtract(from_: Array, mean: Array, offset: Array) -> None:
    """Write the offset of a position from a mean one; the yaw is wrapped to half a turn either
    way."""
    for i in range(4):
        offset[i] = from_[i] - mean[i]
    offset[2] -= 2.0 * math.pi * math.floor(offset[2] / (2.0 * math.pi) + 0.5)


@inner
def _multiply(matrix: Array, vector: Array, product: Array) -> None:
    """Write the product to ``product``; numba's own needs a counted kernel."""
    np.dot(matrix, vector, product)


@inner_inlined
def placement_centre(
    reference: Reference,
    camera: Array,
    scenelet: int,
    start: int,
    end: int,
    before: Array,
    middle: Array,
) -> int:
    """Centre of the distribution of a scenelet's pelvis in its first frame, and its factor's row.

    For a scenelet that is flush with the one before, the position continues from that one's last
    pelvis. Every centre depends linearly on the camera.

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
    middle : (2, 4) float
        Output: bearing, log depth, yaw and log size; the second row is a workspace.

    Returns
    -------
    int
        Row of the displacement factors.
    """
    _mean_position(reference, camera, scenelet, start, 0, middle[0])
    row = FIRST
    if end >= 0:
        row = FLUSH if start == end else GAP
        if row == FLUSH:
            for i in range(2):
                step = reference.path[start, i] - reference.path[end - 1, i]
                middle[0, i] = before[0, i] + step
        _multiply(reference.displacement_regression[row - 1], before[1], middle[1])
        for i in range(4):
            middle[0, i] += middle[1, i]
    for i in range(4):
        for j in range(5):
            off = camera[j] - reference.camera_mean[j]
            middle[0, i] += reference.camera_regression[row, i, j] * off
    return row


@inner_inlined
def end_pose(
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
        Output, see :func:`placement_centre`.

    Returns
    -------
    int
        Frame after the last one; -1 if the pelvis is behind the camera.
    """
    _pelvis_of(reference, camera, scenelet, 1, place, size, before[0])
    if math.isnan(before[0, 1]):
        return -1
    _mean_position(reference, camera, scenelet, start, 1, before[1])
    _subtract(before[0], before[1], before[1])
    return int(start + reference.lengths[scenelet])


@compiled
def mean_offsets(
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
    offsets, where = np.empty((len(items), 2, 4)), np.empty((2, 4))
    k = 0
    for n in range(len(counts)):
        for _ in range(counts[n]):
            scenelet, start = items[k]
            for last in range(2):
                _pelvis_of(
                    reference, cameras[n], scenelet, last, places[k], sizes[k], where[0]
                )  # fmt: skip
                _mean_position(reference, cameras[n], scenelet, start, last, where[1])
                _subtract(where[0], where[1], offsets[k, last])
            k += 1
    return offsets


@compiled
def displacements(
    reference: Reference, cameras: Array, counts: Ints, items: Ints, places: Array, sizes: Array
) -> tuple[Ints, Array, Array]:
    """Displacements of the scenelets of N states from the centres of their placements.

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
        Displacement of each scenelet from the centre of its placement.
    """
    rows, before, offsets = (
        np.empty(len(items), np.int64),
        np.zeros((2, 4)),
        np.zeros((len(items), 4)),
    )
    displaced = np.zeros((len(items), 4))
    where, middle = np.empty(4), np.empty((2, 4))
    k = 0
    for n in range(len(counts)):
        end = NONE_BEFORE
        for _ in range(counts[n]):
            scenelet, start = items[k]
            _pelvis_of(reference, cameras[n], scenelet, 0, places[k], sizes[k], where)
            row = placement_centre(reference, cameras[n], scenelet, start, end, before, middle)
            rows[k] = -1 if math.isnan(where[1]) else row
            if end >= 0:
                displaced[k] = before[1]
            _subtract(where, middle[0], offsets[k])
            end = end_pose(reference, cameras[n], scenelet, start, places[k], sizes[k], before)
            k += 1
    return rows, displaced, offsets


@inner_inlined
def _log_anywhere(reference: Reference, where: Array) -> float:
    """Log density of a position under the prior."""
    total = -math.log(2.0 * math.pi) - 0.5 * (where[3] / reference.size_spread) ** 2
    total -= math.log(reference.size_spread) + 1.5 * math.log(2.0 * math.pi)
    for i in range(2):
        deviation = reference.anywhere_deviation[i]
        total -= 0.5 * ((where[i] - reference.anywhere_mean[i]) / deviation) ** 2
        total -= math.log(deviation)
    return float(total)


@inner_inlined
def log_placement(
    reference: Reference,
    camera: Array,
    scenelet: int,
    start: int,
    place: Array,
    size: float,
    end: int,
    before: Array,
    work: Array,
) -> float:
    """Log density of a scenelet's placement, given the scenelet before.

    Parameters
    ----------
    reference : Reference
    camera : (5,) float
    scenelet : int
    start : int
        Start frame.
    place : (3,) float
    size : float
    end : int
        Frame after the last of the scenelet before, -1 if there is none.
    before : (2, 4) float
        See :func:`placement_centre`.
    work : (4, 4) float
        Workspace.

    Returns
    -------
    float
        Nats, per square metre, radian and unit of log size; -inf behind the camera.
    """
    where, offset = work[0], work[1]
    _pelvis_of(reference, camera, scenelet, 0, place, size, where)
    if math.isnan(where[1]):
        return -math.inf
    row = placement_centre(reference, camera, scenelet, start, end, before, work[2:])
    _subtract(where, work[2], offset)
    new = reference.rarely_visited[scenelet]
    near = log_t(offset, reference.factors[row, new], reference.constants[row, new])
    far = _log_anywhere(reference, where)
    most = max(near, far)
    density = (1.0 - PRIOR_PLACEMENT_WEIGHT) * math.exp(
        near - most
    ) + PRIOR_PLACEMENT_WEIGHT * math.exp(far - most)
    return float(math.log(density) + most - log_area(where[1]))
