"""Predictions: the motion and furniture that a method states for a clip, in camera axes.

They are made from draws and solutions, or read from files of other methods and from folders of
``imapper-prob solve``. The same code scores them all.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.clips.assemble import FARTHEST
from imapper_prob.clips.parsing import field, frame_number, load_archive, load_json, numbers
from imapper_prob.evaluate.truth import Outline, outline_of
from imapper_prob.files import written_whole
from imapper_prob.models.camera import Camera
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip, Scene
from imapper_prob.models.skeleton import JOINTS, N_JOINTS
from imapper_prob.results.scenes_file import object_from_json
from imapper_prob.results.solution import SOLUTION_FORMAT, SOLUTION_VERSION
from imapper_prob.solver.actors import Solved

__all__ = [
    "PREDICTION_FORMAT",
    "SOLVER",
    "Prediction",
    "between_frames",
    "is_solution",
    "of_people",
    "prediction_of_scene",
    "prediction_of_solved",
    "read_prediction",
    "read_solution_folder",
    "write_prediction",
]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Prediction:
    """Motion and furniture stated by a method.

    Parameters
    ----------
    name : str
        Name of the method, the heading of its table row.
    joints : (R, 16, 3) float
        Camera axes (x right, y forward, z up), metres; NaN for joints and frames without a
        prediction. All frames of the first person, then of the next.
    pixels : (R, 16, 2) float
        Their projections by the prediction's own camera.
    objects : tuple of Outline
    people : int
        How many the rows are of.
    """

    name: str
    joints: Array
    pixels: Array
    objects: tuple[Outline, ...]
    people: int = 1


def of_people(prediction: Prediction, people: int, *, frames: int, clip: str) -> Prediction:
    """The prediction for the first people of a clip.

    Parameters
    ----------
    prediction : Prediction
    people : int
        How many.
    frames : int
        Of the clip.
    clip : str
        Its name.

    Returns
    -------
    Prediction
        Rows of other people are left out; rows without a prediction are NaN.

    Raises
    ------
    InputError
        The rows are not the frames of the clip for each person.
    """
    if prediction.people < 1:
        raise InputError(f"{prediction.name}: a prediction is of one person at least")
    for what, values in (("joints", prediction.joints), ("pixels", prediction.pixels)):
        if len(values) != prediction.people * frames:
            whom = "one person" if prediction.people == 1 else f"{prediction.people} people"
            raise InputError(
                f"{prediction.name}: has {len(values)} rows of {what} of {whom}, but {clip} has "
                f"{frames} frames; give each person a row for every frame of the clip"
            )
    rows = people * frames

    def own(values: Array) -> Array:
        missing = np.full((max(0, rows - len(values)), *values.shape[1:]), np.nan)
        return np.concatenate([values[:rows], missing])

    return replace(
        prediction, joints=own(prediction.joints), pixels=own(prediction.pixels), people=people
    )


def between_frames(joints: ArrayLike) -> Array:
    """Interpolate joints linearly between the frames that have them.

    Parameters
    ----------
    joints : (T, J, 3) or (T, J, 2) float
        In space or in the picture; NaN where missing; each joint is treated separately.

    Returns
    -------
    (T, J, 3) or (T, J, 2) float
        Still NaN before the first and after the last frame of a joint.
    """
    filled = np.array(joints, dtype=np.float64)
    frames = np.arange(len(filled))
    for joint in range(filled.shape[1]):
        there = np.isfinite(filled[:, joint]).all(-1)
        if not there.any():
            continue
        first, last = frames[there][[0, -1]]
        gap = frames[first : last + 1]
        for axis in range(filled.shape[2]):
            filled[gap, joint, axis] = np.interp(gap, frames[there], filled[there, joint, axis])
    return filled


def prediction_of_scene(scene: Scene, *, name: str, people: int = 1) -> Prediction:
    """A scene in the axes of its own camera, whose tilt may differ from the true one.

    Parameters
    ----------
    scene : Scene
    name : str
        Name of the method.
    people : int
        Number of people in its motion.

    Returns
    -------
    Prediction
    """
    return Prediction(
        name=name,
        joints=scene.camera.to_camera(scene.joints),
        pixels=scene.camera.project(scene.joints),
        objects=tuple(outline_of(o, scene.camera) for o in scene.objects),
        people=people,
    )


def prediction_of_solved(solved: Solved, *, name: str) -> Prediction:
    """The staged solver's best scene: furniture and motion of all people.

    Parameters
    ----------
    solved : Solved
    name : str
        Name of the method.

    Returns
    -------
    Prediction
    """
    best = solved.scenes[0]
    joints = np.concatenate(best.motions)
    scene = Scene(best.camera, best.objects, joints, (), best.log_posterior)
    return prediction_of_scene(scene, name=name, people=len(best.motions))


# ------------------------------------------------------------------------------------------------
# File format: JSON, x right, y forward along the optical axis, z up in the image, metres from the
# optical centre::
#
#     {"format": "imapper-prob prediction", "version": 1,
#      "method": "what heads its row", "clip": "Scene04",
#      "joints": {"names": ["PELV", "RHIP", ...],
#                 "frames": {"2": [[x, y, z], null, ...], ...}},
#      "objects": [{"label": "chair", "points": [[x, y, z], ...],
#                   "sideways": [x, y, z], "has_front": true}]}
#
# Frames are those of the clip; gaps between frames are interpolated linearly. Joints may be any of
# the sixteen, in any order, and null where the method predicts none. ``points`` are the corners of
# all boxes of an object; ``sideways`` points to the right of its front. ``pixels`` beside
# ``joints``, of the same form with pairs, is for methods with a camera of their own; without it the
# clip's camera projects the joints. ``joints`` and ``objects`` may each be missing; such methods
# have no scores for what is missing. If there are several people, the file has the first.

PREDICTION_FORMAT: Final = "imapper-prob prediction"
_PREDICTION_VERSION: Final = 1
"""Version of the file's format."""


def read_prediction(path: str | Path, clip: Clip) -> Prediction:
    """Read a prediction file of any method for a clip.

    Parameters
    ----------
    path : path
    clip : Clip

    Returns
    -------
    Prediction

    Raises
    ------
    InputError
        The file is missing, damaged, of another clip, or does not follow the format above.
    """
    path = Path(path)
    data = load_json(path)
    if not isinstance(data, Mapping) or data.get("format") != PREDICTION_FORMAT:
        raise InputError(f"{path}: is no prediction; expected format {PREDICTION_FORMAT!r}")
    if data.get("version") != _PREDICTION_VERSION:
        raise InputError(
            f"{path}: has version {data.get('version')!r}, this program reads {_PREDICTION_VERSION}"
        )
    if data.get("clip") != clip.name:
        raise InputError(f"{path}: is of the clip {data.get('clip')!r}, not of {clip.name}")
    joints = between_frames(_table(path, data, "joints", clip, 3))
    pixels = clip.camera.project_camera(joints)
    if "pixels" in data:
        pixels = between_frames(_table(path, data, "pixels", clip, 2))
    listed = data.get("objects", [])
    if not isinstance(listed, list):
        raise InputError(f"{path}: 'objects' must be a list")
    objects = tuple(_read_outline(path, k, entry) for k, entry in enumerate(listed, 1))
    return Prediction(str(field(path, data, "method")), joints, pixels, objects)


def write_prediction(path: str | Path, prediction: Prediction, clip: Clip) -> None:
    """Write a file that :func:`read_prediction` reads; an existing file is replaced.

    Of several people, only the motion of the first is written.

    Parameters
    ----------
    path : path
    prediction : Prediction
    clip : Clip
    """
    document = {
        "format": PREDICTION_FORMAT,
        "version": _PREDICTION_VERSION,
        "method": prediction.name,
        "clip": clip.name,
        "joints": _frames(prediction.joints, clip),
        "pixels": _frames(prediction.pixels, clip),
        "objects": [_from_outline(o) for o in prediction.objects],
    }
    with written_whole(Path(path)) as beside:
        beside.write_text(json.dumps(document) + "\n", encoding="utf-8")


def _table(path: Path, data: Any, key: str, clip: Clip, size: int) -> Array:
    """(T, 16, size) values by the clip's frames and this program's order of joints."""
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


def _read_outline(path: Path, count: int, entry: Any) -> Outline:
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
            for frame, row in zip(clip.frame_ids.tolist(), values[: clip.n_frames], strict=True)
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


# ------------------------------------------------------------------------------------------------
# Folders of staged solutions.

SOLVER = "staged solver"
"""Row heading of the deterministic solution."""


def is_solution(folder: Path) -> bool:
    """Whether a folder holds a solution of the staged solver.

    Parameters
    ----------
    folder : Path

    Returns
    -------
    bool
    """
    return (folder / "solution.json").is_file()


def read_solution_folder(folder: Path, clip: Clip) -> Prediction:
    """Read the best scene of the staged solver.

    Parameters
    ----------
    folder : Path
    clip : Clip

    Returns
    -------
    Prediction

    Raises
    ------
    InputError
        The files are damaged, or belong to another clip.
    """
    path = folder / "solution.json"
    data = load_json(path)
    if (
        not isinstance(data, Mapping)
        or data.get("format") != SOLUTION_FORMAT
        or data.get("version") != SOLUTION_VERSION
    ):
        raise InputError(f"{path}: is no solution of this version; solve the clip again")
    if data.get("clip") != clip.name:
        raise InputError(f"{path}: is of the clip {data.get('clip')!r}, not of {clip.name}")
    scenes = field(path, data, "scenes")
    try:
        arrays = load_archive(folder / "solution.npz", what="solution")
        people = [name for name in arrays if name.startswith("actor") and name.endswith("/joints")]
        joints = np.concatenate([arrays[f"actor{k}/joints"][0] for k in range(len(people))])
        if np.isinf(joints).any() or (np.abs(joints) > FARTHEST).any():
            raise ValueError("joints are no metres")
        best = scenes[0]
        objects = tuple(object_from_json(o) for o in best["objects"])
        scene = Scene(Camera(**best["camera"]), objects, joints, (), float(best["log_posterior"]))
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise InputError(f"{folder}: damaged solution ({error}); solve the clip again") from error
    return prediction_of_scene(scene, name=SOLVER, people=len(people))
