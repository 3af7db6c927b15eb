"""The pelvis path as a Gaussian chain, collapsed and drawn, compiled.

One coordinate at a time (bearing, log depth). Frames under a scenelet have a fixed value,
the others are free. The directed chain

    p(g) = N(g_1; start) * prod_t N(g_t; g_{t-1}, q^2)

leaves out the steps inside a scenelet, whose motion is not random. Each free frame is
measured by a factor exp(-precision/2 (g_t - measured_t)^2), the Gaussian that stands for
its detections. ``chain`` returns the log of the chain with all free frames integrated out,
and a path drawn from what was integrated, as a deterministic function of standard normal
numbers: holding those while the scenelets move keeps the path where it can stay.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled

__all__ = ["chain"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_LOG_2PI = math.log(2 * math.pi)


@compiled
def _log_normal(x: float, mean: float, variance: float) -> float:
    return -0.5 * (_LOG_2PI + math.log(variance) + (x - mean) ** 2 / variance)


@compiled
def chain(
    value: Array,
    item: Ints,
    measured: Array,
    precision: Array,
    latent: Array,
    start_mean: float,
    start_variance: float,
    step_variance: float,
    filtered: Array,
) -> float:
    """Evidence of one coordinate's chain; the free entries of ``value`` are drawn in place.

    Parameters
    ----------
    value : (T,) float
        In: the fixed values. Out: all values.
    item : (T,) int
        Which scenelet a frame is under, -1 if free.
    measured, precision, latent : (T,) float
        Measurement factors and the standard normal numbers of the draw.
    filtered : (T, 2) float
        Workspace.

    Returns
    -------
    float
        log of the chain's density in the fixed values, free frames integrated out.
    """
    n = len(value)
    evidence = 0.0
    mean, variance = start_mean, start_variance
    for t in range(n):
        # Here (mean, variance) predicts frame t from everything before it.
        if item[t] >= 0:
            if t == 0 or item[t] != item[t - 1]:
                evidence += _log_normal(value[t], mean, variance)
            mean, variance = value[t], step_variance
            continue
        gain = precision[t] * variance
        error = measured[t] - mean
        evidence -= 0.5 * (math.log1p(gain) + precision[t] * error * error / (1.0 + gain))
        mean += gain / (1.0 + gain) * error
        variance /= 1.0 + gain
        filtered[t, 0], filtered[t, 1] = mean, variance
        variance += step_variance
    for t in range(n - 1, -1, -1):
        if item[t] >= 0:
            continue
        mean, variance = filtered[t, 0], filtered[t, 1]
        if t + 1 < n:
            gain = variance / (variance + step_variance)
            mean += gain * (value[t + 1] - mean)
            variance *= 1.0 - gain
        value[t] = mean + math.sqrt(variance) * latent[t]
    return evidence
