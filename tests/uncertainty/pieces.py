"""Pieces of furniture for draws made by hand."""

from __future__ import annotations

import numpy as np

from imapper_prob.models.scene import Cuboid, Placement, SceneObject


def piece(
    label: str,
    x: float,
    y: float,
    yaw: float = 0.0,
    *,
    width: float = 1.0,
    depth: float = 0.6,
    height: float = 0.8,
) -> SceneObject:
    """One box that stands on the floor, its centre at (x, y)."""
    size = np.array([width, depth, height])
    box = Cuboid("body", np.array([0.0, 0.0, height / 2]), size)
    return SceneObject(label, Placement(x, y, yaw), (box,))
