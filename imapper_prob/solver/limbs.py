"""How this person's joints differ from a pose, as far as detections tell.

A scenelet says how somebody moves near such furniture, not how this person moved: the posterior
lets detections scatter about a pose by the pose tolerance sigma (``docs/explanation/model.md``
11). What
it sums out comes back here. Of a joint at q, at a depth d, under a focal length f, seen at u,

    u = Pi(q + delta) + e,    delta ~ N(0, sigma^2 I),    rho = f sigma / d,

with u - Pi q of variance (s^2 + rho^2) / w, the w of a Student-t variable. So delta is expected at
lambda (u - Pi q) d / f across the ray, lambda = rho^2 w / (s^2 + rho^2), and known to
sigma^2 (1 - lambda); along the ray nothing is known of it. w is the one expected of an error so
large (the E step of Lange, Little and Taylor 1989) and at most 1, and lambda is the mean over the
joint being seen and hidden, by what confidence and error say of that. The pelvis is the path's,
which has errors of its own.
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
    """A motion, and by how much the person's differs from it.

    Parameters
    ----------
    joints : (T, 16, 3) float
        Where joints are expected, in the state's world, metres.
    known : (T, 16) float
        Part of the variance across the ray that detections take away, lambda.
    rays : (T, 16, 3) float
        Unit vectors from the camera to the pose's joints.
    spread : (16,) float
        Deviation of a joint of which nothing is known, metres.
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
        result: Array = self.spread[:, None, None] ** 2 * left
        return result

    def drawn(self, numbers: Array) -> Array:
        """Joints drawn from what is known of them.

        Parameters
        ----------
        numbers : (T, 16, 3) float
            Standard normal.

        Returns
        -------
        (T, 16, 3) float
            Metres.
        """
        along = (numbers * self.rays).sum(-1, keepdims=True) * self.rays
        left = np.sqrt(1.0 - self.known)[..., None] * (numbers - along) + along
        result: Array = self.joints + self.spread[:, None] * left
        return result


def limbs_of(problem: Problem, state: State, camera: Camera) -> Limbs:
    """The motion of a state, and what detections say of the person's own.

    Parameters
    ----------
    problem : Problem
    state : State
    camera : Camera
        That of the state.

    Returns
    -------
    Limbs
    """
    joints = motion(problem, state)
    seen = camera.to_camera(joints)
    depth = np.maximum(seen[..., 1], NEAREST)
    focal = np.array([camera.fx, camera.fy])
    tolerance = focal[0] * problem.pose_tolerance * _bodies(problem, state)[:, None] / depth
    error, known = _told(problem, state, camera.project(joints), tolerance)
    across = known[..., None] * error / focal * depth[..., None]
    # Pictures have y downward, the camera z upward.
    seen = seen + np.stack([across[..., 0], np.zeros(depth.shape), -across[..., 1]], -1)
    expected = camera.to_world(seen)
    # Nobody detects the neck: it is half-way between these two, and goes with them.
    expected[:, NECK] += ((expected - joints)[:, [THRX, HEAD]]).mean(1)
    rays = joints - camera.to_world(np.zeros(3))
    rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    spread = problem.pose_tolerance.copy()
    # The path has the pelvis, with an error of its own.
    spread[PELV] = 0.0
    return Limbs(expected, known, rays, spread)


def _bodies(problem: Problem, state: State) -> Array:
    """(T,) how large the person of each frame is."""
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
    # (T, 16, 2): of a hidden joint, and of one that is seen.
    noise, dof = problem.error_scale[source] ** 2, problem.error_dof[source]
    variance = noise + tolerance[..., None] ** 2
    distance = (error**2).sum(-1)[..., None] / variance
    odds = problem.confidence_density[source] / variance
    odds = odds * (1 + distance / dof) ** (-(dof + 2) / 2)
    odds = odds / np.maximum(odds.sum(-1, keepdims=True), np.finfo(float).tiny)
    precision = np.minimum((dof + 2) / (dof + distance), 1.0)
    known = (odds * precision * tolerance[..., None] ** 2 / variance).sum(-1)
    return error, np.where(used, known, 0.0)
