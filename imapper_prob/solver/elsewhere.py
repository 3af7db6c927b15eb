"""Find frames in which the detector followed something other than the person.

When a person walks behind furniture, the detector may find something else that looks like a person
for a second or two: all joints jump across the image, stay there, and jump back. Robust errors of
single joints do not help, because all joints agree. Such frames are recognised by motion that no
person makes.

The frames are a chain of two states. In frames of the person (*own* frames), the position follows
from the last own frame by a Student-t step, whose scale grows with the time since then. At a small
rate the detector goes elsewhere, to any place in the image; there it moves like a person or jumps
again, until it returns. The most probable sequence of states is found by dynamic programming over
the last own frame (a semi-Markov chain, because the step back depends on the duration).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.special import logsumexp

from imapper_prob.models.camera import Camera
from imapper_prob.models.detector import (
    ERROR_EDGES,
    REFERENCE_SIDE,
    DetectionModel,
    student_t,
    student_t_loss,
)
from imapper_prob.models.scene import Track
from imapper_prob.models.skeleton import DETECTED

__all__ = ["frames_elsewhere"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_POSITIONED: Final = 0.02
"""Confidence above which the position of a detected joint is used (`models.detector`)."""
_SIZED: Final = 0.3
"""Confidence above which joints are used for the person's height in the image."""
_WHOLE: Final = 7
"""Number of such joints, of fourteen, that are needed for the height."""
_APART: Final = 0.5
"""Distance of two joints of one body in heights. It is added to the step's scale if two frames have
too few joints in common, so that only the medians of their joints can be compared."""
_EVIDENCE: Final = 0.1
"""Sum of confidences above which a frame is used."""
_SHARED: Final = 2
"""Joints that two frames must have in common to measure their displacement."""
_SHAPED: Final = 4
"""Joints that two frames must have in common to measure the change of pose."""
_HEIGHT_TIME: Final = 4.0
"""Window of the running median of heights, seconds."""
_STEP: Final = (0.03, 0.4)
"""Scale of a person's step in heights: constant part, and per second. On eight scenes of i3DB the
median displacement in .1 s is .04 heights, and 99 of 100 are below .15."""
_DOF: Final = 6.0
"""Degrees of freedom of the step: people jump, and so do detected boxes."""
_CHANGE: Final = (0.03, 0.1)
"""Scale of the change of pose in heights: constant part, and per second. On i3DB the median over a
frame's joints is .01 to .04 in .1 s, and .06 to .12 in a second."""
_UNLIKE: Final = 0.23
"""Scale of the change between two unrelated poses: between frames of different scenes of i3DB the
median is .18, which is .76 scales."""
_CHANGE_DOF: Final = 3.0
"""Degrees of freedom of the change: lost joints are detected anywhere, and sides are flipped."""
_OTHER: Final = 0.5
"""Probability that the detector's other target has its own pose; a mirror image has the
person's."""
_BEGINS: Final = 0.01
"""Rate per second at which the detector goes elsewhere."""
_LEAVES: Final = 1.0
"""Rate per second at which the detector returns."""
_HOPS: Final = 0.05
"""Share of the frames elsewhere, at any frame rate, in which the detector jumps to yet another
place."""
_LONGEST: Final = 6.0
"""Seconds after which the person may have walked anywhere."""


def frames_elsewhere(
    track: Track, *, camera: Camera, fps: float, detections: DetectionModel
) -> Flags:
    """Find the frames of a track in which the detector was not on its person.

    Parameters
    ----------
    track : Track
        With usual confidences.
    camera : Camera
        The image size is that of the region in which such a detector may be.
    fps : float
        Frames per second.
    detections : DetectionModel
        Has the pixel errors.

    Returns
    -------
    (T,) bool
    """
    joints = list(DETECTED)
    confidences = track.confidences[:, joints]
    points = np.where(confidences[..., None] > 0, track.keypoints[:, joints], 0.0)
    heights = _heights(points, confidences, fps=fps, picture=camera.height)
    frames = np.flatnonzero(confidences.sum(1) >= _EVIDENCE)
    away = np.zeros(len(confidences), bool)
    if len(frames) < 2:
        return away
    own = _own_frames(
        frames, points[frames], confidences[frames], heights[frames],
        detections.error_scale[0, 1:] * camera.short_side / REFERENCE_SIDE,
        uniform=-np.log(float(camera.width) * camera.height), fps=fps,
    )  # fmt: skip
    away[frames] = ~own
    # A frame with too little evidence is treated like its neighbours.
    index = np.arange(len(away))
    before = np.maximum(np.searchsorted(frames, index, side="right") - 1, 0)
    after = np.minimum(before + 1, len(frames) - 1)
    between: Flags = (confidences > 0).any(1) & away[frames[before]] & away[frames[after]]
    return away | between


_SMALLEST: Final = 0.02
"""Least height of a person as a fraction of the picture's; chosen, so that no height is zero."""


def _heights(points: Array, confidences: Array, *, fps: float, picture: int) -> Array:
    """(T,) running median of the person's height in the image, pixels."""
    sure = confidences >= _SIZED
    frames = np.flatnonzero(sure.sum(1) >= _WHOLE)
    if not len(frames):
        return np.full(len(points), picture / 2)
    up = np.where(sure[frames], points[frames, :, 1], np.nan)
    extent = np.nanmax(up, axis=1) - np.nanmin(up, axis=1)
    window = 2 * round(_HEIGHT_TIME * fps / 2) + 1
    extent = median_filter(extent, size=min(window, 2 * len(extent) - 1), mode="nearest")
    result: Array = np.maximum(
        np.interp(np.arange(len(points)), frames, extent), _SMALLEST * picture
    )
    return result


def _own_frames(
    frames: NDArray[np.int64],
    points: Array,
    confidences: Array,
    heights: Array,
    errors: Array,
    *,
    uniform: float,
    fps: float,
) -> Flags:
    """(N,) which of the usable frames are own frames, by the most probable sequence of states.

    ``best[i]`` is the log-probability of the best sequence that ends with own frame i; ``came[i]``
    is the own frame before it, -1 if there is none.
    """
    n = len(frames)
    begins, leaves = 1 - np.exp(-_BEGINS / fps), 1 - np.exp(-_LEAVES / fps)
    previous = _steps(points, confidences, heights, np.diff(frames) / fps, errors, lag=1)
    # Log-probability of being elsewhere in a frame, given the same in the frame before.
    stay = np.log1p(-_HOPS) + previous
    stays = np.log1p(-leaves) + logsumexp(
        np.stack([stay, np.full_like(stay, np.log(_HOPS) + uniform)]), axis=0
    )
    run = np.concatenate([[0.0, 0.0], np.cumsum(stays)])[: n + 1]  # run[j + 1] - run[i + 1]
    best, came = np.full(n, -np.inf), np.full(n, -1)
    # The first own frame: anywhere, after any number of frames elsewhere.
    usual = np.log(begins / (begins + leaves))
    first = np.arange(n)
    best = np.where(
        first == 0,
        np.log1p(-np.exp(usual)) + uniform,
        usual + 2 * uniform + run[np.maximum(first, 0)] - run[1] + np.log(leaves),
    )
    horizon = _LONGEST * fps
    steps: dict[int, Array] = {1: previous}
    for i in range(1, n):
        for lag in range(1, i + 1):
            gap = frames[i] - frames[i - lag]
            if lag > 1 and gap > horizon:
                break
            if lag not in steps:
                steps[lag] = _steps(
                    points,
                    confidences,
                    heights,
                    (frames[lag:] - frames[:-lag]) / fps,
                    errors,
                    lag=lag,
                )
            j = i - lag
            here = best[j] + steps[lag][j]
            if lag == 1:
                here += np.log1p(-begins)
            else:
                here += np.log(begins) + uniform + run[i] - run[j + 2] + np.log(leaves)
            if here > best[i]:
                best[i], came[i] = here, j
    # The last own frame may be followed by frames elsewhere until the end of the clip.
    ends = best + np.where(
        first == n - 1,
        0.0,
        np.log(begins) + uniform + run[n] - run[np.minimum(first + 2, n)],
    )
    own = np.zeros(n, bool)
    nobody = usual + uniform + run[n] - run[1]
    i = int(ends.argmax()) if ends.max() > nobody else -1
    while i >= 0:
        own[i] = True
        i = int(came[i])
    return own


def _steps(
    points: Array, confidences: Array, heights: Array, seconds: Array, errors: Array, *, lag: int
) -> Array:
    """(N - lag,) log-density of a person's step from each frame to one ``lag`` later, per pixel^2.

    The step is the weighted median displacement of the joints that both frames have; with too few
    of them, the displacement between the medians of both frames. Its scale includes the detection
    error, ``errors`` (2,) in pixels for doubtful and for sure joints. The change of pose enters as
    a ratio to its density in a jump elsewhere.
    """
    a, b = points[:-lag], points[lag:]
    ca, cb = confidences[:-lag], confidences[lag:]
    weight = np.where((ca > _POSITIONED) & (cb > _POSITIONED), np.minimum(ca, cb), 0.0)
    step = _median(b - a, weight)
    few = (weight > 0).sum(1) < _SHARED
    if few.any():
        step[few] = _median(b[few], cb[few]) - _median(a[few], ca[few])
    share = np.minimum(1.0, _STEP[0] + _STEP[1] * seconds) + np.where(few, _APART, 0.0)
    sure = (weight.max(1) >= ERROR_EDGES[1]).astype(int)
    error = errors[sure] * np.sqrt(2.0 / np.maximum((weight > 0).sum(1), 1))
    scale = np.hypot(heights[:-lag] * share, error)
    result = student_t((step**2).sum(-1), scale, _DOF)
    change = np.linalg.norm(b - a - step[:, None], axis=-1, keepdims=True)
    change = _median(change, weight)[:, 0] / heights[:-lag]
    like = _log_change(change, np.minimum(_UNLIKE, _CHANGE[0] + _CHANGE[1] * seconds))
    jump = np.logaddexp(
        np.log1p(-_OTHER) + like, np.log(_OTHER) + _log_change(change, np.asarray(_UNLIKE))
    )
    return result + np.where((weight > 0).sum(1) >= _SHAPED, like - jump, 0.0)


def _log_change(change: Array, scale: Array) -> Array:
    """Log-density of a half Student-t, up to a constant."""
    loss = student_t_loss(change**2, scale, _CHANGE_DOF, dimensions=1)
    result: Array = -np.log(scale) - loss
    return result


def _median(values: Array, weights: Array) -> Array:
    """(N, k) weighted medians of (N, J, k), by coordinate."""
    order = np.argsort(values, axis=1)
    ordered = np.take_along_axis(values, order, axis=1)
    heap = np.cumsum(np.take_along_axis(weights[..., None] + 0 * values, order, axis=1), axis=1)
    middle = (heap < heap[:, -1:] / 2).sum(1, keepdims=True)
    result: Array = np.take_along_axis(ordered, np.minimum(middle, values.shape[1] - 1), axis=1)
    return result[:, 0]
