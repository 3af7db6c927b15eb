"""From 2D joints to 3D poses: the library's poses, chosen to look right and to follow on.

One picture of a body has many poses: whoever leans forward may as well lean back. The
candidates of all frames are therefore weighed together, as a hidden Markov chain whose states
are the nearest poses of each frame: what does not go on smoothly falls away. What is left of
several explanations is reported, not hidden.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from imapper_prob.lifting.nearest import Candidates, nearest_poses
from imapper_prob.lifting.poses import built_in_poses
from imapper_prob.lifting.views import Views, views_of
from imapper_prob.models.camera import Camera
from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.skeleton import N_JOINTS
from imapper_prob.staged.bones import LENGTHS, bones_of, joints_of

__all__ = ["Lifted", "lift_clip", "lift_keypoints"]

Array = NDArray[np.float64]

_log = logging.getLogger(__name__)

_FEWEST: Final = 6
"""Detected joints without which a frame has no pose: fewer fit nearly any."""
_CANDIDATES: Final = 60
"""Poses kept a frame."""
_LIKENESS: Final = 0.06
"""Metres, root-mean-square: how well the library's nearest pose matches somebody in the image.
A frame counts as two joints: what is wrong with one joint is wrong with the others."""
_STEP: Final = 0.06
"""Metres, root-mean-square, that joints move about the pelvis in a tenth of a second."""
_APPROACH: Final = 0.05
"""Change of log depth in a tenth of a second, steps towards the camera and errors of scale."""
_FREELY: Final = 0.2
"""Metres that a detection may carry a joint away from the chosen pose, across the ray."""
_AMBIGUOUS: Final = 0.15
"""Metres of root-mean-square spread from which a frame is called ambiguous."""


@dataclass(frozen=True)
class Lifted:
    """Poses for the frames of one track.

    Parameters
    ----------
    poses : (T, 16, 3) float
        Relative to the pelvis, camera axes, metres at the reference stature; NaN for a whole
        frame with too few detections.
    spread : (T,) float
        Root-mean-square distance in metres of the joints of all explanations, weighed by
        their probability, from the pose given; NaN where there is none.
    """

    poses: Array
    spread: Array


def lift_clip(clip: Clip, *, poses: Array | None = None) -> Clip:
    """Give poses to those tracks of a clip that have none.

    Parameters
    ----------
    clip : Clip
    poses : (K, 16, 3) float, optional
        See :func:`imapper_prob.lifting.poses.distinct_poses`; the built-in library's if not
        given.

    Returns
    -------
    Clip
        Tracks that had a pose in any frame are as they were.
    """
    poses = built_in_poses() if poses is None else poses
    return replace(clip, tracks=tuple(_lifted(clip, track, poses) for track in clip.tracks))


def _lifted(clip: Clip, track: Track, poses: Array) -> Track:
    if track.has_pose.any():
        return track
    lifted = lift_keypoints(
        clip.camera, track.keypoints, track.confidences, fps=clip.fps, poses=poses
    )
    known = np.isfinite(lifted.spread)
    if known.any():
        _log.warning(
            "%s: poses of %s lifted from 2D in %d of %d frames, %d of them ambiguous",
            clip.name,
            track.name,
            known.sum(),
            clip.n_frames,
            (lifted.spread[known] > _AMBIGUOUS).sum(),
        )
    return replace(track, poses=lifted.poses)


def lift_keypoints(
    camera: Camera, keypoints: Array, confidences: Array, *, fps: float, poses: Array
) -> Lifted:
    """Lift one person.

    Parameters
    ----------
    camera : Camera
        Its nominal pose says where the horizon is.
    keypoints : (T, 16, 2) float
        Pixels; NaN where missing.
    confidences : (T, 16) float
        In [0, 1], 0 where missing.
    fps : float
        Frames a second.
    poses : (K, 16, 3) float
        What people look like, facing +y.
    """
    usable = np.flatnonzero((confidences > 0).sum(1) >= _FEWEST)
    result = np.full((len(keypoints), N_JOINTS, 3), np.nan)
    spread = np.full(len(keypoints), np.nan)
    if not len(usable):
        return Lifted(result, spread)
    views = views_of(camera, keypoints[usable], confidences[usable])
    candidates = nearest_poses(views, poses, count=_CANDIDATES)
    gaps = np.diff(usable) * (10.0 / fps)
    best, marginal = _smoothed(candidates, gaps)
    rows = np.arange(len(usable))
    apart = ((candidates.joints - candidates.joints[rows, best][:, None]) ** 2).sum(-1).mean(-1)
    spread[usable] = np.sqrt((marginal * apart).sum(1))
    result[usable] = _towards_detections(views, candidates, best)
    return Lifted(result, spread)


def _smoothed(candidates: Candidates, gaps: Array) -> tuple[NDArray[np.intp], Array]:
    """The most probable sequence of candidates (T,), and each one's probability (T, M).

    ``gaps`` (T - 1,) are tenths of a second between frames.
    """
    joints, scale = candidates.joints, np.log(candidates.scale)
    n_frames, count = scale.shape
    own = -candidates.error / _LIKENESS**2
    forward, best = np.zeros((2, n_frames, count))
    back = np.zeros((n_frames, count), np.intp)
    forward[0] = best[0] = own[0]
    steps = np.zeros((n_frames - 1, count, count))
    for t in range(1, n_frames):
        before, after = (joints[i].reshape(count, -1) for i in (t - 1, t))
        square = (before**2).sum(1)[:, None] + (after**2).sum(1) - 2 * before @ after.T
        moved = square / N_JOINTS / _STEP**2
        nearer = (scale[t - 1][:, None] - scale[t]) ** 2 / _APPROACH**2
        steps[t - 1] = -(moved + nearer) / (2 * gaps[t - 1])
        reached = best[t - 1][:, None] + steps[t - 1]
        back[t] = reached.argmax(0)
        best[t] = reached.max(0) + own[t]
        forward[t] = logsumexp(forward[t - 1][:, None] + steps[t - 1], axis=0) + own[t]
    path = np.zeros(n_frames, np.intp)
    path[-1] = best[-1].argmax()
    backward = np.zeros((n_frames, count))
    for t in range(n_frames - 2, -1, -1):
        path[t] = back[t + 1][path[t + 1]]
        backward[t] = logsumexp(steps[t] + own[t + 1] + backward[t + 1], axis=1)
    weight = forward + backward
    return path, np.exp(weight - logsumexp(weight, axis=1, keepdims=True))


def _towards_detections(views: Views, candidates: Candidates, best: NDArray[np.intp]) -> Array:
    """The chosen poses, bent so that joints lie where they were seen, bones as long as before.

    Across the ray the picture knows better than the library, along it only the library knows.
    """
    rows = np.arange(len(best))
    joints = candidates.joints[rows, best]
    view = joints @ views.axes
    scale = candidates.scale[rows, best][:, None]
    tilt = views.elevation[:, None]
    above = np.cos(tilt) * view[..., 2] - np.sin(tilt) * view[..., 1]
    seen = (views.tangents - candidates.shift[rows, best][:, None]) / scale[..., None]
    pull = np.sqrt(views.weights)
    across = pull * np.clip(seen[..., 0] - view[..., 0], -_FREELY, _FREELY)
    upward = pull * np.clip(seen[..., 1] - above, -_FREELY, _FREELY)
    view[..., 0] += across
    view[..., 1] -= np.sin(tilt) * upward
    view[..., 2] += np.cos(tilt) * upward
    bones = bones_of(view @ views.axes.transpose(0, 2, 1))
    bones *= LENGTHS[:, None] / np.maximum(np.linalg.norm(bones, axis=-1, keepdims=True), 1e-6)
    return joints_of(bones)
