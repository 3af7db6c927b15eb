"""Things cannot be in each other: L_c and L_m of the paper, and the floor, compiled.

All take the negative part of a signed distance, that of two things on the floor plane, and that of
somebody in a thing on the floor plane or in height, whichever is less. (The paper prints L_m with
the positive part, which would reward walking through furniture.)
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled, inlined
from imapper_prob.models.limits import LEVEL

__all__ = [
    "BOTH",
    "DISPLACED",
    "N_DISPLACED",
    "PROBABILITIES",
    "column_depth",
    "depth_below_floor",
    "displaced_cost",
    "footprint_depth",
    "give_way",
    "overlap_depth",
]

Array = NDArray[np.float64]

DISPLACED = (0.0, 0.1573, 0.4888, 0.8871, 1.5341)
"""Standard deviations by which furniture may really stand out of the way.

The mean of a standard normal number's upper half by four of equal probability, at the quantiles
9/16, 11/16, 13/16 and 15/16; where it stands the other way it is left where it is."""

PROBABILITIES = (0.5, 0.125, 0.125, 0.125, 0.125)

BOTH = math.sqrt(2.0)
"""Standard deviations by which two things stand apart that each stand off by one."""

N_DISPLACED = len(DISPLACED)


@inlined
def overlap_depth(a: Array, turn_a: Array, b: Array, turn_b: Array) -> float:
    """:func:`footprint_depth` of boxes the cosine and sine of whose yaws are known.

    The smallest move along a side of either rectangle that separates them (separating axis
    theorem); boxes at different heights do not meet.
    """
    if min(a[2] + a[5], b[2] + b[5]) - max(a[2] - a[5], b[2] - b[5]) <= LEVEL:
        return 0.0
    dx, dy = b[0] - a[0], b[1] - a[1]
    c = abs(turn_a[0] * turn_b[0] + turn_a[1] * turn_b[1])
    s = abs(turn_a[0] * turn_b[1] - turn_a[1] * turn_b[0])
    depth = math.inf
    for which in range(2):
        own, other, turn = (a, b, turn_a) if which == 0 else (b, a, turn_b)
        along = abs(turn[0] * dx + turn[1] * dy)
        across = abs(turn[0] * dy - turn[1] * dx)
        depth = min(depth, own[3] + c * other[3] + s * other[4] - along)
        depth = min(depth, own[4] + s * other[3] + c * other[4] - across)
    return max(depth, 0.0)


@compiled
def footprint_depth(a: Array, b: Array) -> float:
    """How deep two boxes (7,) are in each other on the floor, metres; 0 when apart."""
    turn_a = np.array([math.cos(a[6]), math.sin(a[6])])
    turn_b = np.array([math.cos(b[6]), math.sin(b[6])])
    return overlap_depth(a, turn_a, b, turn_b)


@inlined
def column_depth(x: float, y: float, low: float, high: float, box: Array, turn: Array) -> float:
    """How deep the vertical line at (x, y) from ``low`` to ``high`` stands in a box, metres.

    By how little it would have to move, aside, up or down: who sits a little too low is a little in
    their seat, however wide that is.
    """
    up, down = box[2] + box[5] - low, high - (box[2] - box[5])
    dx, dy = x - box[0], y - box[1]
    u = abs(turn[0] * dx + turn[1] * dy)
    v = abs(-turn[1] * dx + turn[0] * dy)
    depth: float = min(min(up, down), min(box[3] - u, box[4] - v))
    return max(depth, 0.0)


@inlined
def give_way(depth: float, spread: float, sums: Array) -> None:
    """Add to ``sums`` (5,) how deep somebody still is in furniture that stands out of the way.

    ``depth`` is how deep they are where the scenelet says that it stands, and ``spread`` the
    standard deviation of where it really does, both in metres.
    """
    for k in range(N_DISPLACED):
        sums[k] += max(depth - DISPLACED[k] * spread, 0.0)


@inlined
def displaced_cost(sums: Array, unit: float) -> float:
    """-log of the mean of exp(-cost) over where furniture may stand, nats (``docs/model.md`` 16).

    ``sums`` (5,) are metres summed over frames, see :func:`give_way`, and a metre costs ``unit``.
    """
    least, total = sums[N_DISPLACED - 1], 0.0
    for k in range(N_DISPLACED):
        total += PROBABILITIES[k] * math.exp(-unit * (sums[k] - least))
    cost: float = unit * least - math.log(total)
    return cost


@inlined
def depth_below_floor(joints: Array, row: int) -> float:
    """How deep the lowest of ``joints[row]`` (3, 16) is below the floor, metres; 0 above."""
    lowest = 0.0
    for j in range(16):
        lowest = min(lowest, joints[row, 2, j])
    return -lowest
