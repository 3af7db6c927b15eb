"""OpenPose folders: one JSON file a frame, with the people in any order.

Three joint orders are in use, and two of them have 25 keypoints: BODY_25 and BODY_25B. The files do
not state which. It is inferred from the bodies: only in the right order do eyes, ears, toes and
heels lie near the joints they are connected to.
"""

from __future__ import annotations

import logging
import re
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.clips.assemble import FARTHEST, RawDetections
from imapper_prob.clips.keypoints import KEYPOINT_SETS, not_reported, sixteen
from imapper_prob.clips.parsing import load_json
from imapper_prob.models.errors import InputError
from imapper_prob.models.settings import LONGEST_CLIP, MOST_PEOPLE

__all__ = ["ORDERS", "is_openpose", "read_openpose"]

Array = NDArray[np.float64]

_log = logging.getLogger(__name__)

ORDERS: Final = ("body_25", "body_25b", "coco_18")
"""Joint orders of OpenPose, which are also format names."""

_NEIGHBOURS: Final = (
    ("nose", "left_eye"), ("nose", "right_eye"), ("left_eye", "left_ear"),
    ("right_eye", "right_ear"), ("left_ankle", "left_heel"), ("right_ankle", "right_heel"),
    ("left_ankle", "left_big_toe"), ("right_ankle", "right_big_toe"),
)  # fmt: skip
"""Pairs of keypoints that are always close together."""
_NEAR: Final = 0.12
"""Greatest median distance of such neighbours, as a fraction of the body's extent: it is .03 to .07
in the right order of the fixtures, and .3 or more in the wrong one."""
_CLEARLY: Final = 2.0
"""Least ratio of the neighbours' distances in the wrong order to those in the right one."""
_LOOKED_AT: Final = 5
"""Files of a folder that are read to find out whether they are of OpenPose; chosen."""
_TOUCHING: Final = 0.1
"""Tolerance for points outside an image scaled to [0, 1], as a fraction of its size."""


def is_openpose(folder: Path) -> bool:
    """Whether a folder holds OpenPose files; a few files are read, because some may be damaged.

    Parameters
    ----------
    folder : Path

    Returns
    -------
    bool
    """
    for path in _files(folder)[:_LOOKED_AT]:
        with suppress(InputError):
            data = load_json(path)
            if isinstance(data, dict) and isinstance(data.get("people"), list):
                return True
    return False


def _files(folder: Path) -> list[Path]:
    """Its JSON files by name, without the hidden ones that some systems put beside files."""
    return sorted(path for path in folder.glob("*.json") if not path.name.startswith("."))


def read_openpose(folder: Path, *, order: str | None = None) -> RawDetections:
    """Read all people of all frames.

    Parameters
    ----------
    folder : Path
        The frame number is the last number in each file name, apart from ``_keypoints``.
    order : str, optional
        One of :data:`ORDERS`; inferred if not given.

    Returns
    -------
    RawDetections

    Raises
    ------
    InputError
        A file is damaged, the joints are clearly in another order than the one given, or no order
        can be inferred.
    """
    files = _numbered(folder)
    frames: list[int] = []
    people: list[Array] = []
    identities: list[str] = []
    for frame, path in files.items():
        data = load_json(path)
        if not isinstance(data, dict) or not isinstance(data.get("people"), list):
            raise InputError(
                f"{path}: no list 'people'; is this a file of OpenPose? Move others elsewhere"
            )
        if len(data["people"]) > MOST_PEOPLE:
            raise InputError(f"{path}: {len(data['people'])} people; at most {MOST_PEOPLE}")
        for number, person in enumerate(data["people"]):
            people.append(_person(path, number, person))
            frames.append(frame)
            identities.append(_identity(person))
    lengths = sorted({len(p) for p in people})
    if not lengths:
        raise InputError(f"{folder}: nobody in any of the {len(files)} frames")
    if len(lengths) > 1:
        raise InputError(
            f"{folder}: people with {lengths[0]} and with {lengths[1]} keypoints; keep the files "
            "of one model"
        )
    table = np.stack(people)
    order = _order(folder, table, order)
    names = KEYPOINT_SETS[order]
    seen = table[table[..., 2] > 0]
    relative = bool(len(seen)) and bool(np.abs(seen[:, :2]).max() <= 1 + _TOUCHING)
    points = table[..., :2]
    if relative and (seen[:, :2] < -_TOUCHING).any():
        points = (points + 1) / 2  # OpenPose's option that scales to [-1, 1]
    keypoints, scores = sixteen(points, table[..., 2], names)
    told_apart = all(identities) and _once_a_frame(frames, identities)
    return RawDetections(
        name=folder.resolve().name,
        map_name="openpose",
        frames=np.array(frames, np.int64),
        keypoints=keypoints,
        scores=scores,
        span=(min(files), max(files)),
        identities=tuple(identities) if told_apart else (),
        relative=relative,
        missing=not_reported(names),
    )


def _numbered(folder: Path) -> dict[int, Path]:
    """Files by frame number, in order."""
    files: dict[int, Path] = {}
    for path in _files(folder):
        numbers = re.findall(r"\d+", path.stem.removesuffix("_keypoints"))
        if not numbers:
            raise InputError(f"{path}: no frame number in the name")
        frame = int(numbers[-1][-18:])
        if frame in files:
            raise InputError(
                f"{folder}: {files[frame].name} and {path.name} are both frame {frame}"
            )
        files[frame] = path
        if len(files) > LONGEST_CLIP:
            raise InputError(f"{folder}: more than {LONGEST_CLIP} frames; cut the clip")
    if not files:
        raise InputError(f"{folder}: no .json files")
    return dict(sorted(files.items()))


def _person(path: Path, number: int, person: Any) -> Array:
    """(J, 3) pixels and score of one person; 0, 0, 0 is a missing point."""
    flat = person.get("pose_keypoints_2d") if isinstance(person, dict) else None
    counts = [3 * len(KEYPOINT_SETS[order]) for order in ORDERS]
    if not isinstance(flat, list) or len(flat) not in counts:
        count = len(flat) if isinstance(flat, list) else "no"
        raise InputError(
            f"{path}, person {number}: {count} numbers in 'pose_keypoints_2d', expected 75 "
            "(BODY_25, BODY_25B) or 54 (COCO)"
        )
    if not all(type(value) in (int, float) for value in flat):
        raise InputError(f"{path}, person {number}: something in 'pose_keypoints_2d' is no number")
    try:
        table = np.array(flat, float).reshape(-1, 3)
    except OverflowError:
        table = np.full((len(flat) // 3, 3), np.inf)
    fits = (np.abs(table) <= FARTHEST).all(1)
    if not fits.all():
        joint = int(np.argmin(fits))
        fitting = [KEYPOINT_SETS[o] for o in ORDERS if len(KEYPOINT_SETS[o]) == len(table)]
        named = " or ".join(dict.fromkeys(names[joint] for names in fitting))
        raise InputError(
            f"{path}, person {number}, keypoint {joint}: {table[joint]} is no pixel; write 0, 0, 0 "
            f"for a {named} that is missing"
        )
    return table


def _identity(person: dict[str, Any]) -> str:
    """The person's number if the program tracked people; −1 means that it did not."""
    given = person.get("person_id")
    if isinstance(given, list) and len(given) == 1 and type(given[0]) is int and given[0] >= 0:
        return str(given[0])
    return ""


def _once_a_frame(frames: list[int], identities: list[str]) -> bool:
    pairs = list(zip(frames, identities, strict=True))
    return len(set(pairs)) == len(pairs)


def _order(folder: Path, table: Array, said: str | None) -> str:
    """The joint order of the folder."""
    fitting = [order for order in ORDERS if len(KEYPOINT_SETS[order]) == table.shape[1]]
    if said is not None and said not in fitting:
        raise InputError(
            f"{folder}: {table.shape[1]} keypoints a person, {said} has {len(KEYPOINT_SETS[said])}"
        )
    if len(fitting) == 1:
        return fitting[0]
    apart = {order: _neighbours_apart(table, KEYPOINT_SETS[order]) for order in fitting}
    best, second = sorted(fitting, key=lambda order: apart[order])
    clear = apart[best] < _NEAR and apart[second] > _CLEARLY * apart[best]
    if said is None:
        if not clear:
            raise InputError(
                f"{folder}: 25 keypoints a person, and too few of them to tell BODY_25 from "
                "BODY_25B; say --format body_25 or --format body_25b"
            )
        _log.info("%s: joints in the order of %s", folder, best.upper())
        return best
    if clear and said != best:
        raise InputError(
            f"{folder}: these joints are in the order of {best.upper()}, not {said.upper()} "
            f"(eyes, ears, heels and toes would be in the wrong places); say --format {best}"
        )
    return said


def _neighbours_apart(table: Array, names: tuple[str, ...]) -> float:
    """Median distance of neighbours as a fraction of the body's extent; infinite if none is
    seen."""
    points = np.where(table[..., 2:] > 0, table[..., :2], np.nan)
    there = np.isfinite(points[..., 0])
    some = there.sum(1) >= 2
    if not some.any():
        return np.inf
    points = points[some]
    extent = np.linalg.norm(np.nanmax(points, 1) - np.nanmin(points, 1), axis=-1)
    pairs = [(names.index(a), names.index(b)) for a, b in _NEIGHBOURS if a in names and b in names]
    one, other = np.transpose(pairs)
    apart = np.linalg.norm(points[:, one] - points[:, other], axis=-1)
    relative = apart / np.maximum(extent, 1e-9)[:, None]
    values = relative[np.isfinite(relative)]
    return float(np.median(values)) if len(values) else np.inf
