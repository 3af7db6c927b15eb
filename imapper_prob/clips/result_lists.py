"""Result lists of MMPose, RTMPose and AlphaPose, and pose proposals of LCR-Net++.

Two forms of result lists are read. The list of COCO results has one entry a person: ``image_id`` (a
number, or a file name that contains one), ``keypoints`` (x, y, score of each) and, if the program
tracks people, ``idx`` or ``track_id``. MMPose's own form has ``instance_info``: one entry a frame
with ``frame_id`` and ``instances``, each with ``keypoints`` (pairs) and ``keypoint_scores``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.clips.assemble import FARTHEST, RawDetections
from imapper_prob.clips.keypoints import KEYPOINT_SETS, joints_by_name, not_reported, sixteen
from imapper_prob.clips.parsing import field, frame_number, load_json, numbers
from imapper_prob.models.errors import InputError
from imapper_prob.models.settings import LARGEST_IMAGE, LONGEST_CLIP, MOST_PEOPLE
from imapper_prob.models.skeleton import DETECTED, JOINTS, PELV

__all__ = [
    "SETS",
    "is_proposals",
    "is_result_list",
    "proposal_confidence",
    "proposal_variance",
    "read_proposals",
    "read_result_list",
]

Array = NDArray[np.float64]
SETS: Final = ("coco_17", "halpe_26")
"""Keypoint sets of such lists, which are also format names."""
_BEGINS_WITH: Final = {17: "coco_17", 26: "halpe_26", 133: "coco_17", 136: "halpe_26"}
"""Sets by the number of keypoints; the two whole-body sets begin with the body's keypoints."""


def is_result_list(data: Any) -> bool:
    """Whether the content of a JSON file is a result list.

    Parameters
    ----------
    data : object
        Content of a JSON file.

    Returns
    -------
    bool
    """
    if isinstance(data, dict):
        return "instance_info" in data
    return bool(
        isinstance(data, list)
        and data
        and isinstance(data[0], dict)
        and "image_id" in data[0]
        and "keypoints" in data[0]
    )


def read_result_list(path: Path, *, keypoint_set: str | None = None) -> RawDetections:
    """Read all people of all frames.

    Parameters
    ----------
    path : Path
    keypoint_set : str, optional
        One of :data:`SETS`; inferred from the number of keypoints if not given.

    Returns
    -------
    RawDetections

    Raises
    ------
    InputError
        The file is damaged, or an entry does not follow the format.
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
    # These programs, too, write a missing point as one in the very corner of the image.
    there = (table[..., :2] != 0).any(-1)
    keypoints, scores = sixteen(table[..., :2], np.where(there, table[..., 2], 0.0), names)
    frames = np.array([frame for frame, _, _ in entries], np.int64)
    identities = [who for _, _, who in entries]
    pairs = {(frame, who) for frame, _, who in entries}
    return RawDetections(
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
        frame = _frame(place, entry["image_id"])
        place = f"{place}, frame {frame}"
        table = _numbers(place, entry.get("keypoints"), 3)
        if table.size % 3:
            raise InputError(f"{place}: {table.size} numbers in 'keypoints' are no triples")
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
        place = f"{place}, frame {at}"
        for person in frame["instances"]:
            if not isinstance(person, dict):
                raise InputError(f"{place}: an instance is no table")
            points = _numbers(place, person.get("keypoints"), 2)
            scores = _numbers(place, person.get("keypoint_scores"), 1)
            if points.ndim != 2 or points.shape[1] != 2 or scores.shape != (len(points),):
                raise InputError(f"{place}: 'keypoints' must be pairs, with a score each")
            entries.append((at, np.column_stack([points, scores]), _identity(person)))
    return entries


def _numbers(place: str, values: Any, columns: int) -> Array:
    """An array of numbers, ``columns`` of them for each keypoint."""
    try:
        table = np.array(values)
        if not isinstance(values, list) or table.dtype.kind not in "iuf":
            raise ValueError
        table = table.astype(np.float64)
    except (ValueError, OverflowError, TypeError):
        raise InputError(f"{place}: keypoints and their scores must be lists of numbers") from None
    fits = np.abs(table.ravel()) <= FARTHEST
    if not fits.all():
        first = int(np.argmin(fits))
        names = KEYPOINT_SETS.get(_BEGINS_WITH.get(table.size // columns, ""), ())
        joint = names[first // columns] if first // columns < len(names) else first // columns
        raise InputError(
            f"{place}, keypoint {joint}: {table.ravel()[first]:g} is not finite or too far away to "
            "be a pixel; leave that person out of that frame"
        )
    return table


def _frame(place: str, given: Any) -> int:
    """Frame number: an integer, or the last number in a name such as ``"0012.jpg"``."""
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
        if isinstance(given, str) and given:
            return given
        if isinstance(given, int | float) and not isinstance(given, bool) and given == given:
            whole = isinstance(given, int) or given.is_integer()
            return str(int(given) if whole else given)
    return ""


# ------------------------------------------------------------------------------------------------
# Pose proposals of LCR-Net++, and the confidence of their joints.
#
# A region detector proposes many poses for one person; similar ones are grouped. In a group with
# per-pose score s' (Rogez, Weinzaepfel and Schmid 2018, equation 6) a joint k has
#
#     v_k = var_i(q_k^i) / (1 + exp(-.2 s' + 3.5))
#     c_k = 1 / (1 + exp(-10 exp(log v_k / P99(log v_k)) + 24))
#
# over its positions q_k^i in space, where P99 is the 99th percentile of log v over all joints of
# the recording (Monszpart et al. 2019, appendix B). The variance is the mean squared distance from
# the mean in square metres; smaller variances give more confidence only below 1 square metre.

_SMALLEST: Final = 1e-12
"""Square metres: variance used for identical proposals, so that its log is finite."""
_MOST_PROPOSALS: Final = 2_000
"""Most proposals in one group; LCR-Net++ evaluates some thousand regions of an image."""


_MOST_SCORE: Final = 700.0
"""Largest exponent of a double."""


def proposal_variance(positions: ArrayLike, score: float) -> Array:
    """The variances v_k of one group of proposals.

    Parameters
    ----------
    positions : (P, J, 3) float
        Joints of the proposals, metres.
    score : float
        The score s'.

    Returns
    -------
    (J,) float
        Square metres.
    """
    positions = np.asarray(positions, float)
    variance = ((positions - positions.mean(0)) ** 2).sum(-1).mean(0)
    result: Array = variance / (1.0 + np.exp(min(-0.2 * score + 3.5, _MOST_SCORE)))
    return result


def proposal_confidence(variances: ArrayLike, percentile: float) -> Array:
    """The confidences c_k of variances, given the 99th percentile of all log variances.

    Parameters
    ----------
    variances : (...) float
        Square metres.
    percentile : float
        The 99th percentile of the logs of all variances.

    Returns
    -------
    (...) float

    Raises
    ------
    InputError
        The percentile is not negative. The formula would then be reversed, and joints on which the
        proposals agree would be the least confident.
    """
    if not percentile < 0:
        raise InputError(
            f"the 99th percentile of the joints' variances is {np.exp(percentile):.3g} square "
            "metres; the formula holds below 1, so check that poses are in metres"
        )
    logs = np.log(np.maximum(np.asarray(variances, float), _SMALLEST))
    # Beyond exp(5) the confidence is 1 to machine precision.
    agreed = np.exp(np.minimum(logs / percentile, 5.0))
    result: Array = 1.0 / (1.0 + np.exp(-10.0 * agreed + 24.0))
    return result


@dataclass(frozen=True)
class _Group:
    """Proposals for one person in one frame: pixels (P, 16, 2), metres (P, 16, 3), camera axes."""

    frame: int
    score: float
    pixels: Array
    positions: Array


def is_proposals(data: Any) -> bool:
    """Whether the content of a JSON file is a list of pose proposals.

    Parameters
    ----------
    data : object
        Content of a JSON file.

    Returns
    -------
    bool
    """
    people = data.get("people") if isinstance(data, dict) else None
    return isinstance(people, list) and any(
        isinstance(person, dict) and "proposals" in person for person in people
    )


def read_proposals(path: Path) -> RawDetections:
    """Read a file of grouped proposals (format: ``docs/reference/inputs.md``).

    A group with one proposal has no variance, so the confidence of its joints is unknown; it is
    left out as if nobody had been detected.

    Parameters
    ----------
    path : Path

    Returns
    -------
    RawDetections

    Raises
    ------
    InputError
        The file is damaged, a group has no score, or a proposal has no joints. The message names
        the file, the frame and the joint.
    """
    data = load_json(path)
    names = _names(path, data)
    people = field(path, data, "people")
    if not isinstance(people, list) or len(people) > LONGEST_CLIP * MOST_PEOPLE:
        raise InputError(f"{path}: 'people' must be a list, one entry a person a frame")
    groups = [_group(path, number, entry, names) for number, entry in enumerate(people)]
    known = [g for g in groups if len(g.pixels) > 1]
    if not known:
        raise InputError(f"{path}: no person with two proposals or more, so no variance")
    detected = list(DETECTED)
    variances = np.stack([proposal_variance(g.positions, g.score)[detected] for g in known])
    percentile = float(np.percentile(np.log(np.maximum(variances, _SMALLEST)), 99))
    scores = np.zeros((len(known), len(JOINTS)))
    try:
        scores[:, detected] = proposal_confidence(variances, percentile)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    positions = np.stack([g.positions.mean(0) for g in known])
    frames = np.array([g.frame for g in groups], np.int64)
    size = data.get("size")
    if size is not None:
        sides = numbers(size, shape=(2,), place=f"{path}: size")
        if not (np.abs(sides) <= LARGEST_IMAGE).all():
            raise InputError(f"{path}: size {size!r:.60}; {LARGEST_IMAGE} a side at most")
        width, height = sides.astype(int).tolist()
        size = (width, height)
    return RawDetections(
        name=path.stem,
        map_name="identity",
        frames=np.array([g.frame for g in known], np.int64),
        keypoints=np.stack([g.pixels.mean(0) for g in known]),
        scores=scores,
        span=(int(frames.min()), int(frames.max())),
        poses=positions - positions[:, [PELV]],
        size=size,
        fps=None if data.get("fps") is None else _positive(path, data["fps"]),
    )


def _positive(path: Path, value: Any) -> float:
    rate = float(numbers(value, shape=(), place=f"{path}: fps"))
    if rate <= 0:
        raise InputError(f"{path}: fps = {rate} must be positive")
    return rate


def _names(path: Path, data: Any) -> list[str]:
    names = field(path, data, "joints")
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise InputError(f"{path}: 'joints' must list the names of the proposals' joints")
    return names


def _group(path: Path, number: int, entry: Any, names: list[str]) -> _Group:
    if not isinstance(entry, dict) or "frame" not in entry:
        raise InputError(f"{path}, person {number}: no 'frame'")
    frame = frame_number(path, entry["frame"])
    place = f"{path}, frame {frame}"
    if entry.get("score") is None:
        raise InputError(
            f"{place}: proposals without a 'score'; write the per-pose score of the group"
        )
    score = float(numbers(entry["score"], shape=(), place=f"{place}: score"))
    proposals = entry.get("proposals")
    if not isinstance(proposals, list) or not 0 < len(proposals) <= _MOST_PROPOSALS:
        raise InputError(f"{place}: 'proposals' must be a list of 1 to {_MOST_PROPOSALS} poses")
    planar = np.stack([_joints(place, p, "pose2d", names, 2) for p in proposals])
    spatial = np.stack([_joints(place, p, "pose3d", names, 3) for p in proposals])
    pixels = joints_by_name(np.pad(planar, ((0, 0), (0, 0), (0, 1))), names)[..., :2]
    x, y, z = np.moveaxis(joints_by_name(spatial, names), -1, 0)
    return _Group(frame, score, pixels, np.stack([x, z, -y], -1))


def _joints(place: str, proposal: Any, key: str, names: list[str], axes: int) -> Array:
    """(J, axes) coordinates of one proposal."""
    listed = proposal.get(key) if isinstance(proposal, dict) else None
    if not isinstance(listed, list) or len(listed) != len(names):
        count = len(listed) if isinstance(listed, list) else "no"
        raise InputError(f"{place}: {count} joints in '{key}', expected {len(names)}")
    found = np.stack(
        [
            numbers(row, shape=(axes,), place=f"{place}, joint {name}, {key}")
            for row, name in zip(listed, names, strict=True)
        ]
    )
    if not (np.abs(found) <= FARTHEST).all():
        name = names[int((np.abs(found) > FARTHEST).any(1).argmax())]
        raise InputError(f"{place}, joint {name}: {key} is too far away to be true")
    return found
