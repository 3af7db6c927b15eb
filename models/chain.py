"""The pelvis path as a Gaussian chain, collapsed and drawn, compiled.

One coordinate at a time (bearing, log depth). The static path is an estimate whose error is
slow: for seconds it is too near or too far by the same share. In units of its stated deviation,
e_t = (g_t - centre_t) / scale_t, that error is the stationary chain of second order of
:mod:`imapper_prob.models.path_error`, in which frames under a scenelet have a fixed value and
the others are free. Steps inside a scenelet are left out, for its motion is not random: its
first frame is one more step, and the chain goes on from its last two. Where the film of
somebody begins, nothing is known.

``chain`` returns the log of the chain with all free frames integrated out, and a path drawn
from what was integrated, as a deterministic function of standard normal numbers: holding those
while the scenelets move keeps the path where it can stay.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled

__all__ = ["chain", "find_known"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

_LOG_2PI = math.log(2 * math.pi)


@compiled
def find_known(item: Ints, starts: Flags, known: Ints) -> None:
    """The last frame under a scenelet before each one, -1 if there is none since a start.

    Parameters
    ----------
    item : (T,) int
        Which scenelet a frame is under, -1 if free.
    starts : (T,) bool
        Frames that follow upon nothing.
    known : (T,) int
        Out.
    """
    last = -1
    for t in range(len(item)):
        if starts[t]:
            last = -1
        known[t] = last
        if item[t] >= 0:
            last = t


@compiled
def chain(
    value: Array,
    item: Ints,
    known: Ints,
    starts: Flags,
    centre: Array,
    scale: Array,
    latent: Array,
    mean: Array,
    draw: Array,
) -> float:
    """Evidence of one coordinate's chain; the free entries of ``value`` are drawn in place.

    Parameters
    ----------
    value : (T,) float
        In: the fixed values. Out: all values.
    item : (T,) int
        Which scenelet a frame is under, -1 if free; each covers at least two frames.
    known, starts : (T,)
        See :func:`find_known`.
    centre, scale : (T,) float
        Of the stationary chain in each frame.
    latent : (T,) float
        Standard normal numbers of the draw.
    mean, draw : (T + 1, 2), (T + 1, 3, 3) float
        The coordinate's tables, see :func:`imapper_prob.models.path_error.path_tables`.

    Returns
    -------
    float
        log of the chain's density in the fixed values, free frames integrated out.
    """
    n, evidence = len(value), 0.0
    # Deviations of the next two frames from what came before them, and how many there are.
    near, far, ahead = 0.0, 0.0, 0
    at, last, before = -1, 0.0, 0.0
    for t in range(n - 1, -1, -1):
        if t + 1 == n or starts[t + 1]:
            ahead = 0
        if item[t] >= 0 and t > 0 and item[t] == item[t - 1]:
            continue
        row, expected = 0, 0.0
        if known[t] >= 0:
            if known[t] != at:
                at = known[t]
                last = (value[at] - centre[at]) / scale[at]
                before = (value[at - 1] - centre[at - 1]) / scale[at - 1]
            row = t - at
            expected = mean[row, 0] * last + mean[row, 1] * before
        if item[t] >= 0:
            deviation = draw[row, 0, 2]
            near, far, ahead = (value[t] - centre[t]) / scale[t] - expected, 0.0, 1
            evidence -= 0.5 * _LOG_2PI + math.log(deviation * scale[t])
            evidence -= 0.5 * (near / deviation) ** 2
            continue
        error = draw[row, ahead, 0] * near + draw[row, ahead, 1] * far
        error += draw[row, ahead, 2] * latent[t]
        value[t] = centre[t] + scale[t] * (expected + error)
        near, far, ahead = error, near, min(ahead + 1, 2)
    return evidence
