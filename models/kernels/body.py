"""How deep a frame's body stands in boxes, by five columns, compiled.

Equation (16) of ``docs/model.md``: trunk, thighs and shins stand in for the body; each is a
vertical line on the floor plane from its lowest to its highest joint.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.energy.intersection import column_depth
from imapper_prob.models.jit import inlined, inner, inner_inlined
from imapper_prob.models.skeleton import HEAD, LANK, LHIP, LKNE, PELV, RANK, RHIP, RKNE

__all__ = ["apart", "depth_in_box", "set_columns", "set_footprint"]

Array = NDArray[np.float64]

_ABOVE_SEAT = -0.05
"""Metres from the pelvis to where the trunk starts."""

_REACH = 1.0
"""Metres a column may be from the pelvis."""


@inner
def set_footprint(box: Array, turn: Array, footprint: Array) -> None:
    """Least and greatest x, least and greatest y of a box (7,), metres, into (4,)."""
    c, s = abs(turn[0]), abs(turn[1])
    x, y = c * box[3] + s * box[4], s * box[3] + c * box[4]
    footprint[0], footprint[1] = box[0] - x, box[0] + x
    footprint[2], footprint[3] = box[1] - y, box[1] + y


@inner_inlined
def _set_column(
    joints: Array, row: int, upper: int, lower: int, columns: Array, to: int, k: int
) -> None:
    columns[to, k, 0] = 0.5 * (joints[row, 0, upper] + joints[row, 0, lower])
    columns[to, k, 1] = 0.5 * (joints[row, 1, upper] + joints[row, 1, lower])
    columns[to, k, 2] = min(joints[row, 2, upper], joints[row, 2, lower])
    columns[to, k, 3] = max(joints[row, 2, upper], joints[row, 2, lower])


@inlined
def set_columns(joints: Array, row: int, columns: Array, ground: Array, to: int) -> None:
    """Trunk, thighs and shins of the body ``joints[row]`` (3, 16).

    Parameters
    ----------
    joints : (R, 3, 16) float
        World, metres.
    columns : (R, 5, 4) float
        Out, in row ``to``: x, y, lowest and highest z of each.
    ground : (R, 4) float
        Out, in row ``to``: least and greatest x, least and greatest y of all columns.
    """
    # The trunk starts above the seat; each thigh and shin is a short column.
    columns[to, 0, 0], columns[to, 0, 1] = joints[row, 0, PELV], joints[row, 1, PELV]
    columns[to, 0, 2], columns[to, 0, 3] = joints[row, 2, PELV] + _ABOVE_SEAT, joints[row, 2, HEAD]
    _set_column(joints, row, RHIP, RKNE, columns, to, 1)
    _set_column(joints, row, RKNE, RANK, columns, to, 2)
    _set_column(joints, row, LHIP, LKNE, columns, to, 3)
    _set_column(joints, row, LKNE, LANK, columns, to, 4)
    left = right = columns[to, 0, 0]
    near = far = columns[to, 0, 1]
    for k in range(1, 5):
        left, right = min(left, columns[to, k, 0]), max(right, columns[to, k, 0])
        near, far = min(near, columns[to, k, 1]), max(far, columns[to, k, 1])
    ground[to, 0], ground[to, 1], ground[to, 2], ground[to, 3] = left, right, near, far


@inlined
def apart(ground: Array, row: int, footprints: Array, k: int) -> bool:
    """Whether ``ground[row]`` and ``footprints[k]`` (4,), of a body or a box, have no overlap."""
    return bool(
        (footprints[k, 0] > ground[row, 1])
        | (footprints[k, 1] < ground[row, 0])
        | (footprints[k, 2] > ground[row, 3])
        | (footprints[k, 3] < ground[row, 2])
    )


@inlined
def depth_in_box(columns: Array, row: int, boxes: Array, turns: Array, k: int) -> float:
    """How deep the deepest of ``columns[row]`` (5, 4) stands in box ``k``, metres; 0 outside.

    ``turns`` (K, 3) holds cosine and sine of the yaw of ``boxes`` (K, 7) and half a diagonal.
    """
    dx, dy = columns[row, 0, 0] - boxes[k, 0], columns[row, 0, 1] - boxes[k, 1]
    if dx * dx + dy * dy > (turns[k, 2] + _REACH) ** 2:
        return 0.0
    depth = 0.0
    for i in range(5):
        x, y, low, high = (
            columns[row, i, 0], columns[row, i, 1], columns[row, i, 2], columns[row, i, 3],
        )  # fmt: skip
        depth = max(depth, column_depth(x, y, low, high, boxes[k], turns[k]))
    return depth
