"""Furniture of PiGraphs scans (Savva et al. 2016): ``<scene>.segs.json``.

``segGroups`` lists labelled parts, ``{"label": "chair/seat", "objectId": 3, "obb": {...}}``,
each in an oriented box: ``centroid``, ``axesLengths`` (full) and ``normalizedAxes`` (nine
numbers), metres, z up.
"""

from __future__ import annotations

import logging
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.inputs.json_fields import field, load_json, numbers
from imapper_prob.inputs.labels import category, left_out
from imapper_prob.inputs.upright import MeasuredBox, upright_object
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import SceneObject

__all__ = ["read_scan"]

Array = NDArray[np.float64]

_log = logging.getLogger(__name__)

_NEARLY_UPRIGHT: Final = 0.9
"""Cosine of 26 degrees: a box that leans less stands upright and leans by mistake."""

_THINNEST: Final = 0.01
"""Metres; boxes of flat surfaces have no height, and a cuboid needs one."""

_LOW_SHARE: Final = 5.0
"""Percentile of the boxes' lower ends that is the floor where none is labelled."""


def read_scan(path: str | Path) -> tuple[tuple[SceneObject, ...], float]:
    """The furniture of one room.

    Parameters
    ----------
    path : path
        ``<scene>.segs.json``.

    Returns
    -------
    objects : tuple of SceneObject
        With the floor at z = 0. Parts of one ``objectId`` are one object, whose front is
        opposite its back if a part is so called; otherwise it is one of the long sides, the
        one towards the middle of the room.
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
    """Label and part; a label without a part is its own part."""
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
    """(G, 3, 3) unit axes of the boxes, one a row.

    The files do not say whether the nine numbers are three axes or three coordinates of
    them. Boxes of furniture stand upright, so the reading by which more of them do is the
    right one. Where both do, they are axes one after the other, as in the authors' programs.
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
    """The upright box for an oriented one: itself, or one around it where it leans much."""
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
