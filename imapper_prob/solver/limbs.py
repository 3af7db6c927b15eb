"""How a person's joints differ from the pose of a scenelet, given the detections.

A scenelet tells how people move near such furniture, not how this person moved. The posterior
marginalises over deviations of the joints from the pose with standard deviation sigma, the pose
tolerance (``docs/explanation/model.md`` 11). This module computes the distribution of the
deviations given the detections. For a joint at q, at a depth d, with focal length f, detected at u,

    u = Pi(q + delta) + e,    delta ~ N(0, sigma^2 I),    rho = f sigma / d,

where u - Pi q has variance (s^2 + rho^2) / w, with the w of a Student-t variable. So the
expectation of delta across the ray is lambda (u - Pi q) d / f, with lambda = rho^2 w / (s^2 +
rho^2), and its variance is sigma^2 (1 - lambda); along the ray the detection gives no information.
w is its expectation for an error of that size (the E step of Lange, Little and Taylor 1989), at
most 1. lambda is the mean over the joint being seen and hidden, with the probabilities of these
given confidence and error. The pelvis is that of the path, which has its own error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.log_posterior import State, motion, side_flips
from imapper_prob.models.problem import Problem
from imapper_prob.models.settings import NEAREST
from imapper_prob.models.skeleton import HEAD, MIRROR, NECK, PELV, THRX

__all__ = ["Limbs", "limbs_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Limbs:
    """A motion with the person's deviations from it.

    Parameters
    ----------
    joints : (T, 16, 3) float
        Expected joints in the state's world frame, metres.
    known : (T, 16) float
        lambda, the share of the variance across the ray that the detections remove.
    rays : (T, 16, 3) float
        Unit vectors from the camera to the pose's joints.
    spread : (T, 16) float
        Standard deviation of each joint without detections, metres.
    """

    joints: Array
    known: Array
    rays: Array
    spread: Array

    def covariance(self) -> Array:
        """Covariance of every joint.

        Returns
        -------
        (T, 16, 3, 3) float
            Square metres.
        """
        along = self.rays[..., :, None] * self.rays[..., None, :]
        left = np.eye(3) - self.known[..., None, None] * (np.eye(3) - along)
        result: Array = self.spread[..., None, None] ** 2 * left
        return result

    def drawn(self, numbers: Array) -> Array:
        """Draw joints from their conditional distribution.

        Parameters
        ----------
        numbers : (T, 16, 3) float
            Standard normal numbers.

        Returns
        -------
        (T, 16, 3) float
            Metres.
        """
        along = (numbers * self.rays).sum(-1, keepdims=True) * self.rays
        left = np.sqrt(1.0 - self.known)[..., None] * (numbers - along) + along
        result: Array = self.joints + self.spread[..., None] * left
        return result


def limbs_of(problem: Problem, state: State, camera: Camera) -> Limbs:
    """The motion of a state with the person's deviations, given the detections.

    Parameters
    ----------
    problem : Problem
    state : State
    camera : Camera
        Camera of the state.

    Returns
    -------
    Limbs
    """
    joints = motion(problem, state)
    seen = camera.to_camera(joints)
    depth = np.maximum(seen[..., 1], NEAREST)
    focal = np.array([camera.fx, camera.fy])
    spread = problem.pose_tolerance * _bodies(problem, state)[:, None]
    tolerance = focal[0] * spread / depth
    # As in the likelihood, nothing is nearer than that.
    ahead = np.stack([seen[..., 0], depth, seen[..., 2]], -1)
    error, known = _told(problem, state, camera.project_camera(ahead), tolerance)
    across = known[..., None] * error / focal * depth[..., None]
    # v points down in the image, z up in the camera frame.
    seen = seen + np.stack([across[..., 0], np.zeros(depth.shape), -across[..., 1]], -1)
    expected = camera.to_world(seen)
    # The neck has no detection; it moves with the joints on both sides of it.
    expected[:, NECK] += ((expected - joints)[:, [THRX, HEAD]]).mean(1)
    rays = joints - camera.to_world(np.zeros(3))
    rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    # The pelvis comes from the path.
    spread[:, PELV] = 0.0
    return Limbs(expected, known, rays, spread)


def _bodies(problem: Problem, state: State) -> Array:
    """(T,) size of the person in each frame, a factor."""
    sizes = np.full(problem.n_frames, state.camera[3])
    for (scenelet, start), size in zip(state.items.tolist(), state.sizes.tolist(), strict=True):
        sizes[start : start + int(problem.lengths[scenelet])] += size
    bodies: Array = np.exp(sizes)
    return bodies


def _told(problem: Problem, state: State, pixels: Array, tolerance: Array) -> tuple[Array, Array]:
    """(T, 16, 2) pixels from joint to detection, 0 without one, and (T, 16) lambda."""
    own = np.arange(len(MIRROR))
    turned = side_flips(problem, state)[:, None] > 0.5
    source = (np.arange(problem.n_frames)[:, None], np.where(turned, MIRROR, own))
    used = problem.used[source]
    error = np.where(used[..., None], problem.keypoints[source] - pixels, 0.0)
    # (T, 16, 2): for a hidden joint, and for one that is seen.
    noise, dof = problem.error_scale[source] ** 2, problem.error_dof[source]
    variance = noise + tolerance[..., None] ** 2
    distance = (error**2).sum(-1)[..., None] / variance
    odds = problem.confidence_density[source] / variance
    odds = odds * (1 + distance / dof) ** (-(dof + 2) / 2)
    odds = odds / np.maximum(odds.sum(-1, keepdims=True), np.finfo(float).tiny)
    precision = np.minimum((dof + 2) / (dof + distance), 1.0)
    known = (odds * precision * tolerance[..., None] ** 2 / variance).sum(-1)
    return error, np.where(used, known, 0.0)
