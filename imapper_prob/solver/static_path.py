"""The static path: the person's path and poses from each frame alone, without scenelets.

Lifted poses give the shape of the body, detections its position and posture. The known length of
the reference body converts image size to depth (:mod:`imapper_prob.solver.path_fit`).

In gaps without detections, the velocity of bearing and log depth is an Ornstein-Uhlenbeck process,
because a walking person keeps the velocity for about a second. The path through a gap is the
expectation given the fitted path at both ends (Kalman filter and smoother of Rauch, Tung and
Striebel 1965). Its standard deviation grows to metres over two seconds; independent steps would
give decimetres.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from imapper_prob.models.camera import Camera
from imapper_prob.models.detector import ERROR_EDGES, DetectorSettings
from imapper_prob.models.errors import InputError
from imapper_prob.models.path_prior import StaticPath
from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.settings import StaticPathSettings
from imapper_prob.models.skeleton import DETECTED
from imapper_prob.solver.detections import elsewhere_frames, own_detections
from imapper_prob.solver.path_fit import (
    REFERENCE_RATE,
    Motion,
    Observations,
    fit_motion,
    pixel_residuals,
    place_deviation,
)
from imapper_prob.solver.poses import (
    ANCESTORS,
    FrameTable,
    PoseSource,
    implausible_poses,
    joints_of,
    lifted_body,
)
from imapper_prob.solver.published import fast_frames, place_skeletons

__all__ = ["estimate_static_path", "examine_frames", "examine_published"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
_MEASURED_OVER = 0.2
"""Seconds over which the calibrated steps were measured, assuming independent steps."""
_ANYWHERE = 2.0
"""Standard deviation of bearing and log depth before the first detection."""


def _through_gaps(
    place: Array, observations: Observations, settings: StaticPathSettings
) -> tuple[Array, Array]:
    """Fill in the path through frames without a detection.

    Parameters
    ----------
    place : (T, 3) float
        Bearing, lift and log depth of the fitted path.
    observations : Observations
        Frames without a detection are filled in.
    settings : StaticPathSettings

    Returns
    -------
    place : (T, 3) float
        In gaps the height above the optical axis (lift times depth) is interpolated linearly.
    deviation : (T, 2) float
        Standard deviation of bearing and log depth in gaps; 0 in frames with a detection.
    """
    seen = np.asarray((observations.confidences > 0).any(1))
    filled, deviation = np.array(place), np.zeros((len(place), 2))
    if seen.all() or not seen.any():
        return filled, deviation
    steps = (settings.walk_bearing, settings.walk_log_depth)
    for k, (column, step) in enumerate(zip((0, 2), steps, strict=True)):
        mean, spread = _smoothed(
            place[:, column], seen, speed=_speed(step, settings.walk_time),
            time=settings.walk_time, noise=step, fps=observations.fps,
        )  # fmt: skip
        filled[~seen, column] = mean[~seen]
        deviation[~seen, k] = spread[~seen]
    t = np.arange(len(place))
    height = place[:, 1] * np.exp(place[:, 2])
    height = np.interp(t, t[seen], height[seen])
    filled[~seen, 1] = height[~seen] / np.exp(filled[~seen, 2])
    return filled, deviation


def _speed(step: float, time: float) -> float:
    """Standard deviation of the velocity, units per second, from the size of a measured step.

    ``step`` is the step of 1 / 10 s if steps were independent.
    """
    moved = step**2 * _MEASURED_OVER * REFERENCE_RATE
    return math.sqrt(moved / _displacement(_MEASURED_OVER, time))


def _displacement(seconds: float, time: float) -> float:
    """Variance of the displacement by an Ornstein-Uhlenbeck velocity of unit variance."""
    return 2 * time * (seconds - time * -math.expm1(-seconds / time))


def _smoothed(
    values: Array, seen: Flags, *, speed: float, time: float, noise: float, fps: float
) -> tuple[Array, Array]:
    """(T,) mean and standard deviation of the position, given ``values`` in frames with a
    detection."""
    h, kept = 1.0 / fps, math.exp(-1.0 / (fps * time))
    onward = np.array([[1.0, time * (1.0 - kept)], [0.0, kept]])
    cross = speed**2 * time * (1.0 - kept) ** 2
    fresh = np.array(
        [
            [speed**2 * time * (2 * h - time * (3 - 4 * kept + kept**2)), cross],
            [cross, speed**2 * (1 - kept**2)],
        ]
    )
    n = len(values)
    first = values[seen.argmax()]
    mean, covariance = np.array([first, 0.0]), np.diag([_ANYWHERE**2, speed**2])
    means, covariances = np.zeros((n, 2)), np.zeros((n, 2, 2))
    expected, doubted = np.zeros((n, 2)), np.zeros((n, 2, 2))
    for t in range(n):
        if t:
            mean, covariance = onward @ mean, onward @ covariance @ onward.T + fresh
        expected[t], doubted[t] = mean, covariance
        if seen[t]:
            gain = covariance[:, 0] / (covariance[0, 0] + noise**2)
            mean = mean + gain * (values[t] - mean[0])
            covariance = covariance - np.outer(gain, covariance[0])
        means[t], covariances[t] = mean, covariance
    for t in range(n - 2, -1, -1):
        back = covariances[t] @ onward.T @ np.linalg.inv(doubted[t + 1])
        means[t] += back @ (means[t + 1] - expected[t + 1])
        covariances[t] += back @ (covariances[t + 1] - doubted[t + 1]) @ back.T
    return means[:, 0], np.sqrt(covariances[:, 0, 0])


# ------------------------------------------------------------------------------------------------
# The path.

_CONFIDENT = 0.5
"""Confidence above which a detection is used to check a lifted pose."""
_JURY = 4
"""Number of such joints that are needed for the check."""
_DEPTHS = (0.5, 30.0)
"""Range in metres of plausible initial depths."""
_NOBODY = 0.5
"""Share of frames contradicted by detections above which the track is rejected. On i3DB the share
is at most .02, on simulated clips .14."""


def estimate_static_path(
    clip: Clip,
    *,
    settings: StaticPathSettings | None = None,
) -> StaticPath:
    """Maximum a posteriori path and poses of one person, with their errors.

    First the lifted bodies are placed rigidly; poses that contradict the confident detections are
    dropped and interpolated. Then bones and places are fitted together.

    The remaining errors are slow, and in proportion to the uncertainty of the fit
    (``bias_factor_along``, ``bias_factor_across``). In gaps without detections the path is
    extrapolated from its velocity, and ``deviation`` grows.

    Parameters
    ----------
    clip : Clip
        Its first track is that of the person.
    settings : StaticPathSettings, optional

    Returns
    -------
    StaticPath
        In the camera frame, for the clip's nominal focal length and the reference stature.

    Raises
    ------
    InputError
        No frame has enough detected joints, or the detections do not fit any body.
    """
    return examine_frames(clip, settings=settings)[0]


def examine_frames(
    clip: Clip,
    *,
    settings: StaticPathSettings | None = None,
    detector: DetectorSettings | None = None,
) -> tuple[StaticPath, FrameTable]:
    """Estimate the static path, and a table of its frames.

    Parameters
    ----------
    clip, settings
        See :func:`estimate_static_path`.
    detector : DetectorSettings, optional
        Tells which detections are of the person.

    Returns
    -------
    path : StaticPath
    frames : FrameTable

    Raises
    ------
    InputError
        As :func:`estimate_static_path`.
    """
    return _examined(clip, settings or StaticPathSettings(), detector, _bent_bodies)


def examine_published(
    clip: Clip,
    *,
    settings: StaticPathSettings | None = None,
    detector: DetectorSettings | None = None,
) -> tuple[StaticPath, FrameTable]:
    """Estimate the static path of the paper, with rigid skeletons: `imapper_prob.solver.published`.

    Parameters
    ----------
    clip, settings
        See :func:`estimate_static_path`.
    detector : DetectorSettings, optional
        Tells which detections are of the person.

    Returns
    -------
    path : StaticPath
    frames : FrameTable

    Raises
    ------
    InputError
        As :func:`estimate_static_path`.
    """
    return _examined(clip, settings or StaticPathSettings(), detector, _rigid_skeletons)


@dataclass(frozen=True)
class _Sight:
    """The data of a person: pixels (T, 14, 2), confidences (T, 14), and lifted poses."""

    clip: Clip
    person: Track
    pixels: Array
    confidences: Array

    def observations(self, believed: Flags) -> Observations:
        """Observations with the lifted poses of some frames."""
        body = lifted_body(self.person, believed)
        return Observations(self.clip.camera, self.pixels, self.confidences, body, self.clip.fps)


@dataclass(frozen=True)
class _Placed:
    """A fitted motion, the frames whose lifted poses were used, and frames with jumping joints."""

    observations: Observations
    motion: Motion
    believed: Flags
    fast: Flags
    unknown: Array
    """(T, 2) standard deviation of bearing and log depth in gaps."""


def _bent_bodies(sight: _Sight, trusted: Flags, settings: StaticPathSettings) -> _Placed:
    """Fit bodies with free bones, and fill in gaps by the velocity model."""
    observations = sight.observations(trusted)
    motion = _place(observations, settings)
    believed = trusted & ~_contradicted(observations, motion, settings)
    if not np.array_equal(believed, trusted):
        observations = sight.observations(believed)
        motion = _place(observations, settings)
    motion = fit_motion(observations, motion, settings, free_bones=True, annealing=(4.0, 2.0))
    place, unknown = _through_gaps(motion.place, observations, settings)
    nowhere = np.zeros(len(trusted), bool)
    return _Placed(observations, replace(motion, place=place), believed, nowhere, unknown)


def _rigid_skeletons(sight: _Sight, trusted: Flags, settings: StaticPathSettings) -> _Placed:
    """Fit rigid lifted skeletons; jumping frames and gaps are interpolated."""
    fast = fast_frames(sight.pixels, sight.confidences)
    observations = sight.observations(trusted & ~fast)
    motion = place_skeletons(observations, _first_guess(observations))
    _, unknown = _through_gaps(motion.place, observations, settings)
    return _Placed(observations, motion, observations.body.known, fast, unknown)


def _examined(
    clip: Clip,
    settings: StaticPathSettings,
    detector: DetectorSettings | None,
    place: Callable[[_Sight, Flags, StaticPathSettings], _Placed],
) -> tuple[StaticPath, FrameTable]:
    away = elsewhere_frames(clip, detector)[0]
    person = own_detections(clip, detector).tracks[0]
    confidences = person.confidences[:, list(DETECTED)]
    confidences = np.where(confidences < ERROR_EDGES[0], 0.0, confidences)
    if np.max((confidences > 0).sum(1), initial=0) < 3:
        raise InputError(
            f"clip {clip.name}, track {person.name}: no frame with three detected joints, so "
            "nothing says where the person is; leave the track out"
        )
    pixels = np.where(confidences[..., None] > 0, person.keypoints[:, list(DETECTED)], 0.0)
    trusted = person.has_pose & ~person.interpolated & ~implausible_poses(person, clip.camera)
    placed = place(_Sight(clip, person, pixels, confidences), trusted, settings)
    observations, motion = placed.observations, placed.motion
    path = StaticPath(
        estimate=motion.place[:, [0, 2]],
        lift=motion.place[:, 1],
        deviation=np.hypot(_slow_errors(observations, motion, settings), placed.unknown),
        poses=joints_of(motion.bones),
        posed=observations.body.known,
    )
    frames = _frame_table(placed, settings, person, clip.camera, away)
    _require_a_person(clip, person, observations, frames)
    return path, frames


def _require_a_person(
    clip: Clip, person: Track, observations: Observations, frames: FrameTable
) -> None:
    """Refuse detections that no body fits.

    Raises
    ------
    InputError
        In most frames with confident detections, these are far from the fitted body.
    """
    heard = (observations.confidences >= _CONFIDENT).sum(1) >= _JURY
    if not frames.outlier.sum() > _NOBODY * heard.sum():
        return
    miss = float(np.nanmedian(frames.miss))
    raise InputError(
        f"clip {clip.name}, track {person.name}: in {frames.outlier.sum()} of the {heard.sum()} "
        f"frames with sure detections these are not a person's, {miss:.0f} pixels from the nearest "
        f"body in the median, first in frame {clip.frame_ids[frames.outlier.argmax()]}; check the "
        "order of the joints (--format) and the size of the picture, or detect again"
    )


def _frame_table(
    placed: _Placed, settings: StaticPathSettings, person: Track, camera: Camera, away: Flags
) -> FrameTable:
    """Table of the origin of poses, and the distance of detections from the fitted person."""
    observations, motion = placed.observations, placed.motion
    pose = [PoseSource.OWN if own else PoseSource.CONTRADICTED for own in placed.believed]
    for source, frames in (
        (PoseSource.FAST, placed.fast),
        (PoseSource.IMPLAUSIBLE, implausible_poses(person, camera)),
        (PoseSource.INTERPOLATED, person.interpolated),
        (PoseSource.MISSING, ~person.has_pose),
        (PoseSource.ELSEWHERE, away),
    ):
        for frame in np.flatnonzero(frames):
            pose[frame] = source
    sure = observations.confidences >= _CONFIDENT
    distance = np.linalg.norm(pixel_residuals(observations, motion), axis=-1)
    miss = np.full(len(sure), np.nan)
    for frame in np.flatnonzero(sure.any(1)):
        miss[frame] = np.median(distance[frame, sure[frame]])
    return FrameTable(
        pose=tuple(pose),
        detected=(observations.confidences > 0).sum(1),
        miss=miss,
        outlier=_contradicted(observations, motion, settings),
    )


def _place(observations: Observations, settings: StaticPathSettings) -> Motion:
    """Fit the place of rigid bodies."""
    start = Motion(_first_guess(observations), observations.body.bones)
    return fit_motion(observations, start, settings, free_bones=False, annealing=(8.0, 4.0, 2.0))


def _first_guess(observations: Observations) -> Array:
    """(T, 3) initial bearing, lift and log depth: frame by frame, then a running median.

    With k = 1/depth a projection x (1 + k Y) = b + k X is linear in bearing and k. This estimate is
    biased, but needs no initial value. It is re-weighted iteratively for robustness.
    """
    camera, confidences = observations.camera, observations.confidences
    offsets = ANCESTORS[list(DETECTED)] @ observations.body.bones
    x, z = np.moveaxis(camera.rays(observations.pixels)[..., [0, 2]], -1, 0)
    n = x.shape[1]
    design = np.zeros((len(x), 2 * n, 3))
    design[:, :n, 0] = design[:, n:, 1] = 1.0
    design[:, :n, 2] = offsets[..., 0] - x * offsets[..., 1]
    design[:, n:, 2] = offsets[..., 2] - z * offsets[..., 1]
    target = np.concatenate([x, z], 1)
    sure = np.concatenate([confidences, confidences], 1) ** 2
    weights = sure
    spread = 0.02  # tangent; about 40 pixels of a full-HD camera
    for _ in range(8):
        weighted = (design * weights[..., None]).transpose(0, 2, 1)
        normal = weighted @ design + 1e-9 * np.eye(3)
        solution = np.linalg.solve(normal, weighted @ target[..., None])[..., 0]
        residuals = target - (design @ solution[..., None])[..., 0]
        squared = residuals[:, :n] ** 2 + residuals[:, n:] ** 2
        weights = sure / (1 + np.concatenate([squared, squared], 1) / spread**2)

    total = confidences.sum(1)
    depth = 1 / np.maximum(solution[:, 2], 1e-9)
    usable = (confidences > 0).sum(1) >= 3
    usable &= total >= 0.5 * np.median(total[usable])
    usable &= (depth > _DEPTHS[0]) & (depth < _DEPTHS[1])
    frames = np.flatnonzero(usable)
    if not len(frames):
        return np.broadcast_to([0.0, 0.0, np.log(4.0)], (len(x), 3)).copy()
    place = np.stack([solution[:, 0], solution[:, 1], np.log(depth)], -1)[frames]
    window = 2 * round(0.5 * observations.fps) + 1
    place = median_filter(place, size=(window, 1), mode="nearest")
    t = np.arange(len(x))
    return np.stack([np.interp(t, frames, column) for column in place.T], -1)


def _contradicted(
    observations: Observations, motion: Motion, settings: StaticPathSettings
) -> NDArray[np.bool_]:
    """(T,) frames in which most confident detections are far from the fitted pose."""
    distance = np.linalg.norm(pixel_residuals(observations, motion), axis=-1)
    sure = observations.confidences >= _CONFIDENT
    limit = settings.implausible * observations.pixel_unit
    far = (sure & (distance > limit)).sum(1)
    jury = sure.sum(1)
    result: NDArray[np.bool_] = (jury >= _JURY) & (2 * far > jury)
    return result


def _slow_errors(observations: Observations, motion: Motion, settings: StaticPathSettings) -> Array:
    """(T, 2) standard deviations of the slow errors of bearing and log depth.

    In gaps they are interpolated; what is unknown there comes on top.
    """
    deviation = place_deviation(observations, motion, settings)
    seen = np.flatnonzero((observations.confidences > 0).any(1))
    t = np.arange(len(deviation))
    columns = [np.interp(t, seen, deviation[seen, k]) for k in range(2)]
    result: Array = np.stack(columns, -1) * (
        settings.bias_factor_across,
        settings.bias_factor_along,
    )
    return result
