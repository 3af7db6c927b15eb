"""Whether furniture stands between the camera and a joint, compiled.

The volume hidden by a union of boxes is the set of points whose line of sight cuts a box.
``clearance`` is negative exactly in it and grows smoothly out of it; where nothing is near
it is capped, which mends the gap in the paper: with no object its occlusion distance is
undefined (Monszpart et al. 2019, F(v, c)).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.geometry import NOTHING_IN_SIGHT, OPAQUE
from imapper_prob.models.jit import compiled

__all__ = ["boxes_in_sight", "clearance", "p_seen", "sight_windows"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Vector = tuple[float, float, float]

_NEAR = 0.05
"""Metres; nearer than this, bearing and slope say nothing."""


@compiled
def _lowest(start: Vector, slope: Vector, half: Vector) -> float:
    """Minimum over s in [0, 1] of ``max_i |start_i + s slope_i| - half_i``."""
    lowest = -math.inf
    where = 0.0
    for i in range(3):
        rise = abs(slope[i])
        up = (start[i] if slope[i] >= 0 else -start[i]) - half[i]
        for k in range(3):
            fall = abs(slope[k])
            down = (-start[k] if slope[k] >= 0 else start[k]) - half[k]
            total = rise + fall
            meet = (down - up) / total if total > 1e-12 else 0.0
            value = up + rise * meet
            if value > lowest:
                lowest = value
                where = meet
    if 0.0 < where < 1.0:
        return lowest
    s = 0.0 if where <= 0.0 else 1.0
    return max(
        abs(start[0] + s * slope[0]) - half[0],
        abs(start[1] + s * slope[1]) - half[1],
        abs(start[2] + s * slope[2]) - half[2],
    )


@compiled
def sight_windows(elevation: float, boxes: Array, turns: Array) -> Array:
    """Where in the view each box can come near a line of sight: (K, 5).

    Bounds of bearing x / y, of slope (z - elevation) / y and the smallest y, of the box
    grown by ``NOTHING_IN_SIGHT`` on every side. A line of sight that stays out of them has
    no clearance below the cap. A box that reaches behind the camera is always in sight.
    """
    windows = np.empty((len(boxes), 5))
    for k in range(len(boxes)):
        windows[k, 0], windows[k, 1] = math.inf, -math.inf
        windows[k, 2], windows[k, 3] = math.inf, -math.inf
        windows[k, 4] = math.inf
        for corner in range(8):
            u = (boxes[k, 3] + NOTHING_IN_SIGHT) * (1.0 if corner & 1 else -1.0)
            v = (boxes[k, 4] + NOTHING_IN_SIGHT) * (1.0 if corner & 2 else -1.0)
            w = (boxes[k, 5] + NOTHING_IN_SIGHT) * (1.0 if corner & 4 else -1.0)
            x = boxes[k, 0] + turns[k, 0] * u - turns[k, 1] * v
            y = boxes[k, 1] + turns[k, 1] * u + turns[k, 0] * v
            z = boxes[k, 2] + w - elevation
            windows[k, 4] = min(windows[k, 4], y)
            if y > _NEAR:
                windows[k, 0], windows[k, 1] = min(windows[k, 0], x / y), max(windows[k, 1], x / y)
                windows[k, 2], windows[k, 3] = min(windows[k, 2], z / y), max(windows[k, 3], z / y)
        if windows[k, 4] <= _NEAR:
            windows[k, 0], windows[k, 1] = -math.inf, math.inf
            windows[k, 2], windows[k, 3] = -math.inf, math.inf
    return windows


@compiled
def boxes_in_sight(elevation: float, joints: Array, windows: Array, chosen: Ints) -> int:
    """Boxes that may come near a line of sight to any of ``joints`` (16, 3).

    Their indices are written into ``chosen`` (K,); returns how many.
    """
    left, right, low, high, far = math.inf, -math.inf, math.inf, -math.inf, -math.inf
    for j in range(16):
        y = joints[j, 1]
        far = max(far, y)
        if y <= _NEAR:
            left, right, low, high = -math.inf, math.inf, -math.inf, math.inf
            far = math.inf
            break
        bearing, slope = joints[j, 0] / y, (joints[j, 2] - elevation) / y
        left, right = min(left, bearing), max(right, bearing)
        low, high = min(low, slope), max(high, slope)
    n = 0
    for k in range(len(windows)):
        if (
            windows[k, 4] <= far
            and windows[k, 0] <= right
            and windows[k, 1] >= left
            and windows[k, 2] <= high
            and windows[k, 3] >= low
        ):
            chosen[n] = k
            n += 1
    return n


@compiled
def clearance(
    elevation: float,
    x: float,
    y: float,
    z: float,
    boxes: Array,
    turns: Array,
    windows: Array,
    chosen: Ints,
    n_chosen: int,
) -> float:
    """Smallest clearance in metres of the sight line from (0, 0, elevation) to (x, y, z).

    Of ``boxes`` (K, 7) the first ``n_chosen`` that ``chosen`` names count; ``turns`` (K, 2)
    holds cosine and sine of their yaw, ``windows`` is :func:`sight_windows`. The numpy
    reference is :func:`imapper_prob.models.geometry.sight_clearance`.
    """
    result = NOTHING_IN_SIGHT
    ahead = y > _NEAR
    bearing, slope_up = (x / y, (z - elevation) / y) if ahead else (0.0, 0.0)
    for which in range(n_chosen):
        k = chosen[which]
        if ahead and (
            windows[k, 4] > y
            or windows[k, 0] > bearing
            or windows[k, 1] < bearing
            or windows[k, 2] > slope_up
            or windows[k, 3] < slope_up
        ):
            continue
        ox, oy, oz = boxes[k, 0], boxes[k, 1], boxes[k, 2] - elevation
        c, si = turns[k, 0], turns[k, 1]
        dz = z - elevation
        start = (-c * ox - si * oy, si * ox - c * oy, -oz)
        slope = (c * x + si * y, -si * x + c * y, dz)
        value = _lowest(start, slope, (boxes[k, 3], boxes[k, 4], boxes[k, 5]))
        if value < 0.0:
            thinnest = min(boxes[k, 3], boxes[k, 4], boxes[k, 5])
            value *= max(1.0, OPAQUE / thinnest)
        if value < result:
            result = value
    return result


@compiled
def p_seen(distance: float, width: float, surprise: float) -> float:
    """m(v): a smooth step over the clearance, never quite 0 or 1."""
    scaled = min(max(distance / width, -30.0), 30.0)
    return surprise + (1.0 - 2.0 * surprise) / (1.0 + math.exp(-scaled))
