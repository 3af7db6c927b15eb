"""Where the posterior is not zero, and the prior of a person's size, compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled
from imapper_prob.models.limits import LOWEST_CAMERA, STEEPEST_CAMERA

__all__ = ["in_support", "log_size_density"]


@compiled
def in_support(camera: NDArray[np.float64]) -> bool:
    """Whether the camera is above the floor and neither pitched nor rolled too far."""
    upright = abs(camera[0]) < STEEPEST_CAMERA and abs(camera[4]) < STEEPEST_CAMERA
    return bool(upright and camera[1] > LOWEST_CAMERA)


@compiled
def log_size_density(size: float, spread: float) -> float:
    """log N(size; 0, spread^2): the log size of one scenelet."""
    ratio = size / spread
    return -0.5 * (math.log(2 * math.pi) + ratio * ratio) - math.log(spread)
