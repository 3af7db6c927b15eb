"""Lines of sight: their clearance from boxes, and the probability that a joint is seen.

The volume hidden by a union of boxes is the set of points whose line of sight cuts a box. The
clearance is negative exactly inside it and grows smoothly outside. It is capped where no box is
near; the paper's occlusion distance is undefined there (Monszpart et al. 2019, F(v, c)).

All joints of a frame are processed at once. The flat scratch array holds a row of sixteen numbers
for every quantity, so that the compiler can vectorise over joints. Single precision is accurate to
a micrometre; visibility changes over centimetres. For a line that starts at ``p`` and runs along
``d`` in the axes of a box with half sides ``h``, the minimum of ``max_i |p_i + s d_i| - h_i`` over
s in [0, 1] is the maximum of

    -h_i,    |p_i + d_i / 2| - |d_i| / 2 - h_i                             for every axis,
    (|p_i d_k - p_k d_i| - |d_k| h_i - |d_i| h_k) / (|d_i| + |d_k|)        for every pair:

By duality, the minimum of a maximum of linear functions is the maximum of the minima of one or two
of them. These are the separating axes of a segment and a box.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled, inlined, inner_inlined
from imapper_prob.models.kernels.axes import corner_of, rotated_back
from imapper_prob.models.settings import NEAR_SIGHT, NOTHING_IN_SIGHT, OPAQUE

__all__ = [
    "GAP",
    "LINE",
    "OCCLUDER",
    "SCRATCH32",
    "VIEW",
    "Singles",
    "bounds_overlap",
    "clearances",
    "open_bounds",
    "ray_bounds",
    "ray_endpoints",
    "set_occluder",
    "update_clearance",
    "visibility_probability",
]

Array = NDArray[np.float64]
Singles = NDArray[np.float32]


@inlined
def _set_window(
    elevation: float, box: Array, turn: Array, window: Array | NDArray[np.float32]
) -> None:
    """Bounds in the view of all lines of sight that a box may affect.

    Lines of sight outside these bounds have a clearance at the cap. A box that reaches behind the
    camera has no bounds.

    Parameters
    ----------
    elevation : float
        Height of the camera, metres.
    box : (7,) float
        In the world.
    turn : (2 or more,) float
        Cosine and sine of its yaw.
    window : (5 or more,) float or single
        Output: bounds of bearing x / y and of slope (z - elevation) / y, and the smallest y, of the
        box enlarged by ``NOTHING_IN_SIGHT`` on every side.
    """
    left, right, low, high, nearest = math.inf, -math.inf, math.inf, -math.inf, math.inf
    for corner in range(4):
        x, y = corner_of(box, turn, corner, NOTHING_IN_SIGHT)
        nearest = min(nearest, y)
        if y > NEAR_SIGHT:
            bottom = box[2] - box[5] - NOTHING_IN_SIGHT - elevation
            top = box[2] + box[5] + NOTHING_IN_SIGHT - elevation
            left, right = min(left, x / y), max(right, x / y)
            low, high = min(low, bottom / y), max(high, top / y)
    if nearest <= NEAR_SIGHT:
        left, right, low, high = -math.inf, math.inf, -math.inf, math.inf
    window[0], window[1], window[2], window[3], window[4] = left, right, low, high, nearest


@compiled
def visibility_probability(distance: float, width: float, visibility_error: float) -> float:
    """m(v), the probability that a joint is seen: a smooth step in the clearance.

    Parameters
    ----------
    distance : float
        v, the clearance, metres.
    width : float
        Width of the step, metres.
    visibility_error : float
        Probability of the opposite at either end of the step.

    Returns
    -------
    float
    """
    scaled = min(max(distance / width, -30.0), 30.0)
    return visibility_error + (1.0 - 2.0 * visibility_error) / (1.0 + math.exp(-scaled))


_X, _Y, _Z = 0, 16, 32
"""Offsets of x, y and z in a row of lines: vectors from the camera to each joint, metres."""
LINE = 48
"""Numbers of a frame's lines of sight."""
VIEW, OCCLUDER = 5, 15
"""Lengths of a frame's view bounds, and of a box's occluder."""

# Offsets in the scratch array. Half of every line, in a box's axes;
_MIDDLE = 0
# for the axis pairs 01, 02, 12: |d_i| / (|d_i| + |d_k|), and the share of |d_k| with the sign of
# d_i d_k.
_FIRST, _SECOND = 48, 96
# Offsets in `ray_bounds`, for every joint.
_BEARING, _SLOPE = 0, 16
GAP = 144
"""Offset of the clearance of every joint, metres."""
SCRATCH32 = 192
"""Length of the scratch array."""

# Single precision, because one double operand would promote the whole expression.
_HALF, _ONE, _CAP = np.float32(0.5), np.float32(1.0), np.float32(NOTHING_IN_SIGHT)
_EVERYWHERE = np.float32(np.inf)
_LEVEL = np.float32(1e-12)
"""Least component of a line along an axis, metres, which avoids division by zero; it changes the
clearance by no more than this."""


@inlined
def set_occluder(elevation: float, box: Array, turn: Array, occluder: Singles) -> None:
    """Precompute what :func:`update_clearance` needs of a box.

    Parameters
    ----------
    elevation : float
        Height of the camera, metres.
    box : (7,) float
        In the world.
    turn : (2 or more,) float
        Cosine and sine of its yaw.
    occluder : (15,) single
        Output: bounds of :func:`_set_window`; cosine and sine of the yaw; the camera in the box's
        axes; half sides; factor on negative clearance for thin boxes; least value of the box
        function.
    """
    _set_window(elevation, box, turn, occluder)
    occluder[5], occluder[6] = turn[0], turn[1]
    occluder[7], occluder[8] = rotated_back(turn[0], turn[1], -box[0], -box[1])
    occluder[9] = elevation - box[2]
    occluder[10], occluder[11], occluder[12] = box[3], box[4], box[5]
    thinnest = min(box[3], box[4], box[5])
    occluder[13] = max(1.0, OPAQUE / thinnest)
    occluder[14] = -thinnest


@inlined
def ray_endpoints(elevation: float, joints: Array, lines: Singles, row: int) -> None:
    """Vectors from the camera to the joints of a frame.

    Parameters
    ----------
    elevation : float
        Height of the camera, metres.
    joints : (R, 3, 16) float
        World, metres.
    lines : (R, 48) single
        Output, in row ``row``: vectors from the camera to each joint, metres.
    row : int
    """
    for j in range(joints.shape[2]):
        lines[row, _X + j] = joints[row, 0, j]
    for j in range(joints.shape[2]):
        lines[row, _Y + j] = joints[row, 1, j]
    for j in range(joints.shape[2]):
        lines[row, _Z + j] = joints[row, 2, j] - elevation


@inlined
def ray_bounds(lines: Singles, row: int, scratch32: Singles, views: Singles) -> None:
    """Bounds of a frame's lines of sight in the view.

    If a joint is at or behind the camera, there are no bounds.

    Parameters
    ----------
    lines : (R, 48) single
        See :func:`ray_endpoints`.
    row : int
    scratch32 : (SCRATCH32,) single
        Workspace.
    views : (R, 5) single
        Output, in row ``row``: bounds of bearing x / y and of slope z / y, and the largest y.
    """
    for j in range(lines.shape[1] // 3):
        nearness = _ONE / lines[row, _Y + j]
        scratch32[_BEARING + j] = lines[row, _X + j] * nearness
        scratch32[_SLOPE + j] = lines[row, _Z + j] * nearness
    nearest = far = lines[row, _Y]
    left = right = scratch32[_BEARING]
    low = high = scratch32[_SLOPE]
    for j in range(1, 16):
        nearest, far = min(nearest, lines[row, _Y + j]), max(far, lines[row, _Y + j])
        left, right = min(left, scratch32[_BEARING + j]), max(right, scratch32[_BEARING + j])
        low, high = min(low, scratch32[_SLOPE + j]), max(high, scratch32[_SLOPE + j])
    if nearest <= NEAR_SIGHT:
        left = low = -_EVERYWHERE
        right = high = far = _EVERYWHERE
    views[row, 0], views[row, 1], views[row, 2], views[row, 3] = left, right, low, high
    views[row, 4] = far


@inlined
def open_bounds(scratch32: Singles) -> None:
    """Set the clearance of all lines of sight to the cap.

    Parameters
    ----------
    scratch32 : (SCRATCH32,) single
        Output, from ``GAP`` on.
    """
    for j in range(16):
        scratch32[GAP + j] = _CAP


@inner_inlined
def bounds_overlap(windows: Singles, k: int, views: Singles, row: int) -> bool:
    """Whether a box may affect a line of sight of a frame.

    Parameters
    ----------
    windows : (K, 5 or more) single
        See :func:`_set_window`.
    k : int
        The box.
    views : (R, 5) single
        See :func:`ray_bounds`.
    row : int
        The frame's.

    Returns
    -------
    bool
    """
    # Evaluated without short circuit, because the branch would be unpredictable.
    return bool(
        (windows[k, 4] <= views[row, 4])
        & (windows[k, 0] <= views[row, 1])
        & (windows[k, 1] >= views[row, 0])
        & (windows[k, 2] <= views[row, 3])
        & (windows[k, 3] >= views[row, 2])
    )


@inlined
def update_clearance(
    occluders: Singles,
    first: int,
    last: int,
    lines: Singles,
    views: Singles,
    row: int,
    scratch32: Singles,
) -> bool:
    """Lower the clearances on the scratch array to those of some boxes.

    Parameters
    ----------
    occluders : (K, 15) single
        See :func:`set_occluder`.
    first, last : int
        The boxes ``first`` to ``last - 1``.
    lines, views : (R, 48), (R, 5) single
        See :func:`ray_endpoints` and :func:`ray_bounds`.
    row : int
        The frame.
    scratch32 : (SCRATCH32,) single
        Input and output, from ``GAP`` on: clearance, metres.

    Returns
    -------
    bool
        Whether any of the boxes may affect a line of sight.
    """
    turned = -1
    for k in range(first, last):
        if bounds_overlap(occluders, k, views, row):
            c, s = occluders[k, 5], occluders[k, 6]
            if turned < 0 or c != occluders[turned, 5] or s != occluders[turned, 6]:
                _turn(c, s, lines, row, scratch32)
                turned = k
            _pass_by(occluders, k, scratch32)
    return turned >= 0


@inner_inlined
def _turn(c: float, s: float, lines: Singles, row: int, scratch32: Singles) -> None:
    """Rotate the lines of sight to the axes of boxes whose yaw has cosine ``c`` and sine ``s``."""
    for j in range(16):
        u, v = rotated_back(c, s, lines[row, _X + j], lines[row, _Y + j])
        w = lines[row, _Z + j]
        scratch32[_MIDDLE + j] = _HALF * u
        scratch32[_MIDDLE + 16 + j] = _HALF * v
        scratch32[_MIDDLE + 32 + j] = _HALF * w
        along, across, up = max(abs(u), _LEVEL), max(abs(v), _LEVEL), max(abs(w), _LEVEL)
        share = along / (along + across)  # type: ignore[operator]
        scratch32[_FIRST + j] = share
        scratch32[_SECOND + j] = math.copysign(_ONE - share, u * v)
        share = along / (along + up)
        scratch32[_FIRST + 16 + j] = share
        scratch32[_SECOND + 16 + j] = math.copysign(_ONE - share, u * w)
        share = across / (across + up)
        scratch32[_FIRST + 32 + j] = share
        scratch32[_SECOND + 32 + j] = math.copysign(_ONE - share, v * w)


@inner_inlined
def _pass_by(occluders: Singles, k: int, scratch32: Singles) -> None:
    """Lower every joint's clearance to that of box ``k``; the lines are in its axes."""
    p0, p1, p2 = occluders[k, 7], occluders[k, 8], occluders[k, 9]
    h0, h1, h2 = occluders[k, 10], occluders[k, 11], occluders[k, 12]
    thin, least = occluders[k, 13], occluders[k, 14]
    longer01, longer02, longer12 = h0 - h1, h0 - h2, h1 - h2
    for j in range(16):
        half0, half1 = scratch32[_MIDDLE + j], scratch32[_MIDDLE + 16 + j]
        half2 = scratch32[_MIDDLE + 32 + j]
        axis0 = abs(p0 + half0) - abs(half0) - h0
        axis1 = abs(p1 + half1) - abs(half1) - h1
        axis2 = abs(p2 + half2) - abs(half2) - h2
        first, second = scratch32[_FIRST + j], scratch32[_SECOND + j]
        pair01 = abs(first * p1 - second * p0) + (first * longer01 - h0)
        first, second = scratch32[_FIRST + 16 + j], scratch32[_SECOND + 16 + j]
        pair02 = abs(first * p2 - second * p0) + (first * longer02 - h0)
        first, second = scratch32[_FIRST + 32 + j], scratch32[_SECOND + 32 + j]
        pair12 = abs(first * p2 - second * p1) + (first * longer12 - h1)
        value = max(max(max(least, axis0), max(axis1, axis2)), max(pair01, max(pair02, pair12)))
        # A minimum of three: the compiler stores a minimum of two only where it changes, and a row
        # that was stored in parts cannot be read again without delay.
        scratch32[GAP + j] = min(min(scratch32[GAP + j], value), value * thin)


@compiled
def clearances(elevation: float, joints: Array, boxes: Array) -> Array:
    """Clearance of the lines of sight to any number of joints, sixteen per row.

    Parameters
    ----------
    elevation : float
        Height of the camera, metres.
    joints : (R, 3, 16) float
        World, metres.
    boxes : (K, 7) float
        In the world.

    Returns
    -------
    (R, 16) float
        Metres, at most ``NOTHING_IN_SIGHT``.
    """
    occluders = np.empty((len(boxes), OCCLUDER), np.float32)
    turn = np.empty(2)
    for k in range(len(boxes)):
        turn[0], turn[1] = math.cos(boxes[k, 6]), math.sin(boxes[k, 6])
        set_occluder(elevation, boxes[k], turn, occluders[k])
    result = np.empty((len(joints), 16))
    lines, scratch32 = np.empty((1, LINE), np.float32), np.empty(SCRATCH32, np.float32)
    for t in range(len(joints)):
        ray_endpoints(elevation, joints[t : t + 1], lines, 0)
        open_bounds(scratch32)
        for k in range(len(boxes)):
            _turn(occluders[k, 5], occluders[k, 6], lines, 0, scratch32)
            _pass_by(occluders, k, scratch32)
        for j in range(16):
            result[t, j] = scratch32[GAP + j]
    return result
