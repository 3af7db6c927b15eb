"""What furniture does to sight and space: hidden joints, and things in each other, compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.energy.intersection import overlap_depth
from imapper_prob.models.jit import inner
from imapper_prob.models.kernels.body import apart, depth_in_box, set_columns, set_footprint
from imapper_prob.models.kernels.sight import (
    BENCH,
    GAP,
    LINE,
    OUTLOOK,
    VIEW,
    Singles,
    aim,
    clear,
    look,
    open_view,
    set_outlook,
)
from imapper_prob.models.problem import Problem

__all__ = ["collision_depths", "find_clearances", "find_footprints", "motion_depths"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@inner
def find_clearances(elevation: float, joints: Array, boxes: Array, turns: Array) -> Singles:
    """(T, 16) clearance of the line of sight to every joint from all boxes, metres."""
    outlooks = np.empty((len(boxes), OUTLOOK), np.float32)
    for k in range(len(boxes)):
        set_outlook(elevation, boxes[k], turns[k], outlooks[k])
    n = len(joints)
    bench, gaps = np.empty(BENCH, np.float32), np.empty((n, 16), np.float32)
    lines, views = np.empty((n, LINE), np.float32), np.empty((n, VIEW), np.float32)
    for t in range(n):
        aim(elevation, joints, lines, t)
    for t in range(n):
        look(lines, t, bench, views)
    for t in range(n):
        open_view(bench)
        clear(outlooks, 0, len(boxes), lines, views, t, bench)
        for j in range(16):
            gaps[t, j] = bench[GAP + j]
    return gaps


@inner
def find_footprints(boxes: Array, turns: Array) -> Array:
    """(K, 4) least and greatest x, least and greatest y of every box, metres."""
    footprints = np.empty((len(boxes), 4))
    for k in range(len(boxes)):
        set_footprint(boxes[k], turns[k], footprints[k])
    return footprints


@inner
def collision_depths(
    problem: Problem,
    n_items: int,
    boxes: Array,
    turns: Array,
    footprints: Array,
    owner: Ints,
    yaws: Array,
) -> Array:
    """(k, k) metres that objects of two items are in each other, unless they are one; i < j."""
    total = np.zeros((n_items, n_items))
    n = len(boxes)
    merges = math.cos(problem.merge_angle)
    for a in range(n):
        for b in range(a + 1, n):
            if owner[a, 0] == owner[b, 0] or apart(footprints, a, footprints, b):
                continue
            if owner[a, 2] == owner[b, 2]:
                front = problem.label_front[owner[a, 2]]
                if not front or math.cos(yaws[a] - yaws[b]) > merges:
                    continue
            total[owner[a, 0], owner[b, 0]] += overlap_depth(boxes[a], turns[a], boxes[b], turns[b])
    return total


@inner
def motion_depths(
    n_items: int,
    item_of: Ints,
    joints: Array,
    boxes: Array,
    turns: Array,
    footprints: Array,
    owner: Ints,
) -> Array:
    """(k, T) metres that the body stands in each item's objects, but in frames of its own."""
    total = np.zeros((n_items, len(item_of)))
    columns, ground = np.empty((1, 5, 4)), np.empty((1, 4))
    for t in range(len(item_of)):
        set_columns(joints, t, columns, ground, 0)
        for k in range(len(boxes)):
            if owner[k, 0] != item_of[t] and not apart(ground, 0, footprints, k):
                total[owner[k, 0], t] += depth_in_box(columns, 0, boxes, turns, k)
    return total
