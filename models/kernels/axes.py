"""Points in the axes of the camera, and of boxes on the floor.

The camera's axes are right, depth (along the optical axis) and up, as in
:mod:`imapper_prob.models.camera`. Those of a box are its width, its depth and z. The kernels return
numbers, so that loops over joints can be vectorised after inlining.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import inner_inlined
from imapper_prob.models.settings import NEAREST

__all__ = [
    "CameraPose",
    "camera_pose",
    "corner_of",
    "point_of_box",
    "point_to_camera",
    "rotated",
    "rotated_back",
    "vector_to_camera",
]

Array = NDArray[np.float64]
CameraPose = tuple[float, float, float, float, float]
"""Cosine and sine of the camera's pitch, its elevation in metres, cosine and sine of its roll."""


@inner_inlined
def camera_pose(camera: Array) -> CameraPose:
    """Precompute what the conversion to camera axes needs of a camera.

    Parameters
    ----------
    camera : (5,) float
        phi, see :class:`imapper_prob.models.log_posterior.State`.

    Returns
    -------
    CameraPose
    """
    return (
        math.cos(camera[0]), math.sin(camera[0]), camera[1],
        math.cos(camera[4]), math.sin(camera[4]),
    )  # fmt: skip


@inner_inlined
def vector_to_camera(pose: CameraPose, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Convert a vector from world axes to camera axes.

    Parameters
    ----------
    pose : CameraPose
    x, y, z : float
        In the world, metres.

    Returns
    -------
    right, depth, up : float
        Metres.
    """
    cp, sp, _, cr, sr = pose
    level = cp * z - sp * y
    return cr * x + sr * level, cp * y + sp * z, cr * level - sr * x


@inner_inlined
def point_to_camera(pose: CameraPose, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Convert a point from the world to camera axes; nearer ones are put at the least depth.

    Parameters
    ----------
    pose : CameraPose
    x, y, z : float
        In the world, metres.

    Returns
    -------
    right, depth, up : float
        Metres; the depth is ``NEAREST`` or more.
    """
    right, depth, up = vector_to_camera(pose, x, y, z - pose[2])
    return right, max(depth, NEAREST), up


@inner_inlined
def rotated(c: float, s: float, x: float, y: float) -> tuple[float, float]:
    """Rotate a vector on the floor.

    Parameters
    ----------
    c, s : float
        Cosine and sine of the yaw; times a factor if the vector is to be scaled, too.
    x, y : float
        Metres.

    Returns
    -------
    x, y : float
        Metres.
    """
    return c * x - s * y, s * x + c * y


@inner_inlined
def rotated_back(c: float, s: float, x: float, y: float) -> tuple[float, float]:
    """Rotate a vector on the floor by minus a yaw: its parts along axes that have this yaw.

    Parameters
    ----------
    c, s : float
        Cosine and sine of the yaw.
    x, y : float
        Metres.

    Returns
    -------
    along, across : float
        Metres.
    """
    return c * x + s * y, c * y - s * x


@inner_inlined
def point_of_box(
    box: Array, c: float, s: float, along: float, across: float
) -> tuple[float, float]:
    """The point on the floor at an offset from the centre of a box.

    Parameters
    ----------
    box : (7,) float
        In the world.
    c, s : float
        Cosine and sine of its yaw.
    along, across : float
        Offset along its width and along its depth, metres.

    Returns
    -------
    x, y : float
        Metres.
    """
    return box[0] + c * along - s * across, box[1] + s * along + c * across


@inner_inlined
def corner_of(box: Array, turn: Array, corner: int, margin: float) -> tuple[float, float]:
    """A corner of the footprint of a box.

    Parameters
    ----------
    box : (7,) float
        In the world.
    turn : (2 or more,) float
        Cosine and sine of its yaw.
    corner : int
        0 to 3.
    margin : float
        Length by which the box is enlarged on every side, metres.

    Returns
    -------
    x, y : float
        Metres.
    """
    along = (box[3] + margin) * (1.0 if corner & 1 else -1.0)
    across = (box[4] + margin) * (1.0 if corner & 2 else -1.0)
    return point_of_box(box, turn[0], turn[1], along, across)
