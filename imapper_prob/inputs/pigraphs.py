"""Recordings of PiGraphs (Savva et al. 2016): people in scanned rooms, tracked by a Kinect.

A recording ``<scene>_<camera>_<time>.json`` has a ``camera`` (16 numbers, to the world of the
scan: metres, z up) and ``skeletons``, each with ``timestamp``, ``trackingId``, 25
``jointPositions`` in camera axes and as many ``jointConfidences``. What people do may be in
``<recording>.interactions.txt``, the furniture is in ``<scene>.segs.json``; both beside the
recording or anywhere in the same folder.
"""

from __future__ import annotations

import logging
import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.inputs.captures import Capture
from imapper_prob.inputs.json_fields import LARGEST_NUMBER, field, load_json, load_lines, numbers
from imapper_prob.inputs.pigraphs_scan import read_scan
from imapper_prob.inputs.timeline import joints_at
from imapper_prob.models.errors import InputError
from imapper_prob.models.skeleton import HEAD, PELV

__all__ = ["pigraphs_recordings", "read_pigraphs"]

Array = NDArray[np.float64]

_log = logging.getLogger(__name__)

_KINECT_JOINTS: Final = 25

_FROM_KINECT: Final = (18, 17, 16, 12, 13, 14, 0, 20, 2, 3, 10, 9, 8, 4, 5, 6)
"""Kinect v2 joint (Microsoft's ``JointType``) of each of ours; its left is the person's own."""

_TICK: Final = 1e-7
"""Seconds; the unit of a Kinect's time."""
_MICROSECOND: Final = 1e-6
"""Seconds; the unit of times in some exports."""
_KINECT_STEP: Final = 0.03
"""Seconds between skeletons are never fewer: the sensor sees 30 a second."""

_FPS: Final = 10.0
"""Frames a second that the uneven skeletons are brought to; that of the library."""
_BRIDGED: Final = 0.3
"""Seconds between two sightings of a joint that are bridged by a straight line."""
_LONGEST: Final = 4 * 3600.0
"""Seconds; a longer recording has a damaged time."""

_VERBS: Final = {
    "lie": "lie", "sit": "sit", "walk": "walk", "reach": "reach", "grasp": "reach",
    "touch": "reach", "stand": "stand",
}  # fmt: skip
"""Verbs and our actions; the first in this order that is there counts, because somebody who
sits and touches a table sits."""

_INTERACTION: Final = re.compile(r"\s*(\d+(?:\.\d*)?)\s*-\s*(\d+(?:\.\d*)?)\s*,(.+)")
"""Seconds from, seconds to, and verbs with nouns."""


def pigraphs_recordings(path: str | Path) -> list[Path]:
    """Recordings: ``path`` itself, or all in a folder and below."""
    path = Path(path)
    found = [path] if path.is_file() else sorted(path.rglob("*.json"))
    # "<scene>.segs.json" and the like are no recordings.
    recordings = [p for p in found if p.suffix == ".json" and "." not in p.stem]
    if not recordings:
        raise InputError(f"{path}: no PiGraphs recording there (<scene>_<camera>_<time>.json)")
    return recordings


def _scene_of(name: str) -> str:
    """The room of a recording, by its name."""
    return name.partition("_")[0]


def read_pigraphs(path: str | Path, *, folder: str | Path | None = None) -> list[Capture]:
    """The people of one recording.

    Parameters
    ----------
    path : path
        The recording.
    folder : path, optional
        Where to look for the scan; where the recording is, if not given.

    Returns
    -------
    list of Capture
        One for each person, in the order of their appearance, ten frames a second. Frames in
        which a joint was lost for more than 0.3 s are NaN; people without any other frame
        are left out with a warning.

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
    """Seconds since the first (S,), joints (S, 16, 3) in camera axes, and who it is.

    Joints are NaN where lost. Skeletons without any joint are left out: the sensor has
    places for six bodies, seen or not.
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
    """(25, 3) joints; NaN where the tracker has no confidence in them."""
    place = f"{path}: skeleton {index}"
    given = field(path, skeleton, "jointPositions")
    try:
        # JSON has no NaN: writers put null there, or the word that Python reads as one.
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
    """Times of skeletons since the first, in seconds.

    The unit is not in the file. A Kinect counts ticks of 100 ns; where that would be more
    than its 30 skeletons a second, the numbers are microseconds.
    """
    steps = np.diff(np.unique(stamps))
    step = float(np.median(steps)) if len(steps) else 0.0
    unit = _TICK if step * _TICK >= _KINECT_STEP else _MICROSECOND
    seconds: Array = (stamps - stamps.min()) * unit
    return seconds


def _camera(path: Path, data: Any, joints: Array) -> Array:
    """(4, 4) camera to world; of the two ways to read 16 numbers the one that is rigid."""
    given = numbers(field(path, data, "camera"), shape=(16,), place=f"{path}: camera")
    rigid = [
        m for m in (given.reshape(4, 4), given.reshape(4, 4).T)
        if np.allclose(m[3], (0, 0, 0, 1), atol=1e-6)
        and np.allclose(m[:3, :3] @ m[:3, :3].T, np.eye(3), atol=1e-3)
    ]  # fmt: skip
    if not rigid:
        raise InputError(f"{path}: camera is not a rotation and a translation, in either order")
    # Without a translation both are: people have their heads up.
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
    """A word for each moment, from lines such as ``3.2-7.5,sit:chair|touch:table``."""
    if not path.is_file():
        return ()
    words = np.full(len(moments), "", dtype=object)
    strange: Counter[str] = Counter()
    for number, line in enumerate(load_lines(path), 1):
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
