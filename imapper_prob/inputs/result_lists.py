"""Result lists of MMPose, RTMPose and AlphaPose: all people of all frames in one JSON.

Two forms are read. The list of COCO results, one entry a person: ``image_id`` (a number, or a
file's name with one in it), ``keypoints`` (x, y, score for each), and where the program tracks
people ``idx`` or ``track_id``. And MMPose's own: ``instance_info``, one entry a frame with
``frame_id`` and ``instances``, each of ``keypoints`` (pairs) and ``keypoint_scores``.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.inputs.json_fields import load_json
from imapper_prob.inputs.keypoint_sets import KEYPOINT_SETS, not_reported, sixteen
from imapper_prob.inputs.sightings import FARTHEST, Sightings
from imapper_prob.models.errors import InputError
from imapper_prob.models.limits import LONGEST_CLIP, MOST_PEOPLE

__all__ = ["SETS", "is_result_list", "read_result_list"]

Array = NDArray[np.float64]

SETS: Final = ("coco_17", "halpe_26")
"""Keypoint sets of such lists, which may be named as formats."""
_BEGINS_WITH: Final = {17: "coco_17", 26: "halpe_26", 133: "coco_17", 136: "halpe_26"}
"""Sets by the number of keypoints; the two of the whole body begin with those of the body."""


def is_result_list(data: Any) -> bool:
    """Whether this is such a file's content."""
    if isinstance(data, dict):
        return "instance_info" in data
    return bool(
        isinstance(data, list)
        and data
        and isinstance(data[0], dict)
        and "image_id" in data[0]
        and "keypoints" in data[0]
    )


def read_result_list(path: Path, *, keypoint_set: str | None = None) -> Sightings:
    """Read all people of all frames.

    Parameters
    ----------
    path : Path
    keypoint_set : str, optional
        One of :data:`SETS`; told from the number of keypoints if not given.

    Raises
    ------
    InputError
        The file is damaged, or an entry is not what the format says.
    """
    data = load_json(path)
    if not is_result_list(data):
        raise InputError(f"{path}: no list of results with image_id and keypoints")
    entries = _instances(path, data) if isinstance(data, dict) else _results(path, data)
    if not entries:
        raise InputError(f"{path}: nobody in any frame")
    counts = sorted({len(table) for _, table, _ in entries})
    if len(counts) > 1:
        raise InputError(f"{path}: people with {counts[0]} and with {counts[1]} keypoints")
    found = _BEGINS_WITH.get(counts[0])
    if found is None or (keypoint_set is not None and found != keypoint_set):
        raise InputError(
            f"{path}: {counts[0]} keypoints a person, expected "
            f"{len(KEYPOINT_SETS[keypoint_set]) if keypoint_set else '17, 26, 133 or 136'}"
        )
    names = KEYPOINT_SETS[found]
    table = np.stack([own[: len(names)] for _, own, _ in entries])
    # A point in the very corner is how these programs, too, write one they do not have.
    there = (table[..., :2] != 0).any(-1)
    keypoints, scores = sixteen(table[..., :2], np.where(there, table[..., 2], 0.0), names)
    frames = np.array([frame for frame, _, _ in entries], np.int64)
    identities = [who for _, _, who in entries]
    pairs = {(frame, who) for frame, _, who in entries}
    return Sightings(
        name=path.stem,
        map_name="mmpose",
        frames=frames,
        keypoints=keypoints,
        scores=scores,
        span=(int(frames.min()), int(frames.max())),
        identities=tuple(identities) if all(identities) and len(pairs) == len(entries) else (),
        missing=not_reported(names),
    )


_Entry = tuple[int, Array, str]


def _results(path: Path, data: list[Any]) -> list[_Entry]:
    if len(data) > LONGEST_CLIP * MOST_PEOPLE:
        raise InputError(f"{path}: {len(data)} entries; cut the clip")
    entries = []
    for number, entry in enumerate(data):
        place = f"{path}, entry {number}"
        if not isinstance(entry, dict) or "image_id" not in entry:
            raise InputError(f"{place}: no 'image_id'")
        table = _numbers(place, entry.get("keypoints"))
        if table.size % 3:
            raise InputError(f"{place}: {table.size} numbers in 'keypoints' are no triples")
        frame = _frame(place, entry["image_id"])
        entries.append((frame, table.reshape(-1, 3), _identity(entry)))
    return entries


def _instances(path: Path, data: dict[str, Any]) -> list[_Entry]:
    listed = data["instance_info"]
    if not isinstance(listed, list) or len(listed) > LONGEST_CLIP:
        raise InputError(f"{path}: 'instance_info' must be a list of at most {LONGEST_CLIP} frames")
    entries = []
    for number, frame in enumerate(listed):
        place = f"{path}, entry {number}"
        if not isinstance(frame, dict) or not isinstance(frame.get("instances"), list):
            raise InputError(f"{place}: no list 'instances'")
        at = _frame(place, frame.get("frame_id", number))
        for person in frame["instances"]:
            if not isinstance(person, dict):
                raise InputError(f"{place}: an instance is no table")
            points = _numbers(place, person.get("keypoints"))
            scores = _numbers(place, person.get("keypoint_scores"))
            if points.ndim != 2 or points.shape[1] != 2 or scores.shape != (len(points),):
                raise InputError(f"{place}: 'keypoints' must be pairs, with a score each")
            entries.append((at, np.column_stack([points, scores]), _identity(person)))
    return entries


def _numbers(place: str, values: Any) -> Array:
    try:
        table = np.array(values)
        if not isinstance(values, list) or table.dtype.kind not in "iuf":
            raise ValueError
        table = table.astype(np.float64)
    except (ValueError, OverflowError, TypeError):
        raise InputError(f"{place}: keypoints and their scores must be lists of numbers") from None
    if not (np.abs(table) <= FARTHEST).all():
        raise InputError(f"{place}: a keypoint is not finite, or too far away to be a pixel")
    return table


def _frame(place: str, given: Any) -> int:
    """Frame number: an integer, or the last one in a name such as ``"0012.jpg"``."""
    if type(given) is int and abs(given) < 2**53:
        return given
    digits = re.findall(r"\d+", Path(given).stem) if isinstance(given, str) else []
    if not digits or len(digits[-1]) > 15:
        raise InputError(f"{place}: {str(given)[:40]!r} holds no frame number")
    return int(digits[-1])


def _identity(entry: dict[str, Any]) -> str:
    for key in ("track_id", "idx"):
        given = entry.get(key)
        if isinstance(given, list) and len(given) == 1:
            given = given[0]
        if isinstance(given, int | float) and not isinstance(given, bool) and given == given:
            return f"{given:g}"
    return ""
