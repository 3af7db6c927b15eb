"""Whether boxes cut lines of sight, compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled

__all__ = ["lines_cut"]

Array = NDArray[np.float64]


@compiled
def lines_cut(elevation: float, joints: Array, boxes: Array) -> NDArray[np.bool_]:
    """Whether any box cuts the line from the camera to each joint.

    The line is inside a box from where it has entered all three slabs between opposite sides
    to where it leaves the first of them (Kay & Kajiya 1986).

    Parameters
    ----------
    elevation : float
        Of the camera above the world's origin, metres.
    joints : (T, 16, 3) float
        World, metres.
    boxes : (K, 7) float
        World, see `imapper_prob.models.geometry.pack_boxes`.

    Returns
    -------
    (T, 16) bool
    """
    cut = np.zeros(joints.shape[:2], np.bool_)
    for k in range(len(boxes)):
        c, s = math.cos(boxes[k, 6]), math.sin(boxes[k, 6])
        x, y, z = -boxes[k, 0], -boxes[k, 1], elevation - boxes[k, 2]
        start = (c * x + s * y, c * y - s * x, z)
        for t in range(joints.shape[0]):
            for j in range(joints.shape[1]):
                x, y = joints[t, j, 0], joints[t, j, 1]
                slope = (c * x + s * y, c * y - s * x, joints[t, j, 2] - elevation)
                enters, leaves = 0.0, 1.0
                for axis in range(3):
                    half = boxes[k, 3 + axis]
                    if slope[axis] == 0.0:
                        if abs(start[axis]) >= half:
                            leaves = -1.0
                    else:
                        middle = -start[axis] / slope[axis]
                        reach = half / abs(slope[axis])
                        enters = max(enters, middle - reach)
                        leaves = min(leaves, middle + reach)
                if enters < leaves:
                    cut[t, j] = True
    return cut
