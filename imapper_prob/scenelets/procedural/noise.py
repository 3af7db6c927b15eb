"""Errors like those of motion capture, so that no motion is cleaner than a recording."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["TRACKER_ERROR", "TRACKER_MEMORY", "as_tracked"]

Array = NDArray[np.float64]

TRACKER_ERROR: Final = 0.008
"""Metres, root mean square of a joint's error in space: between markers on the skin (a few
millimetres) and depth cameras (a few centimetres)."""

TRACKER_MEMORY: Final = 0.3
"""Seconds over which an error is forgotten: skin and clothes move with the limb."""


def as_tracked(rng: np.random.Generator, joints: ArrayLike, *, fps: float) -> Array:
    """Joints with smooth errors, independent between joints and axes.

    The errors are a Gaussian process with the Matérn covariance of smoothness 3/2, which moves
    without jerks but is not as stiff as a sine.

    Parameters
    ----------
    rng : numpy.random.Generator
    joints : (n, 16, 3) float
        Metres.
    fps : float
        Frames a second.

    Returns
    -------
    (n, 16, 3) float
        Metres.
    """
    joints = np.asarray(joints, float)
    n_frames, *rest = joints.shape
    frames = np.arange(n_frames)
    lag = np.sqrt(3) * np.abs(frames[:, None] - frames) / (fps * TRACKER_MEMORY)
    spread = np.linalg.cholesky((1 + lag) * np.exp(-lag))
    errors = spread @ rng.standard_normal((n_frames, int(np.prod(rest))))
    noisy: Array = joints + TRACKER_ERROR / np.sqrt(3) * errors.reshape(joints.shape)
    return noisy
