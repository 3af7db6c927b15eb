"""A scene as binary glTF, which Blender, Windows, macOS and browsers open.

Metres, y up, the origin on the floor below the camera, which looks along -z. Nodes, by name::

    couch 1                 an object, placed
    couch 1 seat            one of its boxes
    motion                  the path of the pelvis, a line
    person                  somebody in motion
    person NECK-THRX        one of the bones
    camera                  the camera of the scene

For several people ``motion B`` and ``person B``, with the names of their tracks. The animation
``motion`` has all people in it, in seconds from the first frame.

The file is written by trimesh. The animation and the camera, which it cannot write, are added to
its tree as the specification asks (Khronos Group, glTF 2.0, 3.6, 3.10 and 3.11).
"""

from __future__ import annotations

from collections import Counter
from functools import partial
from itertools import accumulate
from pathlib import Path
from typing import Any, Final

import numpy as np
import trimesh as _untyped_trimesh
from numpy.typing import NDArray

from imapper_prob.files import written_whole
from imapper_prob.models.camera import Camera
from imapper_prob.models.scene import Clip, Scene, SceneObject
from imapper_prob.models.skeleton import BONES, JOINTS, PELV
from imapper_prob.people import by_person, own_part
from imapper_prob.plotting import Colour, category_colour
from imapper_prob.uncertainty.scenes import WeightedScene

__all__ = ["write_glb"]

Array = NDArray[np.float64]
trimesh: Any = _untyped_trimesh
_UPRIGHT: Final = np.array(
    [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
"""Transformation from the world frame (z up) to that of glTF (y up)."""
_LENS: Final = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Rotation from a camera of glTF (x right, y up, looking along -z) to a camera frame of ours."""
_NEAREST: Final = 0.1
"""Distance in metres of the near plane, which glTF asks for."""
_BONE: Final = 0.02
"""Radius of a bone in metres, thin enough to see what is behind."""
_SHORTEST: Final = 0.001
"""Least length of a bone in metres, so that it has a direction."""
_OPPOSITE: Final = 1e-9
"""One plus the cosine between opposite directions is below it; rounding errors are 1e-16."""
_PERSON: Final = (235, 200, 70)
_WAY: Final = (60, 60, 70)
"""Colours of people and of their paths, sRGB."""
_ROD: Final = "bone"
"""Name of the mesh that all bones share: a rod of a metre along z."""
_FLOAT: Final = 5126
"""The specification's number for single precision."""


def write_glb(path: Path, scene: Scene | WeightedScene, clip: Clip) -> None:
    """Write one scene of a clip as glTF.

    Parameters
    ----------
    path : Path
    scene : Scene or WeightedScene
        With its probability, if it has one.
    clip : Clip
    """
    shown = scene.scene if isinstance(scene, WeightedScene) else scene
    graph = _as_trimesh(shown, clip)
    graph.metadata.update(_said(scene, clip))
    content = trimesh.exchange.gltf.export_glb(
        graph, buffer_postprocessor=partial(_complete, scene=shown, clip=clip)
    )
    with written_whole(path) as beside:
        beside.write_bytes(content)


def _said(scene: Scene | WeightedScene, clip: Clip) -> dict[str, Any]:
    """What is said about a scene as a whole, which viewers show as properties."""
    said: dict[str, Any] = {
        "clip": clip.name,
        "units": "metres, seconds, radians",
        "axes": "y up, the origin on the floor below the camera",
        "fps": float(clip.fps),
        "first_frame": int(clip.frame_ids[0]),
    }
    if isinstance(scene, WeightedScene):
        said["probability"] = scene.probability
        if np.isfinite(scene.error):
            said["probability_error"] = scene.error
    return said


# ------------------------------------------------------------------------------------------------
# Furniture and paths.


def _as_trimesh(scene: Scene, clip: Clip) -> Any:
    """Furniture, paths and the mesh of a bone as a trimesh scene graph."""
    result = trimesh.Scene(base_frame="world")
    met: Counter[str] = Counter()
    for o in scene.objects:
        met[o.label] += 1
        _add_object(result, o, f"{o.label} {met[o.label]}")
    for person, joints in enumerate(by_person(clip, scene.joints)):
        known = _known(joints)
        if len(known) > 1:
            way = trimesh.load_path(joints[known][:, PELV])
            way.colors = np.tile(_linear(_WAY), (len(way.entities), 1))
            name = f"motion{own_part(clip, person)}"
            result.add_geometry(way, node_name=name, geom_name=name, transform=_UPRIGHT)
    if len(_known(scene.joints)):
        rod = trimesh.creation.cylinder(radius=_BONE, segment=[[0, 0, 0], [0, 0, 1]], sections=8)
        rod.visual = _painted(_PERSON)
        result.geometry[_ROD] = rod
    return result


def _known(joints: Array) -> NDArray[np.int64]:
    """Frames in which a motion (T, 16, 3) is known."""
    return np.flatnonzero(np.isfinite(joints).all((1, 2)))


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
        box.visual = _painted(category_colour(o.label))
        at = trimesh.transformations.translation_matrix(c.centre)
        result.add_geometry(
            box, node_name=part, geom_name=part, parent_node_name=name, transform=at
        )


def _painted(colour: Colour) -> Any:
    material = trimesh.visual.material.PBRMaterial(
        baseColorFactor=_linear(colour), metallicFactor=0.0, roughnessFactor=0.9
    )
    return trimesh.visual.TextureVisuals(material=material)


def _linear(colour: Colour) -> NDArray[np.uint8]:
    """An opaque colour in linear RGBA, as glTF stores colours, from sRGB (IEC 61966-2-1)."""
    srgb = np.array(colour) / 255
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    return np.append(np.round(255 * linear), 255).astype(np.uint8)


# ------------------------------------------------------------------------------------------------
# The camera, and people in motion.


def _complete(buffers: dict[Any, bytes], tree: dict[str, Any], *, scene: Scene, clip: Clip) -> None:
    """Add the camera and people to a tree of glTF, and their numbers to its buffers."""
    _add_root(tree, _camera_node(tree, scene.camera))
    channels: list[dict[str, Any]] = []
    samplers: list[dict[str, Any]] = []
    for person, joints in enumerate(by_person(clip, scene.joints)):
        known = _known(joints)
        if not len(known):
            continue
        times = _accessor(buffers, tree, known / clip.fps, "SCALAR")
        far, near = np.transpose(BONES)
        bones = range(len(tree["nodes"]), len(tree["nodes"]) + len(BONES))
        motion = _rods(joints[known][:, far], joints[known][:, near])
        for b, node in enumerate(bones):
            rest = {target: values[0, b].tolist() for target, values in motion.items()}
            name = f"person{own_part(clip, person)} {JOINTS[far[b]]}-{JOINTS[near[b]]}"
            tree["nodes"].append({"name": name, "mesh": _rod_of(tree), **rest})
            for target, values in motion.items():
                kind = f"VEC{values.shape[-1]}"
                goal = {"node": node, "path": target}
                channels.append({"sampler": len(samplers), "target": goal})
                output = _accessor(buffers, tree, values[:, b], kind)
                samplers.append({"input": times, "output": output})
        matrix = _UPRIGHT.T.ravel().tolist()
        name = f"person{own_part(clip, person)}"
        _add_root(tree, {"name": name, "matrix": matrix, "children": list(bones)})
    if channels:
        tree["animations"] = [{"name": "motion", "channels": channels, "samplers": samplers}]


def _add_root(tree: dict[str, Any], node: dict[str, Any]) -> None:
    tree["scenes"][0]["nodes"].append(len(tree["nodes"]))
    tree["nodes"].append(node)


def _camera_node(tree: dict[str, Any], camera: Camera) -> dict[str, Any]:
    """A node with the camera of a scene; glTF has no principal point, so it is in the extras."""
    tree["cameras"] = [
        {
            "name": "camera",
            "type": "perspective",
            "perspective": {
                "yfov": 2 * float(np.arctan2(0.5 * camera.height, camera.fy)),
                "aspectRatio": float(camera.width / camera.fx * camera.fy / camera.height),
                "znear": _NEAREST,
            },
        }
    ]
    placed = np.eye(4)
    placed[:3, :3], placed[:3, 3] = camera.rotation @ _LENS, camera.centre
    names = ("width", "height", "fx", "fy", "cx", "cy", "pitch", "roll", "elevation")
    return {
        "name": "camera",
        "camera": 0,
        "matrix": (_UPRIGHT @ placed).T.ravel().tolist(),
        "extras": {name: float(getattr(camera, name)) for name in names},
    }


def _rod_of(tree: dict[str, Any]) -> int:
    return [mesh["name"] for mesh in tree["meshes"]].index(_ROD)


def _accessor(buffers: dict[Any, bytes], tree: dict[str, Any], values: Array, kind: str) -> int:
    """Store values in single precision; return the number of their accessor."""
    data = np.ascontiguousarray(values, "<f4").reshape(len(values), -1)
    number, name = len(tree["accessors"]), f"animation {len(buffers)}"
    tree["accessors"][name] = {
        "bufferView": len(buffers),
        "componentType": _FLOAT,
        "count": len(data),
        "type": kind,
        "min": data.min(0).tolist(),
        "max": data.max(0).tolist(),
    }
    buffers[name] = data.tobytes()
    return number


def _rods(far: Array, near: Array) -> dict[str, Array]:
    """Translation, rotation and scale of rods from joints ``near`` to ``far``, (T, B, 3) each.

    Rotations are quaternions (T, B, 4), in the order x y z w.
    """
    along = far - near
    length = np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), _SHORTEST)
    thick = np.ones_like(length)
    return {
        "translation": near,
        "rotation": _turns(along / length),
        "scale": np.concatenate([thick, thick, length], -1),
    }


def _turns(directions: Array) -> Array:
    """Quaternions (T, B, 4) that turn z to unit vectors (T, B, 3).

    From each frame to the next they turn by the least angle: rods do not spin about themselves, and
    between frames they are on the shorter way.
    """
    upward = np.broadcast_to([0.0, 0.0, 1.0], directions[:1].shape)
    before = np.concatenate([upward, directions[:-1]])
    steps = _quaternion(
        np.cross(before, directions), 1.0 + (before * directions).sum(-1, keepdims=True)
    )
    opposite = steps[..., 3] < _OPPOSITE
    across = np.cross(before, np.eye(3)[np.abs(before).argmin(-1)])[opposite]
    steps[opposite] = _quaternion(across, np.zeros((len(across), 1)))
    steps /= np.linalg.norm(steps, axis=-1, keepdims=True)
    return np.array(list(accumulate(steps, _after)))


def _quaternion(vector: Array, scalar: Array) -> Array:
    return np.concatenate([vector, scalar], -1)


def _after(first: Array, second: Array) -> Array:
    """The quaternions of both rotations, one after the other."""
    (v, w), (a, b) = ((q[..., :3], q[..., 3:]) for q in (second, first))
    return _quaternion(w * a + b * v + np.cross(v, a), w * b - (v * a).sum(-1, keepdims=True))
