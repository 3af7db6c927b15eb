"""The most probable path and pose of one person, by Gauss-Newton over all frames at once.

A frame has 45 unknowns: bearing, lift and log depth of the pelvis (tangents, log metres), and
fourteen bone vectors (metres, camera axes). The negative log-posterior is

    w sum_t [ sum_j c (nu + 2)/2 log(1 + r^2 / (nu s^2))  +  lifted pose ]
    + bone lengths + random walks from frame to frame,

where ``r`` is the true pixel residual. A fit that is linear in 1/depth would be simpler, but it is
biased towards the camera: 53 cm against 44 cm of pelvis error on four benchmark clips. ``w`` is one
over the number of frames in a correlation time of the errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from imapper_prob.models.camera import Camera
from imapper_prob.models.detector import REFERENCE_SIDE, student_t_loss
from imapper_prob.models.settings import NEAREST, StaticPathSettings
from imapper_prob.models.skeleton import DETECTED
from imapper_prob.solver.poses import ANCESTORS, N_BONES, SPREADS, LiftedBody

__all__ = [
    "REFERENCE_RATE",
    "Motion",
    "Observations",
    "evidence",
    "fit_motion",
    "pixel_residuals",
    "place_deviation",
    "solve_chain",
]

Array = NDArray[np.float64]

REFERENCE_RATE: Final = 10.0
"""Frames per second to which step sizes refer."""
_BRANCHES: Final[Array] = ANCESTORS[list(DETECTED)]


@dataclass(frozen=True)
class Observations:
    """The observations of one track for the fit.

    Parameters
    ----------
    camera : Camera
    pixels : (T, 14, 2) float
        Detections; any finite number where the confidence is 0.
    confidences : (T, 14) float
    body : LiftedBody
    fps : float
    """

    camera: Camera
    pixels: Array
    confidences: Array
    body: LiftedBody
    fps: float

    @property
    def pixel_unit(self) -> float:
        """Pixels of this image per pixel of one whose shorter side has 1080."""
        return self.camera.short_side / REFERENCE_SIDE


@dataclass(frozen=True)
class Motion:
    """The unknowns of the fit.

    Parameters
    ----------
    place : (T, 3) float
        Bearing and lift (tangents), and log depth (log m).
    bones : (T, 14, 3) float
        Camera axes, metres.
    """

    place: Array
    bones: Array

    @property
    def pelvis(self) -> Array:
        """(T, 3) camera frame, metres."""
        bearing, lift, log_depth = self.place.T
        depth = np.exp(log_depth)
        return np.stack([bearing * depth, depth, lift * depth], -1)

    def vector(self, *, free_bones: bool) -> Array:
        """The unknowns of each frame, or only those of its place.

        Parameters
        ----------
        free_bones : bool
            Whether bones are unknown.

        Returns
        -------
        (T, 45) or (T, 3) float
        """
        if not free_bones:
            return self.place
        return np.concatenate([self.place, self.bones.reshape(len(self.bones), -1)], 1)

    def moved(self, step: Array) -> Motion:
        """The motion after a step in the coordinates of ``vector``.

        Parameters
        ----------
        step : (T, 45) or (T, 3) float
            Step, with the columns of :meth:`vector`.

        Returns
        -------
        Motion
        """
        bones = self.bones
        if step.shape[1] > 3:
            bones = bones + step[:, 3:].reshape(bones.shape)
        return Motion(self.place + step[:, :3], bones)


def _joints(motion: Motion) -> Array:
    return motion.pelvis[:, None] + _BRANCHES @ motion.bones


def pixel_residuals(observations: Observations, motion: Motion) -> Array:
    """Detections minus projections.

    Parameters
    ----------
    observations : Observations
    motion : Motion

    Returns
    -------
    (T, 14, 2) float
        Pixels of the image.
    """
    camera, joints = observations.camera, _joints(motion)
    depth = np.maximum(joints[..., 1], NEAREST)
    projected = np.stack(
        [camera.cx + camera.fx * joints[..., 0] / depth,
         camera.cy - camera.fy * joints[..., 2] / depth], -1
    )  # fmt: skip
    result: Array = observations.pixels - projected
    return result


def _pixel_jacobian(observations: Observations, motion: Motion, *, free_bones: bool) -> Array:
    """(T, 28, 3 or 45) derivatives of the projections by the unknowns of their frame."""
    camera, joints = observations.camera, _joints(motion)
    n_frames, n_joints = joints.shape[:2]
    depth = np.maximum(joints[..., 1], NEAREST)
    by_joint = np.zeros((n_frames, n_joints, 2, 3))
    by_joint[..., 0, 0] = camera.fx / depth
    by_joint[..., 0, 1] = -camera.fx * joints[..., 0] / depth**2
    by_joint[..., 1, 1] = camera.fy * joints[..., 2] / depth**2
    by_joint[..., 1, 2] = -camera.fy / depth
    pelvis = motion.pelvis
    by_place = np.zeros((n_frames, 3, 3))
    by_place[:, 0, 0] = by_place[:, 2, 1] = pelvis[:, 1]
    by_place[:, :, 2] = pelvis
    parts = [by_joint @ by_place[:, None]]
    if free_bones:
        by_bone = by_joint[:, :, :, None, :] * _BRANCHES[None, :, None, :, None]
        parts.append(by_bone.reshape(n_frames, n_joints, 2, 3 * N_BONES))
    return np.concatenate(parts, -1).reshape(n_frames, 2 * n_joints, -1)


def evidence(
    observations: Observations,
    motion: Motion,
    settings: StaticPathSettings,
    *,
    pixel_scale: float,
    free_bones: bool,
) -> tuple[Array, Array]:
    """Information of each frame's detections and lifted pose alone, without the frame weight.

    Parameters
    ----------
    observations : Observations
    motion : Motion
        Point of expansion.
    settings : StaticPathSettings
    pixel_scale : float
        Scale of the pixel error in an image of 1080 lines.
    free_bones : bool
        Whether bones are unknown.

    Returns
    -------
    information : (T, n, n) float
        Gauss-Newton Hessian of the negative log-likelihood, with fixed robust weights.
    pull : (T, n) float
        Negative gradient of the same.
    """
    residuals = pixel_residuals(observations, motion)
    scale = pixel_scale * observations.pixel_unit
    weights = (
        observations.confidences
        * (settings.dof + 2)
        / (settings.dof * scale**2 + (residuals**2).sum(-1))
    )
    jacobian = _pixel_jacobian(observations, motion, free_bones=free_bones)
    weighted = jacobian * np.repeat(weights, 2, axis=1)[..., None]
    information = weighted.transpose(0, 2, 1) @ jacobian
    pull = (weighted * residuals.reshape(len(residuals), -1)[..., None]).sum(1)
    if free_bones:
        precision = _lifted_precision(observations.body, settings)
        diagonal = np.arange(3, 3 + 3 * N_BONES)
        information[:, diagonal, diagonal] += precision.reshape(len(precision), -1)
        offset = precision * (observations.body.bones - motion.bones)
        pull[:, 3:] += offset.reshape(len(offset), -1)
    return information, pull


def _lifted_precision(body: LiftedBody, settings: StaticPathSettings) -> Array:
    """(T, 14, 3) inverse variances in 1/m^2 of the lifted bones."""
    relative = np.array([settings.lifted_across, settings.lifted_along, settings.lifted_across])
    trust = np.where(body.known, 1.0, settings.filled_tolerance)
    deviation = relative * body.lengths[:, None] * trust[:, None, None]
    result: Array = deviation**-2.0
    return result


def _length_terms(
    body: LiftedBody, bones: Array, settings: StaticPathSettings
) -> tuple[Array, Array]:
    """Information (T, 42, 42) and pull (T, 42) of the prior on bone lengths."""
    norms = np.linalg.norm(bones, axis=-1)
    unit = bones / norms[..., None]
    precision = (settings.length_tolerance * SPREADS * body.lengths) ** -2.0
    information = np.zeros((len(bones), N_BONES, 3, N_BONES, 3))
    k = np.arange(N_BONES)
    information[:, k, :, k, :] = np.moveaxis(
        precision[:, None, None] * unit[..., :, None] * unit[..., None, :], 1, 0
    )
    pull = (precision * (body.lengths - norms))[..., None] * unit
    n = 3 * N_BONES
    return information.reshape(-1, n, n), pull.reshape(-1, n)


def _walk_precision(settings: StaticPathSettings, fps: float, *, free_bones: bool) -> Array:
    steps = [settings.walk_bearing, settings.walk_bearing, settings.walk_log_depth]
    if free_bones:
        steps += [settings.walk_bone] * (3 * N_BONES)
    result: Array = np.asarray(steps) ** -2.0 * (fps / REFERENCE_RATE)
    return result


def _cost(
    observations: Observations,
    motion: Motion,
    settings: StaticPathSettings,
    *,
    pixel_scale: float,
    free_bones: bool,
) -> float:
    """Negative log-posterior up to a constant, nats."""
    squared = (pixel_residuals(observations, motion) ** 2).sum(-1)
    scale = pixel_scale * observations.pixel_unit
    loss = student_t_loss(squared, scale, settings.dof)
    data = float((observations.confidences * loss).sum())
    prior = 0.0
    if free_bones:
        body = observations.body
        apart = (motion.bones - body.bones) ** 2
        data += 0.5 * float((_lifted_precision(body, settings) * apart).sum())
        longer = np.linalg.norm(motion.bones, axis=-1) / body.lengths - 1
        prior += 0.5 * float(((longer / (settings.length_tolerance * SPREADS)) ** 2).sum())
    steps = np.diff(motion.vector(free_bones=free_bones), axis=0)
    walk = _walk_precision(settings, observations.fps, free_bones=free_bones)
    prior += 0.5 * float((steps**2 * walk).sum())
    return settings.frame_weight(observations.fps) * data + prior


def _of_frames(
    observations: Observations,
    motion: Motion,
    settings: StaticPathSettings,
    *,
    pixel_scale: float,
    free_bones: bool,
) -> tuple[Array, Array]:
    """Information (T, n, n) and pull (T, n) of all terms but the walk from frame to frame."""
    information, pull = evidence(
        observations, motion, settings, pixel_scale=pixel_scale, free_bones=free_bones
    )
    weight = settings.frame_weight(observations.fps)
    information, pull = weight * information, weight * pull
    if free_bones:
        more, push = _length_terms(observations.body, motion.bones, settings)
        information[:, 3:, 3:] += more
        pull[:, 3:] += push
    # Keeps a clip with very few joints solvable; far below the weight of any detection.
    diagonal = np.arange(pull.shape[1])
    information[:, diagonal, diagonal] += 1e-6
    return information, pull


def place_deviation(
    observations: Observations, motion: Motion, settings: StaticPathSettings
) -> Array:
    """Standard deviation of bearing and log depth, by the Laplace approximation at the fit.

    The blocks of the inverse of the block-tridiagonal Hessian come from eliminating the frames
    before and those after each frame.

    Parameters
    ----------
    observations : Observations
    motion : Motion
        The fit.
    settings : StaticPathSettings

    Returns
    -------
    (T, 2) float
        Tangent, and log metres.
    """
    information, _ = _of_frames(
        observations, motion, settings, pixel_scale=settings.pixel_scale, free_bones=True
    )
    walk = _walk_precision(settings, observations.fps, free_bones=True)
    diagonal = np.arange(len(walk))
    information[:-1, diagonal, diagonal] += walk
    information[1:, diagonal, diagonal] += walk
    coupling = np.outer(walk, walk)
    before, after = information.copy(), information.copy()
    for t in range(1, len(information)):
        before[t] -= coupling * np.linalg.inv(before[t - 1])
    for t in range(len(information) - 2, -1, -1):
        after[t] -= coupling * np.linalg.inv(after[t + 1])
    covariance = np.linalg.inv(before + after - information)
    result: Array = np.sqrt(covariance[:, [0, 2], [0, 2]])
    return result


def solve_chain(information: Array, pull: Array, walk: Array) -> Array:
    """Solve the block-tridiagonal normal equations whose off-diagonal blocks are -diag(walk).

    Parameters
    ----------
    information : (T, n, n) float
    pull : (T, n) float
    walk : (n,) float
        Precision of a step of each unknown.

    Returns
    -------
    (T, n) float
    """
    n_frames, n = pull.shape
    banded = np.zeros((n + 1, n_frames, n))
    for k in range(n):
        i = np.arange(n - k)
        banded[k][:, i] = information[:, i + k, i]
    banded[0, :-1] += walk
    banded[0, 1:] += walk
    banded[n, :-1] = -walk
    solution = solveh_banded(
        banded.reshape(n + 1, -1), pull.ravel(), lower=True, check_finite=False
    )
    result: Array = solution.reshape(n_frames, n)
    return result


_STEPS: Final = 12
"""Largest number of steps at the true pixel scale; chosen."""
_GAIN: Final = 1e-3
"""Gain of a step at the true pixel scale, nats, below which the fit ends; chosen."""


def fit_motion(
    observations: Observations,
    start: Motion,
    settings: StaticPathSettings,
    *,
    free_bones: bool,
    annealing: Sequence[float],
) -> Motion:
    """Gauss-Newton with step halving; the robust scale is annealed from wide to its true value.

    Gross errors make the posterior multimodal. With a wide scale all joints have influence, so the
    majority decides which mode is found.

    Parameters
    ----------
    observations : Observations
    start : Motion
    settings : StaticPathSettings
    free_bones : bool
        Whether bones are unknowns, or only the pelvis.
    annealing : sequence of float
        Factors on the pixel scale, one step for each.

    Returns
    -------
    Motion
    """
    walk = _walk_precision(settings, observations.fps, free_bones=free_bones)
    motion = start
    for factor in (*annealing, *(1.0,) * _STEPS):
        scale = settings.pixel_scale * factor
        information, pull = _of_frames(
            observations, motion, settings, pixel_scale=scale, free_bones=free_bones
        )
        steps_taken = np.diff(motion.vector(free_bones=free_bones), axis=0) * walk
        pull[:-1] += steps_taken
        pull[1:] -= steps_taken
        step = solve_chain(information, pull, walk)

        def cost(m: Motion, scale: float = scale) -> float:
            return _cost(observations, m, settings, pixel_scale=scale, free_bones=free_bones)

        before = cost(motion)
        for halving in range(8):
            candidate = motion.moved(step * 0.5**halving)
            gain = before - cost(candidate)
            if gain >= 0:
                motion = candidate
                break
        if factor == 1.0 and gain < _GAIN:
            break
    return motion
