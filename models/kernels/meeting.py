"""What furniture and the body of a frame have to do with each other, slot by slot, compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.energy.intersection import displaced_cost, give_way
from imapper_prob.models.jit import inner_inlined
from imapper_prob.models.kernels.body import apart, depth_in_box
from imapper_prob.models.kernels.memory import ADDED, REMOVED, Memory
from imapper_prob.models.kernels.sight import GAP, clear, may_hide, open_view
from imapper_prob.models.problem import Problem

__all__ = ["find_changed", "meet_frames", "sum_meetings"]

Ints = NDArray[np.int64]


@inner_inlined
def meet_frames(memory: Memory, n: int, n_moved: int) -> None:
    """Let all ``n`` scenelets meet the frames that moved, and new ones every frame."""
    for i in range(n):
        slot = memory.slots[1, i]
        fresh = memory.role[slot] == ADDED
        frames = memory.every if fresh else memory.frames
        _meet(memory, slot, frames, len(frames) if fresh else n_moved)


@inner_inlined
def _meet(memory: Memory, slot: int, frames: Ints, n: int) -> None:
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
        near = may_hide(hulls, slot, views, row)
        if near:
            open_view(bench)
            near = clear(outlooks, first, last, lines, views, row, bench)
            for j in range(gaps.shape[2]):
                gaps[slot, row, j] = bench[GAP + j]
        memory.near[slot, row] = near
        depth = 0.0
        if watched[t] and cover[1, t] != slot and not apart(ground, row, floors, slot):
            for k in range(first, last):
                if not apart(ground, row, footprints, k):
                    depth += depth_in_box(columns, row, boxes, turns, k)
        memory.depths[slot, row] = depth


@inner_inlined
def find_changed(memory: Memory, n: int, n_old: int) -> None:
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
def sum_meetings(problem: Problem, memory: Memory, n: int) -> float:
    """E_m: what it costs that the body stands in furniture not the frame's own, nats."""
    total, unit = 0.0, problem.frame_weight * problem.likelihood * problem.motion_cost
    rows, depths, sums = memory.pose_row, memory.depths, memory.displaced
    for i in range(n):
        slot = memory.slots[1, i]
        sums[:] = 0.0
        for t in range(len(rows)):
            depth = depths[slot, rows[t]]
            if depth > 0.0:
                give_way(depth, problem.furniture_spread, sums)
        total += displaced_cost(sums, unit)
    return -total
