"""A scene in the benchmark's own files (Monszpart et al. 2019), as its authors write theirs::

    OUT/skel_output.json             joints by frame, hidden joints, and the list of parts
    OUT/skel_output_2.json           the same of a second person, and so on
    OUT/skel_output_objects/*.json   one box a part: centroid, axes in columns, full side lengths

Axes are those of the camera (x right, y down, z forward). As in the benchmark's annotations the
second axis of a part points to the back of its object and the third up.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.files import folder_held, folder_published
from imapper_prob.models.errors import InputError
from imapper_prob.models.geometry import pack_boxes, sight_clearance
from imapper_prob.models.scene import Clip, Scene
from imapper_prob.people import by_person
from imapper_prob.results.benchmark_axes import object_axes, to_benchmark

__all__ = ["write_i3db"]

_STEM: Final = "skel_output"


def write_i3db(folder: Path, scene: Scene, clip: Clip) -> None:
    """Write a scene as the benchmark's files into a new or empty folder.

    Raises
    ------
    InputError
        If something is in the folder already.
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
    """One person's file: joints (T, 16, 3) in the camera's axes, and which of them are hidden."""
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
    """Content of each part's file by its name, ``00_couch_arm-1``."""
    parts = {}
    for number, o in enumerate(scene.objects):
        width, front, up = object_axes(scene.camera, o)
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
    """A word as the benchmark's file names have them."""
    return re.sub("[^a-z]", "", word.lower())
