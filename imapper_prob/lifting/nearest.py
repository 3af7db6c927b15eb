"""Which poses of a library look like what was seen: scaled orthographic matching."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.lifting.views import Views

__all__ = ["Candidates", "nearest_poses"]

Array = NDArray[np.float64]

YAWS: Final = 36
"""Directions that each pose is tried in: ten degrees apart."""
_ELEVATION_STEP: Final = np.deg2rad(6.0)
"""Frames whose rays are this alike are compared with the same pictures of the poses."""
_FRAMES_AT_ONCE: Final = 64


@dataclass(frozen=True)
class Candidates:
    """The poses nearest to each frame, the best first.

    Parameters
    ----------
    joints : (T, M, 16, 3) float
        Relative to the pelvis, metres, camera axes.
    error : (T, M) float
        Weighted mean square distance in the image plane, square metres.
    scale : (T, M) float
        Tangents a metre: one over the depth.
    shift : (T, M, 2) float
        Tangents of the pelvis.
    """

    joints: Array
    error: Array
    scale: Array
    shift: Array


def nearest_poses(views: Views, poses: Array, *, count: int) -> Candidates:
    """Compare every frame with every pose in every direction.

    For weights w that add up to one, tangents u and projected joints p, both less their
    weighted means, the best scale is <u, p> / <p, p>, and what is left over, in metres at the
    person, is <u, u> / scale² - <p, p>.

    Parameters
    ----------
    views : Views
    poses : (K, 16, 3) float
        Relative to the pelvis, metres, facing +y.
    count : int
        How many candidates a frame.
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
