"""Poses: where a body faces, and going from one pose to another without stretching bones."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.skeleton import (
    BONES,
    LHIP,
    LKNE,
    LSHO,
    N_JOINTS,
    PELV,
    RHIP,
    RKNE,
    RSHO,
)

__all__ = ["blend_poses", "facing", "thigh_angle", "turned"]

Array = NDArray[np.float64]


def _outward() -> tuple[tuple[int, int], ...]:
    """Bones as (far, near) joints, each after the one that carries it."""
    order: list[tuple[int, int]] = []
    reached = [PELV]
    for near in reached:  # grows on the way
        ends = [a + b - near for a, b in BONES if near in (a, b)]
        order += [(far, near) for far in ends if far not in reached]
        reached += [far for far in ends if far not in reached]
    return tuple(order)


_OUTWARD = _outward()


def facing(joints: ArrayLike) -> Array:
    """Where a person faces, from the lines through hips and shoulders.

    The body's right is the sum of both lines, left to right, on the floor; forward is a
    quarter turn counter-clockwise from it. Head and feet are not asked: they turn freely.

    Parameters
    ----------
    joints : (..., 16, 3) float
        Metres, z up.

    Returns
    -------
    (...) float
        Yaw in radians: 0 faces +y, counter-clockwise, in (-pi, pi].
    """
    joints = np.asarray(joints, float)
    hips = joints[..., RHIP, :] - joints[..., LHIP, :]
    shoulders = joints[..., RSHO, :] - joints[..., LSHO, :]
    right = hips + shoulders
    yaw: Array = np.arctan2(right[..., 1], right[..., 0])
    return yaw


def thigh_angle(joints: ArrayLike) -> Array:
    """Mean angle of both thighs to the vertical, radians: 0 of somebody who stands upright.

    Parameters
    ----------
    joints : (..., 16, 3) float
        Metres, z up.
    """
    joints = np.asarray(joints, float)
    thighs = joints[..., [RKNE, LKNE], :] - joints[..., [RHIP, LHIP], :]
    level = np.linalg.norm(thighs[..., :2], axis=-1)
    angles: Array = np.arctan2(level, -thighs[..., 2]).mean(-1)
    return angles


def turned(joints: ArrayLike, yaw: ArrayLike) -> Array:
    """Joints (..., 16, 3) rotated about the z axis by ``yaw`` (...) radians."""
    joints, yaw = np.asarray(joints, float), np.asarray(yaw, float)[..., None]
    x, y, z = np.moveaxis(joints, -1, 0)
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack([c * x - s * y, s * x + c * y, z + np.zeros_like(c)], -1)


def blend_poses(first: ArrayLike, second: ArrayLike, weight: ArrayLike) -> Array:
    """A pose between two: bones turn on the way, and are not shortened as joints would be.

    Parameters
    ----------
    first, second : (..., 16, 3) float
        Joints in metres; the pelvis may move too.
    weight : (...) float
        0 gives ``first``, 1 ``second``.

    Returns
    -------
    (..., 16, 3) float
        Joints in metres, each bone as long as the weighted mean of its two lengths.
    """
    first, second = np.asarray(first, float), np.asarray(second, float)
    weight = np.asarray(weight, float)[..., None]
    shape = np.broadcast_shapes(first.shape, second.shape, (*weight.shape[:-1], N_JOINTS, 3))
    joints = np.zeros(shape)
    joints[..., PELV, :] = (1 - weight) * first[..., PELV, :] + weight * second[..., PELV, :]
    for far, near in _OUTWARD:
        a = first[..., far, :] - first[..., near, :]
        b = second[..., far, :] - second[..., near, :]
        mean = (1 - weight) * a + weight * b
        length = (1 - weight) * np.linalg.norm(a, axis=-1, keepdims=True)
        length = length + weight * np.linalg.norm(b, axis=-1, keepdims=True)
        size = np.linalg.norm(mean, axis=-1, keepdims=True)
        joints[..., far, :] = joints[..., near, :] + mean * length / np.maximum(size, 1e-9)
    return joints
