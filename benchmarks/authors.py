"""The objects of the authors' own result on i3DB, regrouped.

Their files scatter the parts of an object over many numbers and repeat some. Seats, table tops
and shelves stand for their objects; repeats within ``REPEATED`` are one.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.scene import Cuboid, Placement, SceneObject

__all__ = ["authors_objects"]

Array = NDArray[np.float64]

MAIN_PARTS = frozenset({"seat", "stool", "top", "shelf"})
REPEATED = 0.3
"""Metres between centres of one part written twice."""
BACK_REACH = 0.6
"""Metres from a seat within which a back is its own."""


def authors_objects(scene: Path, camera: Camera) -> list[SceneObject]:
    """One object a main part, in the world of ``camera``, with the main part's box alone.

    A seat's front is away from its back; where there is none, and of shelves and tables, the
    thinner side faces the camera.
    """
    folder = scene / "iMapper"
    listed = json.loads((folder / "skel_output.json").read_text())["scenelets"]["obbs"]
    parts = [_part(folder / str(name), camera) for name in listed]
    objects: list[SceneObject] = []
    for part in parts:
        if part["part"] not in MAIN_PARTS:
            continue
        x, y, z = part["centre"]
        known = [o for o in objects if o.label == part["label"]]
        if any(np.hypot(*(o.centre[:2] - (x, y))) < REPEATED for o in known):
            continue
        forward, size = _front(part, parts)
        yaw = float(np.arctan2(-forward[0], forward[1]))
        box = Cuboid(part["part"], np.array([0, 0, max(z, size[2] / 2)]), size)
        objects.append(SceneObject(part["label"], Placement(x, y, yaw), (box,)))
    return objects


def _part(path: Path, camera: Camera) -> dict[str, Any]:
    """A box: label, part, centre (3,), horizontal axes (2, 2) in rows, size (3,), world frame."""
    document = json.loads(path.with_suffix(".json").read_text())
    matched = re.fullmatch(r"\d+_([a-z]+)_([a-z]+)(-\d+)?", path.stem)
    assert matched is not None, path
    axes = _camera_axes(np.array(document["axes"]).T) @ camera.rotation.T
    return {
        "label": matched[1],
        "part": matched[2],
        "centre": camera.to_world(_camera_axes(np.array(document["centroid"])[:, 0])),
        "axes": axes[:2, :2] / np.linalg.norm(axes[:2, :2], axis=1, keepdims=True),
        "size": np.array(document["scales"])[:, 0],
    }


def _camera_axes(points: Array) -> Array:
    """The files' x right, y down, z forward to x right, y forward, z up: (..., 3)."""
    return np.stack([points[..., 0], points[..., 2], -points[..., 1]], -1)


def _front(part: dict[str, Any], parts: list[dict[str, Any]]) -> tuple[Array, Array]:
    """Direction of the front on the floor, and sizes across, along it and up."""
    backs = [p["centre"] for p in parts if p["part"] == "back" and p["label"] == part["label"]]
    away = [part["centre"][:2] - b[:2] for b in backs]
    near = [a for a in away if np.linalg.norm(a) < BACK_REACH]
    if near:
        guess = min(near, key=lambda a: float(np.linalg.norm(a)))
        axis = int(np.argmax(np.abs(part["axes"] @ guess)))
    else:
        guess = -part["centre"][:2]
        axis = int(np.argmin(part["size"][:2]))
    forward = part["axes"][axis] * np.sign(part["axes"][axis] @ guess)
    return forward, part["size"][[1 - axis, axis, 2]]
