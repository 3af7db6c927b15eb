"""A state as a world: where the person is in every frame, and where furniture stands, compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.chain import chain, find_known
from imapper_prob.models.jit import compiled, inner
from imapper_prob.models.kernels.facing import log_yaw_density
from imapper_prob.models.kernels.support import in_support, log_size_density
from imapper_prob.models.limits import NEAREST
from imapper_prob.models.problem import Problem
from imapper_prob.models.skeleton import PELV

__all__ = ["place_boxes", "weigh_priors"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@inner
def weigh_priors(
    problem: Problem,
    camera: Array,
    items: Ints,
    placements: Array,
    sizes: Array,
    latent: Array,
    item_of: Ints,
    joints: Array,
    terms: Array,
) -> bool:
    """Place the motion, and what the priors say of it: the first four of the terms.

    Parameters
    ----------
    problem, camera, items, placements, sizes, latent
        See :func:`imapper_prob.models.compiled.evaluate`.
    item_of : (T,) int
        In: -1. Out: which item covers a frame, -1 if free.
    joints : (T, 3, 16) float
        Out: the motion in the world, metres.
    terms : (4 or more,) float
        Out: camera, layout, placement and path, nats.

    Returns
    -------
    bool
        Whether the state is in the support; if not, the first term is -inf.
    """
    if not in_support(camera) or not _place_scenelets(
        problem, camera, items, placements, sizes, item_of, joints
    ):
        terms[0] = -math.inf
        return False
    quadratic = 0.0
    for a in range(5):
        for b in range(5):
            quadratic += (
                (camera[a] - problem.camera_mean[a])
                * problem.camera_precision[a, b]
                * (camera[b] - problem.camera_mean[b])
            )
    terms[0] = problem.camera_constant - 0.5 * quadratic
    terms[3], terms[2] = _path(problem, camera, item_of, latent, joints)
    for i in range(len(items)):
        terms[1] += problem.log_rate[items[i, 0]]
        terms[2] += log_size_density(sizes[i], problem.size_spread)
        terms[2] += log_yaw_density(problem, items[i, 0], items[i, 1], placements[i, 2])
    return True


@inner
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

    Nor may one go on where the film of somebody else begins.

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
            if item_of[start + t] >= 0 or (t > 0 and problem.path_starts[start + t]):
                return False
            item_of[start + t] = i
            for j in range(16):
                x = problem.joints[first + t, j, 0]
                y = problem.joints[first + t, j, 1]
                joints[start + t, 0, j] = c * x - s * y + px
                joints[start + t, 1, j] = s * x + c * y + py
                joints[start + t, 2, j] = body * problem.joints[first + t, j, 2]
    return True


@inner
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
            x, y, z = joints[t, 0, PELV], joints[t, 1, PELV], joints[t, 2, PELV] - camera[1]
            depth = max(cp * y + sp * z, NEAREST)
            values[0, t] = (cr * x + sr * (cp * z - sp * y)) / depth
            values[1, t] = math.log(depth)
            if t == 0 or item_of[t] != item_of[t - 1]:
                # From (bearing, log depth) of the first pelvis to (x, y).
                placement += math.log(cr * cp / (depth * depth))
    evidence, known = 0.0, np.empty(n_frames, dtype=np.int64)
    find_known(item_of, problem.path_starts, known)
    for axis in range(2):
        # The same pixels under another focal length and body size.
        unit = 1.0 / focal if axis == 0 else 1.0
        offset = 0.0 if axis == 0 else camera[2] + camera[3]
        evidence += chain(
            values[axis], item_of, known, problem.path_starts,
            unit * problem.path_centre[:, axis] + offset, unit * problem.path_scale[:, axis],
            latent[:, axis], problem.path_mean[axis], problem.path_draw[axis],
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
                joints[t, 0, j] = cr * right - sr * up
                joints[t, 1, j] = cp * y - sp * z
                joints[t, 2, j] = sp * y + cp * z + camera[1]
    return evidence, placement


@compiled
def place_boxes(
    problem: Problem, camera: Array, items: Ints, placements: Array, sizes: Array
) -> tuple[Array, Array, Ints, Array]:
    """Boxes in the world (K, 7); cosine, sine, radius (K, 3); item, object, label; object yaw.

    Furniture is as much larger than the library's as the person who uses it.
    """
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
        body = math.exp(camera[3] + sizes[i])
        c, s = body * math.cos(yaw), body * math.sin(yaw)
        for b in range(problem.box_first[items[i, 0]], problem.box_first[items[i, 0] + 1]):
            local = problem.boxes[b]
            boxes[k, 0] = c * local[0] - s * local[1] + placements[i, 0]
            boxes[k, 1] = s * local[0] + c * local[1] + placements[i, 1]
            for axis in range(2, 6):
                boxes[k, axis] = body * local[axis]
            boxes[k, 6] = local[6] + yaw
            turns[k, 0], turns[k, 1] = math.cos(boxes[k, 6]), math.sin(boxes[k, 6])
            turns[k, 2] = body * math.sqrt(local[3] ** 2 + local[4] ** 2 + local[5] ** 2)
            owner[k, 0], owner[k, 1] = i, problem.box_object[b]
            owner[k, 2] = problem.box_label[b]
            yaws[k] = problem.box_yaw[b] + yaw
            k += 1
    return boxes, turns, owner, yaws
