"""The static path with its prior (docs/explanation/model.md 6 to 8), and the camera's prior.

In units of its deviation the error of one coordinate is a stationary process of second order,

    e_t ~ N((r + s) e_(t-1) - r s e_(t-2), q),   q = (1 - r^2) (1 - s^2) (1 - r s) / (1 + r s),

of unit variance. With s = 0 it is of first order, rough from frame to frame; with r = s it is
the Matern 3/2 process at equal steps, smooth.

Frames under scenelets are fixed and the others free. The mean of a free frame depends on the
values that are fixed, its variance and weights only on how many frames ago the last two were.
The latter are tabulated here for the kernels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import read_only
from imapper_prob.models.skeleton import N_JOINTS
from imapper_prob.models.text import brief

__all__ = ["CAMERA", "CameraPrior", "StaticPath", "path_tables", "remembered"]

Array = NDArray[np.float64]


def remembered(seconds: Array, smoothing: Array, fps: float) -> Array:
    """Decay rates of the path's errors across and along the view, from one frame to the next.

    Parameters
    ----------
    seconds : (2,) float
        Correlation time: half the integrated autocorrelation of an error.
    smoothing : (2,) float
        Seconds of it over which the error is smooth: 0 for a rough one, at most half.
    fps : float
        Frames a second.

    Returns
    -------
    (2, 2) float
        Rates (r, s) of each coordinate; the roots of its autoregression of second order.
    """
    slow, fast = fps * (seconds - smoothing), fps * smoothing
    with np.errstate(divide="ignore"):
        result: Array = np.stack([np.exp(-1.0 / slow), np.exp(-1.0 / fast)], -1)
    return result


def path_tables(rates: Array, n_frames: int) -> tuple[Array, Array]:
    """What errors of two coordinates say of the frames after them.

    Parameters
    ----------
    rates : (2, 2) float
        r and s of each coordinate, in [0, 1).
    n_frames : int
        Frames of the clip, T.

    Returns
    -------
    mean : (2, T + 1, 2)
        Weights of the last error known and of the one before it, in the mean of the frame k
        after them. In row 0 nothing is known, and the weights are 0.
    draw : (2, T + 1, 3, 3)
        How a frame in row k is drawn backwards in time, given none, one or two that follow
        it: the weights of their deviations from their own means, the next one's first, and the
        standard deviation of what remains.
    """
    rows = [_tables(r, s, n_frames) for r, s in rates.tolist()]
    return np.stack([mean for mean, _ in rows]), np.stack([draw for _, draw in rows])


def _tables(r: float, s: float, n_frames: int) -> tuple[Array, Array]:
    first, second = r + s, -r * s
    noise = (1.0 - r * r) * (1.0 - s * s) * (1.0 - r * s) / (1.0 + r * s)
    # What is left of a shock, so many frames later.
    left = np.ones(n_frames + 2)
    left[1] = first
    for k in range(2, len(left)):
        left[k] = first * left[k - 1] + second * left[k - 2]
    mean = np.zeros((n_frames + 1, 2))
    mean[1:] = np.stack([left[1:-1], second * left[:-2]], -1)

    # Of the k-th frame after the last two known, of the one after it, and of both together; of
    # the stationary chain in row 0, where nothing is known.
    variance = np.append(1.0, noise * np.cumsum(left[:-1] ** 2))
    following = np.append(1.0, variance[2:])
    variance = variance[:-1]
    together = np.append(first / (1.0 - second), noise * np.cumsum(left[:-1] * left[1:])[:-1])
    pull = together / following
    remains = variance - pull * together
    # The second next one is a measurement of this frame, given the next.
    gain = second * remains / (noise + second**2 * remains)
    draw = np.zeros((n_frames + 1, 3, 3))
    draw[:, 0, 2] = np.sqrt(variance)
    draw[:, 1, 0], draw[:, 1, 2] = pull, np.sqrt(remains)
    draw[:, 2, 0] = pull - gain * (first + second * pull)
    draw[:, 2, 1] = gain
    draw[:, 2, 2] = np.sqrt(remains * noise / (noise + second**2 * remains))
    return mean, draw


CAMERA: Final = ("pitch", "elevation", "log_focal_scale", "log_body_scale", "roll")
"""The numbers of φ in their order: radians, metres, 1, 1, radians."""


@dataclass(frozen=True)
class StaticPath:
    """Where each frame alone puts the person, before any scenelet.

    The pelvis is described as the camera sees it, ``(bearing, log depth)`` with
    ``bearing = x / depth``, because nearly all uncertainty lies along the viewing ray and
    is relative: a walk of log depth treats near and far alike.

    Parameters
    ----------
    estimate : (T, 2) float
        Smoothed maximum a posteriori bearing (tangent) and log depth (depth in metres).
    lift : (T,) float
        Height of the pelvis above the optical axis over its depth (tangent), smoothed.
    deviation : (T, 2) float
        By how much bearing and log depth may be off, standard deviations; slow errors, about
        the same for seconds.
    poses : (T, 16, 3) float
        Joints relative to the pelvis in camera axes, metres, for a body of the reference
        stature; frames without a trustworthy pose are filled in.
    posed : (T,) bool
        Frames whose pose is their own.
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


@dataclass(frozen=True)
class CameraPrior:
    """Gaussian over the nuisance parameters φ of a clip.

    In the order of :data:`CAMERA`. The scales multiply the clip's nominal focal length and the
    reference stature.

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

    @property
    def standard_deviations(self) -> Array:
        """(5,) standard deviations, units of ``mean``."""
        return np.sqrt(np.diag(self.covariance))
