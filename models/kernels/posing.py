"""Where the joints are in frames that moved, and what of view and floor they take up, compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.energy.intersection import depth_below_floor
from imapper_prob.models.energy.smoothness import pose_jump
from imapper_prob.models.jit import inner_inlined
from imapper_prob.models.kernels.body import set_columns
from imapper_prob.models.kernels.frame import lens_of, set_chances, set_detections
from imapper_prob.models.kernels.memory import ADDED, Memory
from imapper_prob.models.kernels.sight import aim, look
from imapper_prob.models.problem import Problem

__all__ = ["copy_joints", "list_moved", "pose_frames", "pose_joints", "sum_jumps"]

Array = NDArray[np.float64]


@inner_inlined
def list_moved(memory: Memory) -> int:
    """Put the frames that moved into ``memory.frames``; returns how many there are."""
    n = 0
    for t in range(len(memory.moved)):
        memory.frames[n] = t
        n += memory.moved[t]
    return n


@inner_inlined
def pose_joints(problem: Problem, memory: Memory, n: int, n_moved: int, camera: Array) -> None:
    """World joints of the frames that moved, with ``n`` scenelets, metres."""
    for i in range(n):
        slot = memory.slots[1, i]
        if memory.role[slot] == ADDED:
            _pose_covered_frames(problem, memory, slot)
    _pose_free_frames(problem, memory, n_moved, camera)


@inner_inlined
def copy_joints(memory: Memory, joints: Array) -> None:
    """World joints of the proposal into ``joints`` (T, 3, 16), metres."""
    rows = memory.pose_row
    for t in range(len(joints)):
        for axis in range(3):
            for j in range(joints.shape[2]):
                joints[t, axis, j] = memory.joints[rows[t], axis, j]


@inner_inlined
def pose_frames(problem: Problem, memory: Memory, n: int, n_moved: int, camera: Array) -> None:
    """Everything that follows from the joints of a frame that moved, with ``n`` scenelets."""
    for i in range(n):
        slot = memory.slots[1, i]
        if memory.role[slot] == ADDED:
            _find_chances(problem, memory, camera, slot)
    rows, joints, lines, views = memory.pose_row, memory.joints, memory.lines, memory.views
    columns, ground, sunk = memory.columns, memory.ground, memory.sunk
    # All frames are aimed at first: a row just stored in parts cannot be read again at once.
    for i in range(n_moved):
        aim(camera[1], joints, lines, rows[memory.frames[i]])
    for i in range(n_moved):
        look(lines, rows[memory.frames[i]], memory.bench, views)
    for i in range(n_moved):
        row = rows[memory.frames[i]]
        set_columns(joints, row, columns, ground, row)
        sunk[row] = depth_below_floor(joints, row)


@inner_inlined
def _pose_covered_frames(problem: Problem, memory: Memory, slot: int) -> None:
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
def _find_chances(problem: Problem, memory: Memory, camera: Array, slot: int) -> None:
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
        set_chances(lens, body, joints, row, places, facts, t, desk, bench, chances, row)


@inner_inlined
def _pose_free_frames(problem: Problem, memory: Memory, n_moved: int, camera: Array) -> None:
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
def sum_jumps(problem: Problem, memory: Memory, n: int, camera: Array) -> float:
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
