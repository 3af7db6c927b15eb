"""L_c and L_m of the published energy, compiled: things in each other, in top view.

    L_c = -sum over pairs (i, j) of  int_{L(o_i)} d-_j(x) dx + int_{L(o_j)} d-_i(x) dx
    L_m = -sum over t of min(0, max over q of min over i of d_i(q_t))     (Monszpart et al. 2019)

L(o) is the projection of object o to the floor, d_o its signed distance there in metres, negative
inside, and d- its negative part. An object is a union of cuboids, L(o) one of rectangles, and d_o
the least of the signed distances to these. A pair counts once; it is spared if both have the same
label and the same orientation. q are the pelvis and the two knees, o_i all objects, those in use
among them: who sits has the pelvis in the seat and the knees outside, so that the largest of the
three distances is positive.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled, inlined
from imapper_prob.models.skeleton import LKNE, PELV, RKNE

__all__ = ["MET", "depth_of_motion", "overlap", "overlaps", "signed_distance"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

MET: Final = (PELV, LKNE, RKNE)
"""Joints that L_m asks for."""
_CELLS: Final = 24
"""Along each side of a rectangle, for the integral by midpoints: good to half a percent."""


@inlined
def signed_distance(x: float, y: float, box: Array, turn: Array) -> float:
    """From a point on the floor to a box's footprint, metres, negative inside."""
    dx, dy = x - box[0], y - box[1]
    u = abs(turn[0] * dx + turn[1] * dy) - box[3]
    v = abs(turn[0] * dy - turn[1] * dx) - box[4]
    outside = math.sqrt(max(u, 0.0) ** 2 + max(v, 0.0) ** 2)
    distance: float = outside + min(max(u, v), 0.0)
    return distance


@compiled
def depth_of_motion(joints: Array, row: int, boxes: Array, turns: Array) -> float:
    """-min(0, max_q min_i d_i(q)) of ``joints[row]`` (3, 16), metres."""
    farthest = -math.inf
    for j in MET:
        nearest = math.inf
        for k in range(len(boxes)):
            x, y = joints[row, 0, j], joints[row, 1, j]
            nearest = min(nearest, signed_distance(x, y, boxes[k], turns[k]))
        farthest = max(farthest, nearest)
    return max(0.0, -farthest)


@compiled
def overlap(boxes: Array, turns: Array, one: tuple[int, int], other: tuple[int, int]) -> float:
    """-int over the footprint of one object of the negative part of d of another, cubic metres.

    Parameters
    ----------
    boxes, turns
        See :func:`overlaps`.
    one, other : (int, int)
        First row of an object's boxes, and the row after the last.
    """
    total = 0.0
    for k in range(one[0], one[1]):
        if not _may_meet(boxes, k, other):
            continue
        c, s = turns[k, 0], turns[k, 1]
        cell = 4.0 * boxes[k, 3] * boxes[k, 4] / (_CELLS * _CELLS)
        for a in range(_CELLS):
            u = boxes[k, 3] * ((2.0 * a + 1.0) / _CELLS - 1.0)
            for b in range(_CELLS):
                v = boxes[k, 4] * ((2.0 * b + 1.0) / _CELLS - 1.0)
                x, y = boxes[k, 0] + c * u - s * v, boxes[k, 1] + s * u + c * v
                counted = False
                for earlier in range(one[0], k):
                    counted |= signed_distance(x, y, boxes[earlier], turns[earlier]) <= 0.0
                if not counted:
                    depth = 0.0
                    for m in range(other[0], other[1]):
                        depth = max(depth, -signed_distance(x, y, boxes[m], turns[m]))
                    total += depth * cell
    return total


@inlined
def _may_meet(boxes: Array, k: int, other: tuple[int, int]) -> bool:
    """Whether the circle around a footprint meets that around any of another object."""
    near = False
    for m in range(other[0], other[1]):
        reach = math.hypot(boxes[k, 3], boxes[k, 4]) + math.hypot(boxes[m, 3], boxes[m, 4])
        near |= math.hypot(boxes[k, 0] - boxes[m, 0], boxes[k, 1] - boxes[m, 1]) < reach
    return near


@compiled
def overlaps(boxes: Array, turns: Array, owner: Ints, yaws: Array, same_angle: float) -> float:
    """L_c, cubic metres.

    Parameters
    ----------
    boxes : (K, 7) float
        In the world, those of an object one after the other.
    turns : (K, 2 or more) float
        Cosine and sine of their yaws.
    owner : (K, 3) int
        Item, object and label of each box.
    yaws : (K,) float
        Of its object, radians.
    same_angle : float
        Radians; objects turned by less than this against each other face the same way.
    """
    firsts = np.empty(len(boxes) + 1, dtype=np.int64)
    n = 0
    for k in range(len(boxes)):
        if k == 0 or owner[k, 0] != owner[k - 1, 0] or owner[k, 1] != owner[k - 1, 1]:
            firsts[n] = k
            n += 1
    firsts[n] = len(boxes)
    total, same = 0.0, math.cos(same_angle)
    for i in range(n):
        for j in range(i + 1, n):
            a, b = firsts[i], firsts[j]
            if owner[a, 2] == owner[b, 2] and math.cos(yaws[a] - yaws[b]) > same:
                continue
            one, other = (a, firsts[i + 1]), (b, firsts[j + 1])
            total += overlap(boxes, turns, one, other) + overlap(boxes, turns, other, one)
    return total
