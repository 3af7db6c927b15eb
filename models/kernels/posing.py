"""Joints of the frames that moved, and all values that depend on them.

Frames inside a scenelet have its pose; free frames have their static pose at the drawn path. The
joints determine likelihoods, lines of sight with their clearance from each slot's boxes, and the
penetration of the body into furniture.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import inner_inlined
from imapper_prob.models.kernels.axes import rotated
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
from imapper_prob.models.view import floor_point

__all__ = [
    "copy_joints",
    "list_moved",
    "mark_changed",
    "mark_near",
    "pose_joints",
    "sum_jumps",
    "sum_penetrations",
    "trace_lines",
    "update_likelihoods",
    "update_penetrations",
]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@inner_inlined
def list_moved(cache: Cache) -> int:
    """Write the frames that moved to ``cache.frames``.

    Parameters
    ----------
    cache : Cache

    Returns
    -------
    int
        Their number.
    """
    n = 0
    for t in range(len(cache.moved)):
        cache.frames[n] = t
        n += cache.moved[t]
    return n


@inner_inlined
def pose_joints(problem: Problem, cache: Cache, n: int, n_moved: int, camera: Array) -> None:
    """Compute the world joints of the frames that moved.

    Parameters
    ----------
    problem : Problem
    cache : Cache
    n, n_moved : int
        Numbers of scenelets of the proposal, and of frames that moved.
    camera : (5,) float
    """
    for i in range(n):
        slot = cache.slots[1, i]
        if cache.role[slot] == ADDED:
            _pose_covered_frames(problem, cache, slot)
    _pose_free_frames(problem, cache, n_moved, camera)


@inner_inlined
def copy_joints(cache: Cache, joints: Array) -> None:
    """Copy the world joints of the proposal.

    Parameters
    ----------
    cache : Cache
    joints : (T, 3, 16) float
        Output, metres; may be empty.
    """
    rows = cache.pose_row
    for t in range(len(joints)):
        for axis in range(3):
            for j in range(joints.shape[2]):
                joints[t, axis, j] = cache.joints[rows[t], axis, j]


@inner_inlined
def update_likelihoods(problem: Problem, cache: Cache, n: int, camera: Array) -> None:
    """Compute likelihoods of detections for hidden and for seen joints in all new scenelets.

    Parameters
    ----------
    problem : Problem
    cache : Cache
    n : int
        Number of scenelets of the proposal.
    camera : (5,) float
    """
    for i in range(n):
        slot = cache.slots[1, i]
        if cache.role[slot] == ADDED:
            _update_likelihoods(problem, cache, camera, slot)


@inner_inlined
def trace_lines(cache: Cache, n_moved: int, camera: Array) -> None:
    """Compute lines of sight to the joints, and the extent of the body, of frames that moved.

    Parameters
    ----------
    cache : Cache
    n_moved : int
        Number of frames that moved.
    camera : (5,) float
    """
    rows, joints, lines, views = cache.pose_row, cache.joints, cache.lines, cache.views
    columns, ground, floor_depths = cache.columns, cache.ground, cache.floor_depths
    # Separate loops: a row that was just stored in parts cannot be read again without delay.
    for i in range(n_moved):
        ray_endpoints(camera[1], joints, lines, rows[cache.frames[i]])
    for i in range(n_moved):
        ray_bounds(lines, rows[cache.frames[i]], cache.scratch32, views)
    for i in range(n_moved):
        row = rows[cache.frames[i]]
        set_body_columns(joints, row, columns, ground, row)
        floor_depths[row] = depth_below_floor(joints, row)


@inner_inlined
def _pose_covered_frames(problem: Problem, cache: Cache, slot: int) -> None:
    """Compute the world joints of the scenelet in ``slot`` in all its frames, metres."""
    px, py, yaw = cache.placements[slot]
    body = cache.bodies[slot]
    c, s = body * math.cos(yaw), body * math.sin(yaw)
    joints, rows, library = cache.joints, cache.pose_row, problem.joints
    start = cache.items[slot, 1]
    offset = problem.joint_first[cache.items[slot, 0]] - start
    for t in range(start, cache.items[slot, 2]):
        row = rows[t]
        for j in range(16):
            x, y = library[offset + t, j, 0], library[offset + t, j, 1]
            x, y = rotated(c, s, x, y)
            joints[row, 0, j], joints[row, 1, j] = x + px, y + py
            joints[row, 2, j] = body * library[offset + t, j, 2]


@inner_inlined
def _update_likelihoods(problem: Problem, cache: Cache, camera: Array, slot: int) -> None:
    """Compute likelihoods of detections for hidden and seen joints in all frames of ``slot``."""
    lens, body = lens_of(problem, camera), cache.bodies[slot]
    joints, rows, likelihoods = cache.joints, cache.pose_row, cache.likelihoods
    uv, params, scratch64, scratch32 = cache.uv, cache.params, cache.scratch64, cache.scratch32
    detections_set, tolerance = cache.detections_set, problem.pose_tolerance
    for t in range(cache.items[slot, 1], cache.items[slot, 2]):
        row = rows[t]
        if not detections_set[t]:
            set_detections(problem, t, uv, params, t)
            detections_set[t] = 1
        set_visibility_likelihoods(
            lens, tolerance, body, joints, row, uv, params, t,
            scratch64, scratch32, likelihoods, row,
        )  # fmt: skip
        cache.ceilings[row, 0] = math.nan


@inner_inlined
def _pose_free_frames(problem: Problem, cache: Cache, n_moved: int, camera: Array) -> None:
    """Compute the world joints of every free frame that moved: its static pose on the path,
    metres."""
    cp, sp = math.cos(camera[0]), math.sin(camera[0])
    cr, sr = math.cos(camera[4]), math.sin(camera[4])
    focal, body, elevation = math.exp(camera[2]), math.exp(camera[3]), camera[1]
    joints, path, rows, cover = cache.joints, cache.path, cache.pose_row, cache.cover
    poses, lift = cache.poses, problem.lift
    for i in range(n_moved):
        t = cache.frames[i]
        if cover[1, t] < 0:
            row = rows[t]
            px, depth = floor_point(path[row, 0], path[row, 1])
            pz = lift[t] / focal * depth
            for j in range(16):
                right = px + body * poses[t, 0, j]
                y = depth + body * poses[t, 1, j]
                up = pz + body * poses[t, 2, j]
                z = sr * right + cr * up
                joints[row, 0, j] = cr * right - sr * up
                joints[row, 1, j] = cp * y - sp * z
                joints[row, 2, j] = sp * y + cp * z + elevation


@inner_inlined
def sum_jumps(problem: Problem, cache: Cache, n: int, camera: Array) -> float:
    """The smoothness term -E_s: minus the cost of pose jumps where scenelets begin or end.

    Parameters
    ----------
    problem : Problem
    cache : Cache
    n : int
        Number of scenelets of the proposal.
    camera : (5,) float

    Returns
    -------
    float
        Nats.
    """
    total, scale = 0.0, problem.joint_step * math.exp(camera[3])
    joints, rows, cover, items = cache.joints, cache.pose_row, cache.cover, cache.items
    starts = problem.path_starts
    for i in range(n):
        slot = cache.slots[1, i]
        first, last = items[slot, 1], items[slot, 2]
        if not starts[first]:
            total += pose_jump(joints, rows[first - 1], rows[first], scale)
        if last < len(rows) and cover[1, last] < 0 and not starts[last]:
            total += pose_jump(joints, rows[last - 1], rows[last], scale)
    return -problem.smoothness_cost * problem.likelihood * total


@inner_inlined
def update_penetrations(cache: Cache, n: int, n_moved: int) -> None:
    """Update clearance and penetration: all frames for new scenelets, moved frames for the others.

    Parameters
    ----------
    cache : Cache
    n, n_moved : int
        Numbers of scenelets of the proposal, and of frames that moved.
    """
    for i in range(n):
        slot = cache.slots[1, i]
        fresh = cache.role[slot] == ADDED
        frames = cache.every if fresh else cache.frames
        _penetration(cache, slot, frames, len(frames) if fresh else n_moved)


@inner_inlined
def _penetration(cache: Cache, slot: int, frames: Ints, n: int) -> None:
    """Clearance of lines of sight from the boxes in ``slot``, and depth of the body in them.

    Only for the first ``n`` of ``frames``.
    """
    size = len(cache.boxes) // len(cache.counts)
    first, last = slot * size, slot * size + cache.counts[slot]
    rows, cover, detected, lines = cache.pose_row, cache.cover, cache.detected, cache.lines
    hulls, floors, views, ground = cache.hulls, cache.floors, cache.views, cache.ground
    scratch32, occluders, slot_clearance, columns = (
        cache.scratch32,
        cache.occluders,
        cache.slot_clearance,
        cache.columns,
    )
    footprints, boxes, rotations = cache.footprints, cache.boxes, cache.rotations
    for i in range(n):
        t = frames[i]
        row = rows[t]
        near = bounds_overlap(hulls, slot, views, row)
        if near:
            open_bounds(scratch32)
            near = update_clearance(occluders, first, last, lines, views, row, scratch32)
            for j in range(slot_clearance.shape[2]):
                slot_clearance[slot, row, j] = scratch32[GAP + j]
        cache.near[slot, row] = near
        depth = 0.0
        if detected[t] and cover[1, t] != slot and not aabb_disjoint(ground, row, floors, slot):
            for k in range(first, last):
                if not aabb_disjoint(ground, row, footprints, k):
                    depth += depth_in_box(columns, row, boxes, rotations, k)
        cache.depths[slot, row] = depth


@inner_inlined
def mark_near(cache: Cache, n: int) -> None:
    """Mark where new furniture may be near a line of sight, in frames that did not move.

    Parameters
    ----------
    cache : Cache
        Output: ``near``, by the bounds of all boxes of a slot together.
    n : int
        Number of scenelets of the proposal.
    """
    hulls, views, rows = cache.hulls, cache.views, cache.pose_row
    for i in range(n):
        slot = cache.slots[1, i]
        if cache.role[slot] == ADDED:
            for t in range(len(rows)):
                cache.near[slot, rows[t]] = bounds_overlap(hulls, slot, views, rows[t])


@inner_inlined
def mark_changed(cache: Cache, n: int, n_old: int) -> None:
    """Mark the frames whose emission may change.

    These are frames that moved, and frames in which boxes near a line of sight came or went.

    Parameters
    ----------
    cache : Cache
    n, n_old : int
        Numbers of scenelets of the proposal and of the current state.
    """
    n_frames = len(cache.changed)
    changed, rows, role = cache.changed, cache.pose_row, cache.role
    near = cache.near
    for t in range(n_frames):
        changed[t] = cache.moved[t]
    for which in range(2):
        wanted = REMOVED if which == 0 else ADDED
        for i in range(n_old if which == 0 else n):
            slot = cache.slots[which, i]
            if role[slot] == wanted:
                for t in range(n_frames):
                    changed[t] |= near[slot, rows[t]]
    for t in range(n_frames):
        now = t + n_frames * np.int64(cache.sum_at[t])
        cache.sum_row[t] = 2 * t + n_frames - now if changed[t] else now


@inner_inlined
def sum_penetrations(problem: Problem, cache: Cache, n: int) -> float:
    """The motion term -E_m: minus the cost of the body being inside furniture of other scenelets.

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
    total, unit = 0.0, problem.frame_weight * problem.likelihood * problem.motion_cost
    rows, depths, sums = cache.pose_row, cache.depths, cache.displaced
    for i in range(n):
        slot = cache.slots[1, i]
        sums[:] = 0.0
        for t in range(len(rows)):
            depth = depths[slot, rows[t]]
            if depth > 0.0:
                add_displaced_depth(depth, problem.furniture_spread, sums)
        total += marginal_penetration_cost(sums, unit)
    return -total
