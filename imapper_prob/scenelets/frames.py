"""The local frame of a scenelet, its mirror image, and furniture resized."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.scene import Cuboid, Placement, SceneObject
from imapper_prob.models.scenelet import Scenelet
from imapper_prob.models.skeleton import MIRROR, PELV, facing

__all__ = ["REACH", "localised", "mirrored", "resized"]

Array = NDArray[np.float64]

REACH = 1.0
"""Metres in top view within which an object belongs to a motion (Monszpart et al. 2019)."""

_FLIP = np.array([-1.0, 1.0, 1.0])


def localised(
    name: str, action: str, joints: ArrayLike, objects: Iterable[SceneObject], *, fps: float = 10.0
) -> Scenelet:
    """A scenelet from a motion (n, 16, 3) and furniture in any common frame with the floor at 0.

    The origin goes below the pelvis at frame ``n // 2`` and +y to where the person faces
    then; objects farther than ``REACH`` from every joint in every frame are left out.

    Parameters
    ----------
    name : str
    action : str
    joints : (n, 16, 3) float
        Metres.
    objects : iterable of SceneObject
    fps : float
        Frames a second.

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
    """Smallest distance in metres, top view, of any joint from the piece's bounding box."""
    offset = joints[..., :2] - (piece.placement.x, piece.placement.y)
    local = offset @ piece.placement.rotation
    low, high = piece.bounds[:, :2]
    outside = np.maximum(np.maximum(low - local, local - high), 0.0)
    return float(np.linalg.norm(outside, axis=-1).min())


def mirrored(scenelet: Scenelet, name: str) -> Scenelet:
    """The same scenelet done by somebody left-handed: x changes sign, left and right swap.

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


def resized(piece: SceneObject, factor: float) -> SceneObject:
    """A piece and its placement larger by ``factor``, about the origin of the parent frame.

    Parameters
    ----------
    piece : SceneObject
    factor : float

    Returns
    -------
    SceneObject
    """
    at = piece.placement
    return SceneObject(
        piece.label,
        Placement(at.x * factor, at.y * factor, at.yaw),
        tuple(Cuboid(c.part, c.centre * factor, c.size * factor) for c in piece.cuboids),
    )
