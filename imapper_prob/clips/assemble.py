"""From raw detections to a clip: identities, confidences, camera, and missing values.

Readers return :class:`RawDetections`: all people in all frames, with the detector's own pixels and
scores. :func:`assemble` assigns identities, maps scores to confidences and adds the camera.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.clips.identity import Marks, rows_of_marks
from imapper_prob.clips.options import ClipOptions, camera_of, undistorted
from imapper_prob.clips.tracking import associate
from imapper_prob.models.camera import Camera
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.settings import LONGEST_CLIP, MOST_PEOPLE
from imapper_prob.models.skeleton import DETECTED, JOINTS, LHIP, LSHO, N_JOINTS, RHIP, RSHO

__all__ = [
    "CONFIDENCE_MAPS",
    "FARTHEST",
    "HEAT_GAIN",
    "HEAT_OFFSET",
    "RawDetections",
    "assemble",
    "confidence_map",
]

Array = NDArray[np.float64]
FARTHEST: Final = 1e6
"""Pixels or metres beyond which a coordinate counts as damaged; its square must stay finite."""


@dataclass(frozen=True)
class RawDetections:
    """All people in all frames, with the detector's own pixels and scores.

    Parameters
    ----------
    name : str
        Name of the clip.
    map_name : str
        Name of the default confidence map for these scores, see :func:`confidence_map`.
    frames : (N,) int
        Frame number of each row, that is of each detected person.
    keypoints : (N, 16, 2) float
        Pixels, or fractions of the image's width and height if ``relative``; NaN where missing.
    scores : (N, 16) float
        In the detector's units; 0 where a joint is missing or computed from other joints.
    span : (int, int)
        First and last frame of the clip, with or without people.
    poses : (N, 16, 3) float, optional
        Lifted joints relative to the pelvis, camera axes, metres; NaN for people without a pose.
    along_ray : bool
        Whether poses are in the axes of a camera turned towards the person, not of the real camera.
    identities : (N,) str, optional
        Track names, if the detector tracked people.
    relative : bool
        Whether keypoints are fractions of the image's width and height.
    size : (int, int), optional
        Width and height of the image in pixels, if the files state it.
    fps : float, optional
        Frames a second, if the files state it.
    likely_focal : float, optional
        Estimate of the focal length in pixels, if the files allow one.
    missing : tuple of str
        Joints that this file format never contains.
    """

    name: str
    map_name: str
    frames: NDArray[np.int64]
    keypoints: Array
    scores: Array
    span: tuple[int, int]
    poses: Array | None = None
    along_ray: bool = False
    identities: tuple[str, ...] = ()
    relative: bool = False
    size: tuple[int, int] | None = None
    fps: float | None = None
    likely_focal: float | None = None
    missing: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        first, last = self.span
        if last - first >= LONGEST_CLIP:
            raise InputError(
                f"{self.name}: frames run from {first} to {last}, more than {LONGEST_CLIP}; "
                "check the frame numbers, or cut the clip"
            )
        rows = len(self.frames)
        assert self.keypoints.shape == (rows, N_JOINTS, 2)
        assert self.scores.shape == (rows, N_JOINTS)
        assert self.poses is None or self.poses.shape == (rows, N_JOINTS, 3)
        assert not self.identities or len(self.identities) == rows
        if rows:
            frames, people = np.unique(self.frames, return_counts=True)
            if people.max() > MOST_PEOPLE:
                frame = frames[np.argmax(people)]
                raise InputError(
                    f"{self.name}, frame {frame}: {people.max()} people; at most {MOST_PEOPLE} "
                    "can be told apart"
                )


# ------------------------------------------------------------------------------------------------
# Maps from scores to confidences.
#
# The detection tables (``calibration.md``) were measured with one detector. Scores of other
# detectors have another meaning; a monotone map for each source converts them to that scale first.

Knots = tuple[tuple[float, float], ...]
Map = Callable[[ArrayLike], Array]
CONFIDENCE_MAPS: Final[dict[str, Knots]] = {
    # The values are confidences already.
    "identity": ((0.0, 0.0), (1.0, 1.0)),
    # Peaks of OpenPose's heat maps: .6 to .8 on joints in full view (fixtures: median .63), where
    # the tables expect .8 to .9. OpenPose itself drops points below .05.
    "openpose": ((0.0, 0.0), (0.05, 0.02), (0.3, 0.5), (0.6, 0.82), (0.8, 0.88), (1.0, 0.95)),
    # Scores of MMPose, RTMPose and AlphaPose are not probabilities and can exceed 1. Their own
    # programs draw points from .3.
    "mmpose": ((0.0, 0.0), (0.1, 0.02), (0.3, 0.5), (0.6, 0.82), (0.9, 0.88), (1.2, 0.95)),
    # MediaPipe's visibility is high on hidden joints too. On three clips, joints in plain view have
    # .75 and more, and a leg behind the other .5 to .7. The map ends at .79, where the tables
    # hardly favour "seen" (1.2 to 1).
    "mediapipe": ((0.0, 0.02), (0.1, 0.05), (0.5, 0.15), (0.75, 0.5), (0.9, 0.72), (1.0, 0.79)),
}
"""Knots (score, confidence) of piecewise linear maps, constant outside the knots. All but the first
are chosen by judgement, because no data with marked hidden joints were available. There is a fifth
map, ``cpm``: :func:`_heat`."""
HEAT_GAIN: Final = 5000.0
HEAT_OFFSET: Final = -9.5
"""Gain and offset of the logistic map of i3DB's authors for raw heat values of CPM detectors."""


def confidence_map(name: str) -> Map:
    """Look up a confidence map by name, or make one from knots given as text.

    Parameters
    ----------
    name : str
        One of :data:`CONFIDENCE_MAPS`, ``"cpm"``, or ``"0:0,0.3:0.5,1:1"``: scores and
        confidences, both ascending.

    Returns
    -------
    callable
        Maps scores of any shape to confidences in [0, 1]. A joint whose score is not above 0 stays
        missing.

    Raises
    ------
    InputError
        The name is unknown, or the knots do not ascend.
    """
    if name == "cpm":
        return _heat
    knots = CONFIDENCE_MAPS[name] if name in CONFIDENCE_MAPS else _written_out(name)
    at, value = np.array(knots).T

    def mapped(scores: ArrayLike) -> Array:
        finite = np.nan_to_num(np.asarray(scores, float), posinf=at[-1])
        return np.where(finite > 0, np.interp(finite, at, value), 0.0)

    return mapped


def _heat(scores: ArrayLike) -> Array:
    heat = np.clip(np.nan_to_num(np.asarray(scores, float)), 0.0, 0.1)
    return np.where(heat > 0, 1 / (1 + np.exp(-HEAT_GAIN * heat - HEAT_OFFSET)), 0.0)


def _written_out(text: str) -> Knots:
    number = r"\d*\.?\d+"
    pairs = [part.strip() for part in text.split(",")]
    if not all(re.fullmatch(f"{number}:{number}", pair) for pair in pairs):
        known = ", ".join(sorted([*CONFIDENCE_MAPS, "cpm"]))
        raise InputError(
            f"confidence map {text!r}: known are {known}, or knots such as 0:0,0.3:0.5,1:1"
        )
    knots = tuple((float(a), float(b)) for a, b in (pair.split(":") for pair in pairs))
    scores, confidences = np.array(knots).T
    if len(knots) < 2 or (np.diff(scores) <= 0).any() or (np.diff(confidences) < 0).any():
        raise InputError(f"confidence map {text!r}: two knots or more, scores ascending")
    if confidences.max() > 1:
        raise InputError(f"confidence map {text!r}: confidences are in [0, 1]")
    return knots


# ------------------------------------------------------------------------------------------------
# Clips.

_log = logging.getLogger(__name__)
_HIGHEST_SCORE: Final = 1.5
"""Highest score of a format with scores in [0, 1]: peaks of heat maps exceed 1 a little; chosen."""
_IN_PICTURE: Final = 0.5
"""Least share of detected joints inside of the picture; chosen. A detector sees nothing outside."""
_FRAME_RATE: Final = 30.0
"""Frames a second if neither files nor user say; usual for cameras and phones."""


def assemble(sightings: RawDetections, options: ClipOptions) -> Clip:
    """Build a clip from raw detections.

    Poses stay NaN if the files have none; lifting is a later step.

    Parameters
    ----------
    sightings : RawDetections
    options : ClipOptions

    Returns
    -------
    Clip

    Raises
    ------
    InputError
        Nobody was detected, or image sizes contradict each other.
    """
    name = sightings.name
    sightings = _without_empty_rows(sightings)
    size = _size(sightings, options)
    pixels = keypoints = sightings.keypoints * (size if sightings.relative else 1.0)
    if options.camera is not None:
        keypoints = undistorted(pixels, options.camera)
    scores = np.where(np.isfinite(keypoints).all(-1), sightings.scores, 0.0)
    if options.confidence is None and sightings.map_name != "mmpose":
        _require_scores(sightings, scores)
    confidences = confidence_map(options.confidence or sightings.map_name)(scores)
    _require_in_picture(pixels, confidences, size)
    camera, spread = camera_of(name, options, size=size, likely_focal=sightings.likely_focal)
    fps = options.fps or sightings.fps
    if fps is None:
        fps = _FRAME_RATE
        _log.warning("%s: frame rate assumed to be %.0f a second", name, fps)
    first, last = sightings.span
    if sightings.poses is not None and sightings.along_ray:
        sightings = replace(sightings, poses=_turned_back(camera, keypoints, sightings.poses))
    marked = None
    if options.marks is not None:  # in pixels of the image, with the distortion of the lens
        marked = _rows_of_marks(sightings, pixels, options.marks)
    rows = _rows_of_tracks(sightings, keypoints, confidences, options, size=size, marked=marked)
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


def _require_in_picture(keypoints: Array, confidences: Array, size: tuple[int, int]) -> None:
    """Refuse an image size that most detections are outside of."""
    there = (confidences > 0) & np.isfinite(keypoints).all(-1)
    inside = (keypoints >= 0).all(-1) & (keypoints <= size).all(-1)
    if there.any() and (inside & there).sum() < _IN_PICTURE * there.sum():
        raise InputError(
            f"{(there & ~inside).sum()} of {there.sum()} detected joints are outside of images of "
            f"{size[0]} x {size[1]}; say the size of the image that the detector got (--size)"
        )


def _require_scores(sightings: RawDetections, scores: Array) -> None:
    """Refuse scores in another unit, such as percent, than the default map of the format."""
    for row, joint in np.argwhere(scores > _HIGHEST_SCORE)[:1]:
        raise InputError(
            f"frame {sightings.frames[row]}, joint {JOINTS[joint]}: score "
            f"{scores[row, joint]:g}; scores of this format are in [0, 1]. Say what others mean, "
            "such as --confidence-map 0:0,30:0.5,100:0.95"
        )


def _without_empty_rows(sightings: RawDetections) -> RawDetections:
    """The detections without rows that have no detected joint."""
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


def _size(sightings: RawDetections, options: ClipOptions) -> tuple[int, int]:
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
    """Poses (N, 16, 3) in camera axes, from poses in axes along the ray to the trunk.

    The rotation is the smallest one that takes the optical axis to that ray.
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
    sightings: RawDetections,
    keypoints: Array,
    confidences: Array,
    options: ClipOptions,
    *,
    size: tuple[int, int],
    marked: dict[int, int] | None,
) -> dict[str, NDArray[np.intp]]:
    """Row indices of each track by its name, in order of frames.

    ``marked`` are actors by row, with which the tracks agree.
    """
    marks = options.marks
    if marks is None and sightings.identities:
        return _named(sightings, options.people)
    try:
        actors = associate(
            sightings.frames,
            keypoints,
            confidences,
            people=options.people if marks is None else len(marks.actors),
            marks=marked,
            half_diagonal=float(np.hypot(*size)) / 2 if options.tracker == "paper" else None,
        )
    except InputError as error:
        raise InputError(f"{sightings.name}: {error}") from error
    if marks is not None:
        return dict(zip(marks.actors, actors, strict=False))
    if len(actors) == 1:
        return {sightings.name: actors[0]}
    return {f"{sightings.name}-{a}": rows for a, rows in enumerate(actors)}


def _named(sightings: RawDetections, people: int | None) -> dict[str, NDArray[np.intp]]:
    """Tracks as the detector names them; only the longest if there are more than ``people``."""
    labels = np.array(sightings.identities)
    found = {str(who): np.flatnonzero(labels == who) for who in np.unique(labels)}
    longest = sorted(found, key=lambda who: -len(found[who]))[:people]
    return {who: found[who] for who in sorted(longest)}


def _rows_of_marks(sightings: RawDetections, pixels: Array, marks: Marks) -> dict[int, int]:
    """Actors by row, of the user's marks."""
    try:
        return rows_of_marks(marks, sightings.frames, pixels)
    except InputError as error:
        raise InputError(f"{sightings.name}: {error}") from error


def _track(
    sightings: RawDetections,
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
    return Track(name, own_keypoints, own_confidences, own_poses, np.zeros(n_frames, bool), first)
