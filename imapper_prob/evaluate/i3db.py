"""Ground truth and the authors' own result of an i3DB scene, as in the benchmark's files.

Boxes in the files are tilted by up to six degrees and the published scores use them that way; this
module does not make them upright.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.clips.i3db import (
    AnnotatedBox,
    boxes_by_object,
    camera_axes,
    read_i3db,
    read_i3db_boxes,
    read_i3db_truth,
)
from imapper_prob.clips.parsing import frames_of_joints, load_json
from imapper_prob.evaluate.prediction import Prediction, between_frames
from imapper_prob.evaluate.truth import Outline, TruthInView, box_corners, used_objects
from imapper_prob.models.scene import Clip
from imapper_prob.models.skeleton import N_JOINTS

__all__ = ["read_authors", "read_input_path", "read_truth_in_view"]

Array = NDArray[np.float64]

_MAIN_PARTS: Final = frozenset({"seat", "stool", "top", "shelf"})
"""Main parts of objects in the authors' output; each back or leg is assigned to the nearest."""
_REPEATED: Final = 0.3
"""Metres in top view within which two parts of one kind count as one part written twice."""
_OWN: Final = 0.9
"""Greatest distance in metres, top view, of a back or leg from the seat or top it belongs to."""


def read_truth_in_view(folder: str | Path, clip: Clip | None = None) -> TruthInView:
    """Read the ground truth of one scene, with the annotators' corrected joints in the image.

    Parameters
    ----------
    folder : path
        Folder of the scene.
    clip : Clip, optional
        The clip read from that folder; read if not given.

    Returns
    -------
    TruthInView

    Raises
    ------
    InputError
        A file is missing, damaged, or does not follow the format.
    """
    folder = Path(folder)
    clip = clip or read_i3db(folder)
    truth = read_i3db_truth(folder, clip)
    path = next(iter(sorted((folder / "gt").glob("skel_*_GT.json"))))
    objects = []
    for parts in boxes_by_object(read_i3db_boxes(path, load_json(path))):
        widest = max(parts, key=lambda p: p.size[0] * p.size[1])
        has_front = widest.label in ("chair", "couch")
        objects.append(_outline(widest, parts, has_front=has_front))
    joints = truth.camera.to_camera(truth.joints)
    return TruthInView(
        name=clip.name,
        frame_ids=clip.frame_ids,
        joints=joints,
        pixels=_pixels(folder / "gt" / "skel_GT_2d.json", clip, joints),
        hidden=truth.hidden,
        objects=tuple(objects),
        used=used_objects(tuple(objects), joints, truth.actions, clip.n_frames),
        actions=truth.actions,
    )


def read_authors(folder: str | Path, clip: Clip | None = None) -> Prediction:
    """Read the authors' own result on a scene.

    Their files spread the parts of an object over many numbers and repeat some parts. Repeated
    parts are dropped, and each seat, top or shelf gets the backs and legs of its label that are
    nearest to it. The second axis of a seat points to its back, as in the ground truth.

    Parameters
    ----------
    folder : path
        Folder of the scene.
    clip : Clip, optional
        The clip read from that folder; read if not given.

    Returns
    -------
    Prediction

    Raises
    ------
    InputError
        ``iMapper/skel_output.json`` is missing or damaged.
    """
    folder = Path(folder)
    clip = clip or read_i3db(folder)
    path = folder / "iMapper" / "skel_output.json"
    joints = _path(path, clip)
    return Prediction(
        name="authors' output",
        joints=joints,
        pixels=clip.camera.project_camera(joints),
        objects=tuple(_regrouped(read_i3db_boxes(path, load_json(path)))),
    )


def read_input_path(folder: str | Path, clip: Clip | None = None) -> Prediction:
    """Read the lifted skeletons at the positions of the authors' input; no furniture.

    Parameters
    ----------
    folder : path
        Folder of the scene.
    clip : Clip, optional
        The clip read from that folder; read if not given.

    Returns
    -------
    Prediction
    """
    folder = Path(folder)
    clip = clip or read_i3db(folder)
    joints = _path(folder / f"skel_{clip.tracks[0].name}_unannot.json", clip)
    return Prediction("input path", joints, clip.camera.project_camera(joints), ())


def _path(path: Path, clip: Clip) -> Array:
    """(T, 16, 3) joints of a skeleton file; gaps between frames are interpolated linearly."""
    joints = np.full((clip.n_frames, N_JOINTS, 3), np.nan)
    for frame, position in frames_of_joints(path, load_json(path)).items():
        if frame in clip.frame_ids:
            joints[frame - clip.frame_ids[0]] = camera_axes(position)
    return between_frames(joints)


def _regrouped(parts: Sequence[AnnotatedBox]) -> list[Outline]:
    different: list[AnnotatedBox] = []
    for part in parts:
        alike = (p for p in different if (p.label, p.part) == (part.label, part.part))
        if all(_apart(p, part) >= _REPEATED for p in alike):
            different.append(part)
    mains = [p for p in different if p.part in _MAIN_PARTS]
    own = {id(main): [main] for main in mains}
    for part in different:
        if part.part in _MAIN_PARTS:
            continue
        takers = [m for m in mains if m.label == part.label]
        nearest = min(takers, key=lambda m: _apart(m, part), default=None)
        if nearest is not None and _apart(nearest, part) < _OWN:
            own[id(nearest)].append(part)
    return [_outline(m, own[id(m)], has_front=m.part == "seat") for m in mains]


def _apart(one: AnnotatedBox, other: AnnotatedBox) -> float:
    return float(np.linalg.norm(one.centre[:2] - other.centre[:2]))


def _outline(main: AnnotatedBox, parts: Sequence[AnnotatedBox], *, has_front: bool) -> Outline:
    """The outline of an object whose front is opposite to the second axis of its main part."""
    sideways = main.axes[:, 0]
    # Axes may be left-handed: take right of the front, whichever way the file's first axis points.
    back = main.axes[:, 1]
    if sideways[0] * back[1] - sideways[1] * back[0] > 0:
        sideways = -sideways
    corners = np.concatenate([box_corners(p.centre, p.axes, p.size) for p in parts])
    return Outline.of_corners(main.label, corners, sideways, has_front=has_front)


def _pixels(path: Path, clip: Clip, joints: Array) -> Array:
    """(T, 16, 2) corrected detections in pixels of the video; NaN where joints are not
    annotated."""
    pixels = np.full((clip.n_frames, N_JOINTS, 2), np.nan)
    for frame, corrected in frames_of_joints(path, load_json(path)).items():
        if frame in clip.frame_ids:
            pixels[frame - clip.frame_ids[0]] = corrected[:, :2]
    pixels[np.isnan(joints).any(-1)] = np.nan
    return pixels
