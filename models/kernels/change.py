"""The log-posterior of a state that differs little from the one before, compiled.

Every function works out what a proposal changed and leaves the rest, in this order:
scenelets, path, joints and lines of sight, likelihood of frames, sum.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.energy.intersection import depth_below_floor
from imapper_prob.models.energy.smoothness import pose_jump
from imapper_prob.models.geometry import NOTHING_IN_SIGHT
from imapper_prob.models.jit import compiled
from imapper_prob.models.kernels.body import apart, depth_in_box, set_columns
from imapper_prob.models.kernels.frame import weigh_frames
from imapper_prob.models.kernels.memory import ADDED, KEPT, REMOVED, UNUSED, Memory
from imapper_prob.models.kernels.path import pose_free_frames, segment
from imapper_prob.models.kernels.session import Session
from imapper_prob.models.kernels.sight import GAP, aim, aim_again, clear, keep_aim, look, may_hide
from imapper_prob.models.kernels.slots import collide, fill_slot, pose_covered_frames
from imapper_prob.models.kernels.support import in_support
from imapper_prob.models.problem import Problem

__all__ = ["change", "weigh_bare_frames"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_STILL = 1e-12
"""A pelvis whose bearing and log depth changed by less than this since its frame was last
worked out, a few picometres, counts as where it was; the sum changes by less than 1e-8 nats."""
_TINY = 1e-100
"""Products of densities are rescaled below this."""


@compiled
def weigh_bare_frames(problem: Problem, memory: Memory, camera: Array) -> None:
    """The log-likelihood of every frame in its own pose with nothing in sight."""
    memory.clearance[:] = NOTHING_IN_SIGHT
    memory.wanted[:] = 1
    memory.cover[0] = -1
    rows = np.arange(len(memory.bare))
    weigh_frames(
        problem, camera, memory.wanted, memory.cover[0], memory.sizes, memory.joints, rows,
        memory.clearance, memory.bench, memory.bare, rows,
    )  # fmt: skip


@compiled
def change(
    session: Session,
    n_before: int,
    camera_before: Array,
    latent_before: Array,
    camera: Array,
    items: Ints,
    placements: Array,
    sizes: Array,
    latent: Array,
) -> float:
    """The log-posterior of a proposed state; what differs is worked out, the rest remembered.

    Parameters
    ----------
    session : Session
        Its memory is written only where the current state does not look.
    n_before : int
        Scenelets of the current state; -1 where there is none yet to remember.
    camera_before, latent_before : (5,), (T, 2) float
        Of the current state.
    camera, items, placements, sizes, latent
        Of the proposed state: see :class:`imapper_prob.models.posterior.State`.

    Returns
    -------
    float
        Nats; -inf outside the support.
    """
    problem, memory = session.problem, session.memory
    n, n_old = len(items), max(n_before, 0)
    if not in_support(camera) or not _in_order(problem, items):
        return -math.inf
    anew = n_before < 0
    for a in range(5):
        anew = anew or camera[a] != camera_before[a]
    _find_slots(memory, n_old, items, placements, sizes, anew)
    total = problem.camera_constant
    for a in range(5):
        for b in range(5):
            offset = camera[b] - problem.camera_mean[b]
            total -= (
                0.5 * (camera[a] - problem.camera_mean[a]) * problem.camera_precision[a, b] * offset
            )
    for i in range(n):
        slot = memory.slots[1, i]
        if memory.role[slot] == ADDED:
            memory.items[slot, 2] = items[i, 1] + _length(problem, items[i, 0])
            fill_slot(problem, memory, camera, slot)
        total += problem.log_rate[items[i, 0]] + memory.placed[slot]
    total += _find_path(problem, memory, n, n_old, camera, latent, latent_before, anew)
    if problem.likelihood == 0.0:
        return total
    _pose_frames(problem, memory, n, camera)
    for i in range(n):
        slot = memory.slots[1, i]
        _meet(memory, slot, memory.role[slot] == ADDED)
    _find_changed(memory, n, n_old)
    _weigh(problem, memory, n, camera)
    total += _sum_jumps(problem, memory, n)
    return total + _sum_frames(problem, memory) + _sum_pairs(problem, memory, n)


@compiled
def _length(problem: Problem, scenelet: int) -> int:
    length: int = problem.joint_first[scenelet + 1] - problem.joint_first[scenelet]
    return length


@compiled
def _in_order(problem: Problem, items: Ints) -> bool:
    """Whether scenelets lie in the clip, one after the other."""
    end = 0
    for i in range(len(items)):
        if items[i, 1] < end:
            return False
        end = items[i, 1] + _length(problem, items[i, 0])
    return end <= len(problem.lift)


@compiled
def _find_slots(
    memory: Memory, n_old: int, items: Ints, placements: Array, sizes: Array, anew: bool
) -> None:
    """Give every proposed scenelet its old slot, or a new one if anything about it changed."""
    before, after, role = memory.slots[0], memory.slots[1], memory.role
    role[:] = UNUSED
    for k in range(n_old):
        role[before[k]] = REMOVED
    for i in range(len(items)):
        after[i] = -1
        for k in range(n_old):
            slot = before[k]
            same = (
                not anew
                and role[slot] == REMOVED
                and memory.items[slot, 0] == items[i, 0]
                and memory.items[slot, 1] == items[i, 1]
                and memory.placements[slot, 0] == placements[i, 0]
                and memory.placements[slot, 1] == placements[i, 1]
                and memory.placements[slot, 2] == placements[i, 2]
                and memory.sizes[slot] == sizes[i]
            )
            if same:
                after[i] = slot
                role[slot] = KEPT
                break
    fresh = 0
    for i in range(len(items)):
        if after[i] < 0:
            while role[fresh] != UNUSED:
                fresh += 1
            after[i] = fresh
            role[fresh] = ADDED
            for c in range(2):
                memory.items[fresh, c] = items[i, c]
            for c in range(3):
                memory.placements[fresh, c] = placements[i, c]
            memory.sizes[fresh] = sizes[i]


@compiled
def _find_path(
    problem: Problem,
    memory: Memory,
    n: int,
    n_old: int,
    camera: Array,
    latent: Array,
    latent_before: Array,
    anew: bool,
) -> float:
    """Evidence of the path, nats; says which frames moved, and draws the free ones of them."""
    n_frames = len(problem.lift)
    before, after, cover, role = memory.slots[0], memory.slots[1], memory.cover, memory.role
    pose_at, moved, rows = memory.pose_at, memory.moved, memory.pose_row
    path, drawn = memory.path, memory.filtered
    for t in range(n_frames):
        moved[t] = 0
        rows[t] = t + n_frames * np.int64(pose_at[t])
    evidence = 0.0
    for i in range(n + 1):
        left, right = after[i - 1] if i > 0 else -1, after[i] if i < n else -1
        first = memory.items[left, 2] if left >= 0 else 0
        last = memory.items[right, 1] if right >= 0 else n_frames
        old = -1
        for k in range(n_old + 1):
            old_left, old_right = before[k - 1] if k > 0 else -1, before[k] if k < n_old else -1
            if not anew and old_left == left and old_right == right:
                old = k
        for t in range(first, last):
            cover[1, t] = -1
            if latent[t, 0] != latent_before[t, 0] or latent[t, 1] != latent_before[t, 1]:
                old = -1
        if old >= 0:
            memory.evidence[1, i] = memory.evidence[0, old]
        else:
            memory.evidence[1, i] = segment(
                problem, memory, camera, latent, first, last, left, right
            )
            for t in range(first, last):
                now = rows[t]
                x, y = drawn[t, 4], drawn[t, 5]
                if (
                    anew
                    or cover[0, t] >= 0
                    or abs(x - path[now, 0]) > _STILL
                    or abs(y - path[now, 1]) > _STILL
                ):
                    moved[t] = 1
                    rows[t] = 2 * t + n_frames - now
                    path[rows[t], 0], path[rows[t], 1] = x, y
        evidence += memory.evidence[1, i]
        if right >= 0:
            for t in range(last, memory.items[right, 2]):
                cover[1, t] = right
                if role[right] == ADDED:
                    moved[t] = 1
                    rows[t] = 2 * t + n_frames - rows[t]
    return evidence


@compiled
def _pose_frames(problem: Problem, memory: Memory, n: int, camera: Array) -> None:
    """Joints of all frames that moved, and what of the view and of the floor they take up."""
    for i in range(n):
        slot = memory.slots[1, i]
        if memory.role[slot] == ADDED:
            pose_covered_frames(problem, memory, camera, slot)
    pose_free_frames(problem, memory, camera)
    moved, rows, joints, bench = memory.moved, memory.pose_row, memory.joints, memory.bench
    lines, views, columns, ground = memory.lines, memory.views, memory.columns, memory.ground
    elevation = camera[1]
    for t in range(len(moved)):
        if moved[t]:
            aim(elevation, joints, rows[t], bench)
            keep_aim(bench, lines, rows[t])
            look(bench, views, rows[t])
            set_columns(joints, rows[t], columns, ground, rows[t])
            memory.sunk[rows[t]] = depth_below_floor(joints, rows[t])


@compiled
def _meet(memory: Memory, slot: int, all_frames: bool) -> None:
    """Clearance of lines of sight from the boxes in ``slot``, and how deep the body is in them.

    In all frames, or in those that moved.
    """
    size = len(memory.boxes) // len(memory.counts)
    first, last = slot * size, slot * size + memory.counts[slot]
    moved, rows, cover, watched = memory.moved, memory.pose_row, memory.cover, memory.watched
    hulls, floors, views, ground = memory.hulls, memory.floors, memory.views, memory.ground
    joints, bench, outlooks, gaps = memory.joints, memory.bench, memory.outlooks, memory.gaps
    lines = memory.lines
    footprints, columns, boxes, turns = (
        memory.footprints, memory.columns, memory.boxes, memory.turns,
    )  # fmt: skip
    for t in range(len(moved)):
        if not (all_frames or moved[t]):
            continue
        row = rows[t]
        near = may_hide(hulls, slot, views, row)
        if near:
            aim_again(lines, row, bench)
            near = clear(outlooks, first, last, views, row, bench)
            for j in range(16):
                gaps[slot, row, j] = bench[GAP + j]
        memory.near[slot, row] = near
        depth = 0.0
        if watched[t] and cover[1, t] != slot and not apart(ground, row, floors, slot):
            set_columns(joints, row, columns, ground, row)
            for k in range(first, last):
                if not apart(ground, row, footprints, k):
                    depth += depth_in_box(columns, boxes, turns, k)
        memory.depths[slot, row] = depth


@compiled
def _find_changed(memory: Memory, n: int, n_old: int) -> None:
    """Frames whose likelihood can differ: they moved, or boxes that came or went matter there."""
    n_frames = len(memory.changed)
    changed, rows, role = memory.changed, memory.pose_row, memory.role
    near, depths = memory.near, memory.depths
    for t in range(n_frames):
        changed[t] = memory.moved[t]
    for which in range(2):
        wanted = REMOVED if which == 0 else ADDED
        for i in range(n_old if which == 0 else n):
            slot = memory.slots[which, i]
            if role[slot] == wanted:
                for t in range(n_frames):
                    changed[t] |= near[slot, rows[t]] | (depths[slot, rows[t]] > 0.0)
    for t in range(n_frames):
        now = t + n_frames * np.int64(memory.sum_at[t])
        memory.sum_row[t] = 2 * t + n_frames - now if changed[t] else now


@compiled
def _weigh(problem: Problem, memory: Memory, n: int, camera: Array) -> None:
    """Likelihood and depth of the changed frames with all scenelets."""
    changed, wanted, clearance, gaps = (
        memory.changed, memory.wanted, memory.clearance, memory.gaps,
    )  # fmt: skip
    rows, to, near, depths = memory.pose_row, memory.sum_row, memory.near, memory.depths
    after, cover, bare, by_frame = memory.slots[1], memory.cover[1], memory.bare, memory.by_frame
    votes, inside, bench = memory.votes, memory.inside, memory.bench
    for t in range(len(changed)):
        wanted[t] = 0
        if not changed[t]:
            continue
        row = rows[t]
        depth = memory.sunk[row] if memory.watched[t] else 0.0
        wanted[t] = cover[t] >= 0
        for j in range(16):
            bench[GAP + j] = NOTHING_IN_SIGHT
        for i in range(n):
            slot = after[i]
            depth += depths[slot, row]
            if near[slot, row]:
                wanted[t] = 1
                for j in range(16):
                    bench[GAP + j] = min(bench[GAP + j], gaps[slot, row, j])
        for j in range(16):
            clearance[t, j] = bench[GAP + j]
        inside[to[t]] = depth
        if not wanted[t]:
            by_frame[to[t], 0], by_frame[to[t], 1] = bare[t, 0], bare[t, 1]
    weigh_frames(
        problem, camera, wanted, cover, memory.sizes, memory.joints, rows, clearance,
        memory.bench, by_frame, to,
    )  # fmt: skip
    weight = problem.frame_weight * problem.likelihood
    for t in range(len(changed)):
        if changed[t]:
            right, wrong = weight * by_frame[to[t], 0], weight * by_frame[to[t], 1]
            top = max(right, wrong)
            votes[to[t], 0] = top
            votes[to[t], 1], votes[to[t], 2] = math.exp(right - top), math.exp(wrong - top)


@compiled
def _sum_frames(problem: Problem, memory: Memory) -> float:
    """Detections of all frames, whichever are swapped, cost of free poses, and depth inside.

    The recursion is that of :func:`imapper_prob.models.energy.swaps.summed_over_swaps`, on
    densities that are rescaled now and then in place of probabilities.
    """
    begins, ends = problem.swap_begins, problem.swap_ends
    turned = begins / (begins + ends)
    stays = 1.0 - turned
    total, free, inside = 0.0, 0.0, 0.0
    rows, votes, depths = memory.sum_row, memory.votes, memory.inside
    cover, free_cost = memory.cover[1], problem.free_cost
    for t in range(len(rows)):
        row = rows[t]
        total += votes[row, 0]
        stays *= votes[row, 1]
        turned *= votes[row, 2]
        if stays + turned < _TINY:
            scale = stays + turned
            total += math.log(scale)
            stays /= scale
            turned /= scale
        stays, turned = (
            stays * (1.0 - begins) + turned * ends,
            stays * begins + turned * (1.0 - ends),
        )
        inside += depths[row]
        if cover[t] < 0:
            free += free_cost[t]
    total += math.log(stays + turned)
    weight = problem.frame_weight * problem.likelihood
    return total - weight * (free + problem.motion_cost * inside)


@compiled
def _sum_jumps(problem: Problem, memory: Memory, n: int) -> float:
    """What it costs that the pose jumps where a scenelet begins or ends."""
    total = 0.0
    joints, rows, cover, items = memory.joints, memory.pose_row, memory.cover[1], memory.items
    for i in range(n):
        slot = memory.slots[1, i]
        first, last = items[slot, 1], items[slot, 2]
        if first > 0:
            total += pose_jump(joints, rows[first - 1], rows[first], problem.joint_step)
        if last < len(rows) and cover[last] < 0:
            total += pose_jump(joints, rows[last - 1], rows[last], problem.joint_step)
    return -problem.smoothness_cost * problem.likelihood * total


@compiled
def _sum_pairs(problem: Problem, memory: Memory, n: int) -> float:
    """What it costs that objects are in each other."""
    depth = 0.0
    for i in range(n):
        for k in range(i):
            one, other = memory.slots[1, i], memory.slots[1, k]
            if memory.role[one] == ADDED or memory.role[other] == ADDED:
                memory.pairs[one, other] = collide(problem, memory, one, other)
                memory.pairs[other, one] = memory.pairs[one, other]
            depth += memory.pairs[one, other]
    return -problem.collision_cost * problem.likelihood * depth
