"""Furniture as scores see it: from above, in the axes of the camera.

Scores are taken in the frame of the files of i3DB, which is that of the camera: what is
compared is not upright, and the tilt of a camera is part of an answer, not of the frame it is
judged in. Top view therefore means: without the camera's own up axis.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from shapely import MultiPoint, Polygon, convex_hull

from imapper_prob.models.camera import Camera
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import SceneObject

__all__ = ["GROUPS", "Outline", "box_corners", "outline_of"]

Array = NDArray[np.float64]

GROUPS: Final = {
    "chair": "seat", "couch": "seat", "stool": "seat", "bench": "seat", "armchair": "seat",
    "sofa": "seat", "table": "table", "desk": "table", "shelf": "shelf", "bookcase": "shelf",
}  # fmt: skip
"""Labels that may be taken for each other: {chair, couch, stool} {table} {shelf} are those of
the benchmark; the rest are other words for the same. A label that is not here is a group of
its own, and has no partner in i3DB."""

_WITH_FRONT: Final = frozenset({"chair", "couch", "bench", "armchair", "sofa"})
"""Categories of which the front can be told from the back; of the others only the axis."""

_CORNERS: Final = np.array(list(product((-0.5, 0.5), repeat=3)))


@dataclass(frozen=True, eq=False)
class Outline:
    """A piece of furniture in top view.

    Parameters
    ----------
    label : str
    centre : (2,) float
        Middle of the smallest rectangle along the object's axes that holds all its boxes:
        metres to the right of the camera and ahead of it.
    yaw : float
        Direction of the front, radians counter-clockwise from straight ahead.
    has_front : bool
        Whether front and back can be told apart; otherwise ``yaw`` is known up to half a turn.
    hull : shapely.Polygon
        Convex outline of all boxes, metres.
    corners : (N, 3) float
        Of all boxes, camera axes, metres.
    """

    label: str
    centre: Array
    yaw: float
    has_front: bool
    hull: Polygon
    corners: Array

    @property
    def group(self) -> str:
        """What it may be taken for."""
        return GROUPS.get(self.label, self.label)

    @property
    def middle(self) -> Array:
        """(3,) centre in space: that in top view, and half the height, metres."""
        low, high = self.corners[:, 2].min(), self.corners[:, 2].max()
        return np.array([*self.centre, (low + high) / 2])

    @classmethod
    def of_corners(
        cls, label: str, corners: ArrayLike, sideways: ArrayLike, *, has_front: bool
    ) -> Outline:
        """The outline of boxes from their corners.

        Parameters
        ----------
        label : str
        corners : (N, 3) float
            Of all boxes, camera axes (x right, y forward, z up), metres.
        sideways : (3,) float
            Direction from the object's left to its right as one faces its front, that is
            its local x axis, camera axes. It is level whatever the camera's tilt, so that the
            front, at a right angle to it, does not depend on the tilt.
        has_front : bool
        """
        whole = np.asarray(corners, float)
        points = whole[:, :2]
        right = np.asarray(sideways, float)[:2]
        length = np.linalg.norm(right)
        if not np.isfinite(whole).all() or not length > 0:
            raise InputError(f"{label}: corners must be finite and its sideways axis level")
        right = right / length
        front = np.array([-right[1], right[0]])
        axes = np.stack([right, front])
        along = points @ axes.T
        centre = (along.min(0) + along.max(0)) / 2 @ axes
        yaw = float(np.arctan2(-front[0], front[1]))
        return cls(label, centre, yaw, has_front, convex_hull(MultiPoint(points)), whole)


def box_corners(centre: ArrayLike, axes: ArrayLike, size: ArrayLike) -> Array:
    """(8, 3) corners of a box from its centre, unit axes in columns and full side lengths."""
    corners: Array = np.asarray(centre) + (_CORNERS * np.asarray(size)) @ np.asarray(axes).T
    return corners


def outline_of(item: SceneObject, camera: Camera) -> Outline:
    """An object of a world in the axes of the camera that the world belongs to."""
    corners = np.concatenate(
        [item.placement.apply(box_corners(c.centre, np.eye(3), c.size)) for c in item.cuboids]
    )
    sideways = np.array([*item.placement.rotation[:, 0], 0.0]) @ camera.rotation
    return Outline.of_corners(
        item.label,
        camera.to_camera(corners),
        sideways,
        has_front=item.label in _WITH_FRONT,
    )
