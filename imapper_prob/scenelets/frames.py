"""Local frames of scenelets, mirror images, and scaled furniture."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.scene import Cuboid, Placement, SceneObject
from imapper_prob.models.scenelet import Scenelet
from imapper_prob.models.skeleton import MIRROR, PELV, facing

__all__ = ["REACH", "localised", "mirrored"]

Array = NDArray[np.float64]

REACH = 1.0
"""Distance in metres, in top view, within which an object belongs to a motion (Monszpart et al.
2019)."""

_FLIP = np.array([-1.0, 1.0, 1.0])


def localised(
    name: str, action: str, joints: ArrayLike, objects: Iterable[SceneObject], *, fps: float = 10.0
) -> Scenelet:
    """Make a scenelet from a motion (n, 16, 3) and furniture in a common frame with floor at 0.

    The local origin is below the pelvis in frame ``n // 2``, with +y in the person's facing
    direction; objects farther than ``REACH`` from every joint in every frame are left out.

    Parameters
    ----------
    name : str
    action : str
    joints : (n, 16, 3) float
        Metres.
    objects : iterable of SceneObject
    fps : float
        Frames per second.

    Returns
    -------
    Scenelet
    """
    joints = np.asarray(joints, float)
    middle = joints[len(joints) // 2]
    yaw = float(facing(middle))
    c, s = np.cos(yaw), np.sin(yaw)
    x, y = middle[PELV, :2]
    into = Placement(float(-c * x - s * y), float(s * x - c * y), -yaw)
    moved = [o.moved(into) for o in objects]
    joints = into.apply(joints)
    near = tuple(o for o in moved if _distance(o, joints) <= REACH)
    return Scenelet(name, action, joints, near, fps)


def _distance(piece: SceneObject, joints: Array) -> float:
    """Least horizontal distance in metres of any joint from the object's bounding box."""
    offset = joints[..., :2] - (piece.placement.x, piece.placement.y)
    local = offset @ piece.placement.rotation
    low, high = piece.bounds[:, :2]
    outside = np.maximum(np.maximum(low - local, local - high), 0.0)
    return float(np.linalg.norm(outside, axis=-1).min())


def mirrored(scenelet: Scenelet, name: str) -> Scenelet:
    """Mirror a scenelet: x changes sign, left and right are swapped.

    Parameters
    ----------
    scenelet : Scenelet
    name : str

    Returns
    -------
    Scenelet
    """
    joints = scenelet.joints[:, list(MIRROR)] * _FLIP
    objects = tuple(
        SceneObject(
            o.label,
            Placement(-o.placement.x, o.placement.y, -o.placement.yaw),
            tuple(Cuboid(c.part, c.centre * _FLIP, c.size) for c in o.cuboids),
        )
        for o in scenelet.objects
    )
    return Scenelet(name, scenelet.action, joints, objects, scenelet.fps, scenelet.weight)
