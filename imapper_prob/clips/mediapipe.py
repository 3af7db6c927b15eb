"""Landmarks of MediaPipe, from dumps or from any other source of its 33 points.

MediaPipe has no file format of its own. A dump is a list of frames, or a table with ``frames`` and
optionally ``fps``, ``width`` and ``height``. A frame is a table with

``frame``            its number; the position in the list if missing
``landmarks``        33 tables ``{x, y, visibility}`` in fractions of the image, or rows
                     ``[x, y, z, visibility]``; null where nobody was found
``world_landmarks``  33 of ``{x, y, z}`` in metres, y down, z away from the camera; optional

The last two may have MediaPipe's own names, ``pose_landmarks`` and ``pose_world_landmarks``. If
several people were detected, each is a list of such lists.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.clips.assemble import RawDetections
from imapper_prob.clips.keypoints import KEYPOINT_SETS, not_reported, sixteen
from imapper_prob.clips.parsing import load_json
from imapper_prob.models.errors import InputError
from imapper_prob.models.settings import LONGEST_CLIP, MOST_PEOPLE
from imapper_prob.models.skeleton import PELV

__all__ = ["Landmarks", "is_mediapipe", "read_mediapipe", "sightings_of_landmarks"]

Array = NDArray[np.float64]

_NAMES: Final = KEYPOINT_SETS["mediapipe_33"]
_IMAGE_KEYS: Final = ("landmarks", "pose_landmarks")
_WORLD_KEYS: Final = ("world_landmarks", "pose_world_landmarks")
_FARTHEST: Final = 10.0
"""Greatest distance of a landmark outside the image, in image sizes."""
_TALLEST: Final = 5.0
"""Greatest distance from the hips in metres; larger values cannot be metres."""


@dataclass(frozen=True)
class Landmarks:
    """One person in one frame.

    Parameters
    ----------
    frame : int
    image : (33, 2) float
        Fractions of the image's width and height.
    visibility : (33,) float
    world : (33, 3) float, optional
        Metres from the middle of the hips; x right, y down, z away from the camera.
    """

    frame: int
    image: Array
    visibility: Array
    world: Array | None = None


_OUTSIDE: Final = 0.02
"""Fraction of the image beyond its edge from which on a joint counts as outside the picture."""


def sightings_of_landmarks(
    name: str,
    found: Sequence[Landmarks],
    *,
    span: tuple[int, int],
    size: tuple[int, int] | None = None,
    fps: float | None = None,
    likely_focal: float | None = None,
) -> RawDetections:
    """Raw detections of the sixteen joints, from landmarks.

    MediaPipe processes a crop around the person, so world landmarks are in the axes of a camera
    turned towards the person. On three clips, 3 to 13 degrees off the axis, the median distance of
    reprojected joints is 4, 6 and 9 pixels if that rotation is undone, and 4, 6 and 12 otherwise.

    Parameters
    ----------
    name : str
        Name of the clip.
    found : sequence of Landmarks
    span : (int, int)
        First and last frame.
    size : (int, int), optional
        Width and height in pixels.
    fps : float, optional
        Frames a second.
    likely_focal : float, optional
        Pixels.

    Returns
    -------
    RawDetections

    Raises
    ------
    InputError
        Nobody was found in any frame.
    """
    if not found:
        raise InputError(f"{name}: nobody was found in any frame")
    places = np.stack([landmarks.image for landmarks in found])
    # Outside of the picture the detector only guesses.
    inside = ((places >= -_OUTSIDE) & (places <= 1 + _OUTSIDE)).all(-1)
    visibility = np.where(inside, [landmarks.visibility for landmarks in found], 0.0)
    keypoints, scores = sixteen(places, visibility, _NAMES)
    poses = np.full((len(found), len(keypoints[0]), 3), np.nan)
    posed = [i for i, landmarks in enumerate(found) if landmarks.world is not None]
    if posed:
        world = np.stack([m.world for m in found if m.world is not None])
        axes = world[..., [0, 2, 1]] * (1, 1, -1)
        joints, _ = sixteen(axes, np.ones(axes.shape[:2]), _NAMES)
        poses[posed] = joints - joints[:, PELV, None]
    return RawDetections(
        name=name,
        map_name="mediapipe",
        frames=np.array([m.frame for m in found], np.int64),
        keypoints=keypoints,
        scores=scores,
        span=span,
        poses=poses,
        along_ray=True,
        relative=True,
        size=size,
        fps=fps,
        likely_focal=likely_focal,
        missing=not_reported(_NAMES),
    )


def is_mediapipe(data: Any) -> bool:
    """Whether the content of a JSON file is a dump of MediaPipe landmarks.

    Parameters
    ----------
    data : object
        Content of a JSON file.

    Returns
    -------
    bool
    """
    frames = data.get("frames") if isinstance(data, dict) else data
    if not isinstance(frames, list):
        return False
    keys = {key for frame in frames[:100] if isinstance(frame, dict) for key in frame}
    return bool(keys & set(_IMAGE_KEYS))


def read_mediapipe(path: Path) -> RawDetections:
    """Read a dump of MediaPipe landmarks.

    Parameters
    ----------
    path : Path

    Returns
    -------
    RawDetections

    Raises
    ------
    InputError
        The file is damaged, or a frame does not follow the format.
    """
    data = load_json(path)
    if not is_mediapipe(data):
        raise InputError(f"{path}: no list of frames with 'landmarks'")
    frames = data["frames"] if isinstance(data, dict) else data
    if len(frames) > LONGEST_CLIP:
        raise InputError(f"{path}: {len(frames)} frames, more than {LONGEST_CLIP}; cut the clip")
    found: list[Landmarks] = []
    numbers: list[int] = []
    for index, frame in enumerate(frames):
        if frame is None:
            frame = {}
        if not isinstance(frame, dict):
            raise InputError(f"{path}, entry {index}: a frame is a table or null")
        number = frame.get("frame", index)
        if type(number) is not int or abs(number) > 2**53:
            raise InputError(f"{path}, entry {index}: frame {str(number)[:40]!r} is no number")
        numbers.append(number)
        found += _people(path, number, frame)
    twice = next((n for n, times in Counter(numbers).items() if times > 1), None)
    if twice is not None:
        raise InputError(f"{path}: frame {twice} occurs twice")
    return sightings_of_landmarks(
        path.stem,
        found,
        span=(min(numbers), max(numbers)),
        size=_size(path, data),
        fps=_positive(path, data, "fps"),
    )


def _people(path: Path, number: int, frame: dict[str, Any]) -> list[Landmarks]:
    place = f"{path}, frame {number}"
    image = _several(_first(frame, _IMAGE_KEYS))
    world = _several(_first(frame, _WORLD_KEYS))
    if len(image) > MOST_PEOPLE:
        raise InputError(f"{place}: {len(image)} people; at most {MOST_PEOPLE} can be told apart")
    if world and len(world) != len(image):
        raise InputError(f"{place}: {len(image)} people in the image, {len(world)} in the world")
    people = []
    for i, points in enumerate(image):
        table = _points(place, points, ("x", "y", "visibility"), columns=(0, 1, 3))
        if np.abs(table[:, :2]).max() > _FARTHEST:
            raise InputError(f"{place}: landmarks are parts of the image, not pixels")
        metres = None
        if world:
            metres = _points(place, world[i], ("x", "y", "z"), columns=(0, 1, 2))
            if np.abs(metres).max() > _TALLEST:
                raise InputError(f"{place}: world landmarks are in metres about the hips")
        people.append(Landmarks(number, table[:, :2], table[:, 2], metres))
    return people


def _first(frame: dict[str, Any], keys: tuple[str, ...]) -> Any:
    return next((frame[key] for key in keys if frame.get(key) is not None), None)


def _several(value: Any) -> list[Any]:
    """A list of people, from nobody, one person, or a list of people."""
    if value is None or value == []:
        return []
    if not isinstance(value, list):
        return [value]
    several = isinstance(value[0], list) and bool(value[0]) and isinstance(value[0][0], list | dict)
    return value if several else [value]


def _points(place: str, points: Any, keys: tuple[str, ...], *, columns: tuple[int, ...]) -> Array:
    """(33, 3) values under ``keys`` of each landmark, or in ``columns`` of its row."""
    if not isinstance(points, list) or len(points) != len(_NAMES):
        count = len(points) if isinstance(points, list) else "no list of"
        raise InputError(f"{place}: {count} landmarks, expected {len(_NAMES)}")
    rows = []
    for name, point in zip(_NAMES, points, strict=True):
        if isinstance(point, dict):
            row = [point.get(key) for key in keys]
        elif isinstance(point, list) and len(point) > max(columns):
            row = [point[column] for column in columns]
        else:
            raise InputError(f"{place}, landmark {name}: expected x, y, z and visibility")
        if not all(type(value) in (int, float) for value in row):
            raise InputError(f"{place}, landmark {name}: {', '.join(keys)} must be numbers")
        rows.append(row)
    try:
        table = np.array(rows, float)
    except OverflowError:
        table = np.full((len(rows), len(keys)), np.inf)
    for landmark, column in np.argwhere(~np.isfinite(table))[:1]:
        raise InputError(
            f"{place}, landmark {_NAMES[landmark]}: {keys[column]} is not finite; leave that "
            "person out of that frame"
        )
    return table


def _size(path: Path, data: Any) -> tuple[int, int] | None:
    width, height = (_positive(path, data, key) for key in ("width", "height"))
    if width is None or height is None:
        return None
    return int(width), int(height)


def _positive(path: Path, data: Any, key: str) -> float | None:
    value = data.get(key) if isinstance(data, dict) else None
    if value is None:
        return None
    if type(value) not in (int, float) or not 1 <= value < 1e6:
        raise InputError(f"{path}: {key} must be a number of at least 1")
    return float(value)
