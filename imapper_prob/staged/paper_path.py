"""The static path as the paper fits it: rigid skeletons, squared residuals, linear filling.

In every frame the lifted skeleton a_t is placed at P_t = (x, y, z, theta) so that

    w_r sum_t sum_k c_tk |Pi T(P_t) a_tk - u_tk|^2 + w_s sum_t |p_t - p_(t-1)|^2

is least, p being the pelvis (Monszpart et al. 2019, section 6). Frames without a skeleton that
can be believed are occluded: those whose pose is missing or impossible, and those whose joints
move faster than in all but 5 % of the frames, as a Winsorisation would clip them. They have no
say in the fit, and their joints are interpolated linearly.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.energy.paper import PaperWeights
from imapper_prob.models.skeleton import DETECTED
from imapper_prob.staged.bones import ANCESTORS
from imapper_prob.staged.lifted_poses import LiftedBody
from imapper_prob.staged.path_fit import Motion, Observations, pixel_residuals, solve_chain

__all__ = ["fast_frames", "interpolated", "place_skeletons"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_WINSORISED: Final = 0.05
"""Part of the velocities above which they are clipped (Monszpart et al. 2019, section 6)."""
_STEPS: Final = 40
_LEAST_GAIN: Final = 1e-9
"""Energy by which a step must improve the fit for another one to follow."""
_STEADY: Final = 1e-9
"""Added to the diagonal: a frame that nothing says anything of stays where it is."""


def fast_frames(keypoints: Array, confidences: Array) -> Flags:
    """(T,) frames into which joints move at velocities that a 5 % Winsorisation clips.

    A frame's velocity is the mean over the joints that it and the one before have.

    Parameters
    ----------
    keypoints : (T, K, 2) float
        Pixels.
    confidences : (T, K) float
        0 where nothing was detected.
    """
    there = confidences > 0
    both = there[1:] & there[:-1]
    step = np.linalg.norm(np.diff(keypoints, axis=0), axis=-1)
    moved = both.any(1)
    speed = np.where(both, step, 0.0).sum(1)[moved] / both.sum(1)[moved]
    fast = np.zeros(len(keypoints), bool)
    if len(speed):
        limit = np.quantile(speed, 1 - _WINSORISED)
        fast[1 + np.flatnonzero(moved)[speed > limit]] = True
    return fast


def interpolated(values: Array, known: Flags) -> Array:
    """Rows of ``values`` (T, ...) that are not known, linearly from those that are.

    Before the first and after the last known row these are held; without any all stay.
    """
    frames = np.flatnonzero(known)
    if not len(frames):
        return np.array(values)
    flat = values.reshape(len(values), -1)
    t = np.arange(len(values))
    columns = [np.interp(t, frames, column) for column in flat[frames].T]
    return np.stack(columns, -1).reshape(values.shape)


def place_skeletons(observations: Observations, start: Array) -> Motion:
    """The energy's least, from bearing, lift and log depth ``start`` (T, 3) on.

    Frames whose pose is not their own (``observations.body.known``) are interpolated.
    """
    body, camera = observations.body, observations.camera
    known = body.known if body.known.any() else np.ones(len(start), bool)
    confidences = np.where(known[:, None], observations.confidences, 0.0)
    told = Observations(camera, observations.pixels, confidences, body, observations.fps)
    weights = PaperWeights()
    walk = weights.smoothness * np.array([1.0, 1.0, 1.0, 0.0])
    pelvis = Motion(start, body.bones).pelvis
    places = np.concatenate([interpolated(pelvis, known), np.zeros((len(start), 1))], 1)
    cost = _energy(told, places, walk)
    for _ in range(_STEPS):
        information, pull = _normal_equations(told, places)
        steps = np.diff(places, axis=0) * walk
        pull[:-1] += steps
        pull[1:] -= steps
        diagonal = np.arange(4)
        information[:, diagonal, diagonal] += _STEADY
        step = solve_chain(information, pull, walk)
        for halving in range(10):
            moved = places + 0.5**halving * step
            value = _energy(told, moved, walk)
            if value <= cost:
                break
        gain = cost - value
        if gain < 0:
            break
        places, cost = moved, value
        if gain < _LEAST_GAIN:
            break
    motion = _motion(body, camera, places)
    pelvis = interpolated(motion.pelvis, known)
    depth = np.maximum(pelvis[:, 1], 0.1)
    place = np.stack([pelvis[:, 0] / depth, pelvis[:, 2] / depth, np.log(depth)], -1)
    return Motion(place, interpolated(motion.bones, known))


def _motion(body: LiftedBody, camera: Camera, places: Array) -> Motion:
    """The skeletons turned by theta about the vertical, the pelvis at (x, y, z), camera axes."""
    x, y, z = places[:, :3].T
    y = np.maximum(y, 0.1)
    place = np.stack([x / y, z / y, np.log(y)], -1)
    return Motion(place, _turned(body, camera, places[:, 3]))


def _turned(body: LiftedBody, camera: Camera, theta: Array) -> Array:
    c, s, zero, one = np.cos(theta), np.sin(theta), np.zeros_like(theta), np.ones_like(theta)
    turn = np.stack([c, -s, zero, s, c, zero, zero, zero, one], -1).reshape(-1, 3, 3)
    to_world = camera.rotation
    whole = to_world.T @ turn @ to_world
    bones: Array = body.bones @ whole.transpose(0, 2, 1)
    return bones


def _energy(told: Observations, places: Array, walk: Array) -> float:
    residuals = pixel_residuals(told, _motion(told.body, told.camera, places))
    residuals = residuals / (told.camera.fx, told.camera.fy)
    data = float((told.confidences * (residuals**2).sum(-1)).sum())
    return data + float((np.diff(places, axis=0) ** 2 * walk).sum())


def _normal_equations(told: Observations, places: Array) -> tuple[Array, Array]:
    """Gauss-Newton Hessian (T, 4, 4) and negative gradient (T, 4) of L_r, both halved."""
    camera, motion = told.camera, _motion(told.body, told.camera, places)
    residuals = pixel_residuals(told, motion) / (camera.fx, camera.fy)
    branches = ANCESTORS[list(DETECTED)]
    offsets = branches @ motion.bones
    joints = motion.pelvis[:, None] + offsets
    depth = np.maximum(joints[..., 1], 0.1)
    jacobian = np.zeros((*joints.shape[:2], 2, 3))
    jacobian[..., 0, 0] = 1 / depth
    jacobian[..., 0, 1] = -joints[..., 0] / depth**2
    jacobian[..., 1, 1] = joints[..., 2] / depth**2
    jacobian[..., 1, 2] = -1 / depth
    up = camera.rotation.T @ np.array([0.0, 0.0, 1.0])
    by_angle = np.cross(up, offsets)
    whole = np.concatenate([jacobian, (jacobian @ by_angle[..., None])], -1)
    weighted = whole * told.confidences[..., None, None]
    information = np.einsum("tkai,tkaj->tij", weighted, whole)
    pull = np.einsum("tkai,tka->ti", weighted, residuals)
    return information, pull
