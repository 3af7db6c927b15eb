"""The static path and its prior (docs/explanation/model.md 6 to 8), and the camera prior.

The error of one coordinate, in units of its standard deviation, is a stationary AR(2) process

    e_t ~ N((r + s) e_(t-1) - r s e_(t-2), q),   q = (1 - r^2) (1 - s^2) (1 - r s) / (1 + r s),

of unit variance. With s = 0 it is of first order and rough from frame to frame. With r = s it is
the Matern 3/2 process at equal steps, which is smooth.

Frames inside scenelets are fixed and the others free. The mean of a free frame depends on the
values of the last two fixed frames; its variance and weights depend only on the number of frames
since then. This module tabulates variances and weights for the kernels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import read_only
from imapper_prob.models.settings import LOWEST_CAMERA, STEEPEST_CAMERA
from imapper_prob.models.skeleton import N_JOINTS
from imapper_prob.models.text import brief

__all__ = ["CAMERA", "CameraPrior", "StaticPath", "path_tables", "remembered", "within_support"]

Array = NDArray[np.float64]
_MARGIN: Final = 0.01
"""Distance from the border of the support, as a share; chosen."""


def remembered(seconds: Array, smoothing: Array, fps: float) -> Array:
    """AR(2) decay rates per frame of the path's errors in bearing and in log depth.

    Parameters
    ----------
    seconds : (2,) float
        Correlation time: half the integrated autocorrelation of an error, seconds.
    smoothing : (2,) float
        Part of the correlation time over which the error is smooth, seconds: 0 to half of it.
    fps : float
        Frames per second.

    Returns
    -------
    (2, 2) float
        Rates (r, s) of each coordinate, the roots of its AR(2) polynomial.
    """
    slow, fast = fps * (seconds - smoothing), fps * smoothing
    with np.errstate(divide="ignore"):
        result: Array = np.stack([np.exp(-1.0 / slow), np.exp(-1.0 / fast)], -1)
    return result


def path_tables(rates: Array, n_frames: int) -> tuple[Array, Array]:
    """Tables that predict the path's errors in free frames from those in known frames.

    Parameters
    ----------
    rates : (2, 2) float
        r and s of each coordinate, in [0, 1).
    n_frames : int
        T, the number of frames of the clip.

    Returns
    -------
    mean : (2, T + 1, 2)
        Weights of the last known error and of the one before it in the mean of the k-th frame after
        them. In row 0 nothing is known, and the weights are 0.
    draw : (2, T + 1, 3, 3)
        How to draw the frame in row k, backwards in time, given none, one or two of the frames
        after it: the weights of their deviations from their own means, the nearest first, and the
        remaining standard deviation.
    """
    rows = [_tables(r, s, n_frames) for r, s in rates.tolist()]
    return np.stack([mean for mean, _ in rows]), np.stack([draw for _, draw in rows])


def _tables(r: float, s: float, n_frames: int) -> tuple[Array, Array]:
    first, second = r + s, -r * s
    noise = (1.0 - r * r) * (1.0 - s * s) * (1.0 - r * s) / (1.0 + r * s)
    # Impulse response of the AR(2) process.
    left = np.ones(n_frames + 2)
    left[1] = first
    for k in range(2, len(left)):
        left[k] = first * left[k - 1] + second * left[k - 2]
    mean = np.zeros((n_frames + 1, 2))
    mean[1:] = np.stack([left[1:-1], second * left[:-2]], -1)

    # Variance of the k-th frame after the last two known ones, variance of the next frame, and
    # their covariance. Row 0 has the stationary values, because nothing is known there.
    variance = np.append(1.0, noise * np.cumsum(left[:-1] ** 2))
    following = np.append(1.0, variance[2:])
    variance = variance[:-1]
    together = np.append(first / (1.0 - second), noise * np.cumsum(left[:-1] * left[1:])[:-1])
    pull = together / following
    remains = variance - pull * together
    # Given the next frame, the one after it is a noisy measurement of this frame.
    gain = second * remains / (noise + second**2 * remains)
    draw = np.zeros((n_frames + 1, 3, 3))
    draw[:, 0, 2] = np.sqrt(variance)
    draw[:, 1, 0], draw[:, 1, 2] = pull, np.sqrt(remains)
    draw[:, 2, 0] = pull - gain * (first + second * pull)
    draw[:, 2, 1] = gain
    draw[:, 2, 2] = np.sqrt(remains * noise / (noise + second**2 * remains))
    return mean, draw


CAMERA: Final = ("pitch", "elevation", "log_focal_scale", "log_body_scale", "roll")
"""Camera parameters φ in order; units: radians, metres, 1, 1, radians."""


@dataclass(frozen=True)
class StaticPath:
    """The person's path and poses estimated from each frame alone, then smoothed.

    The pelvis is given as ``(bearing, log depth)`` with ``bearing = x / depth``. Nearly all of its
    uncertainty lies along the viewing ray and is relative to the distance, so errors of the log
    depth have the same size near and far.

    Parameters
    ----------
    estimate : (T, 2) float
        Smoothed maximum a posteriori bearing (tangent) and log depth (log metres).
    lift : (T,) float
        Smoothed height of the pelvis above the optical axis divided by its depth (tangent).
    deviation : (T, 2) float
        Standard deviations of bearing and log depth. These errors are slow: they persist for
        seconds.
    poses : (T, 16, 3) float
        Joints relative to the pelvis in camera axes, metres, for a body of the reference stature;
        frames without a reliable pose are interpolated.
    posed : (T,) bool
        Frames whose pose is estimated from the frame itself.
    """

    estimate: Array
    lift: Array
    deviation: Array
    poses: Array
    posed: NDArray[np.bool_]

    __repr__ = brief

    def __post_init__(self) -> None:
        n = len(self.lift)
        for name, shape in (
            ("estimate", (n, 2)),
            ("lift", (n,)),
            ("deviation", (n, 2)),
            ("poses", (n, N_JOINTS, 3)),
        ):
            array = read_only(getattr(self, name), shape=shape, name=f"static path {name}")
            if not np.isfinite(array).all():
                raise InputError(f"static path: {name} is not finite")
            object.__setattr__(self, name, array)
        if np.any(self.deviation <= 0):
            raise InputError("static path: a deviation is not positive")

    @property
    def pelvis(self) -> Array:
        """(T, 3) pelvis in the camera frame, metres."""
        bearing, depth = self.estimate[:, 0], np.exp(self.estimate[:, 1])
        return np.stack([bearing * depth, depth, self.lift * depth], -1)

    @property
    def joints(self) -> Array:
        """(T, 16, 3) joints in the camera frame, metres."""
        return self.pelvis[:, None] + self.poses


def within_support(mean: Array) -> Array:
    """The nearest camera that is clearly inside the support of the posterior.

    Chains start from the prior's mean, which the feet of a person may place at the border.

    Parameters
    ----------
    mean : (5,) float
        In the order of :data:`CAMERA`.

    Returns
    -------
    (5,) float
    """
    steepest = (1.0 - _MARGIN) * STEEPEST_CAMERA
    inside = np.array(mean, np.float64)
    inside[[0, 4]] = np.clip(inside[[0, 4]], -steepest, steepest)
    inside[1] = max(inside[1], (1.0 + _MARGIN) * LOWEST_CAMERA)
    return inside


@dataclass(frozen=True)
class CameraPrior:
    """Gaussian prior of the camera and body parameters φ of a clip.

    Parameters have the order of :data:`CAMERA`. The two scales multiply the clip's nominal focal
    length and the reference stature.

    Parameters
    ----------
    mean : (5,) float
    covariance : (5, 5) float
        Positive definite.
    """

    mean: Array
    covariance: Array

    __repr__ = brief

    def __post_init__(self) -> None:
        mean = read_only(self.mean, shape=(5,), name="camera prior mean")
        covariance = read_only(self.covariance, shape=(5, 5), name="camera prior covariance")
        if not np.all(np.linalg.eigvalsh(covariance) > 0):
            raise InputError("camera prior: covariance must be positive definite")
        object.__setattr__(self, "mean", mean)
        object.__setattr__(self, "covariance", covariance)
