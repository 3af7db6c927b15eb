"""Results of any method in a file, so that the same code scores them all.

JSON, in the axes of the camera: x right, y forward along the optical axis, z up in the image,
metres from the optical centre::

    {"format": "imapper-prob prediction", "version": 1,
     "method": "what heads its row", "clip": "Scene04",
     "joints": {"names": ["PELV", "RHIP", ...],
                "frames": {"2": [[x, y, z], null, ...], ...}},
     "objects": [{"label": "chair", "points": [[x, y, z], ...],
                  "sideways": [x, y, z], "has_front": true}]}

Frames are those of the clip; frames between two are filled in on straight lines. Joints may be
any of the sixteen, in any order, and null where the method says nothing. ``points`` are the
corners of all boxes of an object, ``sideways`` points to the right of its front. ``pixels``
beside ``joints``, of the same form with pairs, is for methods with a camera of their own;
without it the clip's camera projects the joints. ``joints`` may be missing, and so may
``objects``: methods that only do one of the two have no scores for the other.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.evaluate.outline import Outline
from imapper_prob.evaluate.prediction import Prediction, between_frames
from imapper_prob.files import written_whole
from imapper_prob.inputs.json_fields import field, frame_number, load_json, numbers
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip
from imapper_prob.models.skeleton import JOINTS, N_JOINTS

__all__ = ["FORMAT", "VERSION", "read_prediction", "write_prediction"]

Array = NDArray[np.float64]

FORMAT: Final = "imapper-prob prediction"
VERSION: Final = 1


def read_prediction(path: str | Path, clip: Clip) -> Prediction:
    """A result of any method on a clip.

    Raises
    ------
    InputError
        The file is missing, damaged, of another clip, or holds something that is not said above.
    """
    path = Path(path)
    data = load_json(path)
    if not isinstance(data, Mapping) or data.get("format") != FORMAT:
        raise InputError(f"{path}: is no prediction; expected format {FORMAT!r}")
    if data.get("version") != VERSION:
        raise InputError(
            f"{path}: has version {data.get('version')!r}, this program reads {VERSION}"
        )
    if data.get("clip") != clip.name:
        raise InputError(f"{path}: is of the clip {data.get('clip')!r}, not of {clip.name}")
    joints = between_frames(_table(path, data, "joints", clip, 3))
    pixels = clip.camera.project_camera(joints)
    if "pixels" in data:
        pixels = _table(path, data, "pixels", clip, 2)
    listed = data.get("objects", [])
    if not isinstance(listed, list):
        raise InputError(f"{path}: 'objects' must be a list")
    objects = tuple(_object(path, k, entry) for k, entry in enumerate(listed, 1))
    return Prediction(str(field(path, data, "method")), joints, pixels, objects)


def write_prediction(path: str | Path, prediction: Prediction, clip: Clip) -> None:
    """Write what :func:`read_prediction` reads; a file in the way is replaced."""
    document = {
        "format": FORMAT,
        "version": VERSION,
        "method": prediction.name,
        "clip": clip.name,
        "joints": _frames(prediction.joints, clip),
        "pixels": _frames(prediction.pixels, clip),
        "objects": [_from_outline(o) for o in prediction.objects],
    }
    with written_whole(Path(path)) as beside:
        beside.write_text(json.dumps(document) + "\n", encoding="utf-8")


def _table(path: Path, data: Any, key: str, clip: Clip, size: int) -> Array:
    """(T, 16, size) by the clip's frames and our order of joints."""
    table = np.full((clip.n_frames, N_JOINTS, size), np.nan)
    if key not in data:
        return table
    names = field(path, data, key, "names")
    unknown = [n for n in names if n not in JOINTS] if isinstance(names, list) else [names]
    if unknown or len(set(names)) != len(names):
        raise InputError(
            f"{path}: {key}.names has {unknown[0]!r}; joints are {', '.join(JOINTS)}"
            if unknown
            else f"{path}: {key}.names has a joint twice"
        )
    where = [JOINTS.index(n) for n in names]
    frames = field(path, data, key, "frames")
    if not isinstance(frames, Mapping):
        raise InputError(f"{path}: {key}.frames must map frame numbers to joints")
    for number, values in frames.items():
        frame = frame_number(path, number)
        if frame not in clip.frame_ids:
            raise InputError(
                f"{path}: frame {frame} is not of {clip.name}, whose frames are "
                f"{clip.frame_ids[0]} to {clip.frame_ids[-1]}"
            )
        if not isinstance(values, list) or len(values) != len(names):
            raise InputError(f"{path}, frame {frame}: expected {len(names)} {key}")
        for joint, value in zip(where, values, strict=True):
            if value is not None:
                place = f"{path}, frame {frame}, joint {JOINTS[joint]}"
                row = numbers(value, shape=(size,), place=place)
                table[frame - clip.frame_ids[0], joint] = row
    return table


def _object(path: Path, count: int, entry: Any) -> Outline:
    if not isinstance(entry, Mapping) or not {"label", "points", "sideways"} <= set(entry):
        raise InputError(f"{path}: object {count} must have label, points and sideways")
    place = f"{path}: {entry['label']} {count}"
    points = entry["points"]
    length = len(points) if isinstance(points, list) else 0
    if length < 3:
        raise InputError(f"{place}: needs three points or more")
    return Outline.of_corners(
        str(entry["label"]),
        numbers(points, shape=(length, 3), place=f"{place}, points"),
        numbers(entry["sideways"], shape=(3,), place=f"{place}, sideways"),
        has_front=bool(entry.get("has_front", False)),
    )


def _frames(values: Array, clip: Clip) -> dict[str, Any]:
    return {
        "names": list(JOINTS),
        "frames": {
            str(frame): [None if np.isnan(v).any() else v.tolist() for v in row]
            for frame, row in zip(clip.frame_ids.tolist(), values, strict=True)
            if not np.isnan(row).all()
        },
    }


def _from_outline(item: Outline) -> dict[str, Any]:
    return {
        "label": item.label,
        "points": item.corners.tolist(),
        "sideways": [float(np.cos(item.yaw)), float(np.sin(item.yaw)), 0.0],
        "has_front": item.has_front,
    }
