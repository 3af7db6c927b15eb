"""L_o of the published energy, compiled: unsure joints that nothing hides.

    F(v, c) = (c - 1/2)^2 v^2   if c < 1/2 and v > 0,   else 0          (Monszpart et al. 2019)

v is the signed distance of a joint to the occlusion volume, all that the camera does not see for
furniture. F asks for it outside only, where the distance to a union is the least to its parts.
What a box [l, h] hides, in its own axes and seen from the origin, is

    { s b : s >= 1, l <= b <= h },

and the squared distance to a point y is the least over s >= 1 of

    sum_i max(0, s l_i - y_i)^2 + max(0, y_i - s h_i)^2,

convex in s, with a slope that is linear between the s at which a side of the box passes y.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled, inlined

__all__ = ["FARTHEST", "hidden_distance", "occlusion_cost"]

Array = NDArray[np.float64]

FARTHEST: Final = 1.0
"""V, metres: cap of the distance to the occlusion volume, and the distance where there is none. An
actor's arm's reach, within which a scenelet has its objects (Monszpart et al. 2019, section 3)."""


@compiled
def occlusion_cost(distance: float, confidence: float) -> float:
    """F(v, c) of a signed distance in metres and a confidence in [0, 1], square metres."""
    if confidence < 0.5 and distance > 0.0:
        return (confidence - 0.5) ** 2 * distance**2
    return 0.0


@compiled
def hidden_distance(
    elevation: float, x: float, y: float, z: float, boxes: Array, turns: Array, room: Array
) -> float:
    """How far a point is from what boxes hide, metres: 0 in it, at most ``FARTHEST``.

    Parameters
    ----------
    elevation : float
        Of the camera, which is above the origin, metres.
    x, y, z : float
        The point in the world, metres.
    boxes : (K, 7) float
    turns : (K, 2 or more) float
        Cosine and sine of their yaws.
    room : (9,) float
        Scratch.
    """
    least = FARTHEST
    for k in range(len(boxes)):
        c, s = turns[k, 0], turns[k, 1]
        across, ahead = boxes[k, 0], boxes[k, 1]
        room[0] = c * across + s * ahead - boxes[k, 3]
        room[1] = c * ahead - s * across - boxes[k, 4]
        room[2] = boxes[k, 2] - elevation - boxes[k, 5]
        for i in range(3):
            room[3 + i] = room[i] + 2.0 * boxes[k, 3 + i]
        room[6], room[7], room[8] = c * x + s * y, c * y - s * x, z - elevation
        least = min(least, _distance(room))
    return least


@inlined
def _distance(room: Array) -> float:
    """From the point ``room[6:]`` to what the box ``room[:3]`` to ``room[3:6]`` hides."""
    before, slope = 1.0, _slope(room, 1.0)
    if slope >= 0.0:
        return _apart(room, 1.0)
    after, steeper = math.inf, 0.0
    for i in range(6):
        if room[i] != 0.0:
            at = room[6 + i % 3] / room[i]
            if before < at < after:
                found = _slope(room, at)
                if found < 0.0:
                    before, slope = at, found
                else:
                    after, steeper = at, found
    if after == math.inf:
        # Sides that go on to infinity: from here on the slope is one straight line.
        after, steeper = 2.0 * before, _slope(room, 2.0 * before)
    return _apart(room, before + (after - before) * slope / (slope - steeper))


@inlined
def _slope(room: Array, scale: float) -> float:
    """Half the derivative of the squared distance by s."""
    total = 0.0
    for i in range(3):
        total += room[i] * max(0.0, scale * room[i] - room[6 + i])
        total -= room[3 + i] * max(0.0, room[6 + i] - scale * room[3 + i])
    return total


@inlined
def _apart(room: Array, scale: float) -> float:
    """From the point to the box ``scale`` times as far away and as large."""
    total = 0.0
    for i in range(3):
        short = max(0.0, scale * room[i] - room[6 + i])
        long = max(0.0, room[6 + i] - scale * room[3 + i])
        total += short * short + long * long
    return math.sqrt(total)
