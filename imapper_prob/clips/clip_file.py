"""The program's own clip file: one ``.npz`` that holds everything a clip holds.

The file is a plain numpy archive without pickled objects, so any tool can write one:

============================  ==================  =============================================
entry                         shape               meaning
============================  ==================  =============================================
``format``                    ()                  ``"imapper-prob clip 1"``
``name``                      ()                  text
``fps``                       ()                  frames a second
``focal_spread``              ()                  standard deviation of the log focal length;
                                                 older files have ``focal_known`` instead
``camera``                    (9,)                width, height, fx, fy, cx, cy (pixels),
                                                  pitch, roll (radians), elevation (metres)
``frame_ids``                 (T,) int            the input's own frame numbers
``track_names``               (A,) text           one per actor
``keypoints``                 (A, T, 16, 2)       pixels; NaN where there is none
``confidences``               (A, T, 16)          in [0, 1]
``poses``                     (A, T, 16, 3)       metres, camera axes, relative to the pelvis
``interpolated``              (A, T) bool         poses that the input had interpolated
============================  ==================  =============================================

A file with ground truth also has ``truth_camera`` (9,), ``truth_joints`` (R, 16, 3),
``truth_hidden`` (R, 16), ``truth_actions`` (R or 0,), ``object_labels`` (K,) and
``object_placements`` (K, 3). Its boxes are concatenated: ``cuboid_owners`` (C,) int index of the
object, ``cuboid_parts`` (C,), ``cuboid_boxes`` (C, 6) centre and size. R is T if only the first
actor's motion is known, or A T with all actors concatenated.
"""

from __future__ import annotations

from dataclasses import astuple
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.clips.parsing import Arrays, load_archive
from imapper_prob.files import written_whole
from imapper_prob.models.camera import Camera
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import (
    MEASURED_FOCAL,
    Clip,
    Cuboid,
    Placement,
    SceneObject,
    Track,
    Truth,
)

__all__ = ["FORMAT", "clip_of", "pack_clip", "read_clip", "write_clip"]


FORMAT: Final = "imapper-prob clip 1"
"""First entry of the file; the number increases when old readers would misread a new file."""


def write_clip(path: str | Path, clip: Clip) -> None:
    """Write a clip to a file, atomically.

    Parameters
    ----------
    path : path
        Ends in ``.npz``.
    clip : Clip
        The clip; its ground truth is written too if it has one.

    Raises
    ------
    InputError
        The file name does not end in ``.npz``.
    OSError
        The file cannot be written.

    Examples
    --------
    >>> im.write_clip("clip.npz", im.demo_clip())
    >>> im.load_clip("clip.npz").n_frames
    130
    """
    path = Path(path)
    if path.suffix != ".npz":
        raise InputError(f"{path}: a clip file's name ends in .npz")
    arrays = pack_clip(clip)
    with written_whole(path) as beside, beside.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def pack_clip(clip: Clip) -> Arrays:
    """Convert a clip to the arrays listed in the module's description.

    Parameters
    ----------
    clip : Clip

    Returns
    -------
    dict of str to array
    """
    arrays: Arrays = {
        "format": np.array(FORMAT),
        "name": np.array(clip.name),
        "fps": np.array(clip.fps),
        "focal_spread": np.array(clip.focal_spread),
        "camera": np.array(astuple(clip.camera)),
        "frame_ids": clip.frame_ids,
        "track_names": np.array([t.name for t in clip.tracks], dtype=np.str_),
        "keypoints": np.stack([t.keypoints for t in clip.tracks]),
        "confidences": np.stack([t.confidences for t in clip.tracks]),
        "poses": np.stack([t.poses for t in clip.tracks]),
        "interpolated": np.stack([t.interpolated for t in clip.tracks]),
    }
    if clip.truth is not None:
        arrays |= _truth_arrays(clip.truth)
    return arrays


def read_clip(path: str | Path) -> Clip:
    """Read a clip file in the format of :func:`write_clip`.

    Parameters
    ----------
    path : path

    Returns
    -------
    Clip

    Raises
    ------
    InputError
        The file is missing, damaged, of another version, or does not hold a valid clip.
    """
    path = Path(path)
    return clip_of(load_archive(path, what="clip"), path)


def clip_of(arrays: Arrays, path: Path) -> Clip:
    """Convert the arrays of :func:`pack_clip` back to a clip.

    Parameters
    ----------
    arrays : mapping of str to array
    path : Path
        Path named in error messages.

    Returns
    -------
    Clip

    Raises
    ------
    InputError
        As :func:`read_clip`.
    """
    form = str(_entry(path, arrays, "format", (), "U"))
    if form != FORMAT:
        raise InputError(f"{path}: format {form!r}, this version reads {FORMAT!r}")
    frame_ids = _entry(path, arrays, "frame_ids", (None,), "i")
    n_frames, first = len(frame_ids), int(frame_ids[0]) if len(frame_ids) else 0
    names = _entry(path, arrays, "track_names", (None,), "U")
    per_frame = (len(names), n_frames)
    keypoints = _entry(path, arrays, "keypoints", (*per_frame, 16, 2), "f")
    confidences = _entry(path, arrays, "confidences", (*per_frame, 16), "f")
    poses = _entry(path, arrays, "poses", (*per_frame, 16, 3), "f")
    interpolated = _entry(path, arrays, "interpolated", per_frame, "b")
    try:
        return Clip(
            name=str(_entry(path, arrays, "name", (), "U")),
            camera=_camera(_entry(path, arrays, "camera", (9,), "f")),
            fps=float(_entry(path, arrays, "fps", (), "f")),
            frame_ids=frame_ids,
            tracks=tuple(
                Track(str(name), keypoints[a], confidences[a], poses[a], interpolated[a], first)
                for a, name in enumerate(names)
            ),
            focal_spread=_focal_spread(path, arrays),
            truth=_truth(path, arrays, (n_frames, len(names) * n_frames))
            if "truth_joints" in arrays
            else None,
        )
    except InputError as error:
        message = str(error)
        raise InputError(message if str(path) in message else f"{path}: {message}") from error


def _entry(
    path: Path,
    arrays: Arrays,
    name: str,
    shape: tuple[int | None, ...],
    kind: str,
) -> NDArray[Any]:
    """One entry, with its shape (``None``: any length) and kind of dtype checked."""
    if name not in arrays:
        raise InputError(f"{path}: no entry {name!r}; see the description of the format")
    array = arrays[name]
    fits = array.ndim == len(shape) and all(
        e is None or e == n for e, n in zip(shape, array.shape, strict=True)
    )
    accepted = {"f": "fiu", "i": "iu"}.get(kind, kind)
    if not fits or array.dtype.kind not in accepted:
        raise InputError(
            f"{path}: entry {name!r} has shape {array.shape} and type {array.dtype}, "
            f"expected shape {shape} of kind {kind!r}"
        )
    return array


_UNMEASURED_FOCAL: Final = 0.05
"""Standard deviation of the log focal length in older files in which it was not measured; that of
i3DB (docs/explanation/model.md 4)."""


def _focal_spread(path: Path, arrays: Arrays) -> float:
    """Spread of the focal length; for older files derived from whether it was measured."""
    if "focal_spread" in arrays:
        return float(_entry(path, arrays, "focal_spread", (), "f"))
    return (
        MEASURED_FOCAL if bool(_entry(path, arrays, "focal_known", (), "b")) else _UNMEASURED_FOCAL
    )


def _camera(values: NDArray[Any]) -> Camera:
    width, height, *rest = (float(v) for v in values)
    if not (width.is_integer() and height.is_integer()):
        raise InputError(f"image size {width} x {height} must be whole numbers of pixels")
    return Camera(int(width), int(height), *rest)


def _truth_arrays(truth: Truth) -> Arrays:
    cuboids = [(k, c) for k, o in enumerate(truth.objects) for c in o.cuboids]
    return {
        "truth_camera": np.array(astuple(truth.camera)),
        "truth_joints": truth.joints,
        "truth_hidden": np.asarray(truth.hidden, bool),
        "truth_actions": np.array(truth.actions, dtype=np.str_),
        "object_labels": np.array([o.label for o in truth.objects], dtype=np.str_),
        "object_placements": np.array(
            [astuple(o.placement) for o in truth.objects], dtype=np.float64
        ).reshape(-1, 3),
        "cuboid_owners": np.array([k for k, _ in cuboids], dtype=np.int64),
        "cuboid_parts": np.array([c.part for _, c in cuboids], dtype=np.str_),
        "cuboid_boxes": np.array(
            [np.concatenate([c.centre, c.size]) for _, c in cuboids], dtype=np.float64
        ).reshape(-1, 6),
    }


def _truth(path: Path, arrays: Arrays, possible: tuple[int, int]) -> Truth:
    """The ground truth, of the first actor or of all actors; ``possible`` are the row counts."""
    joints = _entry(path, arrays, "truth_joints", (None, 16, 3), "f")
    if len(joints) not in possible:
        raise InputError(
            f"{path}: truth_joints has {len(joints)} rows; the first actor has {possible[0]}, "
            f"everybody {possible[1]}"
        )
    labels = _entry(path, arrays, "object_labels", (None,), "U")
    placements = _entry(path, arrays, "object_placements", (len(labels), 3), "f")
    owners = _entry(path, arrays, "cuboid_owners", (None,), "i")
    parts = _entry(path, arrays, "cuboid_parts", owners.shape, "U")
    boxes = _entry(path, arrays, "cuboid_boxes", (len(owners), 6), "f")
    actions = _entry(path, arrays, "truth_actions", (None,), "U")
    if len(actions) not in (0, len(joints)):
        raise InputError(f"{path}: {len(actions)} actions for {len(joints)} rows of truth_joints")
    if len(owners) and not (owners.min() >= 0 and owners.max() < len(labels)):
        raise InputError(f"{path}: a cuboid belongs to an object that is not there")
    objects = [
        SceneObject(
            label=str(label),
            placement=Placement(*(float(v) for v in placement)),
            cuboids=tuple(
                Cuboid(str(part), box[:3], box[3:])
                for part, box, owner in zip(parts, boxes, owners, strict=True)
                if owner == k
            ),
        )
        for k, (label, placement) in enumerate(zip(labels, placements, strict=True))
    ]
    return Truth(
        camera=_camera(_entry(path, arrays, "truth_camera", (9,), "f")),
        objects=tuple(objects),
        joints=joints,
        hidden=_entry(path, arrays, "truth_hidden", (len(joints), 16), "b"),
        actions=tuple(str(a) for a in actions),
    )
