"""From sightings to a clip: who is who, confidences, camera, and what is missing."""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.inputs.camera_options import ClipOptions, camera_of, undistorted
from imapper_prob.inputs.confidence_maps import confidence_map
from imapper_prob.inputs.marks import Marks, rows_of_marks
from imapper_prob.inputs.sightings import Sightings
from imapper_prob.models.camera import Camera
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.skeleton import DETECTED, LHIP, LSHO, N_JOINTS, RHIP, RSHO
from imapper_prob.tracking.associate import associate

__all__ = ["assemble"]

Array = NDArray[np.float64]

_log = logging.getLogger(__name__)

_FRAME_RATE: Final = 30.0
"""Frames a second, where nobody says: what cameras and phones record at."""


def assemble(sightings: Sightings, options: ClipOptions) -> Clip:
    """A clip of all that was seen.

    Poses stay NaN where the files have none; a lifter comes later.

    Raises
    ------
    InputError
        Nobody was seen, or size or frame rate contradict each other.
    """
    name = sightings.name
    sightings = _without_empty_rows(sightings)
    size = _size(sightings, options)
    keypoints = sightings.keypoints * (size if sightings.relative else 1.0)
    if options.camera is not None:
        keypoints = undistorted(keypoints, options.camera)
    scores = np.where(np.isfinite(keypoints).all(-1), sightings.scores, 0.0)
    confidences = confidence_map(options.confidence or sightings.map_name)(scores)
    camera, spread = camera_of(name, options, size=size, likely_focal=sightings.likely_focal)
    fps = options.fps or sightings.fps
    if fps is None:
        fps = _FRAME_RATE
        _log.warning("%s: frame rate assumed to be %.0f a second", name, fps)
    first, last = sightings.span
    if sightings.poses is not None and sightings.along_ray:
        sightings = replace(sightings, poses=_turned_back(camera, keypoints, sightings.poses))
    rows = _rows_of_tracks(sightings, keypoints, confidences, options, size)
    if sightings.missing:
        _log.info("%s: these files never have %s", name, ", ".join(sightings.missing))
    return Clip(
        name=name,
        camera=camera,
        fps=fps,
        frame_ids=np.arange(first, last + 1),
        tracks=tuple(
            _track(sightings, who, own, keypoints, confidences) for who, own in rows.items()
        ),
        focal_spread=spread,
    )


def _without_empty_rows(sightings: Sightings) -> Sightings:
    """Detectors list people of whom they then report no joint."""
    full: NDArray[np.bool_] = np.any(sightings.scores > 0, axis=1)
    if not full.any():
        raise InputError(f"{sightings.name}: no person with a detected joint in any frame")
    return replace(
        sightings,
        frames=sightings.frames[full],
        keypoints=sightings.keypoints[full],
        scores=sightings.scores[full],
        poses=None if sightings.poses is None else sightings.poses[full],
        identities=tuple(i for i, keep in zip(sightings.identities, full, strict=False) if keep),
    )


def _size(sightings: Sightings, options: ClipOptions) -> tuple[int, int]:
    given = options.camera.size if options.camera is not None else None
    sizes = {s for s in (given, options.size, sightings.size) if s is not None}
    if len(sizes) > 1:
        one, other = sorted(sizes)[:2]
        raise InputError(
            f"{sightings.name}: image sizes {one[0]} x {one[1]} and {other[0]} x {other[1]} "
            "contradict each other"
        )
    if sizes:
        return sizes.pop()
    raise InputError(
        f"{sightings.name}: these files do not say how large the image is; say it, such as "
        "--size 1920x1080"
    )


def _turned_back(camera: Camera, keypoints: Array, poses: Array) -> Array:
    """Poses (N, 16, 3) seen along the ray to the trunk, in the axes of the camera.

    The least rotation that takes the optical axis to that ray.
    """
    trunk = keypoints[:, [RHIP, LHIP, RSHO, LSHO]]
    there: NDArray[np.bool_] = np.all(np.isfinite(trunk), axis=-1)
    middle = np.where(there[..., None], trunk, 0).sum(1) / np.maximum(there.sum(1), 1)[:, None]
    middle = np.where((there.sum(1) > 0)[:, None], middle, (camera.cx, camera.cy))
    ray = camera.rays(middle)
    right, ahead, up = np.moveaxis(ray / np.linalg.norm(ray, axis=-1, keepdims=True), -1, 0)
    rotation = np.stack(
        [
            np.stack([1 - right**2 / (1 + ahead), right, -right * up / (1 + ahead)], -1),
            np.stack([-right, ahead, -up], -1),
            np.stack([-right * up / (1 + ahead), up, 1 - up**2 / (1 + ahead)], -1),
        ],
        1,
    )
    result: Array = poses @ rotation.transpose(0, 2, 1)
    return result


def _rows_of_tracks(
    sightings: Sightings,
    keypoints: Array,
    confidences: Array,
    options: ClipOptions,
    size: tuple[int, int],
) -> dict[str, NDArray[np.intp]]:
    """The rows of each track by its name, in order of frames."""
    half_diagonal = float(np.hypot(*size)) / 2 if options.tracker == "paper" else None
    if options.marks is not None:
        return _marked(sightings, keypoints, confidences, options.marks, half_diagonal)
    if sightings.identities:
        return _named(sightings, options.people)
    actors = associate(
        sightings.frames,
        keypoints,
        confidences,
        people=options.people,
        half_diagonal=half_diagonal,
    )
    if len(actors) == 1:
        return {sightings.name: actors[0]}
    return {f"{sightings.name}-{a}": rows for a, rows in enumerate(actors)}


def _named(sightings: Sightings, people: int | None) -> dict[str, NDArray[np.intp]]:
    """As the program says that made the files; the longest tracks where there are too many."""
    labels = np.array(sightings.identities)
    found = {str(who): np.flatnonzero(labels == who) for who in np.unique(labels)}
    longest = sorted(found, key=lambda who: -len(found[who]))[:people]
    return {who: found[who] for who in sorted(longest)}


def _marked(
    sightings: Sightings,
    keypoints: Array,
    confidences: Array,
    marks: Marks,
    half_diagonal: float | None,
) -> dict[str, NDArray[np.intp]]:
    """As the user says, and what follows from that."""
    try:
        rows = rows_of_marks(marks, sightings.frames, keypoints)
        actors = associate(
            sightings.frames,
            keypoints,
            confidences,
            people=len(marks.actors),
            marks=rows,
            half_diagonal=half_diagonal,
        )
    except InputError as error:
        raise InputError(f"{sightings.name}: {error}") from error
    return dict(zip(marks.actors, actors, strict=False))


def _track(
    sightings: Sightings,
    name: str,
    rows: NDArray[np.intp],
    keypoints: Array,
    confidences: Array,
) -> Track:
    first, last = sightings.span
    n_frames = last - first + 1
    at = sightings.frames[rows] - first
    own_keypoints = np.full((n_frames, N_JOINTS, 2), np.nan)
    own_confidences = np.zeros((n_frames, N_JOINTS))
    own_poses = np.full((n_frames, N_JOINTS, 3), np.nan)
    own_keypoints[at] = keypoints[rows]
    detected = list(DETECTED)
    own_confidences[at[:, None], detected] = confidences[rows][:, detected]
    if sightings.poses is not None:
        poses = sightings.poses[rows]
        poses[~np.isfinite(poses).all((1, 2))] = np.nan
        own_poses[at] = poses
    return Track(name, own_keypoints, own_confidences, own_poses, np.zeros(n_frames, bool))
