"""Boxes on the floor: packing into arrays, and clearance of lines of sight.

A box is a row of seven numbers ``(x, y, z, hx, hy, hz, yaw)``: its centre and half side
lengths in metres and its rotation about z in radians, in the world frame.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.kernels.visibility import clearances
from imapper_prob.models.scene import SceneObject
from imapper_prob.models.settings import NOTHING_IN_SIGHT
from imapper_prob.models.skeleton import N_JOINTS

__all__ = ["pack_boxes", "sight_clearance"]

Array = NDArray[np.float64]


def pack_boxes(objects: Iterable[SceneObject]) -> Array:
    """Pack all cuboids of ``objects`` as (K, 7) boxes in their common parent frame.

    Parameters
    ----------
    objects : iterable of SceneObject
        Objects that share a parent frame.

    Returns
    -------
    (K, 7) float
        See the module docstring.
    """
    rows = [
        (*o.placement.apply(c.centre), *(c.size / 2), o.placement.yaw)
        for o in objects
        for c in o.cuboids
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 7)


def sight_clearance(origin: ArrayLike, points: ArrayLike, boxes: ArrayLike) -> Array:
    """Clearance of the line of sight from the camera to each point, metres.

    The clearance is the minimum, along the segment from ``origin`` to the point, of the box
    function ``max_i(|p_i| - h_i)``. It is negative if the segment passes through a box (its size is
    the depth of the cut) and positive if it is clear. For a box thinner than ``2 OPAQUE`` negative
    values are scaled so that they reach ``-OPAQUE`` in its middle. Computed in single precision by
    the kernels of :mod:`imapper_prob.models.kernels.visibility`.

    Parameters
    ----------
    origin : (3,) float
        Optical centre in the world, metres.
    points : (..., 3) float
        Joints in the world, metres.
    boxes : (K, 7) float
        See the module docstring.

    Returns
    -------
    (...) float
        Clearance in metres, at most ``NOTHING_IN_SIGHT``; NaN if a point is not finite.
    """
    (x, y, elevation), points = np.asarray(origin, float), np.asarray(points, float)
    below = np.array([x, y, 0.0])
    flat = (points - below).reshape(-1, 3)
    rows = np.zeros((-(-len(flat) // N_JOINTS) * N_JOINTS, 3))
    known = np.isfinite(flat).all(-1)
    rows[: len(flat)][known] = flat[known]
    boxes = np.array(boxes, float).reshape(-1, 7)
    boxes[:, :3] -= below
    joints = np.ascontiguousarray(rows.reshape(-1, N_JOINTS, 3).transpose(0, 2, 1))
    found = clearances(float(elevation), joints, boxes).reshape(-1)[: len(flat)]
    capped = np.minimum(found, NOTHING_IN_SIGHT)  # single precision may round up
    result: Array = np.where(known, capped, np.nan).reshape(points.shape[:-1])
    return result
