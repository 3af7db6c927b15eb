"""How scenelets follow one another: errors of the path, jumps of the pose, furniture, compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.kernels.intersection import (
    BOTH,
    N_DISPLACED,
    add_displaced_depth,
    marginal_penetration_cost,
    overlap_depth,
)
from imapper_prob.models.kernels.path import pose_jump
from imapper_prob.models.problem import Problem
from imapper_prob.models.settings import NEAREST
from imapper_prob.models.skeleton import PELV
from imapper_prob.models.view import floor_point
from imapper_prob.sampling.jit import compiled

__all__ = ["collision", "loose_jumps", "path_errors"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@compiled
def path_errors(problem: Problem, camera: Array, items: Ints, where: Array, errors: Array) -> None:
    """Deviations from the static path, in its own units, of each scenelet's first and last frames.

    Parameters
    ----------
    problem : Problem
    camera : (5,) float
    items : (n, 2) int
    where : (n, 4) float
        Bearing (tangent), log depth (log m), yaw (radians) and log size.
    errors : (n, 6) float
        Out: across and along the view, of the first frame, of the last and of the one before.
    """
    cp, sp = math.cos(camera[0]), math.sin(camera[0])
    cr, sr = math.cos(camera[4]), math.sin(camera[4])
    shrunk, offset = math.exp(-camera[2]), camera[2] + camera[3]
    for i in range(len(items)):
        first = problem.joint_first[items[i, 0]]
        length = problem.joint_first[items[i, 0] + 1] - first
        body = math.exp(camera[3] + where[i, 3])
        c, s = body * math.cos(where[i, 2]), body * math.sin(where[i, 2])
        x0, y0 = floor_point(where[i, 0], where[i, 1])
        for of in range(3):
            n = 0 if of == 0 else length - of
            x, y = problem.joints[first + n, PELV, 0], problem.joints[first + n, PELV, 1]
            height = body * problem.joints[first + n, PELV, 2] - camera[1]
            forward = s * x + c * y + y0
            depth = max(cp * forward + sp * height, NEAREST)
            right = cr * (c * x - s * y + x0) + sr * (cp * height - sp * forward)
            t = items[i, 1] + n
            centre, scale = problem.path_centre, problem.path_scale
            errors[i, 2 * of] = (right / depth / shrunk - centre[t, 0]) / scale[t, 0]
            errors[i, 2 * of + 1] = (math.log(depth) - offset - centre[t, 1]) / scale[t, 1]


@compiled
def _set_pose(problem: Problem, row: int, body: float, yaw: float, joints: Array, to: int) -> None:
    """A frame of the library, of a body so large, turned, into ``joints[to]`` (3, 16)."""
    c, s = body * math.cos(yaw), body * math.sin(yaw)
    for j in range(16):
        x, y = problem.joints[row, j, 0], problem.joints[row, j, 1]
        joints[to, 0, j] = c * x - s * y
        joints[to, 1, j] = s * x + c * y
        joints[to, 2, j] = body * problem.joints[row, j, 2]


@compiled
def loose_jumps(
    problem: Problem,
    film: Ints,
    items: Ints,
    where: Array,
    loose: Array,
    joints: Array,
    jumps: Array,
) -> None:
    """What it costs that the pose jumps between free frames and scenelets, in the mean camera.

    Parameters
    ----------
    problem : Problem
    film : (T,) int
        Which film a frame is of.
    items, where : (n, 2), (n, 4)
        See :func:`path_errors`.
    loose : (T, 3, 16) float
        Joints of free frames, metres.
    joints : (2 n, 3, 16) float
        Out: joints of the first and the last frame of each, metres.
    jumps : (n, 2) float
        Out: where it begins and where it ends, units of the smoothness cost; 0 at a film's edges.
    """
    scale, both = problem.joint_step * math.exp(problem.camera_mean[3]), np.empty((2, 3, 16))
    for i in range(len(items)):
        body = math.exp(problem.camera_mean[3] + where[i, 3])
        row, last = problem.joint_first[items[i, 0]], problem.joint_first[items[i, 0] + 1] - 1
        start = items[i, 1]
        end = start + last + 1 - row
        _set_pose(problem, row, body, where[i, 2], joints, 2 * i)
        _set_pose(problem, last, body, where[i, 2], joints, 2 * i + 1)
        jumps[i] = 0.0
        if start > 0 and film[start - 1] == film[start]:
            both[0], both[1] = loose[start - 1], joints[2 * i]
            jumps[i, 0] = pose_jump(both, 0, 1, scale)
        if end < len(film) and film[end - 1] == film[end]:
            both[0], both[1] = joints[2 * i + 1], loose[end]
            jumps[i, 1] = pose_jump(both, 0, 1, scale)


@compiled
def collision(
    problem: Problem,
    first_box: Ints,
    boxes: Array,
    turns: Array,
    labels: Ints,
    yaws: Array,
    one: int,
    other: int,
) -> float:
    """What it costs that furniture of two scenelets is in each other, unless it is the same, nats.

    Parameters
    ----------
    problem : Problem
    first_box : (n + 1,) int
        Where each scenelet's boxes begin.
    boxes, turns, labels, yaws
        Of all scenelets, see :func:`imapper_prob.models.kernels.placement.place_boxes`.
    one, other : int
    """
    merges, total = math.cos(problem.merge_angle), 0.0
    for i in range(first_box[one], first_box[one + 1]):
        for k in range(first_box[other], first_box[other + 1]):
            if labels[i] == labels[k]:
                front = problem.label_front[labels[i]]
                if not front or math.cos(yaws[i] - yaws[k]) > merges:
                    continue
            reach = turns[i, 2] + turns[k, 2]
            if (boxes[i, 0] - boxes[k, 0]) ** 2 + (boxes[i, 1] - boxes[k, 1]) ** 2 < reach * reach:
                total += overlap_depth(boxes[i], turns[i], boxes[k], turns[k])
    if total <= 0.0:
        return 0.0
    sums = np.zeros(N_DISPLACED)
    add_displaced_depth(total, BOTH * problem.furniture_spread, sums)
    cost: float = marginal_penetration_cost(sums, problem.collision_cost)
    return cost
