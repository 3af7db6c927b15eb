"""Export scenes and draws: JSON in the benchmark's axes, files of i3DB.

Every draw has its own camera (pitch, roll, elevation and focal length), so each is converted to
camera coordinates with its own camera.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.files import folder_held, folder_published, written_whole
from imapper_prob.models.camera import Camera
from imapper_prob.models.errors import InputError
from imapper_prob.models.geometry import pack_boxes, sight_clearance
from imapper_prob.models.scene import Clip, Scene, SceneObject
from imapper_prob.models.skeleton import JOINTS
from imapper_prob.people import by_person
from imapper_prob.results.posterior import Posterior
from imapper_prob.uncertainty.motion import drawn_motion

__all__ = [
    "evenly_spaced",
    "intrinsics",
    "scene_document",
    "to_benchmark",
    "write_i3db",
    "write_json",
    "yaw_in_camera",
]

Array = NDArray[np.float64]


def to_benchmark(camera: Camera, points: ArrayLike) -> Array:
    """Convert world points to the benchmark's camera axes.

    Parameters
    ----------
    camera : Camera
    points : (..., 3) float
        Metres.

    Returns
    -------
    (..., 3) float
        Metres.
    """
    x, forward, up = np.moveaxis(camera.to_camera(points), -1, 0)
    return np.stack([x, -up, forward], -1)


def intrinsics(camera: Camera) -> Array:
    """The intrinsic matrix, from the benchmark's axes to homogeneous pixels.

    Parameters
    ----------
    camera : Camera

    Returns
    -------
    (3, 3) float
    """
    return np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])


def _object_axes(camera: Camera, o: SceneObject) -> Array:
    """(3, 3) unit vectors of an object's width, front and up as rows, in the benchmark's axes."""
    c, s = np.cos(o.placement.yaw), np.sin(o.placement.yaw)
    axes = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return to_benchmark(camera, camera.centre + axes)


def yaw_in_camera(camera: Camera, o: SceneObject) -> float:
    """Yaw of an object in the camera's (x, z) plane, radians: width (cos, sin), front (-sin, cos).

    That plane is tilted against the floor by the camera's pitch and roll; the angle is that of the
    front direction projected to the plane.

    Parameters
    ----------
    camera : Camera
    o : SceneObject

    Returns
    -------
    float
    """
    front = _object_axes(camera, o)[1]
    return float(np.arctan2(-front[0], front[2]))


# ------------------------------------------------------------------------------------------------
# JSON of a scene, and of posterior draws.
#
# For programs that know neither the world frame nor the model: metres, x right, y down, z forward,
# with the camera at the origin. ``docs/reference/results.md`` describes the fields.

_FORMAT: Final = "imapper-prob scene 1"
_DECIMALS: Final = 5
"""Decimals of metres: a hundredth of a millimetre, less than a thousandth of a pixel."""


def write_json(
    path: Path, posterior: Posterior, *, scene: int | None = None, samples: int = 0
) -> None:
    """Write a scene, and optionally draws, as one JSON file.

    Parameters
    ----------
    path : path
        Written atomically.
    posterior : Posterior
    scene : int, optional
        Number of the scene, 1 being the most probable; the scene of least expected loss if left
        out.
    samples : int
        Number of draws, evenly spaced over the chains. Their limbs and furniture have random
        deviations from the scenelets (:mod:`imapper_prob.uncertainty.motion`,
        :mod:`imapper_prob.uncertainty.estimate`).

    Raises
    ------
    InputError
        There are not as many scenes or draws.
    """
    document = scene_document(posterior, scene=scene, samples=samples)
    with written_whole(path) as beside:
        beside.write_text(json.dumps(document, allow_nan=False) + "\n", encoding="utf-8")


def scene_document(
    posterior: Posterior, *, scene: int | None = None, samples: int = 0
) -> dict[str, Any]:
    """The content of the JSON file, see :func:`write_json`.

    Parameters
    ----------
    posterior : Posterior
    scene : int, optional
        Number of the scene, from 1; the scene of least expected loss if not given.
    samples : int
        Number of draws.

    Returns
    -------
    dict
    """
    shown = None if scene is None else posterior.scene(scene)
    clip = posterior.clip
    document = {
        "format": _FORMAT,
        "frame": "camera: metres, x right, y down, z forward, the camera at the origin",
        "clip": clip.name,
        "fps": clip.fps,
        "image_size": [clip.camera.width, clip.camera.height],
        "joint_names": list(JOINTS),
        "scene": scene,
        "probability": None if shown is None else shown.probability,
        "probability_error": None if shown is None else _known(shown.error),
        **_scene_content(posterior.estimate if shown is None else shown.scene, clip),
    }
    if samples:
        rng, problem = np.random.default_rng(posterior.config.seed), posterior.solution.problem
        document["samples"] = [
            _scene_content(
                replace(
                    draw,
                    objects=posterior.furniture[n],
                    joints=drawn_motion(
                        rng, problem, posterior.samples.states[n], draw.camera, fps=clip.fps
                    ),
                ),
                clip,
            )
            for n in evenly_spaced(posterior, samples)
            for draw in [posterior.draw(n)]
        ]
    return document


def evenly_spaced(posterior: Posterior, count: int) -> list[int]:
    """Indices of ``count`` draws, evenly spaced over all chains.

    Parameters
    ----------
    posterior : Posterior
    count : int

    Returns
    -------
    list of int

    Raises
    ------
    InputError
        There are not as many draws.
    """
    total = posterior.samples.log_posterior.size
    if not 1 <= count <= total:
        raise InputError(f"{count} samples: the run has {total} draws; ask for 1 to {total}")
    numbers: list[int] = np.floor((np.arange(count) + 0.5) * total / count).astype(int).tolist()
    return numbers


def _scene_content(scene: Scene, clip: Clip) -> dict[str, Any]:
    """Objects, joints and camera of a scene; for several people, joints by name."""
    camera = scene.camera
    people = {
        track.name: {
            str(frame): _listed(pose)
            for frame, pose in zip(clip.frame_ids.tolist(), joints, strict=True)
        }
        for track, joints in zip(
            clip.tracks, by_person(clip, to_benchmark(camera, scene.joints)), strict=True
        )
    }
    up = to_benchmark(camera, camera.centre + np.array([0.0, 0.0, 1.0]))
    return {
        "log_prob": _known(scene.log_posterior),
        "camera_matrix": _listed(intrinsics(camera)),
        "floor": {"up": _listed(up), "camera_height": round(camera.elevation, _DECIMALS)},
        "objects": [_object(scene, o) for o in scene.objects],
        "joints3d": people[clip.tracks[0].name],
        **({"actors": people} if len(people) > 1 else {}),
    }


def _object(scene: Scene, o: SceneObject) -> dict[str, Any]:
    camera, place = scene.camera, o.placement.apply
    low, high = o.bounds
    width, depth, height = (high - low).tolist()
    return {
        "label": o.label,
        "center": _listed(to_benchmark(camera, o.centre)),
        "size": _listed([width, height, depth]),
        "yaw": round(yaw_in_camera(camera, o), _DECIMALS),
        "axes": _listed(_object_axes(camera, o)),
        "parts": [
            {
                "part": c.part,
                "center": _listed(to_benchmark(camera, place(c.centre))),
                "size": _listed(c.size[[0, 2, 1]]),
            }
            for c in o.cuboids
        ],
    }


def _listed(values: ArrayLike) -> Any:
    return np.round(np.asarray(values, float), _DECIMALS).tolist()


def _known(value: float) -> float | None:
    """The value, or None for NaN, which JSON does not have."""
    return float(value) if np.isfinite(value) else None


# ------------------------------------------------------------------------------------------------
# A scene in the files of the benchmark (Monszpart et al. 2019), in its authors' format::
#
#     OUT/skel_output.json             joints by frame, hidden joints, and the list of parts
#     OUT/skel_output_2.json           the same for a second person, and so on
#     OUT/skel_output_objects/*.json   one box per part: centroid, axes in columns, full side
# lengths
#
# Axes are those of the camera (x right, y down, z forward). As in the benchmark's annotations, the
# second axis of a part points to the back of its object, and the third one up.

_STEM: Final = "skel_output"


def write_i3db(folder: Path, scene: Scene, clip: Clip) -> None:
    """Write a scene as files of the benchmark into a new or empty folder.

    Parameters
    ----------
    folder : Path
    scene : Scene
    clip : Clip

    Raises
    ------
    InputError
        The folder is not empty.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: exists already; name a new or an empty folder")
    parts = _parts(scene)
    boxes = pack_boxes(scene.objects)
    hidden = sight_clearance(scene.camera.centre, scene.joints, boxes) < 0
    joints = to_benchmark(scene.camera, scene.joints)
    obbs = [f"{_STEM}_objects/{name}.obj" for name in parts]
    documents = {
        _STEM if number == 1 else f"{_STEM}_{number}": _skeleton(clip, motion, behind, obbs)
        for number, (motion, behind) in enumerate(
            zip(by_person(clip, joints), by_person(clip, hidden), strict=True), 1
        )
    }
    with folder_held(folder), folder_published(folder, names=()) as beside:
        objects = beside / f"{_STEM}_objects"
        objects.mkdir()
        for name, document in documents.items():
            (beside / f"{name}.json").write_text(json.dumps(document), encoding="utf-8")
        for name, part in parts.items():
            (objects / f"{name}.json").write_text(json.dumps(part), encoding="utf-8")


def _skeleton(
    clip: Clip, joints: NDArray[np.float64], hidden: NDArray[np.bool_], obbs: list[str]
) -> dict[str, Any]:
    """Content of one person's file: joints (T, 16, 3) in camera axes, and which are hidden."""
    ids = clip.frame_ids.tolist()
    return {
        "3d": {
            f"{frame:05d}": {str(j): point.tolist() for j, point in enumerate(pose)}
            for frame, pose in zip(ids, joints, strict=True)
        },
        "frame_ids": ids,
        "occluded": {
            str(frame): flags.astype(int).tolist() for frame, flags in zip(ids, hidden, strict=True)
        },
        "scenelets": {"obbs": obbs, "transforms": {}},
    }


def _parts(scene: Scene) -> dict[str, dict[str, Any]]:
    """Content of each part's file by its name, such as ``00_couch_arm-1``."""
    parts = {}
    for number, o in enumerate(scene.objects):
        width, front, up = _object_axes(scene.camera, o)
        axes = np.stack([-width, -front, up], 1)  # right-handed
        names = [_letters(c.part) or "part" for c in o.cuboids]
        met: Counter[str] = Counter()
        for name, cuboid in zip(names, o.cuboids, strict=True):
            twice = f"-{met[name]}" if names.count(name) > 1 else ""
            met[name] += 1
            centre = to_benchmark(scene.camera, o.placement.apply(cuboid.centre))
            parts[f"{number:02d}_{_letters(o.label) or 'object'}_{name}{twice}"] = {
                "axes": axes.tolist(),
                "centroid": centre[:, None].tolist(),
                "scales": cuboid.size[:, None].tolist(),
                "part_id": sum(met.values()) - 1,
            }
    return parts


def _letters(word: str) -> str:
    """A word in the form that file names of the benchmark have."""
    return re.sub("[^a-z]", "", word.lower())
