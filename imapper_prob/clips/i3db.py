"""Clips of the i3DB benchmark (Monszpart et al. 2019), read from its files on disk.

A scene is a folder with ``intrinsics.json``, ``skel_<name>_2d_00.json`` (detections),
``skel_<name>_unannot.json`` (lifted poses) and, for evaluation only, ``gt/``.  The files
have x right, y down, z forward; their frame numbers are the keys of ``3d`` (the
``frame_ids`` lists follow three other conventions).  :func:`read_i3db` never opens ``gt/``,
so that inference on these scenes is blind.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.clips.assemble import HEAT_GAIN, HEAT_OFFSET
from imapper_prob.clips.furniture import MeasuredBox, upright_object
from imapper_prob.clips.options import NOMINAL_ELEVATION, check_matrix
from imapper_prob.clips.parsing import (
    field,
    frame_number,
    frames_of_joints,
    load_json,
    numbers,
)
from imapper_prob.files import read_text
from imapper_prob.models.camera import Camera
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip, SceneObject, Track, Truth
from imapper_prob.models.settings import LONGEST_CLIP
from imapper_prob.models.skeleton import (
    DETECTED,
    HEAD,
    JOINTS,
    LHIP,
    N_JOINTS,
    NECK,
    PELV,
    RHIP,
    THRX,
)

__all__ = [
    "ACTIONS", "DETECTIONS", "AnnotatedBox", "action_words", "boxes_by_object", "camera_axes",
    "read_i3db", "read_i3db_boxes", "read_i3db_truth",
]  # fmt: skip

Array = NDArray[np.float64]

DETECTIONS: Final = "skel_*_2d_00.json"
"""Pattern of the file that identifies a folder of this format."""

ACTIONS: Final = "actions.txt"
"""File in ``gt/`` that names the action in each frame."""

_IMAGE_SIZE: Final = (1920, 1080)
"""Width and height in pixels of every i3DB video; no file states them."""
_DETECTION_LINES: Final = 368
"""Height in pixels of the reduced image (654 x 368) that the 2D detector processed."""
_FRAME_RATE: Final = 10.0
"""Frames a second if ``video_params.json`` does not say."""
_NOMINAL_PITCH: Final = np.deg2rad(-4.0)
"""Mean pitch of the benchmark's cameras in radians; the files' ``ground_rot`` is 0 and wrong."""
_LEAST_HEAT: Final = -700.0
"""Least exponent of a logistic function that a double holds."""
_RAW_CONFIDENCE_LIMIT: Final = 0.05
"""Largest confidence below which a file holds raw heat values; its own flag is unreliable."""


def read_i3db(folder: str | Path) -> Clip:
    """Read the detections and lifted poses of one scene.

    Parameters
    ----------
    folder : path
        Scene folder such as ``Scene04``.

    Returns
    -------
    Clip
        Frames from the first to the last detection. Frames without a detection have NaN keypoints
        and confidence 0; frames without a lifted pose have NaN poses.

    Raises
    ------
    InputError
        A file is missing, damaged, or does not follow the format.
    """
    folder = Path(folder)
    detections_path = _only(folder, DETECTIONS)
    stem = detections_path.name.removesuffix("_2d_00.json")
    detections = load_json(detections_path)
    pixels = frames_of_joints(detections_path, detections)
    first, last = min(pixels), max(pixels)
    if last - first >= LONGEST_CLIP:
        raise InputError(
            f"{detections_path}: frames run from {first} to {last}, more than the "
            f"{LONGEST_CLIP} of an hour; check the frame numbers"
        )
    frame_ids = np.arange(first, last + 1)
    keypoints = np.full((len(frame_ids), N_JOINTS, 2), np.nan)
    for frame, joints in pixels.items():
        keypoints[frame - first] = joints[:, :2] * (_IMAGE_SIZE[1] / _DETECTION_LINES)
    keypoints[:, PELV] = (keypoints[:, RHIP] + keypoints[:, LHIP]) / 2
    keypoints[:, NECK] = (keypoints[:, THRX] + keypoints[:, HEAD]) / 2

    confidences = np.zeros((len(frame_ids), N_JOINTS))
    for frame, values in _confidences(detections_path, detections, list(pixels)).items():
        confidences[frame - first] = values

    poses_path = folder / f"{stem}_unannot.json"
    lifted = load_json(poses_path)
    poses = np.full((len(frame_ids), N_JOINTS, 3), np.nan)
    for frame, joints in frames_of_joints(poses_path, lifted).items():
        if first <= frame <= last:
            poses[frame - first] = camera_axes(joints - joints[PELV])
    filled_in = lifted.get("frame_ids_filled_in") or []
    if not isinstance(filled_in, list):
        raise InputError(f"{poses_path}: 'frame_ids_filled_in' must be a list of frame numbers")
    filled = [frame_number(poses_path, f) for f in filled_in]

    track = Track(
        name=stem.removeprefix("skel_"),
        keypoints=keypoints,
        confidences=confidences,
        poses=poses,
        interpolated=np.isin(frame_ids, filled),
    )
    return Clip(
        name=folder.resolve().name,
        camera=_camera(folder / "intrinsics.json"),
        fps=_frame_rate(folder / "video_params.json"),
        frame_ids=frame_ids,
        tracks=(track,),
    )


def read_i3db_truth(folder: str | Path, clip: Clip) -> Truth:
    """Read the ground truth of a scene, for evaluation and never for inference.

    Parameters
    ----------
    folder : path
        The scene's folder; the files are in its ``gt/``.
    clip : Clip
        Result of :func:`read_i3db` for the same folder.

    Returns
    -------
    Truth
        In a world frame of its own. Pitch and roll of the camera are those that make the annotated
        furniture stand upright, and its elevation puts the median piece on the floor. Joints are
        NaN and ``hidden`` is false on odd frames, which are not annotated. Frames without an action
        have an empty word.

    Raises
    ------
    InputError
        The files are missing, damaged or contradict the clip.
    """
    truth_folder = Path(folder) / "gt"
    path = _only(truth_folder, "skel_*_GT.json")
    data = load_json(path)
    objects = boxes_by_object(read_i3db_boxes(path, data))
    if not objects:
        raise InputError(f"{path}: 'scenelets.obbs' lists no objects")
    camera = _upright_camera(clip.camera, objects)
    joints = np.full((clip.n_frames, N_JOINTS, 3), np.nan)
    hidden = np.zeros((clip.n_frames, N_JOINTS), bool)
    occluded = field(path, data, "occluded")
    if not isinstance(occluded, Mapping):
        raise InputError(f"{path}: 'occluded' must map frame numbers to flags")
    flags = {frame_number(path, key): values for key, values in occluded.items()}
    first = int(clip.frame_ids[0])
    for frame, positions in frames_of_joints(path, data).items():
        if frame % 2 == 0 and frame in clip.frame_ids:
            joints[frame - first] = camera.to_world(camera_axes(positions))
            place = f"{path}, frame {frame}, occlusion flags"
            hidden[frame - first] = numbers(flags.get(frame), shape=(N_JOINTS,), place=place) > 0
    return Truth(
        camera=camera,
        objects=tuple(_object(parts, camera) for parts in objects),
        joints=joints,
        hidden=hidden,
        # The remark in brackets is not part of the action.
        actions=tuple(
            word.partition("(")[0].strip()
            for word in action_words(truth_folder / ACTIONS, clip.n_frames)
        ),
    )


@dataclass(frozen=True)
class AnnotatedBox:
    """One box of an object, in the axes of the camera.

    Parameters
    ----------
    object_id : str
        Number of the object in the file.
    label, part : str
        Category of the object, and which part of it the box is.
    centre : (3,) float
        Metres.
    axes : (3, 3) float
        Unit axes of the box, in columns.
    size : (3,) float
        Full side lengths along these axes, metres.
    """

    object_id: str
    label: str
    part: str
    centre: Array
    axes: Array
    size: Array


def camera_axes(points: ArrayLike) -> Array:
    """Convert points from the axes of the files to those of a camera.

    Parameters
    ----------
    points : (..., 3) array_like
        x right, y down, z forward.

    Returns
    -------
    (..., 3) float
        x right, y forward, z up.
    """
    x, y, z = np.moveaxis(np.asarray(points, float), -1, 0)
    return np.stack([x, z, -y], -1)


def _only(folder: Path, pattern: str) -> Path:
    """The only file in ``folder`` that matches ``pattern``."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder")
    found = sorted(folder.glob(pattern))
    if not found:
        raise InputError(f"{folder}: no file {pattern}; is this an i3DB scene?")
    if len(found) > 1:
        names = ", ".join(p.name for p in found)
        raise InputError(f"{folder}: more than one file {pattern} ({names}); keep one")
    return found[0]


def _camera(path: Path) -> Camera:
    matrix = numbers(load_json(path), shape=(3, 3), place=f"{path}: intrinsic matrix")
    width, height = _IMAGE_SIZE
    try:
        check_matrix(matrix)
        return Camera(
            width=width,
            height=height,
            fx=float(matrix[0, 0]),
            fy=float(matrix[1, 1]),
            cx=float(matrix[0, 2]),
            cy=float(matrix[1, 2]),
            pitch=float(_NOMINAL_PITCH),
            elevation=NOMINAL_ELEVATION,
        )
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _frame_rate(path: Path) -> float:
    if not path.exists():
        return _FRAME_RATE
    value = field(path, load_json(path), "rate-avconv")
    rate = float(numbers(value, shape=(), place=f"{path}: rate-avconv"))
    if rate <= 0:
        raise InputError(f"{path}: frame rate {rate} must be positive")
    return rate


def _confidences(path: Path, data: Any, frames: list[int]) -> dict[int, Array]:
    """(16,) confidences in [0, 1] by frame; 0 for PELV and NECK, which are not detected."""
    values = field(path, data, "confidence", "values")
    if not isinstance(values, list) or len(values) != len(frames):
        count = len(values) if isinstance(values, list) else "no list of"
        raise InputError(f"{path}: {count} confidences for {len(frames)} frames of joints")
    listed = data["confidence"].get("frame_ids")
    if isinstance(listed, list) and all(isinstance(f, int) for f in listed):
        frames = listed if sorted(listed) == frames else frames
    table = np.zeros((len(frames), N_JOINTS))
    for row, frame, entry in zip(table, frames, values, strict=True):
        for joint in DETECTED:
            place = f"{path}, frame {frame}, joint {JOINTS[joint]}, confidence"
            value = entry.get(str(joint)) if isinstance(entry, Mapping) else None
            row[joint] = numbers(value, shape=(), place=place)
    if table.max() <= _RAW_CONFIDENCE_LIMIT:
        heat = HEAT_GAIN * table + HEAT_OFFSET
        mapped = 1 / (1 + np.exp(-np.maximum(heat, _LEAST_HEAT)))
        mapped[table < 0] = 0
        mapped[:, [j for j in range(N_JOINTS) if j not in DETECTED]] = 0
        table = mapped
    outside = (table < 0) | (table > 1)
    if outside.any():
        t, j = np.argwhere(outside)[0]
        raise InputError(
            f"{path}, frame {frames[t]}, joint {JOINTS[j]}: confidence {table[t, j]} "
            "is not in [0, 1]"
        )
    return dict(zip(frames, table, strict=True))


def read_i3db_boxes(path: Path, data: Any) -> list[AnnotatedBox]:
    """Read the boxes listed in ``scenelets.obbs`` of a skeleton file; unlisted files are ignored.

    Parameters
    ----------
    path : Path
        The skeleton file; the listed files are in its folder or below.
    data : Any
        Its parsed content.

    Returns
    -------
    list of AnnotatedBox
        In the order of the list; empty if nothing is listed.

    Raises
    ------
    InputError
        A file is missing, damaged, or does not follow the format.
    """
    listed = field(path, data, "scenelets", "obbs")
    if not isinstance(listed, list):
        raise InputError(f"{path}: 'scenelets.obbs' must list files")
    boxes = []
    for name in listed:
        below = Path(str(name))
        match = re.fullmatch(r"(\d+)_([a-z]+)_([a-z]+)(-\d+)?", below.stem)
        if match is None or below.is_absolute() or ".." in below.parts:
            raise InputError(
                f"{path}: object {name!r} is not named <id>_<category>_<part>[-<number>]"
            )
        file = (path.parent / below).with_suffix(".json")
        box = load_json(file)
        centre = numbers(field(file, box, "centroid"), shape=(3, 1), place=f"{file}: centroid")
        axes = numbers(field(file, box, "axes"), shape=(3, 3), place=f"{file}: axes")
        size = numbers(field(file, box, "scales"), shape=(3, 1), place=f"{file}: scales")
        if not np.allclose(np.linalg.norm(axes, axis=0), 1, atol=1e-3):
            raise InputError(f"{file}: axes must be unit vectors, in columns")
        if (size <= 0).any():
            raise InputError(f"{file}: scales must be positive")
        boxes.append(
            AnnotatedBox(
                object_id=match[1],
                label=match[2],
                part=match[3],
                centre=camera_axes(centre[:, 0]),
                axes=camera_axes(axes.T).T,
                size=size[:, 0],
            )
        )
    return boxes


def boxes_by_object(boxes: Iterable[AnnotatedBox]) -> list[list[AnnotatedBox]]:
    """Group boxes by the number of their object.

    Parameters
    ----------
    boxes : iterable of AnnotatedBox

    Returns
    -------
    list of list of AnnotatedBox
        Objects in the order of their first boxes.
    """
    objects: dict[str, list[AnnotatedBox]] = defaultdict(list)
    for box in boxes:
        objects[box.object_id].append(box)
    return list(objects.values())


def _upright_camera(camera: Camera, objects: list[list[AnnotatedBox]]) -> Camera:
    """The camera in the world frame in which the furniture stands upright on the floor.

    Medians are used because some backrests lean and some legs are annotated through the floor.
    """
    upward = np.median([part.axes[:, 2] for parts in objects for part in parts], axis=0)
    right, forward, up = upward / np.linalg.norm(upward)
    level = replace(
        camera,
        pitch=float(np.arcsin(forward)),
        roll=float(np.arctan2(right, up)),
        elevation=0.0,
    )
    bottoms = [min(level.to_world(p.centre)[2] - p.size[2] / 2 for p in parts) for parts in objects]
    return replace(level, elevation=-float(np.median(bottoms)))


def _object(parts: list[AnnotatedBox], camera: Camera) -> SceneObject:
    """One object from its annotated parts, as upright boxes.

    The part with the largest footprint (seat, table top, board) gives the front: its second axis
    points to the backrest or the wall.
    """
    boxes = []
    for part in parts:
        sideways = camera.rotation @ part.axes[:, 0]
        boxes.append(
            MeasuredBox(
                part=part.part,
                centre=camera.to_world(part.centre),
                size=part.size,
                yaw=float(np.arctan2(sideways[1], sideways[0])),
            )
        )
    widest = max(range(len(parts)), key=lambda i: boxes[i].footprint_area)
    back = camera.rotation @ parts[widest].axes[:, 1]
    return upright_object(parts[widest].label, boxes, float(np.arctan2(back[0], -back[1])))


def action_words(path: Path, n_frames: int) -> tuple[str, ...]:
    """The annotated action of each frame, such as ``"standing(from sitting)"``.

    The file numbers frames from its own first number; it may be missing.

    Parameters
    ----------
    path : Path
        Path of the file of actions.
    n_frames : int

    Returns
    -------
    tuple of str
        One word a frame, or empty if there is no file.

    Raises
    ------
    InputError
        The file is damaged.
    """
    if not path.exists():
        return ()
    words: dict[int, str] = {}
    for line in read_text(path).splitlines():
        if line.strip():
            number, _, word = line.partition("\t")
            words[frame_number(path, number)] = word.strip()
    start = min(words, default=0)
    return tuple(words.get(start + t, "") for t in range(n_frames))
