"""Things cannot be in each other: L_c and L_m of the paper, and the floor, compiled.

All take the negative part of a signed distance, the first two on the floor plane. (The paper
prints L_m with the positive part, which would reward walking through furniture.)
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled
from imapper_prob.models.limits import LEVEL

__all__ = ["column_depth", "depth_below_floor", "footprint_depth"]

Array = NDArray[np.float64]


@compiled
def footprint_depth(a: Array, b: Array) -> float:
    """How deep two boxes (7,) are in each other on the floor, metres; 0 when apart.

    The smallest move along a side of either rectangle that separates them (separating axis
    theorem); boxes at different heights do not meet.
    """
    if min(a[2] + a[5], b[2] + b[5]) - max(a[2] - a[5], b[2] - b[5]) <= LEVEL:
        return 0.0
    dx, dy = b[0] - a[0], b[1] - a[1]
    turn = b[6] - a[6]
    c, s = abs(math.cos(turn)), abs(math.sin(turn))
    depth = math.inf
    for which in range(2):
        yaw = a[6] if which == 0 else b[6]
        cy, sy = math.cos(yaw), math.sin(yaw)
        own, other = (a, b) if which == 0 else (b, a)
        along = abs(cy * dx + sy * dy)
        across = abs(-sy * dx + cy * dy)
        depth = min(depth, own[3] + c * other[3] + s * other[4] - along)
        depth = min(depth, own[4] + s * other[3] + c * other[4] - across)
    return max(depth, 0.0)


@compiled
def column_depth(x: float, y: float, low: float, high: float, box: Array, turn: Array) -> float:
    """How deep the vertical line at (x, y) from ``low`` to ``high`` stands in a box, metres."""
    if min(box[2] + box[5], high) - max(box[2] - box[5], low) <= LEVEL:
        return 0.0
    dx, dy = x - box[0], y - box[1]
    u = abs(turn[0] * dx + turn[1] * dy)
    v = abs(-turn[1] * dx + turn[0] * dy)
    depth: float = min(box[3] - u, box[4] - v)
    return max(depth, 0.0)


@compiled
def depth_below_floor(joints: Array, row: int) -> float:
    """How deep the lowest of ``joints[row]`` (16, 3) is below the floor, metres; 0 above."""
    lowest = 0.0
    for j in range(16):
        lowest = min(lowest, joints[row, j, 2])
    return -lowest
