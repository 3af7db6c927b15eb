"""A target of unknown dimension with known answer: signals of which only the sum is observed.

There are none to four signals of three numbers each. All counts have equal prior probability, and
the numbers are standard normal; their sum is observed with noise. The sum of k signals is normal
with variance k, so P(k | data) has a closed form, and given k the signals depend on each other
through their sum.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["DIMENSION", "MOST", "log_likelihood", "log_prior", "probabilities"]

Array = NDArray[np.float64]

MOST, NOISE = 4, 0.5
SEEN = np.array([1.2, -0.4, 0.9])
"""Chosen so that no count is improbable, including zero."""
DIMENSION = len(SEEN)


def probabilities() -> Array:
    """(MOST + 1,) P(k | seen) for k from zero."""
    variance = np.arange(MOST + 1) + NOISE**2
    weights = variance ** (-DIMENSION / 2) * np.exp(-0.5 * (SEEN @ SEEN) / variance)
    return np.asarray(weights / weights.sum())


def log_likelihood(total: Array) -> Array:
    """Log density of the observation, given the sums (..., 3) of the signals."""
    residual = (SEEN - total) / NOISE
    constant = DIMENSION * math.log(NOISE * math.sqrt(2 * math.pi))
    return np.asarray(-0.5 * (residual**2).sum(-1) - constant)


def log_prior(signals: Array) -> Array:
    """Log prior density of each of the signals (..., 3)."""
    return np.asarray(-0.5 * (signals**2).sum(-1) - 0.5 * DIMENSION * math.log(2 * math.pi))
