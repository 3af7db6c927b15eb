"""Joints of the frames that moved, and how deep the body is in furniture, frame by frame."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import inner_inlined
from imapper_prob.models.kernels.cache import ADDED, REMOVED, Cache
from imapper_prob.models.kernels.frame import lens_of, set_detections, set_visibility_likelihoods
from imapper_prob.models.kernels.intersection import (
    aabb_disjoint,
    add_displaced_depth,
    depth_below_floor,
    depth_in_box,
    marginal_penetration_cost,
    set_body_columns,
)
from imapper_prob.models.kernels.path import pose_jump
from imapper_prob.models.kernels.visibility import (
    GAP,
    bounds_overlap,
    open_bounds,
    ray_bounds,
    ray_endpoints,
    update_clearance,
)
from imapper_prob.models.problem import Problem

__all__ = [
    "copy_joints",
    "find_changed",
    "find_penetrations",
    "list_moved",
    "pose_frames",
    "pose_joints",
    "sum_jumps",
    "sum_penetrations",
]

Array = NDArray[np.float64]


@inner_inlined
def list_moved(memory: Cache) -> int:
    """Put the frames that moved into ``memory.frames``; returns how many there are."""
    n = 0
    for t in range(len(memory.moved)):
        memory.frames[n] = t
        n += memory.moved[t]
    return n


@inner_inlined
def pose_joints(problem: Problem, memory: Cache, n: int, n_moved: int, camera: Array) -> None:
    """World joints of the frames that moved, with ``n`` scenelets, metres."""
    for i in range(n):
        slot = memory.slots[1, i]
        if memory.role[slot] == ADDED:
            _pose_covered_frames(problem, memory, slot)
    _pose_free_frames(problem, memory, n_moved, camera)


@inner_inlined
def copy_joints(memory: Cache, joints: Array) -> None:
    """World joints of the proposal into ``joints`` (T, 3, 16), metres."""
    rows = memory.pose_row
    for t in range(len(joints)):
        for axis in range(3):
            for j in range(joints.shape[2]):
                joints[t, axis, j] = memory.joints[rows[t], axis, j]


@inner_inlined
def pose_frames(problem: Problem, memory: Cache, n: int, n_moved: int, camera: Array) -> None:
    """Everything that follows from the joints of a frame that moved, with ``n`` scenelets."""
    for i in range(n):
        slot = memory.slots[1, i]
        if memory.role[slot] == ADDED:
            _find_likelihoods(problem, memory, camera, slot)
    rows, joints, lines, views = memory.pose_row, memory.joints, memory.lines, memory.views
    columns, ground, sunk = memory.columns, memory.ground, memory.sunk
    # All frames are aimed at first: a row just stored in parts cannot be read again at once.
    for i in range(n_moved):
        ray_endpoints(camera[1], joints, lines, rows[memory.frames[i]])
    for i in range(n_moved):
        ray_bounds(lines, rows[memory.frames[i]], memory.bench, views)
    for i in range(n_moved):
        row = rows[memory.frames[i]]
        set_body_columns(joints, row, columns, ground, row)
        sunk[row] = depth_below_floor(joints, row)


@inner_inlined
def _pose_covered_frames(problem: Problem, memory: Cache, slot: int) -> None:
    """World joints of the scenelet in ``slot`` in all its frames, metres."""
    px, py, yaw = memory.placements[slot]
    body = memory.bodies[slot]
    c, s = body * math.cos(yaw), body * math.sin(yaw)
    joints, rows, library = memory.joints, memory.pose_row, problem.joints
    start = memory.items[slot, 1]
    offset = problem.joint_first[memory.items[slot, 0]] - start
    for t in range(start, memory.items[slot, 2]):
        row = rows[t]
        for j in range(16):
            x, y = library[offset + t, j, 0], library[offset + t, j, 1]
            joints[row, 0, j] = c * x - s * y + px
            joints[row, 1, j] = s * x + c * y + py
            joints[row, 2, j] = body * library[offset + t, j, 2]


@inner_inlined
def _find_likelihoods(problem: Problem, memory: Cache, camera: Array, slot: int) -> None:
    """How likely the detections are, of joints hidden and seen, in all frames of ``slot``."""
    lens, body = lens_of(problem, camera), memory.bodies[slot]
    joints, rows, chances = memory.joints, memory.pose_row, memory.chances
    places, facts, desk, bench = memory.places, memory.facts, memory.desk, memory.bench
    told = memory.told
    for t in range(memory.items[slot, 1], memory.items[slot, 2]):
        row = rows[t]
        if not told[t]:
            set_detections(problem, t, places, facts, t)
            told[t] = 1
        set_visibility_likelihoods(
            lens, body, joints, row, places, facts, t, desk, bench, chances, row
        )


@inner_inlined
def _pose_free_frames(problem: Problem, memory: Cache, n_moved: int, camera: Array) -> None:
    """World joints of every free frame that moved: its own pose where the path goes, metres."""
    cp, sp = math.cos(camera[0]), math.sin(camera[0])
    cr, sr = math.cos(camera[4]), math.sin(camera[4])
    focal, body, elevation = math.exp(camera[2]), math.exp(camera[3]), camera[1]
    joints, path, rows, cover = memory.joints, memory.path, memory.pose_row, memory.cover
    poses, lift = memory.poses, problem.lift
    for i in range(n_moved):
        t = memory.frames[i]
        if cover[1, t] < 0:
            row = rows[t]
            depth = math.exp(path[row, 1])
            px, pz = path[row, 0] * depth, lift[t] / focal * depth
            for j in range(16):
                right = px + body * poses[t, 0, j]
                y = depth + body * poses[t, 1, j]
                up = pz + body * poses[t, 2, j]
                z = sr * right + cr * up
                joints[row, 0, j] = cr * right - sr * up
                joints[row, 1, j] = cp * y - sp * z
                joints[row, 2, j] = sp * y + cp * z + elevation


@inner_inlined
def sum_jumps(problem: Problem, memory: Cache, n: int, camera: Array) -> float:
    """What it costs that the pose jumps where a scenelet begins or ends, nats."""
    total, scale = 0.0, problem.joint_step * math.exp(camera[3])
    joints, rows, cover, items = memory.joints, memory.pose_row, memory.cover, memory.items
    starts = problem.path_starts
    for i in range(n):
        slot = memory.slots[1, i]
        first, last = items[slot, 1], items[slot, 2]
        if not starts[first]:
            total += pose_jump(joints, rows[first - 1], rows[first], scale)
        if last < len(rows) and cover[1, last] < 0 and not starts[last]:
            total += pose_jump(joints, rows[last - 1], rows[last], scale)
    return -problem.smoothness_cost * problem.likelihood * total


# ------------------------------------------------------------------------------------------------
# What furniture and the body of a frame have to do with each other, slot by slot, compiled.

Ints = NDArray[np.int64]


@inner_inlined
def find_penetrations(memory: Cache, n: int, n_moved: int) -> None:
    """Let all ``n`` scenelets meet the frames that moved, and new ones every frame."""
    for i in range(n):
        slot = memory.slots[1, i]
        fresh = memory.role[slot] == ADDED
        frames = memory.every if fresh else memory.frames
        _penetration(memory, slot, frames, len(frames) if fresh else n_moved)


@inner_inlined
def _penetration(memory: Cache, slot: int, frames: Ints, n: int) -> None:
    """Clearance of lines of sight from the boxes in ``slot``, and how deep the body is in them.

    In the first ``n`` of ``frames``.
    """
    size = len(memory.boxes) // len(memory.counts)
    first, last = slot * size, slot * size + memory.counts[slot]
    rows, cover, watched, lines = memory.pose_row, memory.cover, memory.watched, memory.lines
    hulls, floors, views, ground = memory.hulls, memory.floors, memory.views, memory.ground
    bench, outlooks, gaps, columns = memory.bench, memory.outlooks, memory.gaps, memory.columns
    footprints, boxes, turns = memory.footprints, memory.boxes, memory.turns
    for i in range(n):
        t = frames[i]
        row = rows[t]
        near = bounds_overlap(hulls, slot, views, row)
        if near:
            open_bounds(bench)
            near = update_clearance(outlooks, first, last, lines, views, row, bench)
            for j in range(gaps.shape[2]):
                gaps[slot, row, j] = bench[GAP + j]
        memory.near[slot, row] = near
        depth = 0.0
        if watched[t] and cover[1, t] != slot and not aabb_disjoint(ground, row, floors, slot):
            for k in range(first, last):
                if not aabb_disjoint(ground, row, footprints, k):
                    depth += depth_in_box(columns, row, boxes, turns, k)
        memory.depths[slot, row] = depth


@inner_inlined
def find_changed(memory: Cache, n: int, n_old: int) -> None:
    """Frames whose vote can differ: they moved, or boxes that came or went may hide something."""
    n_frames = len(memory.changed)
    changed, rows, role = memory.changed, memory.pose_row, memory.role
    near = memory.near
    for t in range(n_frames):
        changed[t] = memory.moved[t]
    for which in range(2):
        wanted = REMOVED if which == 0 else ADDED
        for i in range(n_old if which == 0 else n):
            slot = memory.slots[which, i]
            if role[slot] == wanted:
                for t in range(n_frames):
                    changed[t] |= near[slot, rows[t]]
    for t in range(n_frames):
        now = t + n_frames * np.int64(memory.sum_at[t])
        memory.sum_row[t] = 2 * t + n_frames - now if changed[t] else now


@inner_inlined
def sum_penetrations(problem: Problem, memory: Cache, n: int) -> float:
    """E_m: what it costs that the body stands in furniture not the frame's own, nats."""
    total, unit = 0.0, problem.frame_weight * problem.likelihood * problem.motion_cost
    rows, depths, sums = memory.pose_row, memory.depths, memory.displaced
    for i in range(n):
        slot = memory.slots[1, i]
        sums[:] = 0.0
        for t in range(len(rows)):
            depth = depths[slot, rows[t]]
            if depth > 0.0:
                add_displaced_depth(depth, problem.furniture_spread, sums)
        total += marginal_penetration_cost(sums, unit)
    return -total
