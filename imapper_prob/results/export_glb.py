"""A scene as binary glTF, which Blender, Windows, macOS and browsers open.

Metres, y up, the camera at the origin of the floor looking along -z. Nodes, by name::

    couch 1                 an object, placed
    couch 1 seat            one of its boxes
    motion                  the way of the pelvis, a line
    person at frame 40      a pose, one bone a rod

Of several people ``motion B`` and ``person B at frame 40``, by the names of their tracks.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any, Final

import numpy as np
import trimesh as _untyped_trimesh
from numpy.typing import NDArray

from imapper_prob.colours import category_colour
from imapper_prob.files import written_whole
from imapper_prob.models.scene import Clip, Scene, SceneObject
from imapper_prob.models.skeleton import BONES, PELV
from imapper_prob.people import by_person, own_part

__all__ = ["write_glb"]

Array = NDArray[np.float64]
trimesh: Any = _untyped_trimesh

_UPRIGHT: Final = np.array(
    [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
"""Our world (z up) to that of glTF (y up)."""
_POSES: Final = 6
"""Poses shown along the way: more stand in each other."""
_BONE: Final = 0.02
"""Metres, radius of a bone: thin enough to see what is behind."""
_PERSON: Final = (235, 200, 70, 255)
_WAY: Final = (60, 60, 70, 255)


def write_glb(path: Path, scene: Scene, clip: Clip) -> None:
    """Write one scene of a clip."""
    content = _as_trimesh(scene, clip).export(file_type="glb")
    with written_whole(path) as beside:
        beside.write_bytes(content)


def _as_trimesh(scene: Scene, clip: Clip) -> Any:
    """The scene as a trimesh scene graph."""
    result = trimesh.Scene(base_frame="world")
    met: Counter[str] = Counter()
    for o in scene.objects:
        met[o.label] += 1
        _add_object(result, o, f"{o.label} {met[o.label]}")
    for person, joints in enumerate(by_person(clip, scene.joints)):
        _add_person(result, joints, clip.frame_ids, own_part(clip, person))
    return result


def _add_person(result: Any, joints: Array, frame_ids: NDArray[np.int64], whose: str) -> None:
    """The way of a person (T, 16, 3), and how they stand at some moments."""
    known = np.flatnonzero(np.isfinite(joints).all((1, 2)))
    if len(known) > 1:
        way = trimesh.load_path(joints[known][:, PELV])
        way.colors = np.array([_WAY] * len(way.entities), np.uint8)
        name = f"motion{whose}"
        result.add_geometry(way, node_name=name, geom_name=name, transform=_UPRIGHT)
    shown = known[np.linspace(0, len(known) - 1, _POSES).round().astype(int)] if len(known) else []
    for t in np.unique(shown):
        name = f"person{whose} at frame {frame_ids[t]}"
        body = _body(joints[t])
        result.add_geometry(body, node_name=name, geom_name=name, transform=_UPRIGHT)


def _add_object(result: Any, o: SceneObject, name: str) -> None:
    placed = np.eye(4)
    placed[:2, :2] = o.placement.rotation
    placed[:2, 3] = o.placement.x, o.placement.y
    result.graph.update(frame_to=name, frame_from="world", matrix=_UPRIGHT @ placed)
    met: Counter[str] = Counter()
    parts = [c.part for c in o.cuboids]
    for c in o.cuboids:
        met[c.part] += 1
        part = f"{name} {c.part}" + (f" {met[c.part]}" if parts.count(c.part) > 1 else "")
        box = trimesh.creation.box(extents=c.size)
        box.visual = _painted((*category_colour(o.label), 255))
        at = trimesh.transformations.translation_matrix(c.centre)
        result.add_geometry(
            box, node_name=part, geom_name=part, parent_node_name=name, transform=at
        )


def _body(pose: Array) -> Any:
    """(16, 3) joints as one mesh of rods."""
    rods = [
        trimesh.creation.cylinder(radius=_BONE, segment=pose[list(bone)], sections=8)
        for bone in BONES
        if np.linalg.norm(pose[bone[0]] - pose[bone[1]]) > _BONE
    ]
    body = trimesh.util.concatenate(rods)
    body.visual = _painted(_PERSON)
    return body


def _painted(colour: tuple[int, int, int, int]) -> Any:
    material = trimesh.visual.material.PBRMaterial(
        baseColorFactor=np.array(colour, np.uint8), metallicFactor=0.0, roughnessFactor=0.9
    )
    return trimesh.visual.TextureVisuals(material=material)
