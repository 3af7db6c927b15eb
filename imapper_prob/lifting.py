"""3D poses for clips with 2D joints only, from poses of the built-in library.

Each frame is rotated so that the camera looks straight at the person, and poses of the library are
matched under scaled orthographic projection. The projection of a pose is ambiguous: a forward lean
may look like a backward lean. The candidates of all frames are therefore combined in a hidden
Markov model, whose states are the nearest poses of each frame. Frames that remain ambiguous are
reported.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from imapper_prob.models.camera import Camera
from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.scenelet import Library
from imapper_prob.models.skeleton import MIRROR, N_JOINTS, PELV, facing
from imapper_prob.scenelets.library import built_in_library
from imapper_prob.solver.poses import LENGTHS, bones_of, joints_of

__all__ = [
    "Candidates",
    "Lifted",
    "Views",
    "distinct_poses",
    "lift_clip",
    "lift_keypoints",
    "views_of",
]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Views:
    """Detections of one track, seen along the ray to the person in each frame.

    Parameters
    ----------
    tangents : (T, 16, 2) float
        Detections to the right of and above that ray, as tangents; 0 where missing.
    weights : (T, 16) float
        Squared confidences; 0 where missing.
    elevation : (T,) float
        Angle of the ray above the horizon, radians.
    axes : (T, 3, 3) float
        Rotation from view axes (x right and level, y along the ray's horizontal direction, z up) to
        camera axes.
    """

    tangents: Array
    weights: Array
    elevation: Array
    axes: Array


def views_of(camera: Camera, keypoints: Array, confidences: Array) -> Views:
    """Rotate the camera towards the person, frame by frame.

    Parameters
    ----------
    camera : Camera
        Its pitch and roll give the horizon.
    keypoints : (T, 16, 2) float
        Pixels; NaN where missing.
    confidences : (T, 16) float
        0 where missing.

    Returns
    -------
    Views
    """
    weights = np.where(np.isfinite(keypoints).all(-1), confidences, 0.0) ** 2
    filled = np.where(weights[..., None] > 0, keypoints, (camera.cx, camera.cy))
    rays = camera.rays(filled) @ camera.rotation.T
    total = np.maximum(weights.sum(1), 1e-12)[:, None]
    forward = (weights[..., None] * rays).sum(1) / total
    forward = np.where((weights.max(1) > 0)[:, None], forward, camera.rotation[:, 1])
    forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
    azimuth = np.arctan2(forward[:, 0], forward[:, 1])
    elevation = np.arcsin(np.clip(forward[:, 2], -1, 1))
    cos, sin, zero = np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)
    right = np.stack([cos, -sin, zero], -1)
    level = np.stack([sin, cos, zero], -1)
    up = np.cross(right, forward)
    depth = np.maximum(np.einsum("tjc,tc->tj", rays, forward), 1e-6)
    across = np.einsum("tjc,tc->tj", rays, right) / depth
    above = np.einsum("tjc,tc->tj", rays, up) / depth
    there = weights > 0
    vertical = np.broadcast_to([0.0, 0.0, 1.0], right.shape)
    axes = camera.rotation.T @ np.stack([right, level, vertical], -1)
    return Views(
        tangents=np.where(there[..., None], np.stack([across, above], -1), 0.0),
        weights=weights,
        elevation=elevation,
        axes=axes,
    )


# ------------------------------------------------------------------------------------------------
# Distinct poses of a library, independent of where they face.

_APART: Final = 0.06
"""Root-mean-square joint distance in metres below which two poses count as one."""


@cache
def _built_in_poses() -> Array:
    """Distinct poses of the built-in library, computed once a process."""
    return distinct_poses(built_in_library())


def distinct_poses(library: Library) -> Array:
    """Select distinct poses of a library, and add their mirror images.

    Parameters
    ----------
    library : Library

    Returns
    -------
    (K, 16, 3) float
        Joints relative to the pelvis, metres, z up, facing +y; the second half are the mirror
        images of the first.
    """
    joints = np.concatenate([scenelet.joints for scenelet in library])
    poses = joints - joints[:, PELV, None]
    yaw = facing(poses)
    cos, sin = np.cos(-yaw), np.sin(-yaw)
    x, y = poses[..., 0], poses[..., 1]
    poses[..., 0], poses[..., 1] = (
        cos[:, None] * x - sin[:, None] * y,
        sin[:, None] * x + cos[:, None] * y,
    )
    # Each chosen pose removes its neighbours from the poses that may still be chosen.
    flat = poses.reshape(len(poses), -1)
    left = np.ones(len(flat), bool)
    chosen = []
    for row in range(len(flat)):
        if left[row]:
            chosen.append(row)
            squared = ((flat[left] - flat[row]) ** 2).sum(1)
            left[np.flatnonzero(left)[squared < 16 * _APART**2]] = False
    kept = poses[chosen]
    mirrored = kept[:, list(MIRROR)] * (-1, 1, 1)
    result: Array = np.concatenate([kept, mirrored])
    return result


# ------------------------------------------------------------------------------------------------
# Matching.

YAWS: Final = 36
"""Number of yaws tried for each pose, ten degrees apart."""
_ELEVATION_STEP: Final = np.deg2rad(6.0)
"""Frames with ray elevations this close use the same projections of the poses."""
_FRAMES_AT_ONCE: Final = 64
"""Frames whose poses are compared at once; chosen to limit memory."""


@dataclass(frozen=True)
class Candidates:
    """The nearest poses of each frame, the best first.

    Parameters
    ----------
    joints : (T, M, 16, 3) float
        Relative to the pelvis, metres, camera axes.
    error : (T, M) float
        Weighted mean square distance in the image plane, square metres.
    scale : (T, M) float
        Tangents a metre, the reciprocal of depth.
    shift : (T, M, 2) float
        Tangents of the pelvis.
    """

    joints: Array
    error: Array
    scale: Array
    shift: Array


def _nearest_poses(views: Views, poses: Array, *, count: int) -> Candidates:
    """Match every frame with every pose in every yaw.

    Let weights w sum to one, and let tangents u and projected joints p be relative to their
    weighted means. The best scale is <u, p> / <p, p>, and the residual, in square metres at the
    person, is <u, u> / scale² - <p, p>.

    Parameters
    ----------
    views : Views
    poses : (K, 16, 3) float
        Relative to the pelvis, metres, facing +y.
    count : int
        Candidates a frame.
    """
    angles = np.arange(YAWS) * (2 * np.pi / YAWS)
    cos, sin = np.cos(angles)[:, None, None], np.sin(angles)[:, None, None]
    x, y, z = (poses[None, ..., axis] for axis in range(3))
    turned = np.stack(
        [cos * x - sin * y, sin * x + cos * y, np.broadcast_to(z, (cos * x).shape)], -1
    )
    turned = turned.reshape(-1, *poses.shape[1:])
    n_frames = len(views.elevation)
    shape = (n_frames, min(count, len(turned)))
    chosen = np.zeros(shape, np.intp)
    error, scale, shift = np.zeros(shape), np.zeros(shape), np.zeros((*shape, 2))
    level = np.round(views.elevation / _ELEVATION_STEP)
    for value in np.unique(level):
        tilt = value * _ELEVATION_STEP
        across = turned[..., 0].astype(np.float32)
        above = (np.cos(tilt) * turned[..., 2] - np.sin(tilt) * turned[..., 1]).astype(np.float32)
        squares = across**2 + above**2
        frames = np.flatnonzero(level == value)
        for start in range(0, len(frames), _FRAMES_AT_ONCE):
            rows = frames[start : start + _FRAMES_AT_ONCE]
            weights = views.weights[rows]
            weights = (weights / np.maximum(weights.sum(1, keepdims=True), 1e-12)).T
            u, v = views.tangents[rows].T.transpose(0, 1, 2)
            mean_u, mean_v = (weights * u).sum(0), (weights * v).sum(0)
            mean_a, mean_b = across @ weights, above @ weights
            pp = squares @ weights - mean_a**2 - mean_b**2
            up = across @ (weights * u) + above @ (weights * v) - mean_a * mean_u - mean_b * mean_v
            uu = (weights * (u**2 + v**2)).sum(0) - mean_u**2 - mean_v**2
            best_scale = np.maximum(up / np.maximum(pp, 1e-9), 1e-6)
            left = uu / best_scale**2 - pp
            best = np.argpartition(left, shape[1] - 1, axis=0)[: shape[1]]
            best = np.take_along_axis(best, np.argsort(np.take_along_axis(left, best, 0), 0), 0)
            chosen[rows] = best.T
            error[rows] = np.maximum(np.take_along_axis(left, best, 0).T, 0.0)
            scale[rows] = np.take_along_axis(best_scale, best, 0).T
            for axis, (mean, own) in enumerate(((mean_u, mean_a), (mean_v, mean_b))):
                at = np.take_along_axis(own, best, 0).T
                shift[rows, :, axis] = mean[:, None] - scale[rows] * at
    joints = turned[chosen] @ views.axes.transpose(0, 2, 1)[:, None]
    return Candidates(joints=joints, error=error, scale=scale, shift=shift)


# ------------------------------------------------------------------------------------------------
# Selection.

_log = logging.getLogger(__name__)
_FEWEST: Final = 6
"""Least number of detected joints of a frame with a pose; fewer fit almost any pose."""
_CANDIDATES: Final = 60
"""Candidates kept for each frame."""
_LIKENESS: Final = 0.06
"""Root-mean-square error in metres of the library's nearest pose in the image. A frame counts as
two joints, because errors of joints are correlated."""
_STEP: Final = 0.06
"""Root-mean-square motion of joints relative to the pelvis in a tenth of a second, metres."""
_APPROACH: Final = 0.05
"""Change of log depth in a tenth of a second, by steps towards the camera and scale errors."""
_FREELY: Final = 0.2
"""Distance in metres that a detection may move a joint from the chosen pose, across the ray."""
_AMBIGUOUS: Final = 0.15
"""Root-mean-square spread in metres from which a frame is called ambiguous."""


@dataclass(frozen=True)
class Lifted:
    """Poses for the frames of one track.

    Parameters
    ----------
    poses : (T, 16, 3) float
        Relative to the pelvis, camera axes, metres at the reference stature; NaN for frames with
        too few detections.
    spread : (T,) float
        Root-mean-square distance in metres of the joints of all candidates from the given pose,
        weighted by probability; NaN for frames without a pose.
    """

    poses: Array
    spread: Array


def lift_clip(clip: Clip) -> Clip:
    """Lift the tracks of a clip that have no poses, to poses of the built-in library.

    Parameters
    ----------
    clip : Clip

    Returns
    -------
    Clip
        Tracks with a pose in any frame are unchanged.
    """
    return replace(clip, tracks=tuple(_lifted(clip, track) for track in clip.tracks))


def _lifted(clip: Clip, track: Track) -> Track:
    if track.has_pose.any():
        return track
    lifted = lift_keypoints(
        clip.camera, track.keypoints, track.confidences, fps=clip.fps, poses=_built_in_poses()
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
    """Lift the 2D joints of one person.

    Parameters
    ----------
    camera : Camera
        Its nominal orientation gives the horizon.
    keypoints : (T, 16, 2) float
        Pixels; NaN where missing.
    confidences : (T, 16) float
        In [0, 1], 0 where missing.
    fps : float
        Frames a second.
    poses : (K, 16, 3) float
        Candidate poses, facing +y.

    Returns
    -------
    Lifted
    """
    usable = np.flatnonzero((confidences > 0).sum(1) >= _FEWEST)
    result = np.full((len(keypoints), N_JOINTS, 3), np.nan)
    spread = np.full(len(keypoints), np.nan)
    if not len(usable):
        return Lifted(result, spread)
    views = views_of(camera, keypoints[usable], confidences[usable])
    candidates = _nearest_poses(views, poses, count=_CANDIDATES)
    gaps = np.diff(usable) * (10.0 / fps)
    best, marginal = _smoothed(candidates, gaps, share=min(1.0, 10.0 / fps))
    rows = np.arange(len(usable))
    apart = ((candidates.joints - candidates.joints[rows, best][:, None]) ** 2).sum(-1).mean(-1)
    spread[usable] = np.sqrt((marginal * apart).sum(1))
    result[usable] = _towards_detections(views, candidates, best)
    return Lifted(result, spread)


def _smoothed(
    candidates: Candidates, gaps: Array, *, share: float
) -> tuple[NDArray[np.intp], Array]:
    """The most probable sequence of candidates (T,), and marginal probabilities (T, M).

    ``gaps`` (T - 1,) are times between frames in tenths of a second. ``share`` is that
    of a frame's evidence which is new: errors of frames less than a tenth of a second apart repeat
    each other.
    """
    joints, scale = candidates.joints, np.log(candidates.scale)
    n_frames, count = scale.shape
    own = -share * candidates.error / _LIKENESS**2
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
    """The chosen poses, moved so that joints match the detections, at the reference bone lengths.

    Across the ray the image is more accurate than the library; along it only the library informs.
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
