"""Penetration of furniture and bodies, and joints below the floor (model.md 15 to 17).

All penalties use the negative part of a signed distance: for two objects that of their footprints,
for a body in an object the least of all directions. Trunk, thighs and shins represent the body
(equation 16), each as a vertical line on the floor from its lowest to its highest joint. (The paper
prints L_m with the positive part, which would reward walking through furniture.)
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled, inlined, inner, inner_inlined
from imapper_prob.models.kernels.axes import rotated_back
from imapper_prob.models.settings import LEVEL
from imapper_prob.models.skeleton import HEAD, LANK, LHIP, LKNE, PELV, RANK, RHIP, RKNE

__all__ = [
    "BOTH",
    "DISPLACED",
    "N_DISPLACED",
    "PROBABILITIES",
    "aabb_disjoint",
    "add_displaced_depth",
    "column_depth",
    "depth_below_floor",
    "depth_in_box",
    "footprint_depth",
    "marginal_penetration_cost",
    "overlap_depth",
    "set_body_columns",
    "set_footprint",
]

Array = NDArray[np.float64]
DISPLACED = (0.0, 0.1573, 0.4888, 0.8871, 1.5341)
"""Displacements of furniture out of the way, in standard deviations.

The positive half of a standard normal distribution is represented by four values of equal
probability, at the quantiles 9/16, 11/16, 13/16 and 15/16; the negative half, by 0."""
PROBABILITIES = (0.5, 0.125, 0.125, 0.125, 0.125)
BOTH = math.sqrt(2.0)
"""Standard deviation of the distance of two objects that are each displaced by one."""
N_DISPLACED = len(DISPLACED)


@inlined
def overlap_depth(a: Array, turn_a: Array, b: Array, turn_b: Array) -> float:
    """Penetration depth of two boxes on the floor, given cosine and sine of their yaws.

    The depth is the least translation along a side of either rectangle that separates them
    (separating axis theorem); 0 if the boxes do not overlap in height.

    Parameters
    ----------
    a : (7,) float
        In the world.
    turn_a : (2 or more,) float
        Cosine and sine of its yaw.
    b, turn_b
        The same for the other box.

    Returns
    -------
    float
        Metres.
    """
    if min(a[2] + a[5], b[2] + b[5]) - max(a[2] - a[5], b[2] - b[5]) <= LEVEL:
        return 0.0
    dx, dy = b[0] - a[0], b[1] - a[1]
    c, s = rotated_back(turn_a[0], turn_a[1], turn_b[0], turn_b[1])
    c, s = abs(c), abs(s)
    depth = math.inf
    for which in range(2):
        own, other, turn = (a, b, turn_a) if which == 0 else (b, a, turn_b)
        along, across = rotated_back(turn[0], turn[1], dx, dy)
        depth = min(depth, own[3] + c * other[3] + s * other[4] - abs(along))
        depth = min(depth, own[4] + s * other[3] + c * other[4] - abs(across))
    return max(depth, 0.0)


@compiled
def footprint_depth(a: Array, b: Array) -> float:
    """Penetration depth of two boxes on the floor.

    Parameters
    ----------
    a, b : (7,) float
        In the world.

    Returns
    -------
    float
        Metres; 0 when apart.
    """
    turn_a = np.array([math.cos(a[6]), math.sin(a[6])])
    turn_b = np.array([math.cos(b[6]), math.sin(b[6])])
    return overlap_depth(a, turn_a, b, turn_b)


@inlined
def column_depth(x: float, y: float, low: float, high: float, box: Array, turn: Array) -> float:
    """Penetration depth of a vertical line in a box.

    The depth is the least translation, sideways, up or down, that separates them. So a person who
    sits slightly too low penetrates the seat slightly, whatever its width.

    Parameters
    ----------
    x, y : float
        Position of the line, metres.
    low, high : float
        Heights of its ends, metres.
    box : (7,) float
    turn : (2 or more,) float
        Cosine and sine of its yaw.

    Returns
    -------
    float
        Metres; 0 outside.
    """
    up, down = box[2] + box[5] - low, high - (box[2] - box[5])
    along, across = rotated_back(turn[0], turn[1], x - box[0], y - box[1])
    depth: float = min(min(up, down), min(box[3] - abs(along), box[4] - abs(across)))
    return max(depth, 0.0)


@inlined
def add_displaced_depth(depth: float, spread: float, sums: Array) -> None:
    """Add the penetration depths that remain if furniture is displaced out of the way.

    Parameters
    ----------
    depth : float
        Depth at the furniture's position in the scenelet, metres.
    spread : float
        Standard deviation of the furniture's displacement, metres.
    sums : (5,) float
        Input and output, metres: sum of depths for each displacement in ``DISPLACED``.
    """
    for k in range(N_DISPLACED):
        sums[k] += max(depth - DISPLACED[k] * spread, 0.0)


@inlined
def marginal_penetration_cost(sums: Array, unit: float) -> float:
    """-log of the mean of exp(-cost) over displacements of the furniture (``model.md`` 16).

    Parameters
    ----------
    sums : (5,) float
        Depths summed over frames, metres, see :func:`add_displaced_depth`.
    unit : float
        Nats per metre.

    Returns
    -------
    float
        Nats.
    """
    least, total = sums[N_DISPLACED - 1], 0.0
    for k in range(N_DISPLACED):
        total += PROBABILITIES[k] * math.exp(-unit * (sums[k] - least))
    cost: float = unit * least - math.log(total)
    return cost


@inlined
def depth_below_floor(joints: Array, row: int) -> float:
    """Depth of the lowest joint of a frame below the floor.

    Parameters
    ----------
    joints : (R, 3, 16) float
        World, metres.
    row : int

    Returns
    -------
    float
        Metres; 0 above.
    """
    lowest = 0.0
    for j in range(16):
        lowest = min(lowest, joints[row, 2, j])
    return -lowest


_ABOVE_SEAT = -0.05
"""Height of the lower end of the trunk relative to the pelvis, metres."""
_REACH = 1.0
"""Largest horizontal distance of a body column from the pelvis, metres."""


@inner
def set_footprint(box: Array, turn: Array, footprint: Array) -> None:
    """Axis-aligned bounds of a box on the floor.

    Parameters
    ----------
    box : (7,) float
        In the world.
    turn : (2 or more,) float
        Cosine and sine of its yaw.
    footprint : (4,) float
        Output: least and greatest x, least and greatest y, metres.
    """
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
def set_body_columns(joints: Array, row: int, columns: Array, ground: Array, to: int) -> None:
    """Represent trunk, thighs and shins of a body as vertical lines.

    Parameters
    ----------
    joints : (R, 3, 16) float
        World, metres.
    row : int
        The body's.
    columns : (R, 5, 4) float
        Output, in row ``to``: x, y, lowest and highest z of each line.
    ground : (R, 4) float
        Output, in row ``to``: least and greatest x, least and greatest y of all lines.
    to : int
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
def aabb_disjoint(ground: Array, row: int, footprints: Array, k: int) -> bool:
    """Whether two axis-aligned bounds on the floor are disjoint.

    Parameters
    ----------
    ground : (R, 4) float
        Of bodies or boxes, see :func:`set_footprint`.
    row : int
    footprints : (K, 4) float
        Of boxes.
    k : int

    Returns
    -------
    bool
    """
    return bool(
        (footprints[k, 0] > ground[row, 1])
        | (footprints[k, 1] < ground[row, 0])
        | (footprints[k, 2] > ground[row, 3])
        | (footprints[k, 3] < ground[row, 2])
    )


@inlined
def depth_in_box(columns: Array, row: int, boxes: Array, rotations: Array, k: int) -> float:
    """Depth of the deepest body column in a box.

    Parameters
    ----------
    columns : (R, 5, 4) float
        See :func:`set_body_columns`.
    row : int
        The body's.
    boxes : (K, 7) float
        In the world.
    rotations : (K, 3) float
        Cosine and sine of their yaws, and half a diagonal (m).
    k : int
        The box.

    Returns
    -------
    float
        Metres; 0 outside.
    """
    dx, dy = columns[row, 0, 0] - boxes[k, 0], columns[row, 0, 1] - boxes[k, 1]
    if dx * dx + dy * dy > (rotations[k, 2] + _REACH) ** 2:
        return 0.0
    depth = 0.0
    for i in range(5):
        x, y, low, high = (
            columns[row, i, 0], columns[row, i, 1], columns[row, i, 2], columns[row, i, 3],
        )  # fmt: skip
        depth = max(depth, column_depth(x, y, low, high, boxes[k], rotations[k]))
    return depth
