"""Frames in which the detector was somewhere else: on clutter, a picture, another person.

Whoever walks behind furniture may leave the detector with something that looks like a person for
a second or two: all joints jump across the picture, stay there, and jump back. Robust errors of
single joints do not help, for all joints agree. What gives such frames away is that nobody
moves like that.

The frames are a chain of two states. In frames of its own the person goes on from where they
were last seen, by a Student-t step whose scale grows with the time since then; the detector begins
to be elsewhere now and then, at any place of the picture, stays there as a person would or hops
on, and comes back. The most probable sequence of states is found by dynamic programming over the
last frame of its own (a semi-Markov chain, for the step back depends on how long it took).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.special import logsumexp

from imapper_prob.models.camera import Camera
from imapper_prob.models.detector import (
    ERROR_EDGES,
    DetectionModel,
    student_t,
    student_t_loss,
)
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.skeleton import DETECTED

__all__ = ["frames_elsewhere", "own_detections"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_POSITIONED: Final = 0.02
"""Confidence above which a detection says where its joint is (`models.detector`)."""
_SIZED: Final = 0.3
"""Confidence from which joints count for the person's height in the picture."""
_WHOLE: Final = 7
"""So many of the fourteen joints it takes to say how high somebody is."""
_APART: Final = 0.5
"""Heights by which two joints of one body may be apart: added to the step's scale where two frames
have hardly a joint in common, so that only the middles of what they have can be compared."""
_EVIDENCE: Final = 0.1
"""Sum of confidences from which a frame says where anybody is."""
_SHARED: Final = 2
"""Joints that two frames must have in common for their displacement."""
_SHAPED: Final = 4
"""The same for how they move against each other."""
_HEIGHT_TIME: Final = 4.0
"""Seconds over which that height is a running median."""
_STEP: Final = (0.03, 0.4)
"""Scale of a person's step in heights: at once, and per second. On eight scenes of i3DB the median
displacement in .1 s is .04 heights, 99 of 100 are below .15."""
_DOF: Final = 6.0
"""Tails of the step: people jump, and so do boxes around them."""
_CHANGE: Final = (0.03, 0.1)
"""Scale in heights by which a person's joints move against each other: at once, and per second. On
i3DB the median of a frame's joints is .01 to .04 in .1 s, .06 to .12 in a second."""
_UNLIKE: Final = 0.23
"""That scale between two poses that have nothing to do with each other: between frames of different
scenes of i3DB the median is .18, which is .76 scales."""
_CHANGE_DOF: Final = 3.0
"""Tails of that: joints that are lost land anywhere, and sides are exchanged."""
_OTHER: Final = 0.5
"""Probability that what a detector goes to has a pose of its own; a mirror has the person's."""
_BEGINS: Final = 0.01
"""How often a second a detector goes elsewhere."""
_LEAVES: Final = 1.0
"""How often a second it comes back."""
_HOPS: Final = 0.05
"""Part of the frames elsewhere in which it goes on to yet another place."""
_LONGEST: Final = 6.0
"""Seconds after which somebody may have walked anywhere."""
_MOST: Final = 0.9
"""Part of the frames from which on a track is nobody's."""


def own_detections(clip: Clip) -> Clip:
    """The clip without what the detector said of its people while it was elsewhere.

    In such frames nothing is detected, and there is no lifted pose, for that was made of the
    same detections.

    Parameters
    ----------
    clip : Clip

    Returns
    -------
    Clip

    Raises
    ------
    InputError
        If that is nearly all of somebody's track.
    """
    tracks = []
    for track in clip.tracks:
        away = frames_elsewhere(track, camera=clip.camera, fps=clip.fps)
        detected = (track.confidences > 0).any(1)
        if away.any() and away.sum() > _MOST * detected.sum():
            raise InputError(
                f"clip {clip.name}, track {track.name}: in {away.sum()} of the {detected.sum()} "
                "frames with detections all joints jump across the picture as nobody does, "
                f"first in frame {clip.frame_ids[away.argmax()]}; leave the track out, or "
                "detect again"
            )
        tracks.append(_without(track, away))
    return replace(clip, tracks=tuple(tracks))


def _without(track: Track, away: Flags) -> Track:
    if not away.any():
        return track
    return replace(
        track,
        keypoints=np.where(away[:, None, None], np.nan, track.keypoints),
        confidences=np.where(away[:, None], 0.0, track.confidences),
        poses=np.where(away[:, None, None], np.nan, track.poses),
    )


def frames_elsewhere(track: Track, *, camera: Camera, fps: float) -> Flags:
    """Find the frames of a track in which the detector was not on its person.

    Parameters
    ----------
    track : Track
    camera : Camera
        For the size of its picture, in which a detector that is elsewhere may be anywhere.
    fps : float
        Frames a second.

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
        DetectionModel().error_scale[0, 1:] * camera.height / 1080.0,
        uniform=-np.log(float(camera.width) * camera.height), fps=fps,
    )  # fmt: skip
    away[frames] = ~own
    # A frame that hardly says anything is as those around it.
    index = np.arange(len(away))
    before = np.maximum(np.searchsorted(frames, index, side="right") - 1, 0)
    after = np.minimum(before + 1, len(frames) - 1)
    between: Flags = (confidences > 0).any(1) & away[frames[before]] & away[frames[after]]
    return away | between


def _heights(points: Array, confidences: Array, *, fps: float, picture: int) -> Array:
    """(T,) running median of how high the person is in the picture, pixels."""
    sure = confidences >= _SIZED
    frames = np.flatnonzero(sure.sum(1) >= _WHOLE)
    if not len(frames):
        return np.full(len(points), picture / 2)
    up = np.where(sure[frames], points[frames, :, 1], np.nan)
    extent = np.nanmax(up, axis=1) - np.nanmin(up, axis=1)
    window = 2 * round(_HEIGHT_TIME * fps / 2) + 1
    extent = median_filter(extent, size=min(window, 2 * len(extent) - 1), mode="nearest")
    result: Array = np.maximum(np.interp(np.arange(len(points)), frames, extent), 0.02 * picture)
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
    """(N,) which of the usable frames are the person's own, by the best sequence of states.

    ``best[i]`` is the log-probability of the best sequence up to frame i, which is its own;
    ``came[i]`` is the frame before it that is its own, -1 if there is none.
    """
    n = len(frames)
    begins, leaves = 1 - np.exp(-_BEGINS / fps), 1 - np.exp(-_LEAVES / fps)
    previous = _steps(points, confidences, heights, np.diff(frames) / fps, errors, lag=1)
    # What it costs to be elsewhere in a frame and to have been so in the one before.
    stay = np.log1p(-_HOPS) + previous
    stays = np.log1p(-leaves) + logsumexp(
        np.stack([stay, np.full_like(stay, np.log(_HOPS) + uniform)]), axis=0
    )
    run = np.concatenate([[0.0, 0.0], np.cumsum(stays)])[: n + 1]  # run[j + 1] - run[i + 1]
    best, came = np.full(n, -np.inf), np.full(n, -1)
    # The first frame of its own: anywhere, after any number of frames elsewhere.
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
    # Until the end of the clip it may be elsewhere.
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
    """(N - lag,) log-density of a person's step from each frame to that ``lag`` later, per pixel^2.

    The step is the weighted median displacement of the joints that both frames have; where they
    have too few, that between the medians of either. To its scale belongs the error of
    detections, ``errors`` (2,) pixels of a doubtful and of a sure joint. How joints move against
    each other meanwhile is relative to its density in a jump elsewhere.
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
    """Log-density of a half Student-t of that scale, up to its constant."""
    loss = student_t_loss(change**2, scale, _CHANGE_DOF, dimensions=1)
    result: Array = -np.log(scale) - loss
    return result


def _median(values: Array, weights: Array) -> Array:
    """(N, k) weighted medians of (N, J, k) by coordinate."""
    order = np.argsort(values, axis=1)
    ordered = np.take_along_axis(values, order, axis=1)
    heap = np.cumsum(np.take_along_axis(weights[..., None] + 0 * values, order, axis=1), axis=1)
    middle = (heap < heap[:, -1:] / 2).sum(1, keepdims=True)
    result: Array = np.take_along_axis(ordered, np.minimum(middle, values.shape[1] - 1), axis=1)
    return result[:, 0]
