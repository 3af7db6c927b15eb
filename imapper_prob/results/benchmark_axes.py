"""A scene in the axes of the benchmark: camera at the origin, x right, y down, z forward.

Every draw has a camera of its own, with its own pitch, roll, height and focal length: what
leaves the world must leave it through the camera of its draw.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.scene import SceneObject

__all__ = ["intrinsics", "object_axes", "to_benchmark", "yaw_in_camera"]

Array = NDArray[np.float64]


def to_benchmark(camera: Camera, points: ArrayLike) -> Array:
    """World (..., 3) to the benchmark's axes (..., 3), metres."""
    x, forward, up = np.moveaxis(camera.to_camera(points), -1, 0)
    return np.stack([x, -up, forward], -1)


def intrinsics(camera: Camera) -> Array:
    """(3, 3) matrix that takes the benchmark's axes to homogeneous pixels."""
    return np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])


def object_axes(camera: Camera, o: SceneObject) -> Array:
    """(3, 3) unit vectors along an object's width, front and up, in rows, benchmark's axes."""
    c, s = np.cos(o.placement.yaw), np.sin(o.placement.yaw)
    axes = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return to_benchmark(camera, camera.centre + axes)


def yaw_in_camera(camera: Camera, o: SceneObject) -> float:
    """Orientation in the (x, z) plane, radians: width (cos, sin), front (-sin, cos).

    That plane is tilted against the floor by the camera's pitch and roll; the angle is that of
    the front's direction as it falls on the plane.
    """
    front = object_axes(camera, o)[1]
    return float(np.arctan2(-front[0], front[2]))
