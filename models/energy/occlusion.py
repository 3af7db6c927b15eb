"""Whether furniture stands between the camera and a joint, compiled.

The volume hidden by a union of boxes is the set of points whose line of sight cuts a box.
The clearance of a line of sight (:func:`imapper_prob.models.geometry.sight_clearance` in plain
numpy, :mod:`imapper_prob.models.kernels.sight` compiled) is negative exactly in it and grows
smoothly out of it. Where nothing is near it is capped, which mends the gap in the paper: with
no object its occlusion distance is undefined (Monszpart et al. 2019, F(v, c)).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.geometry import NOTHING_IN_SIGHT
from imapper_prob.models.jit import compiled, inlined
from imapper_prob.models.limits import NEAR_SIGHT

__all__ = ["p_seen", "set_window"]

Array = NDArray[np.float64]


@inlined
def set_window(
    elevation: float, box: Array, turn: Array, window: Array | NDArray[np.float32]
) -> None:
    """Where in the view a box can come near a line of sight, into ``window`` (5,).

    Bounds of bearing x / y, of slope (z - elevation) / y and the smallest y, of the box
    grown by ``NOTHING_IN_SIGHT`` on every side. A line of sight that stays out of them has
    no clearance below the cap. A box that reaches behind the camera is always in sight.
    """
    left, right, low, high, nearest = math.inf, -math.inf, math.inf, -math.inf, math.inf
    for corner in range(4):
        u = (box[3] + NOTHING_IN_SIGHT) * (1.0 if corner & 1 else -1.0)
        v = (box[4] + NOTHING_IN_SIGHT) * (1.0 if corner & 2 else -1.0)
        x = box[0] + turn[0] * u - turn[1] * v
        y = box[1] + turn[1] * u + turn[0] * v
        nearest = min(nearest, y)
        if y > NEAR_SIGHT:
            bottom = box[2] - box[5] - NOTHING_IN_SIGHT - elevation
            top = box[2] + box[5] + NOTHING_IN_SIGHT - elevation
            left, right = min(left, x / y), max(right, x / y)
            low, high = min(low, bottom / y), max(high, top / y)
    if nearest <= NEAR_SIGHT:
        left, right, low, high = -math.inf, math.inf, -math.inf, math.inf
    window[0], window[1], window[2], window[3], window[4] = left, right, low, high, nearest


@compiled
def p_seen(distance: float, width: float, surprise: float) -> float:
    """m(v): a smooth step over the clearance, never quite 0 or 1."""
    scaled = min(max(distance / width, -30.0), 30.0)
    return surprise + (1.0 - 2.0 * surprise) / (1.0 + math.exp(-scaled))
