"""The published energy (Monszpart et al. 2019, section 5), evaluated on states of this model.

    L = w_r L_r + w_o L_o + w_s L_s + w_c L_c + w_m L_m

    L_r = sum_t sum_k c_tk |Pi q_tk - u_tk|^2                    reprojection
    L_o = sum_t sum_k F(v(q_tk, O), c_tk)                        occlusion
    L_s = sum_t |p_t - p_(t-1)|^2                                smoothness of the pelvis
    L_c = -sum_(i, j) ( int_Li d-_j + int_Lj d-_i )              objects in each other
    L_m = -sum_t min(0, max_q min_i d_i(q))                      motion through objects

with joints q and pelvis p in metres and detections u of confidence c in normalised image
coordinates (pixels from the principal point over the focal length). :func:`evaluate_paper` is the
log-posterior that the preset ``paper`` samples from: these terms with the priors of
:mod:`imapper_prob.models.kernels.incremental`.

Four misprints of the paper are corrected:

* eta_t tells whether a scenelet covers frame t. The upper limit of its sum over starts is printed
 as max(t, n_l), so that a scenelet would cover every frame after its start; the limit is
 min(t, n_l).
* L_m is printed with the signed distance itself and would reward walking far from things; it
  takes the negative part, as L_c does.
* L_c is printed over pairs with "b_i != b_j and theta_i != theta_j"; the text spares only pairs
  of the same label and the same orientation.
* v is undefined where there is no object; the distance to an empty volume is the cap
  :data:`FARTHEST`, and so is every larger one.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled, inlined, inner
from imapper_prob.models.kernels.axes import (
    camera_pose,
    point_of_box,
    point_to_camera,
    rotated_back,
)
from imapper_prob.models.kernels.cache import open_evaluator
from imapper_prob.models.kernels.given import sum_given
from imapper_prob.models.kernels.incremental import NOWHERE, place_scene
from imapper_prob.models.kernels.placement import place_boxes
from imapper_prob.models.kernels.posing import copy_joints, list_moved, pose_joints
from imapper_prob.models.problem import ASSIGNMENT, CAMERA, PATH, PLACEMENT, TERMS, Problem
from imapper_prob.models.skeleton import DETECTED, LKNE, PELV, RKNE

__all__ = [
    "FARTHEST",
    "PAPER_TERMS",
    "depth_of_motion",
    "evaluate_paper",
    "hidden_distance",
    "occlusion_cost",
    "overlap",
    "overlaps",
    "signed_distance",
]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
_MET: Final = (PELV, LKNE, RKNE)
"""Joints that the motion term L_m checks."""
_CELLS: Final = 24
"""Midpoints along each side of a rectangle in the integral of L_c; accurate to half a percent."""


@inlined
def signed_distance(x: float, y: float, box: Array, turn: Array) -> float:
    """Signed distance from a point on the floor to the footprint of a box.

    Parameters
    ----------
    x, y : float
        Metres.
    box : (7,) float
    turn : (2 or more,) float
        Cosine and sine of the yaw of the box.

    Returns
    -------
    float
        Metres; negative inside.
    """
    along, across = rotated_back(turn[0], turn[1], x - box[0], y - box[1])
    u, v = abs(along) - box[3], abs(across) - box[4]
    outside = math.sqrt(max(u, 0.0) ** 2 + max(v, 0.0) ** 2)
    distance: float = outside + min(max(u, v), 0.0)
    return distance


@compiled
def depth_of_motion(joints: Array, row: int, boxes: Array, turns: Array) -> float:
    """L_m of one frame: -min(0, max_q min_i d_i(q)).

    Parameters
    ----------
    joints : (R, 3, 16) float
        World, metres.
    row : int
        Row of ``joints``.
    boxes : (K, 7) float
        World frame, see :mod:`imapper_prob.models.geometry`.
    turns : (K, 2 or more) float
        Cosine and sine of the yaw of each box.

    Returns
    -------
    float
        Metres.
    """
    farthest = -math.inf
    for j in _MET:
        nearest = math.inf
        for k in range(len(boxes)):
            x, y = joints[row, 0, j], joints[row, 1, j]
            nearest = min(nearest, signed_distance(x, y, boxes[k], turns[k]))
        farthest = max(farthest, nearest)
    return max(0.0, -farthest)


@compiled
def overlap(boxes: Array, turns: Array, one: tuple[int, int], other: tuple[int, int]) -> float:
    """Integral of the depth in one object over the footprint of another, cubic metres.

    Parameters
    ----------
    boxes, turns
        See :func:`overlaps`.
    one, other : (int, int)
        First row of the object's boxes, and the row after the last.

    Returns
    -------
    float
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
                x, y = point_of_box(boxes[k], c, s, u, v)
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
    """Whether the circumcircle of a box's footprint meets that of any box of another object."""
    near = False
    for m in range(other[0], other[1]):
        reach = math.hypot(boxes[k, 3], boxes[k, 4]) + math.hypot(boxes[m, 3], boxes[m, 4])
        near |= math.hypot(boxes[k, 0] - boxes[m, 0], boxes[k, 1] - boxes[m, 1]) < reach
    return near


@compiled
def overlaps(boxes: Array, turns: Array, owner: Ints, yaws: Array, same_angle: float) -> float:
    """The collision term L_c, cubic metres.

    Parameters
    ----------
    boxes : (K, 7) float
        World frame, with the boxes of each object in consecutive rows.
    turns : (K, 2 or more) float
        Cosine and sine of the yaw of each box.
    owner : (K, 3) int
        Item, object and label of each box.
    yaws : (K,) float
        Yaw of the object that each box belongs to, radians.
    same_angle : float
        Radians; a pair of the same label whose yaws differ by less is left out.

    Returns
    -------
    float
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


# ------------------------------------------------------------------------------------------------
# The occlusion term.
#
#     F(v, c) = (c - 1/2)^2 v^2   if c < 1/2 and v > 0,   else 0
#
# v is the signed distance of a joint to the occlusion volume, which is all that furniture hides
# from the camera. F needs v only outside the volume, where the distance to a union is the least
# distance to its parts. With the camera at the origin and in the axes of a box [l, h], the box
# hides
#
#     { s b : s >= 1, l <= b <= h }.
#
# The squared distance of a point y to this set is the minimum over s >= 1 of
#
#     sum_i max(0, s l_i - y_i)^2 + max(0, y_i - s h_i)^2,
#
# which is convex in s. Its slope is piecewise linear; it changes where a side of the box passes y.

FARTHEST: Final = 1.0
"""V, metres: cap of the distance to the occlusion volume, which is also its value without
furniture. It is the reach of an actor's arm, within which a scenelet has its objects (Monszpart et
al. 2019, section 3)."""


@compiled
def occlusion_cost(distance: float, confidence: float) -> float:
    """The penalty F(v, c) of a joint of low confidence that is not occluded.

    Parameters
    ----------
    distance : float
        v, the distance to the occlusion volume, metres.
    confidence : float
        c, the confidence in [0, 1].

    Returns
    -------
    float
        Square metres.
    """
    if confidence < 0.5 and distance > 0.0:
        return (confidence - 0.5) ** 2 * distance**2
    return 0.0


@compiled
def hidden_distance(
    elevation: float, x: float, y: float, z: float, boxes: Array, turns: Array, room: Array
) -> float:
    """Distance from a point to the volume that boxes hide, metres: 0 inside, at most ``FARTHEST``.

    Parameters
    ----------
    elevation : float
        Height of the camera, which is above the origin, metres.
    x, y, z : float
        The point in the world, metres.
    boxes : (K, 7) float
    turns : (K, 2 or more) float
        Cosine and sine of the yaw of each box.
    room : (9,) float
        Scratch array.

    Returns
    -------
    float
    """
    least = FARTHEST
    for k in range(len(boxes)):
        c, s = turns[k, 0], turns[k, 1]
        along, across = rotated_back(c, s, boxes[k, 0], boxes[k, 1])
        room[0], room[1] = along - boxes[k, 3], across - boxes[k, 4]
        room[2] = boxes[k, 2] - elevation - boxes[k, 5]
        for i in range(3):
            room[3 + i] = room[i] + 2.0 * boxes[k, 3 + i]
        room[6], room[7] = rotated_back(c, s, x, y)
        room[8] = z - elevation
        least = min(least, _distance(room))
    return least


@inlined
def _distance(room: Array) -> float:
    """Distance from the point ``room[6:]`` to the volume hidden by the box ``room[:6]``."""
    before, slope = 1.0, _slope(room, 1.0)
    if slope >= 0.0:
        return _apart(room, 1.0)
    after, steeper = math.inf, 0.0
    for i in range(6):
        if room[i] != 0.0:
            at = room[6 + i % 3] / room[i]
            if before < at < after:
                found = _slope(room, at)
                if found < 0.0:
                    before, slope = at, found
                else:
                    after, steeper = at, found
    if after == math.inf:
        # No side passes the point beyond this scale, so the slope is linear from here on.
        after, steeper = 2.0 * before, _slope(room, 2.0 * before)
    return _apart(room, before + (after - before) * slope / (slope - steeper))


@inlined
def _slope(room: Array, scale: float) -> float:
    """Half the derivative, by the scale s, of the squared distance."""
    total = 0.0
    for i in range(3):
        total += room[i] * max(0.0, scale * room[i] - room[6 + i])
        total -= room[3 + i] * max(0.0, room[6 + i] - scale * room[3 + i])
    return total


@inlined
def _apart(room: Array, scale: float) -> float:
    """Distance from the point to the box scaled by ``scale`` about the camera."""
    total = 0.0
    for i in range(3):
        short = max(0.0, scale * room[i] - room[6 + i])
        long = max(0.0, room[6 + i] - scale * room[3 + i])
        total += short * short + long * long
    return math.sqrt(total)


# ------------------------------------------------------------------------------------------------
# The log-posterior of the preset `paper`.
#
#     log pi(s) = log p(phi) + log p(X) + log p(P, G | X)
#                 - w_r L_r - w_o L_o - w_s L_s - w_c L_c - w_m L_m + log p(statements | s)

PAPER_TERMS = (
    *TERMS[: PATH + 1], "reprojection", "occlusion", "smoothness", "collision", "motion", "given"
)  # fmt: skip
"""Names of the terms of :func:`evaluate_paper`, in order; the log-posterior is their sum."""
_REPROJECTION, _OCCLUSION, _SMOOTHNESS, _COLLISION, _MOTION = range(5)
"""Indices in ``Problem.paper_nats``; of the terms, these come after the first `_PRIORS`."""
_PRIORS, _GIVEN = PATH + 1, len(PAPER_TERMS) - 1
_DETECTED = np.array(DETECTED)


@inner
def _reprojection(problem: Problem, camera: Array, joints: Array, by_frame: Array) -> None:
    """L_r: sum of c |Pi q - u|^2 over the joints of each frame, in normalised image coordinates."""
    pose, focal = camera_pose(camera), math.exp(camera[2])
    for t in range(len(joints)):
        for j in _DETECTED:
            right, depth, up = point_to_camera(
                pose, joints[t, 0, j], joints[t, 1, j], joints[t, 2, j]
            )
            u, v = focal * right / depth, -focal * up / depth
            du = u - (problem.keypoints[t, j, 0] - problem.cx) / problem.fx
            dv = v - (problem.keypoints[t, j, 1] - problem.cy) / problem.fy
            if problem.used[t, j]:
                by_frame[t] += problem.confidences[t, j] * (du * du + dv * dv)


@inner
def _occlusion(
    problem: Problem, camera: Array, joints: Array, boxes: Array, turns: Array, by_frame: Array
) -> None:
    """L_o: sum of F(v, c) over the joints of each frame; undetected joints have c = 0."""
    room = np.empty(9)
    for t in range(len(joints)):
        for j in _DETECTED:
            confidence = problem.confidences[t, j] if problem.used[t, j] else 0.0
            if confidence < 0.5:
                x, y, z = joints[t, 0, j], joints[t, 1, j], joints[t, 2, j]
                distance = hidden_distance(camera[1], x, y, z, boxes, turns, room)
                by_frame[t] += occlusion_cost(distance, confidence)


@inner
def _smoothness(problem: Problem, joints: Array, by_frame: Array) -> None:
    """L_s: |p_t - p_(t-1)|^2 of the pelvis, square metres."""
    for t in range(1, len(joints)):
        if not problem.path_starts[t]:
            for axis in range(3):
                by_frame[t] += (joints[t, axis, PELV] - joints[t - 1, axis, PELV]) ** 2


@compiled
def evaluate_paper(
    problem: Problem,
    camera: Array,
    items: Ints,
    placements: Array,
    sizes: Array,
    latent: Array,
    joints: Array,
    by_frame: Array,
) -> Array:
    """Evaluate the terms of one state under the published energy.

    Parameters
    ----------
    problem, camera, items, placements, sizes, latent
        See :func:`imapper_prob.models.kernels.incremental.change`.
    joints : (T, 3, 16) float
        Output: the motion in the world, metres; unchanged outside the support.
    by_frame : (T, 4) float
        Output: reprojection, occlusion, smoothness and motion of each frame, unweighted; occlusion
        is 0 if its weight is 0.

    Returns
    -------
    (10,) float
        Values of ``PAPER_TERMS``, nats; the first is -inf outside the support.
    """
    terms = np.zeros(len(PAPER_TERMS))
    evaluator = open_evaluator(problem, len(items))
    cache = evaluator.cache
    prior = place_scene(
        evaluator, NOWHERE, camera, latent, camera, items, placements, sizes, latent
    )  # fmt: skip
    if prior == -math.inf:
        terms[CAMERA] = prior
        return terms
    for i in (CAMERA, ASSIGNMENT, PLACEMENT, PATH):
        terms[i] = cache.terms[i]
    pose_joints(problem, cache, len(items), list_moved(cache), camera)
    copy_joints(cache, joints)
    if len(problem.given) > 0:
        terms[_GIVEN] = sum_given(problem, cache, len(items), camera)
    if problem.likelihood == 0.0:
        return terms
    boxes, turns, owner, yaws = place_boxes(problem, camera, items, placements, sizes)
    by_frame[:] = 0.0
    nats = problem.paper_nats
    _reprojection(problem, camera, joints, by_frame[:, 0])
    if nats[_OCCLUSION] > 0.0:
        _occlusion(problem, camera, joints, boxes, turns, by_frame[:, 1])
    _smoothness(problem, joints, by_frame[:, 2])
    for t in range(len(joints)):
        by_frame[t, 3] = depth_of_motion(joints, t, boxes, turns)
    for t in range(len(joints)):
        for i in (_REPROJECTION, _OCCLUSION, _SMOOTHNESS):
            terms[_PRIORS + i] -= nats[i] * by_frame[t, i]
        terms[_PRIORS + _MOTION] -= nats[_MOTION] * by_frame[t, 3]
    if nats[_COLLISION] > 0.0:
        cost = overlaps(boxes, turns, owner, yaws, problem.merge_angle)
        terms[_PRIORS + _COLLISION] = -nats[_COLLISION] * cost
    return terms
