"""Placement of scenelets: boxes, first and last pelvis, yaw and size (model.md 9, 10, 15).

The prior of a scenelet's yaw is a wrapped Cauchy distribution about the yaw at which it faces, on
average over its frames, the direction of the static path. Detections alone hardly determine the yaw
of a seated person, but the lifted poses of the static path do. The density has a closed form, and
heavy tails for frames in which the lifted pose is wrong.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled, inner_inlined
from imapper_prob.models.kernels.axes import camera_pose, point_to_camera, rotated, rotated_back
from imapper_prob.models.kernels.cache import ADDED, Cache
from imapper_prob.models.kernels.intersection import (
    BOTH,
    aabb_disjoint,
    add_displaced_depth,
    marginal_penetration_cost,
    overlap_depth,
    set_footprint,
)
from imapper_prob.models.kernels.visibility import set_occluder
from imapper_prob.models.problem import Problem
from imapper_prob.models.settings import LOWEST_CAMERA, STEEPEST_CAMERA
from imapper_prob.models.skeleton import PELV
from imapper_prob.models.view import seen_point

__all__ = [
    "expected_facing",
    "fill_slot",
    "in_support",
    "log_yaw_density",
    "place_boxes",
    "sum_pairs",
]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@inner_inlined
def _place_box(
    boxes: Array, b: int, body: float, x: float, y: float, yaw: float, box: Array, turn: Array
) -> None:
    """Transform a box of the library to the world frame.

    Parameters
    ----------
    boxes : (B, 7) float
        Boxes in the local frames of their scenelets.
    b : int
        Row of ``boxes``.
    body : float
        Size of person and furniture, a factor.
    x, y, yaw : float
        Placement of the scenelet, metres and radians.
    box : (7,) float
        Output.
    turn : (3,) float
        Output: cosine and sine of its yaw, and half a diagonal (m).
    """
    local = boxes[b]
    c, s = body * math.cos(yaw), body * math.sin(yaw)
    across, ahead = rotated(c, s, local[0], local[1])
    box[0], box[1] = across + x, ahead + y
    for axis in range(2, 6):
        box[axis] = body * local[axis]
    box[6] = local[6] + yaw
    turn[0], turn[1] = math.cos(box[6]), math.sin(box[6])
    turn[2] = body * math.sqrt(local[3] ** 2 + local[4] ** 2 + local[5] ** 2)


@compiled
def place_boxes(
    problem: Problem, camera: Array, items: Ints, placements: Array, sizes: Array
) -> tuple[Array, Array, Ints, Array]:
    """Transform the boxes of all scenelets of a state to the world frame.

    Furniture is scaled by the same factor as the person who uses it.

    Parameters
    ----------
    problem : Problem
    camera, items, placements, sizes
        See :class:`imapper_prob.models.log_posterior.State`.

    Returns
    -------
    boxes : (K, 7) float
        In the world.
    rotations : (K, 3) float
        Cosine and sine of their yaws, and half a diagonal (m).
    owner : (K, 3) int
        Item, object and label of each box.
    yaws : (K,) float
        Yaw of the object of each box, radians.
    """
    n = 0
    for i in range(len(items)):
        n += problem.box_first[items[i, 0] + 1] - problem.box_first[items[i, 0]]
    boxes = np.empty((n, 7))
    rotations = np.empty((n, 3))
    owner = np.empty((n, 3), dtype=np.int64)
    yaws = np.empty(n)
    k = 0
    for i in range(len(items)):
        yaw = placements[i, 2]
        body = math.exp(camera[3] + sizes[i])
        for b in range(problem.box_first[items[i, 0]], problem.box_first[items[i, 0] + 1]):
            x, y = placements[i, 0], placements[i, 1]
            _place_box(problem.boxes, b, body, x, y, yaw, boxes[k], rotations[k])
            owner[k, 0], owner[k, 1] = i, problem.box_object[b]
            owner[k, 2] = problem.box_label[b]
            yaws[k] = problem.box_yaw[b] + yaw
            k += 1
    return boxes, rotations, owner, yaws


@inner_inlined
def fill_slot(problem: Problem, cache: Cache, camera: Array, slot: int) -> None:
    """Compute all values of a slot that follow from its item and placement.

    Parameters
    ----------
    problem : Problem
    cache : Cache
    camera : (5,) float
    slot : int
    """
    cache.bodies[slot] = math.exp(camera[3] + cache.sizes[slot])
    _place_boxes(problem, cache, camera, slot)
    scenelet = cache.items[slot, 0]
    first, last = problem.joint_first[scenelet], problem.joint_first[scenelet + 1] - 1
    _pelvis(problem, cache, camera, slot, last - 1, 2)
    _pelvis(problem, cache, camera, slot, last, 4)
    depth = _pelvis(problem, cache, camera, slot, first, 0)
    # Change of variables from (bearing, log depth) of the first pelvis to (x, y).
    cosine = math.cos(camera[0]) * math.cos(camera[4])
    cache.placement_log_density[slot] = math.log(cosine / (depth * depth))
    start, yaw = cache.items[slot, 1], cache.placements[slot, 2]
    cache.placement_log_density[slot] += log_yaw_density(problem, scenelet, start, yaw)
    cache.placement_log_density[slot] += _log_size_density(cache.sizes[slot], problem.size_spread)


@inner_inlined
def _pelvis(problem: Problem, cache: Cache, camera: Array, slot: int, frame: int, to: int) -> float:
    """Compute bearing and log depth of the pelvis in a frame of the library; returns its depth."""
    px, py, yaw = cache.placements[slot]
    body = cache.bodies[slot]
    c, s = body * math.cos(yaw), body * math.sin(yaw)
    x, y = rotated(c, s, problem.joints[frame, PELV, 0], problem.joints[frame, PELV, 1])
    z = body * problem.joints[frame, PELV, 2]
    right, depth, _ = point_to_camera(camera_pose(camera), x + px, y + py, z)
    cache.pelvis[slot, to], cache.pelvis[slot, to + 1] = seen_point(right, depth)
    return float(depth)


@inner_inlined
def _place_boxes(problem: Problem, cache: Cache, camera: Array, slot: int) -> None:
    scenelet = cache.items[slot, 0]
    px, py, yaw = cache.placements[slot]
    body = cache.bodies[slot]
    size = len(cache.boxes) // len(cache.counts)
    hull, floor = cache.hulls[slot], cache.floors[slot]
    hull[:] = (math.inf, -math.inf, math.inf, -math.inf, math.inf)
    floor[:] = (math.inf, -math.inf, math.inf, -math.inf)
    first, last = problem.box_first[scenelet], problem.box_first[scenelet + 1]
    cache.counts[slot] = last - first
    for b in range(first, last):
        k = slot * size + b - first
        box, turn = cache.boxes[k], cache.rotations[k]
        _place_box(problem.boxes, b, body, px, py, yaw, box, turn)
        cache.labels[k] = problem.box_label[b]
        cache.yaws[k] = problem.box_yaw[b] + yaw
        set_occluder(camera[1], box, turn, cache.occluders[k])
        set_footprint(box, turn, cache.footprints[k])
        for i in (0, 2):
            hull[i] = min(hull[i], cache.occluders[k, i])
            hull[i + 1] = max(hull[i + 1], cache.occluders[k, i + 1])
            floor[i] = min(floor[i], cache.footprints[k, i])
            floor[i + 1] = max(floor[i + 1], cache.footprints[k, i + 1])
        hull[4] = min(hull[4], cache.occluders[k, 4])


@inner_inlined
def _collide(problem: Problem, cache: Cache, one: int, other: int) -> float:
    """Cost of collisions between the objects of two slots, except merged objects, nats (15)."""
    if aabb_disjoint(cache.floors, one, cache.floors, other):
        return 0.0
    size = len(cache.boxes) // len(cache.counts)
    labels, yaws, boxes, rotations = cache.labels, cache.yaws, cache.boxes, cache.rotations
    merges = math.cos(problem.merge_angle)
    total = 0.0
    for i in range(one * size, one * size + cache.counts[one]):
        for k in range(other * size, other * size + cache.counts[other]):
            if aabb_disjoint(cache.footprints, i, cache.footprints, k):
                continue
            if labels[i] == labels[k]:
                front = problem.label_front[labels[i]]
                if not front or math.cos(yaws[i] - yaws[k]) > merges:
                    continue
            total += overlap_depth(boxes[i], rotations[i], boxes[k], rotations[k])
    sums = cache.displaced
    sums[:] = 0.0
    add_displaced_depth(total, BOTH * problem.furniture_spread, sums)
    return marginal_penetration_cost(sums, problem.collision_cost)


@inner_inlined
def sum_pairs(problem: Problem, cache: Cache, n: int) -> float:
    """The collision term -E_c: minus the cost of collisions between different scenelets.

    Parameters
    ----------
    problem : Problem
    cache : Cache
    n : int
        Number of scenelets of the proposal.

    Returns
    -------
    float
        Nats, at most 0.
    """
    cost = 0.0
    for i in range(n):
        for k in range(i):
            one, other = cache.slots[1, i], cache.slots[1, k]
            if cache.role[one] == ADDED or cache.role[other] == ADDED:
                cache.collision_costs[one, other] = _collide(problem, cache, one, other)
                cache.collision_costs[other, one] = cache.collision_costs[one, other]
            cost += cache.collision_costs[one, other]
    return -problem.likelihood * cost


_UNKNOWN = 1e-9
"""Length of a mean direction vector below which it has no direction."""


@compiled
def expected_facing(problem: Problem, scenelet: int, start: int) -> tuple[float, float]:
    """The yaw at which a scenelet faces, on average, the direction of the static path.

    Parameters
    ----------
    problem : Problem
    scenelet, start : int
        Index in the library, and start frame.

    Returns
    -------
    cosine, sine : float
        Cosine and sine of the yaw; 0, 0 if it is unknown.
    """
    first, last = problem.joint_first[scenelet], problem.joint_first[scenelet + 1]
    along, aside = 0.0, 0.0
    for n in range(first, last):
        seen = problem.path_facing[start + n - first]
        own = problem.joint_facing[n]
        ahead, left = rotated_back(own[0], own[1], seen[0], seen[1])
        along += ahead
        aside += left
    length = math.hypot(along, aside)
    if length < _UNKNOWN:
        return 0.0, 0.0
    return along / length, aside / length


@compiled
def log_yaw_density(problem: Problem, scenelet: int, start: int, yaw: float) -> float:
    """Log density of a scenelet's yaw: wrapped Cauchy, or uniform if nothing is known.

    Parameters
    ----------
    problem : Problem
    scenelet, start : int
        Index in the library, and start frame.
    yaw : float
        Radians.

    Returns
    -------
    float
        Nats, per radian.
    """
    along, aside = expected_facing(problem, scenelet, start)
    if along == 0.0 and aside == 0.0:
        return -math.log(2 * math.pi)
    near = math.exp(-problem.facing_spread)
    cosine = along * math.cos(yaw) + aside * math.sin(yaw)
    density = (1.0 - near * near) / (2 * math.pi * (1.0 + near * near - 2.0 * near * cosine))
    return math.log(density)


@compiled
def in_support(camera: NDArray[np.float64]) -> bool:
    """Whether elevation, pitch and roll of the camera are inside the prior's support.

    Parameters
    ----------
    camera : (5,) float
        phi, see :class:`imapper_prob.models.log_posterior.State`.

    Returns
    -------
    bool
    """
    upright = abs(camera[0]) < STEEPEST_CAMERA and abs(camera[4]) < STEEPEST_CAMERA
    return bool(upright and camera[1] > LOWEST_CAMERA)


@compiled
def _log_size_density(size: float, spread: float) -> float:
    """log N(size; 0, spread^2) of the log size of one scenelet.

    Parameters
    ----------
    size : float
        Log.
    spread : float
        Standard deviation, log.

    Returns
    -------
    float
        Nats.
    """
    ratio = size / spread
    return -0.5 * (math.log(2 * math.pi) + ratio * ratio) - math.log(spread)
