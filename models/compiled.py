"""The log-posterior of a scene, compiled.

    log pi(s) = log p(phi) + log p(X) + log p(P, G | X) + log p(u, c | s)
                - free poses - E_s - E_c - E_m - E_g

over a state s = (phi, X, P, b, z): camera and body scale phi, the assignment X of scenelets
to start frames, their placements P and sizes b, and standard normal numbers z that say which
path G is drawn where no scenelet lies (see :mod:`imapper_prob.models.chain`). The density is
with respect to d phi dP db and the normal law of z, so that it has the same dimension of z
whatever the number of scenelets.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.chain import chain
from imapper_prob.models.energy.intersection import depth_below_floor, footprint_depth
from imapper_prob.models.energy.smoothness import pose_jump
from imapper_prob.models.energy.swaps import summed_over_swaps
from imapper_prob.models.jit import compiled
from imapper_prob.models.kernels.body import apart, depth_in_box, set_columns, set_footprint
from imapper_prob.models.kernels.frame import weigh_frames
from imapper_prob.models.kernels.sight import BENCH, GAP, aim, clear, look, set_outlook
from imapper_prob.models.kernels.support import in_support, log_size_density
from imapper_prob.models.limits import NEAREST
from imapper_prob.models.problem import Problem

__all__ = ["TERMS", "evaluate"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

TERMS = (
    "camera", "layout", "placement", "path", "detections", "free_pose", "smoothness", "collision",
    "motion", "ground",
)  # fmt: skip
"""What :func:`evaluate` returns, in order; the log-posterior is their sum."""


@compiled
def _place_scenelets(
    problem: Problem,
    camera: Array,
    items: Ints,
    placements: Array,
    sizes: Array,
    item_of: Ints,
    joints: Array,
) -> bool:
    """Joints of covered frames in the world. False where scenelets overlap or stick out.

    Each scenelet's person is scaled about its own origin on the floor.
    """
    n_frames = len(item_of)
    for i in range(len(items)):
        scenelet, start = items[i, 0], items[i, 1]
        first = problem.joint_first[scenelet]
        n = problem.joint_first[scenelet + 1] - first
        if start < 0 or start + n > n_frames:
            return False
        px, py = placements[i, 0], placements[i, 1]
        body = math.exp(camera[3] + sizes[i])
        c, s = body * math.cos(placements[i, 2]), body * math.sin(placements[i, 2])
        for t in range(n):
            if item_of[start + t] >= 0:
                return False
            item_of[start + t] = i
            for j in range(16):
                x = problem.joints[first + t, j, 0]
                y = problem.joints[first + t, j, 1]
                joints[start + t, j, 0] = c * x - s * y + px
                joints[start + t, j, 1] = s * x + c * y + py
                joints[start + t, j, 2] = body * problem.joints[first + t, j, 2]
    return True


@compiled
def _place_boxes(
    problem: Problem, items: Ints, placements: Array
) -> tuple[Array, Array, Ints, Array]:
    """Boxes in the world (K, 7); cosine, sine, radius (K, 3); item, object, label; object yaw."""
    n = 0
    for i in range(len(items)):
        n += problem.box_first[items[i, 0] + 1] - problem.box_first[items[i, 0]]
    boxes = np.empty((n, 7))
    turns = np.empty((n, 3))
    owner = np.empty((n, 3), dtype=np.int64)
    yaws = np.empty(n)
    k = 0
    for i in range(len(items)):
        yaw = placements[i, 2]
        c, s = math.cos(yaw), math.sin(yaw)
        for b in range(problem.box_first[items[i, 0]], problem.box_first[items[i, 0] + 1]):
            local = problem.boxes[b]
            boxes[k, 0] = c * local[0] - s * local[1] + placements[i, 0]
            boxes[k, 1] = s * local[0] + c * local[1] + placements[i, 1]
            boxes[k, 2:6] = local[2:6]
            boxes[k, 6] = local[6] + yaw
            turns[k, 0], turns[k, 1] = math.cos(boxes[k, 6]), math.sin(boxes[k, 6])
            turns[k, 2] = math.sqrt(local[3] ** 2 + local[4] ** 2 + local[5] ** 2)
            owner[k, 0], owner[k, 1] = i, problem.box_object[b]
            owner[k, 2] = problem.box_label[b]
            yaws[k] = problem.box_yaw[b] + yaw
            k += 1
    return boxes, turns, owner, yaws


@compiled
def _path(
    problem: Problem, camera: Array, item_of: Ints, latent: Array, joints: Array
) -> tuple[float, float]:
    """Draw the path of free frames and pose the body along it; returns (evidence, placement)."""
    n_frames = len(item_of)
    cp, sp = math.cos(camera[0]), math.sin(camera[0])
    cr, sr = math.cos(camera[4]), math.sin(camera[4])
    focal, body = math.exp(camera[2]), math.exp(camera[3])
    values = np.zeros((2, n_frames))
    placement = 0.0
    for t in range(n_frames):
        if item_of[t] >= 0:
            x, y, z = joints[t, 6, 0], joints[t, 6, 1], joints[t, 6, 2] - camera[1]
            depth = max(cp * y + sp * z, NEAREST)
            values[0, t] = (cr * x + sr * (cp * z - sp * y)) / depth
            values[1, t] = math.log(depth)
            if t == 0 or item_of[t] != item_of[t - 1]:
                # From (bearing, log depth) of the first pelvis to (x, y), and a uniform yaw.
                placement += math.log(cr * cp / (depth * depth)) - math.log(2 * math.pi)
    evidence = 0.0
    filtered = np.empty((n_frames, 2))
    measured = np.empty(n_frames)
    precision = np.empty(n_frames)
    for axis in range(2):
        for t in range(n_frames):
            # The same pixels under another focal length and body size.
            if axis == 0:
                measured[t] = problem.measured[t, 0] / focal
                precision[t] = problem.precision[t, 0] * focal * focal
            else:
                measured[t] = problem.measured[t, 1] + camera[2] + camera[3]
                precision[t] = problem.precision[t, 1]
        evidence += chain(
            values[axis], item_of, measured, precision, latent[:, axis],
            problem.start_mean[axis], problem.start_variance[axis],
            problem.step_variance[axis], filtered,
        )  # fmt: skip
    for t in range(n_frames):
        if item_of[t] < 0:
            depth = math.exp(values[1, t])
            px, pz = values[0, t] * depth, problem.lift[t] / focal * depth
            for j in range(16):
                right = px + body * problem.poses[t, j, 0]
                y = depth + body * problem.poses[t, j, 1]
                up = pz + body * problem.poses[t, j, 2]
                z = sr * right + cr * up
                joints[t, j, 0] = cr * right - sr * up
                joints[t, j, 1] = cp * y - sp * z
                joints[t, j, 2] = sp * y + cp * z + camera[1]
    return evidence, placement


@compiled
def _detections(
    problem: Problem,
    camera: Array,
    item_of: Ints,
    sizes: Array,
    joints: Array,
    boxes: Array,
    turns: Array,
    by_frame: Array,
) -> None:
    """log p(u, c | q, m) summed over each frame's joints: as they are, and sides swapped."""
    n_frames = len(item_of)
    outlooks = np.empty((len(boxes), 15))
    for k in range(len(boxes)):
        set_outlook(camera[1], boxes[k], turns[k], outlooks[k])
    bench, view, gaps = np.empty(BENCH), np.empty((1, 5)), np.empty((n_frames, 16))
    for t in range(n_frames):
        aim(camera[1], joints, t, bench)
        look(bench, view, 0)
        clear(outlooks, 0, len(boxes), view, 0, bench)
        for j in range(16):
            gaps[t, j] = bench[GAP + j]
    every, rows = np.ones(n_frames, dtype=np.uint8), np.arange(n_frames)
    weigh_frames(problem, camera, every, item_of, sizes, joints, rows, gaps, bench, by_frame, rows)


@compiled
def _footprints(boxes: Array, turns: Array) -> Array:
    """(K, 4) least and greatest x, least and greatest y of every box, metres."""
    footprints = np.empty((len(boxes), 4))
    for k in range(len(boxes)):
        set_footprint(boxes[k], turns[k], footprints[k])
    return footprints


@compiled
def _collisions(
    problem: Problem, boxes: Array, footprints: Array, owner: Ints, yaws: Array
) -> float:
    """E_c: how deep objects of different scenelets are in each other, unless they are one."""
    total = 0.0
    n = len(boxes)
    for a in range(n):
        for b in range(a + 1, n):
            if owner[a, 0] == owner[b, 0] or apart(footprints, a, footprints, b):
                continue
            aligned = math.cos(yaws[a] - yaws[b]) > math.cos(problem.merge_angle)
            if owner[a, 2] == owner[b, 2] and aligned:
                continue
            total += footprint_depth(boxes[a], boxes[b])
    return -problem.collision_cost * problem.likelihood * total


@compiled
def _motion(
    problem: Problem,
    item_of: Ints,
    joints: Array,
    boxes: Array,
    turns: Array,
    footprints: Array,
    owner: Ints,
) -> float:
    """E_m: how deep trunk, thighs and shins stand in objects that are not the frame's own."""
    total = 0.0
    columns, ground = np.empty((5, 4)), np.empty((1, 4))
    for t in range(len(item_of)):
        if not problem.used[t].any():
            continue
        set_columns(joints, t, columns, ground, 0)
        for k in range(len(boxes)):
            if owner[k, 0] != item_of[t] and not apart(ground, 0, footprints, k):
                total += depth_in_box(columns, boxes, turns, k)
    return -problem.motion_cost * problem.frame_weight * problem.likelihood * total


@compiled
def _smoothness(problem: Problem, item_of: Ints, joints: Array) -> float:
    """E_s: what it costs that the pose jumps where a scenelet begins or ends."""
    total = 0.0
    for t in range(1, len(item_of)):
        if item_of[t] != item_of[t - 1]:
            total += pose_jump(joints, t - 1, t, problem.joint_step)
    return -problem.smoothness_cost * problem.likelihood * total


@compiled
def _ground(problem: Problem, joints: Array) -> float:
    """E_g: how deep the lowest joint of each frame is below the floor."""
    total = 0.0
    for t in range(len(joints)):
        if problem.used[t].any():
            total += depth_below_floor(joints, t)
    return -problem.motion_cost * problem.frame_weight * problem.likelihood * total


@compiled
def evaluate(
    problem: Problem,
    camera: Array,
    items: Ints,
    placements: Array,
    sizes: Array,
    latent: Array,
    joints: Array,
    by_frame: Array,
) -> Array:
    """The terms of the log-posterior of one state.

    Parameters
    ----------
    problem : Problem
    camera : (5,) float
        phi: pitch (rad), elevation (m), log focal scale, log body scale, roll (rad).
    items : (k, 2) int
        Scenelet and start frame, sorted by start.
    placements : (k, 3) float
        x, y (m), yaw (rad) of each scenelet's local frame in the world.
    sizes : (k,) float
        Log size of each scenelet's person, on top of the body scale.
    latent : (T, 2) float
        Standard normal numbers of the path.
    joints : (T, 16, 3) float
        Out: the motion in the world, metres.
    by_frame : (T, 2) float
        Out: log-likelihood of each frame's detections, as they are and with left and right
        swapped, nats, unweighted; left as it is where the likelihood is switched off.

    Returns
    -------
    (10,) float
        Values of ``TERMS``; the first is -inf outside the support.
    """
    terms = np.zeros(10)
    item_of = np.full(problem.lift.shape[0], -1, dtype=np.int64)
    if not in_support(camera) or not _place_scenelets(
        problem, camera, items, placements, sizes, item_of, joints
    ):
        terms[0] = -math.inf
        return terms
    quadratic = 0.0
    for a in range(5):
        for b in range(5):
            quadratic += (
                (camera[a] - problem.camera_mean[a])
                * problem.camera_precision[a, b]
                * (camera[b] - problem.camera_mean[b])
            )
    terms[0] = problem.camera_constant - 0.5 * quadratic
    for i in range(len(items)):
        terms[1] += problem.log_rate[items[i, 0]]
    terms[3], terms[2] = _path(problem, camera, item_of, latent, joints)
    for i in range(len(items)):
        terms[2] += log_size_density(sizes[i], problem.size_spread)
    if problem.likelihood == 0.0:
        return terms
    boxes, turns, owner, yaws = _place_boxes(problem, items, placements)
    footprints = _footprints(boxes, turns)
    _detections(problem, camera, item_of, sizes, joints, boxes, turns, by_frame)
    weight = problem.frame_weight * problem.likelihood
    terms[4] = summed_over_swaps(by_frame, weight, problem.swap_begins, problem.swap_ends)
    for t in range(len(item_of)):
        if item_of[t] < 0:
            terms[5] -= weight * problem.free_cost[t]
    terms[6] = _smoothness(problem, item_of, joints)
    terms[7] = _collisions(problem, boxes, footprints, owner, yaws)
    terms[8] = _motion(problem, item_of, joints, boxes, turns, footprints, owner)
    terms[9] = _ground(problem, joints)
    return terms
