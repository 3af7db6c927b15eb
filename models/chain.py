"""The pelvis path as a Gaussian chain, collapsed and drawn, compiled.

One coordinate at a time (bearing, log depth). The static path is an estimate whose error is
slow: for seconds it is too near or too far by the same share. In units of its stated
deviation, e_t = (g_t - centre_t) / scale_t, that error is a stationary chain

    e_1 ~ N(0, 1),    e_t | e_{t-1} ~ N(memory e_{t-1}, 1 - memory^2)

in which frames under a scenelet have a fixed value and the others are free. Steps inside a
scenelet are left out, for its motion is not random. ``chain`` returns the log of the chain
with all free frames integrated out, and a path drawn from what was integrated, as a
deterministic function of standard normal numbers: holding those while the scenelets move
keeps the path where it can stay.
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
def chain(
    value: Array,
    item: Ints,
    centre: Array,
    scale: Array,
    latent: Array,
    memory: float,
    predicted: Array,
) -> float:
    """Evidence of one coordinate's chain; the free entries of ``value`` are drawn in place.

    Parameters
    ----------
    value : (T,) float
        In: the fixed values. Out: all values.
    item : (T,) int
        Which scenelet a frame is under, -1 if free.
    centre, scale : (T,) float
        Of the stationary chain in each frame.
    latent : (T,) float
        Standard normal numbers of the draw.
    memory : float
        Correlation of neighbouring frames.
    predicted : (T, 2) float
        Workspace.

    Returns
    -------
    float
        log of the chain's density in the fixed values, free frames integrated out.
    """
    n, innovation = len(value), 1.0 - memory * memory
    evidence = 0.0
    mean, variance = 0.0, 1.0
    for t in range(n):
        # Here (mean, variance) predicts frame t from everything before it.
        if item[t] >= 0:
            error = (value[t] - centre[t]) / scale[t]
            if t == 0 or item[t] != item[t - 1]:
                evidence -= 0.5 * (_LOG_2PI + math.log(variance)) + math.log(scale[t])
                evidence -= 0.5 * (error - mean) ** 2 / variance
            mean, variance = memory * error, innovation
            continue
        predicted[t, 0], predicted[t, 1] = mean, variance
        mean, variance = memory * mean, memory * memory * variance + innovation
    ahead = 0.0
    for t in range(n - 1, -1, -1):
        if item[t] >= 0:
            ahead = (value[t] - centre[t]) / scale[t]
            continue
        mean, variance = predicted[t, 0], predicted[t, 1]
        if t + 1 < n:
            gain = memory * variance / (memory * memory * variance + innovation)
            mean += gain * (ahead - memory * mean)
            variance *= 1.0 - memory * gain
        ahead = mean + math.sqrt(variance) * latent[t]
        value[t] = centre[t] + scale[t] * ahead
    return evidence
