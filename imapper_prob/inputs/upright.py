"""Furniture from boxes that were measured one by one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import Cuboid, Placement, SceneObject

__all__ = ["MeasuredBox", "upright_object"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MeasuredBox:
    """A box with vertical sides in the world.

    Parameters
    ----------
    part : str
        What it is of its object.
    centre : (3,) float
        World, metres, floor at z = 0.
    size : (3,) float
        Full side lengths in metres along its own x, y and z axes.
    yaw : float
        Direction of its own x axis, radians.
    """

    part: str
    centre: Array
    size: Array
    yaw: float

    @property
    def footprint_area(self) -> float:
        """Square metres."""
        return float(self.size[0] * self.size[1])


def upright_object(label: str, boxes: Sequence[MeasuredBox], yaw: float) -> SceneObject:
    """One piece of furniture whose local +y axis, its front, points along ``yaw``.

    Boxes keep their size and place. They are turned by the few degrees that part them from
    the nearest multiple of a right angle, because all boxes of an object share its axes.
    """
    centres = Placement(0.0, 0.0, -yaw).apply([box.centre for box in boxes])
    sizes = []
    for box in boxes:
        lengthwise = abs(np.cos(box.yaw - yaw)) >= abs(np.sin(box.yaw - yaw))
        sizes.append(box.size if lengthwise else box.size[[1, 0, 2]])
    low = np.min(centres - np.array(sizes) / 2, axis=0)
    high = np.max(centres + np.array(sizes) / 2, axis=0)
    middle = (low + high) / 2 * (1, 1, 0)
    x, y, _ = Placement(0.0, 0.0, yaw).apply(middle)
    return SceneObject(
        label=label,
        placement=Placement(float(x), float(y), yaw),
        cuboids=tuple(
            Cuboid(box.part, centre - middle, size)
            for box, centre, size in zip(boxes, centres, sizes, strict=True)
        ),
    )
