"""Read recordings of PiGraphs (Savva et al. 2016): people in scanned rooms, tracked by a Kinect.

A recording ``<scene>_<camera>_<time>.json`` has a ``camera`` (16 numbers, to the world of the scan:
metres, z up) and ``skeletons``, each with ``timestamp``, ``trackingId``, 25 ``jointPositions`` in
camera axes and as many ``jointConfidences``. Actions may be in ``<recording>.interactions.txt``,
and furniture is in ``<scene>.segs.json``; both are in the folder of the recording or below the
given folder.
"""

from __future__ import annotations

import logging
import re
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.clips.furniture import MeasuredBox, category, left_out, upright_object
from imapper_prob.clips.parsing import LARGEST_NUMBER, field, load_json, numbers
from imapper_prob.files import read_text
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import SceneObject
from imapper_prob.models.skeleton import HEAD, PELV
from imapper_prob.scenelets.captures import Capture, joints_at

__all__ = ["pigraphs_recordings", "read_pigraphs", "read_scan"]

Array = NDArray[np.float64]
_log = logging.getLogger(__name__)
_NEARLY_UPRIGHT: Final = 0.9
"""Cosine of 26 degrees: a box that leans less is taken as upright."""
_THINNEST: Final = 0.01
"""Least thickness in metres, because boxes of flat surfaces have no height."""
_LOW_SHARE: Final = 5.0
"""Percentile of the boxes' lower ends that is taken as the floor if no floor is labelled."""


def read_scan(path: str | Path) -> tuple[tuple[SceneObject, ...], float]:
    """Read the furniture of one room.

    Parameters
    ----------
    path : path
        ``<scene>.segs.json``.

    Returns
    -------
    objects : tuple of SceneObject
        With the floor at z = 0. Parts with the same ``objectId`` are one object. Its front is
        opposite a part called back; without one, it is the long side that faces the middle of the
        room.
    floor : float
        Height of the floor in the file, metres.

    Raises
    ------
    InputError
        The file is missing or damaged, or has no labelled furniture.
    """
    path = Path(path)
    groups = field(path, load_json(path), "segGroups")
    if not isinstance(groups, list) or not groups:
        raise InputError(f"{path}: 'segGroups' lists no parts; is the scan annotated?")
    labels = [_label(path, index, group) for index, group in enumerate(groups)]
    centres = np.stack([_numbers(path, i, g, "centroid", 3) for i, g in enumerate(groups)])
    sizes = np.stack([_numbers(path, i, g, "axesLengths", 3) for i, g in enumerate(groups)])
    if (sizes < 0).any():
        raise InputError(f"{path}: group {int(np.argmax((sizes < 0).any(1)))} has a negative size")
    axes = _axes(path, groups)
    heights = (np.abs(axes[:, :, 2]) * sizes).sum(1)
    floors = [c[2] for c, (label, _) in zip(centres, labels, strict=True) if label == "floor"]
    bottoms = centres[:, 2] - heights / 2
    floor = float(np.median(floors) if floors else np.percentile(bottoms, _LOW_SHARE))
    centres[:, 2] -= floor

    members: dict[tuple[str, str], list[MeasuredBox]] = defaultdict(list)
    others = []
    for index, (label, part) in enumerate(labels):
        kind = category(label)
        if kind is None:
            others.append(label)
            continue
        owner = str(groups[index].get("objectId", f"group {index}"))
        members[kind, owner].append(_upright(part, centres[index], axes[index], sizes[index]))
    if others:
        _log.warning("%s: %s", path, left_out(others))
    if not members:
        raise InputError(f"{path}: no part of {len(groups)} is labelled as furniture")
    middle = np.median(centres[:, :2], axis=0)
    objects = tuple(
        upright_object(kind, boxes, _front(boxes, middle)) for (kind, _), boxes in members.items()
    )
    return objects, floor


def _label(path: Path, index: int, group: Any) -> tuple[str, str]:
    """Label and part; a label without a part is its own part name."""
    if not isinstance(group, Mapping):
        raise InputError(f"{path}: group {index} is not an object")
    label = group.get("label", "")
    if not isinstance(label, str):
        raise InputError(f"{path}: group {index} has a label that is no text ({label!r})")
    kind, _, part = label.strip().lower().partition("/")
    return kind, part or kind


def _numbers(path: Path, index: int, group: Any, key: str, count: int) -> Array:
    values = field(path, group, "obb", key)
    return numbers(values, shape=(count,), place=f"{path}: group {index}, {key}")


def _axes(path: Path, groups: Sequence[Any]) -> Array:
    """(G, 3, 3) unit axes of the boxes, one per row.

    The files do not tell whether the nine numbers are three axes or three coordinates of them.
    Furniture is upright, so the reading with more upright boxes is used. If both are equal, they
    are axes one after the other, as in the authors' programs.
    """
    values = []
    for index, group in enumerate(groups):
        given = field(path, group, "obb", "normalizedAxes")
        shape = (3, 3) if isinstance(given, list) and len(given) == 3 else (9,)
        place = f"{path}: group {index}, normalizedAxes"
        axes = numbers(given, shape=shape, place=place).reshape(3, 3)
        if not np.allclose(axes @ axes.T, np.eye(3), atol=0.01):
            raise InputError(f"{place}: not three unit vectors at right angles")
        values.append(axes)
    rows = np.stack(values)
    columns = rows.transpose(0, 2, 1)

    def upright(axes: Array) -> int:
        return int((np.abs(axes[:, :, 2]).max(1) > _NEARLY_UPRIGHT).sum())

    return columns if upright(columns) > upright(rows) else rows


def _upright(part: str, centre: Array, axes: Array, size: Array) -> MeasuredBox:
    """The upright box for an oriented one: the box itself, or a bounding box if it leans much."""
    up = int(np.abs(axes[:, 2]).argmax())
    level = [i for i in range(3) if i != up]
    longer = max(level, key=lambda i: float(np.linalg.norm(axes[i, :2])) * size[i])
    yaw = float(np.arctan2(axes[longer, 1], axes[longer, 0]))
    if abs(axes[up, 2]) > _NEARLY_UPRIGHT:
        other = next(i for i in level if i != longer)
        extent = size[[longer, other, up]]
    else:
        c, s = np.cos(yaw), np.sin(yaw)
        frame = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        extent = np.abs(frame @ axes.T) @ size
    return MeasuredBox(part, centre, np.maximum(extent, _THINNEST), yaw)


def _front(boxes: Sequence[MeasuredBox], middle: Array) -> float:
    """Yaw of the object's front."""
    widest = max(boxes, key=lambda box: box.footprint_area)
    backs = [box for box in boxes if "back" in box.part]
    seats = [box for box in boxes if "back" not in box.part]
    quarter = np.pi / 2
    if backs and seats:
        away = np.mean([b.centre for b in seats], 0) - np.mean([b.centre for b in backs], 0)
        turns = [0, 1, 2, 3]
    else:
        away = np.append(middle, 0.0) - widest.centre
        turns = [0, 2]
    fronts = [widest.yaw + turn * quarter for turn in turns]
    best = max(fronts, key=lambda yaw: float(-np.sin(yaw) * away[0] + np.cos(yaw) * away[1]))
    return float(np.arctan2(np.sin(best), np.cos(best)))


# ------------------------------------------------------------------------------------------------
# Recordings.

_KINECT_JOINTS: Final = 25
"""Joints of a Kinect v2 skeleton."""
_FROM_KINECT: Final = (18, 17, 16, 12, 13, 14, 0, 20, 2, 3, 10, 9, 8, 4, 5, 6)
"""Kinect v2 joint (Microsoft's ``JointType``) for each of ours; its left is the person's own."""
_TICK: Final = 1e-7
"""Time unit of a Kinect, seconds."""
_MICROSECOND: Final = 1e-6
"""Time unit of some exports, seconds."""
_KINECT_STEP: Final = 0.03
"""Least time between skeletons, seconds: the sensor has 30 frames per second."""
_FPS: Final = 10.0
"""Frame rate to which skeletons are resampled, that of the library."""
_BRIDGED: Final = 0.3
"""Longest gap in seconds between two sightings of a joint that is interpolated."""
_LONGEST: Final = 4 * 3600.0
"""Longest duration in seconds; a longer recording has a damaged time."""
_VERBS: Final = {
    "lie": "lie", "sit": "sit", "walk": "walk", "reach": "reach", "grasp": "reach",
    "touch": "reach", "stand": "stand",
}  # fmt: skip
"""Verbs and our actions. The first one in this order applies: a person who sits and touches a table
sits."""
_INTERACTION: Final = re.compile(r"\s*(\d+(?:\.\d*)?)\s*-\s*(\d+(?:\.\d*)?)\s*,(.+)")
"""A line with start and end in seconds, and pairs of verb and noun."""


def pigraphs_recordings(path: str | Path) -> list[Path]:
    """Find recordings: ``path`` itself, or all in and below a folder.

    Parameters
    ----------
    path : path

    Returns
    -------
    list of Path

    Raises
    ------
    InputError
        There is none.
    """
    path = Path(path)
    found = [path] if path.is_file() else sorted(path.rglob("*.json"))
    # Names such as "<scene>.segs.json" are not recordings.
    recordings = [p for p in found if p.suffix == ".json" and "." not in p.stem]
    if not recordings:
        raise InputError(f"{path}: no PiGraphs recording there (<scene>_<camera>_<time>.json)")
    return recordings


def _scene_of(name: str) -> str:
    """The room of a recording, from its name."""
    return name.partition("_")[0]


def read_pigraphs(path: str | Path, *, folder: str | Path | None = None) -> list[Capture]:
    """Read the people of one recording.

    Parameters
    ----------
    path : path
        The recording.
    folder : path, optional
        Folder in which the scan is searched; by default that of the recording.

    Returns
    -------
    list of Capture
        One per person, in order of appearance, at ten frames per second. Frames in which a joint
        was lost for more than 0.3 s are NaN; people without any other frame are left out with a
        warning.

    Raises
    ------
    InputError
        A file is missing, damaged, or without people or furniture.
    """
    path = Path(path)
    scene = _scene_of(path.stem)
    folder = path.parent if folder is None else Path(folder)
    data = load_json(path)
    times, joints, people = _skeletons(path, data)
    camera = _camera(path, data, joints)
    objects, floor = read_scan(_scan(path, scene, folder))
    joints = joints @ camera[:3, :3].T + camera[:3, 3] - (0.0, 0.0, floor)
    moments = np.arange(int(np.floor(times[-1] * _FPS + 1e-9)) + 1) / _FPS
    actions = _actions(path.with_name(f"{path.stem}.interactions.txt"), moments)
    captures = []
    order = list(dict.fromkeys(people))
    for number, person in enumerate(order, 1):
        own = np.array([p == person for p in people])
        motion = joints_at(moments, times[own], joints[own], bridged=_BRIDGED)
        there = np.isfinite(motion[:, 0, 0])
        if not there.any():
            _log.warning(
                "%s: left out person %d of %d: never tracked whole", path, number, len(order)
            )
            continue
        captures.append(
            Capture(
                name=path.stem if len(order) == 1 else f"{path.stem}-{number}",
                scene=scene,
                joints=motion,
                objects=objects,
                fps=_FPS,
                actions=actions,
            )
        )
    if not captures:
        raise InputError(f"{path}: nobody was tracked with all joints in any frame")
    return captures


def _skeletons(path: Path, data: Any) -> tuple[Array, Array, list[Any]]:
    """Times in seconds since the first (S,), joints (S, 16, 3) in camera axes, and person IDs.

    Lost joints are NaN. Skeletons without any joint are left out, because the sensor always stores
    six bodies.
    """
    skeletons = field(path, data, "skeletons")
    if not isinstance(skeletons, list) or not all(isinstance(s, Mapping) for s in skeletons):
        raise InputError(f"{path}: 'skeletons' must be a list of skeletons")
    if not skeletons:
        raise InputError(f"{path}: nobody was tracked (no skeletons)")
    stamps = np.array(
        [
            numbers(field(path, s, "timestamp"), shape=(), place=f"{path}: skeleton {i}, timestamp")
            for i, s in enumerate(skeletons)
        ]
    )
    joints = np.stack([_positions(path, i, s) for i, s in enumerate(skeletons)])
    joints = joints[:, list(_FROM_KINECT)]
    seen: NDArray[np.bool_] = np.any(np.isfinite(joints), axis=(1, 2))
    if not seen.any():
        raise InputError(f"{path}: nobody was tracked in any of {len(skeletons)} skeletons")
    times = _seconds(stamps)
    if times.max() > _LONGEST:
        raise InputError(f"{path}: times run over {times.max() / 3600:.0f} hours; one is damaged")
    order = [i for i in np.argsort(stamps, kind="stable") if seen[i]]
    return times[order], joints[order], [skeletons[i].get("trackingId", 0) for i in order]


def _positions(path: Path, index: int, skeleton: Mapping[str, Any]) -> Array:
    """(25, 3) joints; NaN where the tracker has no confidence."""
    place = f"{path}: skeleton {index}"
    given = field(path, skeleton, "jointPositions")
    try:
        # JSON has no NaN: writers use null, or a word that Python parses as NaN.
        positions = np.array(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{place}: jointPositions must be numbers") from error
    if positions.shape != (_KINECT_JOINTS, 3):
        raise InputError(
            f"{place}: jointPositions have shape {positions.shape}, expected ({_KINECT_JOINTS}, 3)"
        )
    confidence = numbers(
        skeleton.get("jointConfidences", [1.0] * _KINECT_JOINTS),
        shape=(_KINECT_JOINTS,),
        place=f"{place}, jointConfidences",
    )
    lost = (confidence <= 0) | ~(np.abs(positions) < LARGEST_NUMBER).all(1)
    positions[lost] = np.nan
    return positions


def _seconds(stamps: Array) -> Array:
    """Times of skeletons in seconds since the first one.

    The file does not state the unit. A Kinect counts ticks of 100 ns; if that would give more than
    its 30 skeletons per second, the unit is microseconds.
    """
    steps = np.diff(np.unique(stamps))
    step = float(np.median(steps)) if len(steps) else 0.0
    unit = _TICK if step * _TICK >= _KINECT_STEP else _MICROSECOND
    seconds: Array = (stamps - stamps.min()) * unit
    return seconds


def _camera(path: Path, data: Any, joints: Array) -> Array:
    """(4, 4) camera to world, from the one of both orders of 16 numbers that is a rigid motion."""
    given = numbers(field(path, data, "camera"), shape=(16,), place=f"{path}: camera")
    rigid = [
        m for m in (given.reshape(4, 4), given.reshape(4, 4).T)
        if np.allclose(m[3], (0, 0, 0, 1), atol=1e-6)
        and np.allclose(m[:3, :3] @ m[:3, :3].T, np.eye(3), atol=1e-3)
    ]  # fmt: skip
    if not rigid:
        raise InputError(f"{path}: camera is not a rotation and a translation, in either order")
    # Without a translation both are rigid; then heads must be up.
    upward = np.nansum(joints[:, HEAD] - joints[:, PELV], axis=0)
    return max(rigid, key=lambda m: float(m[2, :3] @ upward))


def _scan(path: Path, scene: str, folder: Path) -> Path:
    name = f"{scene}.segs.json"
    beside = path.with_name(name)
    found = [beside] if beside.is_file() else sorted(folder.rglob(name))
    if not found:
        raise InputError(f"{path}: no scan {name} beside it or below {folder}")
    return found[0]


def _actions(path: Path, moments: Array) -> tuple[str, ...]:
    """An action for each time, from lines such as ``3.2-7.5,sit:chair|touch:table``."""
    if not path.is_file():
        return ()
    words = np.full(len(moments), "", dtype=object)
    strange: Counter[str] = Counter()
    for number, line in enumerate(read_text(path).splitlines(), 1):
        if not line.strip():
            continue
        match = _INTERACTION.fullmatch(line)
        if match is None:
            raise InputError(
                f"{path}, line {number}: expected <start>-<end>,<verb>:<noun>, got {line!r}"
            )
        start, end = float(match[1]), float(match[2])
        verbs = [pair.partition(":")[0].strip().lower() for pair in match[3].split("|")]
        action = next((_VERBS[verb] for verb in _VERBS if verb in verbs), None)
        if action is None:
            strange["|".join(verbs)] += 1
            continue
        words[(moments >= start) & (moments <= end)] = action
    if strange:
        listed = ", ".join(f"{count} of {verb}" for verb, count in strange.items())
        _log.warning("%s: interactions without an action of ours: %s", path, listed)
    return tuple(str(word) for word in words)
