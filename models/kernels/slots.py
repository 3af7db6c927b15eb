"""What a scenelet in its place brings along: its boxes, and where it starts and ends, compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.energy.intersection import (
    BOTH,
    displaced_cost,
    give_way,
    overlap_depth,
)
from imapper_prob.models.jit import inner_inlined
from imapper_prob.models.kernels.body import apart, set_footprint
from imapper_prob.models.kernels.facing import log_yaw_density
from imapper_prob.models.kernels.memory import ADDED, Memory
from imapper_prob.models.kernels.sight import set_outlook
from imapper_prob.models.kernels.support import log_size_density
from imapper_prob.models.kernels.world import place_box
from imapper_prob.models.limits import NEAREST
from imapper_prob.models.problem import Problem
from imapper_prob.models.skeleton import PELV

__all__ = ["fill_slot", "sum_pairs"]

Array = NDArray[np.float64]


@inner_inlined
def fill_slot(problem: Problem, memory: Memory, camera: Array, slot: int) -> None:
    """Everything of ``slot`` that follows from its item and placement."""
    memory.bodies[slot] = math.exp(camera[3] + memory.sizes[slot])
    _place_boxes(problem, memory, camera, slot)
    scenelet = memory.items[slot, 0]
    first, last = problem.joint_first[scenelet], problem.joint_first[scenelet + 1] - 1
    _pelvis(problem, memory, camera, slot, last - 1, 2)
    _pelvis(problem, memory, camera, slot, last, 4)
    depth = _pelvis(problem, memory, camera, slot, first, 0)
    # From (bearing, log depth) of the first pelvis to (x, y).
    cosine = math.cos(camera[0]) * math.cos(camera[4])
    memory.placed[slot] = math.log(cosine / (depth * depth))
    start, yaw = memory.items[slot, 1], memory.placements[slot, 2]
    memory.placed[slot] += log_yaw_density(problem, scenelet, start, yaw)
    memory.placed[slot] += log_size_density(memory.sizes[slot], problem.size_spread)


@inner_inlined
def _pelvis(
    problem: Problem, memory: Memory, camera: Array, slot: int, frame: int, to: int
) -> float:
    """Bearing and log depth of the pelvis in a frame of the library; returns its depth."""
    px, py, yaw = memory.placements[slot]
    body = memory.bodies[slot]
    c, s = body * math.cos(yaw), body * math.sin(yaw)
    cp, sp = math.cos(camera[0]), math.sin(camera[0])
    x, y = problem.joints[frame, PELV, 0], problem.joints[frame, PELV, 1]
    height = body * problem.joints[frame, PELV, 2] - camera[1]
    forward = s * x + c * y + py
    depth: float = max(cp * forward + sp * height, NEAREST)
    right = math.cos(camera[4]) * (c * x - s * y + px)
    right += math.sin(camera[4]) * (cp * height - sp * forward)
    memory.pelvis[slot, to] = right / depth
    memory.pelvis[slot, to + 1] = math.log(depth)
    return depth


@inner_inlined
def _place_boxes(problem: Problem, memory: Memory, camera: Array, slot: int) -> None:
    scenelet = memory.items[slot, 0]
    px, py, yaw = memory.placements[slot]
    body = memory.bodies[slot]
    size = len(memory.boxes) // len(memory.counts)
    hull, floor = memory.hulls[slot], memory.floors[slot]
    hull[:] = (math.inf, -math.inf, math.inf, -math.inf, math.inf)
    floor[:] = (math.inf, -math.inf, math.inf, -math.inf)
    first, last = problem.box_first[scenelet], problem.box_first[scenelet + 1]
    memory.counts[slot] = last - first
    for b in range(first, last):
        k = slot * size + b - first
        box, turn = memory.boxes[k], memory.turns[k]
        place_box(problem.boxes, b, body, px, py, yaw, box, turn)
        memory.labels[k] = problem.box_label[b]
        memory.yaws[k] = problem.box_yaw[b] + yaw
        set_outlook(camera[1], box, turn, memory.outlooks[k])
        set_footprint(box, turn, memory.footprints[k])
        for i in (0, 2):
            hull[i] = min(hull[i], memory.outlooks[k, i])
            hull[i + 1] = max(hull[i + 1], memory.outlooks[k, i + 1])
            floor[i] = min(floor[i], memory.footprints[k, i])
            floor[i + 1] = max(floor[i + 1], memory.footprints[k, i + 1])
        hull[4] = min(hull[4], memory.outlooks[k, 4])


@inner_inlined
def _collide(problem: Problem, memory: Memory, one: int, other: int) -> float:
    """What it costs that objects in two slots are in each other, unless they are one, nats (15)."""
    if apart(memory.floors, one, memory.floors, other):
        return 0.0
    size = len(memory.boxes) // len(memory.counts)
    labels, yaws, boxes, turns = memory.labels, memory.yaws, memory.boxes, memory.turns
    merges = math.cos(problem.merge_angle)
    total = 0.0
    for i in range(one * size, one * size + memory.counts[one]):
        for k in range(other * size, other * size + memory.counts[other]):
            if apart(memory.footprints, i, memory.footprints, k):
                continue
            if labels[i] == labels[k]:
                front = problem.label_front[labels[i]]
                if not front or math.cos(yaws[i] - yaws[k]) > merges:
                    continue
            total += overlap_depth(boxes[i], turns[i], boxes[k], turns[k])
    sums = memory.displaced
    sums[:] = 0.0
    give_way(total, BOTH * problem.furniture_spread, sums)
    return displaced_cost(sums, problem.collision_cost)


@inner_inlined
def sum_pairs(problem: Problem, memory: Memory, n: int) -> float:
    """What it costs that objects of the ``n`` proposed scenelets are in each other, nats."""
    cost = 0.0
    for i in range(n):
        for k in range(i):
            one, other = memory.slots[1, i], memory.slots[1, k]
            if memory.role[one] == ADDED or memory.role[other] == ADDED:
                memory.pairs[one, other] = _collide(problem, memory, one, other)
                memory.pairs[other, one] = memory.pairs[one, other]
            cost += memory.pairs[one, other]
    return -problem.likelihood * cost
