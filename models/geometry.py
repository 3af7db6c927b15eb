"""Boxes on the floor: packing, lines of sight, footprints.

A box is a row of seven numbers ``(x, y, z, hx, hy, hz, yaw)``: its centre and half side
lengths in metres and its rotation about z in radians, in the world frame.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.scene import SceneObject

__all__ = ["NOTHING_IN_SIGHT", "OPAQUE", "pack_boxes", "sight_clearance"]

Array = NDArray[np.float64]

NOTHING_IN_SIGHT = 0.2
"""Cap of the clearance in metres: a ray that far from every box is as free as any."""

OPAQUE = 0.1
"""Metres; a line of sight through the middle of a box thinner than twice this counts as this
deep in it: a table top hides as well as a chest does."""


def pack_boxes(objects: Iterable[SceneObject]) -> Array:
    """All cuboids of ``objects`` as (K, 7) boxes in their common parent frame.

    Parameters
    ----------
    objects : iterable of SceneObject
        In one parent frame.

    Returns
    -------
    (K, 7) float
        See the module.
    """
    rows = [
        (*o.placement.apply(c.centre), *(c.size / 2), o.placement.yaw)
        for o in objects
        for c in o.cuboids
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 7)


def sight_clearance(origin: ArrayLike, points: ArrayLike, boxes: ArrayLike) -> Array:
    """How far the boxes are from cutting the line of sight to each point.

    The smallest value along the segment from ``origin`` to the point of the box function
    ``max_i(|p_i| - h_i)``: negative exactly where the segment passes through a box (then by
    how deep it cuts), positive where it is clear. The function is a maximum of linear
    functions, so its minimum along a line is the largest of the values where a rising and a
    falling one meet. In a box thinner than ``2 OPAQUE`` negative values are scaled up to
    ``OPAQUE`` in its middle.

    Parameters
    ----------
    origin : (3,) float
        Optical centre in the world, metres.
    points : (..., 3) float
        Joints in the world, metres.
    boxes : (K, 7) float
        See the module.

    Returns
    -------
    (...) float
        Clearance in metres, at most ``NOTHING_IN_SIGHT``.
    """
    points = np.asarray(points, float)
    origin = np.asarray(origin, float)
    clearance = np.full(points.shape[:-1], NOTHING_IN_SIGHT)
    for x, y, z, *half, yaw in np.asarray(boxes, float).reshape(-1, 7):
        c, s = np.cos(yaw), np.sin(yaw)
        into_box = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        start = into_box @ (origin - (x, y, z))
        slope = (points - origin) @ into_box.T
        h = np.asarray(half)
        # Six lines, value(s) = a s + b, of which three rise and three fall (or are level).
        rise, fall = np.abs(slope), -np.abs(slope)
        sign = np.where(slope >= 0, 1.0, -1.0)
        rise_at_0, fall_at_0 = sign * start - h, -sign * start - h
        a_up, b_up = rise[..., :, None], rise_at_0[..., :, None]
        a_down, b_down = fall[..., None, :], fall_at_0[..., None, :]
        gap = np.maximum(a_up - a_down, 1e-12)
        meet = (b_down - b_up) / gap
        value = b_up + a_up * meet
        flat = value.reshape(*value.shape[:-2], 9)
        best = flat.argmax(-1)[..., None]
        lowest = np.take_along_axis(flat, best, -1)[..., 0]
        where = np.take_along_axis(meet.reshape(flat.shape), best, -1)[..., 0]
        at_0 = np.broadcast_to((np.abs(start) - h).max(), lowest.shape)
        at_1 = (np.abs(start + slope) - h).max(-1)
        lowest = np.where(where <= 0, at_0, np.where(where >= 1, at_1, lowest))
        depth = lowest * max(1.0, OPAQUE / h.min())
        clearance = np.minimum(clearance, np.where(lowest < 0, depth, lowest))
    return clearance
