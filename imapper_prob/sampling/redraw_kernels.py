"""A stretch of time drawn anew: sequences of nodes, and where these stand, compiled.

All numbers of chance are handed in, so that draws are those of one generator wherever they run.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.kernels.cache import Evaluator
from imapper_prob.models.kernels.path import pose_jump, steps_of_depth
from imapper_prob.models.problem import Problem
from imapper_prob.models.view import floor_point, log_area
from imapper_prob.samplers.segments import (
    Segments,
    Sums,
    draw_sequence,
    forward,
    sequence_weight,
)
from imapper_prob.sampling.jit import compiled
from imapper_prob.sampling.join_kernels import path_errors, set_pose
from imapper_prob.sampling.nodes import Common, Table

__all__ = ["LONGEST", "TAIL", "Room", "redraw"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

LONGEST = 12
"""Most nodes of a sequence; of those that are drawn longer nothing is proposed."""
TAIL = 5.0
"""Degrees of freedom of the flat density of places: what a Gaussian takes for impossible is then
rare only."""
_MISSING = -1.0


class Room(NamedTuple):
    """Workspaces for N nodes.

    Parameters
    ----------
    sharp, flat : Sums
    left, right : (2, N) float
        Log factors of the first and the last node, of the sharp and of the flat table.
    """

    sharp: Sums
    flat: Sums
    left: Array
    right: Array


@compiled
def _steps_between(problem: Problem, axis: int, end: int, start: int) -> int:
    """Steps of one coordinate of the path's error from the frame before ``end`` to ``start``."""
    if axis == 0:
        return start - end + 1
    return steps_of_depth(problem.path_stay, problem.stay_steps, end, start)


@compiled
def _stands(heights: Array, node: int, where: Array, before: Array, after: Array) -> Array:
    """By how much a place has to change to look alike through another camera; NaN if nowhere.

    See :mod:`imapper_prob.sampling.camera_moves`.
    """
    height = heights[node]
    x, y = floor_point(where[0], where[1])
    gone = np.empty(4)
    gone[:] = math.nan
    cp, sp, cr, sr = (
        math.cos(before[0]), math.sin(before[0]), math.cos(before[4]), math.sin(before[4]),
    )  # fmt: skip
    body = math.exp(before[3] + where[3])
    z = body * height - before[1]
    depth = cp * y + sp * z
    if depth <= 0.0:
        return gone
    by = math.exp(before[2] - after[2]) / depth
    right = by * (cr * x + sr * (cp * z - sp * y))
    up = by * (cr * (cp * z - sp * y) - sr * x)
    apparent = by * body
    cp, sp, cr, sr = math.cos(after[0]), math.sin(after[0]), math.cos(after[4]), math.sin(after[4])
    rise = sr * right + cr * up
    ahead, drop = cp - sp * rise, apparent * height - (sp + cp * rise)
    if not drop * after[1] > 0.0 or ahead <= 0.0:
        return gone
    depth = after[1] / drop
    gone[0] = (cr * right - sr * up) / ahead - where[0]
    gone[1] = math.log(depth * ahead) - where[1]
    gone[2] = 0.0
    gone[3] = math.log(apparent * depth) - after[3] - where[3]
    return gone


@compiled
def _density_of_places(
    evaluator: Evaluator,
    common: Common,
    table: Table,
    camera: Array,
    sequence: Ints,
    count: int,
    sides: Array,
    tail: float,
    normals: Array,
    stretch: float,
    where: Array,
) -> float:
    """Log density of where the nodes of a sequence stand, on the floor; -inf if it has none.

    All nodes at once are one Gaussian: each by itself, and what the path says of each given the
    one before. ``sides`` (2, 5) are the scenelets on both sides, see :func:`_sides`. Where
    ``stretch`` is positive the places are drawn first, of the Gaussian's coordinates times it.
    With ``tail`` degrees of freedom it is Student's t in place of a Gaussian.
    """
    problem = evaluator.problem
    size = 4 * count
    matrix, pull, errors = np.zeros((size, size)), np.zeros(size), np.empty((count, 6))
    items = np.empty((1, 2), np.int64)
    for k in range(count):
        node = sequence[k]
        gone = _stands(common.heights, node, common.where[node], problem.camera_mean, camera)
        if math.isnan(gone[0]):
            return -math.inf
        steps = common.inverse @ gone
        bent = table.bend[node] @ steps
        for i in range(4):
            pull[4 * k + i] = table.pull[node, i] + bent[i]
            for j in range(4):
                matrix[4 * k + i, 4 * k + j] = table.precision[node, i, j]
        items[0, 0], items[0, 1] = common.items[node, 0], common.items[node, 1]
        path_errors(problem, camera, items, common.where[node : node + 1], errors[k : k + 1])
    row = np.empty(size)
    for k in range(count + 1):
        for axis in range(2):
            row[:] = 0.0
            known, frames = True, 0
            if k < count:
                node = sequence[k]
                off = errors[k, axis]
                for i in range(4):
                    row[4 * k + i] = common.pull[node, axis, i]
                start = common.items[node, 1]
            elif sides[1, 4] == _MISSING:
                continue
            else:
                off, start = sides[1, axis], np.int64(sides[1, 4])
            if k > 0:
                before = sequence[k - 1]
                scenelet = common.items[before, 0]
                end = common.items[before, 1] + (
                    problem.joint_first[scenelet + 1] - problem.joint_first[scenelet]
                )
            else:
                end = np.int64(sides[0, 4])
            if end == _MISSING or common.film[end - 1] != common.film[start]:
                known = False
            if known:
                frames = _steps_between(problem, axis, int(end), int(start))
                one, two = problem.path_mean[axis, frames, 0], problem.path_mean[axis, frames, 1]
                if k > 0:
                    off -= one * errors[k - 1, 2 + axis] + two * errors[k - 1, 4 + axis]
                    for i in range(4):
                        row[4 * (k - 1) + i] -= one * common.pull[before, 2 + axis, i]
                        row[4 * (k - 1) + i] -= two * common.pull[before, 4 + axis, i]
                else:
                    off -= one * sides[0, axis] + two * sides[0, 2 + axis]
            elif k == count:
                continue
            doubt = problem.path_draw[axis, frames, 0, 2]
            for i in range(size):
                pull[i] -= off * row[i] / (doubt * doubt)
                for j in range(size):
                    matrix[i, j] += row[i] * row[j] / (doubt * doubt)
    # Cholesky's factor, in place below the diagonal.
    log_volume = 0.0
    for i in range(size):
        for j in range(i + 1):
            total = matrix[i, j]
            for m in range(j):
                total -= matrix[i, m] * matrix[j, m]
            if i == j:
                if not total > 0.0:
                    return -math.inf
                matrix[i, i] = math.sqrt(total)
                log_volume += math.log(matrix[i, i])
            else:
                matrix[i, j] = total / matrix[j, j]
    mean = pull
    for i in range(size):
        for j in range(i):
            mean[i] -= matrix[i, j] * mean[j]
        mean[i] /= matrix[i, i]
    for i in range(size - 1, -1, -1):
        for j in range(i + 1, size):
            mean[i] -= matrix[j, i] * mean[j]
        mean[i] /= matrix[i, i]
    offset = np.empty(size)
    if stretch > 0.0:
        for i in range(size - 1, -1, -1):
            offset[i] = stretch * normals[i]
            for j in range(i + 1, size):
                offset[i] -= matrix[j, i] * offset[j]
            offset[i] /= matrix[i, i]
        for k in range(count):
            moved = common.steps @ (mean[4 * k : 4 * k + 4] + offset[4 * k : 4 * k + 4])
            where[k] = common.where[sequence[k]] + moved
    else:
        for k in range(count):
            moved = where[k] - common.where[sequence[k]]
            offset[4 * k : 4 * k + 4] = common.inverse @ moved - mean[4 * k : 4 * k + 4]
    square, result = 0.0, log_volume
    for i in range(size):
        total = 0.0
        for j in range(i, size):
            total += matrix[j, i] * offset[j]
        square += total * total
    if tail > 0.0:
        result += math.lgamma(0.5 * (tail + size)) - math.lgamma(0.5 * tail)
        result -= 0.5 * size * math.log(tail * math.pi)
        result -= 0.5 * (tail + size) * math.log1p(square / tail)
    else:
        result -= 0.5 * (square + size * math.log(2.0 * math.pi))
    volume = abs(np.linalg.det(common.steps))
    for k in range(count):
        # Nobody is told apart who turned once around: one image of each yaw is drawn.
        if abs(where[k, 2] - common.where[sequence[k], 2]) > math.pi:
            return -math.inf
        result -= math.log(volume) + log_area(where[k, 1])
    return result


@compiled
def _sides(
    evaluator: Evaluator, camera: Array, beside: Ints, beside_where: Array, sides: Array
) -> None:
    """Of the scenelet on the left path errors of its last two frames and its end, of that on the
    right those of its first frame and its start; missing where ``beside`` has no scenelet."""
    problem, errors = evaluator.problem, np.empty((2, 6))
    sides[:] = _MISSING
    for side in range(2):
        if beside[side, 0] < 0:
            continue
        path_errors(
            problem, camera, beside[side : side + 1], beside_where[side : side + 1],
            errors[side : side + 1],
        )  # fmt: skip
        first = 2 if side == 0 else 0
        for i in range(4):
            sides[side, i] = errors[side, first + i] if first + i < 6 else 0.0
        sides[side, 4] = beside[side, 1]
        if side == 0:
            scenelet = beside[side, 0]
            sides[side, 4] += problem.joint_first[scenelet + 1] - problem.joint_first[scenelet]


@compiled
def _set_edges(
    evaluator: Evaluator,
    common: Common,
    table: Table,
    segments: Segments,
    camera: Array,
    beside: Ints,
    beside_where: Array,
    sides: Array,
    begin: int,
    finish: int,
    credit: Array,
    left: Array,
    right: Array,
) -> float:
    """Log factors of a first and of a last node; returns the log weight of no node at all."""
    problem = evaluator.problem
    mean, draw, film = problem.path_mean, problem.path_draw, common.film
    start_after, end_before = np.int64(sides[1, 4]), np.int64(sides[0, 4])
    joints = np.empty((4, 3, 16))
    scale = problem.joint_step * math.exp(camera[3])
    unit = table.power * problem.smoothness_cost * problem.likelihood
    if end_before != _MISSING:
        body = math.exp(camera[3] + beside_where[0, 3])
        row = problem.joint_first[beside[0, 0] + 1] - 1
        set_pose(problem, row, body, beside_where[0, 2], joints, 0)
    if start_after != _MISSING:
        body = math.exp(camera[3] + beside_where[1, 3])
        set_pose(problem, problem.joint_first[beside[1, 0]], body, beside_where[1, 2], joints, 1)
    for b in range(segments.starting[begin], segments.starting[max(begin, finish)]):
        start, end = segments.start[b], segments.end[b]
        if end > finish:
            continue
        left[b], right[b] = credit[segments.kind[b]], 0.0
        before = end_before != _MISSING and film[end_before - 1] == film[start]
        after = start_after != _MISSING and film[start_after] == film[end - 1]
        for axis in range(2):
            entry = table.first[b, axis]
            if before:
                frames = _steps_between(problem, axis, int(end_before), int(start))
                expected = mean[axis, frames, 0] * sides[0, axis]
                expected += mean[axis, frames, 1] * sides[0, 2 + axis]
                alone = 1.0 + entry[1]
                given = draw[axis, frames, 0, 2] ** 2 + entry[1]
                off = entry[0] - expected
                left[b] += 0.5 * (math.log(alone / given) + entry[0] * entry[0] / alone)
                left[b] -= 0.5 * off * off / given
            if after:
                of = table.last[b, axis]
                frames = _steps_between(problem, axis, int(end), int(start_after))
                one, two = mean[axis, frames, 0], mean[axis, frames, 1]
                given = one * one * of[2] + two * two * of[3] + 2.0 * one * two * of[4]
                given += draw[axis, frames, 0, 2] ** 2
                off = sides[1, axis] - one * of[0] - two * of[1]
                right[b] -= 0.5 * (math.log(given) + off * off / given)
        furthest = common.credit.shape[2] - 1
        if before:
            gap, last = start - end_before, start - beside[0, 1]
            left[b] += table.power * common.credit[b, 0, min(gap, furthest)]
            left[b] -= table.power * common.credit[b, 0, min(last, furthest)]
        if after:
            gap = start_after - end
            last = gap + problem.joint_first[beside[1, 0] + 1] - problem.joint_first[beside[1, 0]]
            right[b] += table.power * common.credit[b, 1, min(gap, furthest)]
            right[b] -= table.power * common.credit[b, 1, min(last, furthest)]
        joins = before and start == end_before, after and end == start_after
        if joins[0] or joins[1]:
            scenelet = common.items[b, 0]
            body = math.exp(camera[3] + common.where[b, 3])
            row, last = problem.joint_first[scenelet], problem.joint_first[scenelet + 1] - 1
            if joins[0]:
                set_pose(problem, row, body, common.where[b, 2], joints, 2)
                joints[3] = common.loose[start - 1]
                gain = pose_jump(joints, 3, 2, scale) - pose_jump(joints, 0, 2, scale)
                joints[3] = common.loose[start]
                left[b] += unit * (gain + pose_jump(joints, 0, 3, scale))
            if joins[1]:
                set_pose(problem, last, body, common.where[b, 2], joints, 2)
                joints[3] = common.loose[end]
                gain = pose_jump(joints, 2, 3, scale) - pose_jump(joints, 2, 1, scale)
                joints[3] = common.loose[end - 1]
                right[b] += unit * (gain + pose_jump(joints, 3, 1, scale))
    nothing = 0.0
    if start_after != _MISSING:
        known = end_before != _MISSING and film[end_before - 1] == film[start_after]
        for axis in range(2):
            frames = 0
            if known:
                frames = _steps_between(problem, axis, int(end_before), int(start_after))
            off, given = sides[1, axis], draw[axis, frames, 0, 2] ** 2
            if frames > 0:
                off -= mean[axis, frames, 0] * sides[0, axis]
                off -= mean[axis, frames, 1] * sides[0, 2 + axis]
            nothing -= 0.5 * (math.log(given) + off * off / given)
        # A node in another film than the right one leaves that as it is.
        for b in range(segments.starting[begin], segments.starting[max(begin, finish)]):
            if segments.end[b] <= finish and film[start_after] != film[segments.end[b] - 1]:
                right[b] = nothing
    return nothing


@compiled
def redraw(
    evaluator: Evaluator,
    common: Common,
    sharp: Table,
    sharp_segments: Segments,
    flat: Table,
    flat_segments: Segments,
    room: Room,
    camera: Array,
    others: Ints,
    beside: Ints,
    beside_where: Array,
    begin: int,
    finish: int,
    present: Ints,
    present_where: Array,
    uniforms: Array,
    normals: Array,
    spreads: Array,
    counts: Ints,
    sequences: Ints,
    where: Array,
    log_density: Array,
) -> None:
    """Draws of a stretch beside what is there.

    Half of them come of each table, and all densities are of both together.

    Parameters
    ----------
    evaluator : Evaluator
        Of the problem.
    common : Common
    sharp, sharp_segments, flat, flat_segments
        The two tables.
    room : Room
    camera : (5,) float
    others : (m, 2) int
        Scenelets and starts that stay.
    beside : (2, 2) int
        The one before and the one after the stretch; scenelet -1 where there is none.
    beside_where : (2, 4) float
        Where they stand, as nodes.
    begin, finish : int
        First frame of the stretch and the one after its last.
    present, present_where : (k,) int, (k, 4) float
        Nodes that are there, and where they stand; yaws within half a turn of the node's.
    uniforms : (n, u) float
        In [0, 1): one for the table, then as :func:`~imapper_prob.samplers.segments.draw_sequence`
        takes them, for as many nodes as there are frames.
    normals : (n, 4 LONGEST) float
        Standard normal.
    spreads : (n,) float
        Of chi square with the degrees of freedom of the tail, over these.
    counts, sequences, where : (n,), (n, LONGEST), (n, LONGEST, 4)
        Out: nodes of each draw and where they stand.
    log_density : (n + 1,) float
        Out: of the draws, on the floor, and of what is there; -inf for draws that are nothing.
    """
    problem, kinds = evaluator.problem, len(sharp_segments.follow)
    sides = np.empty((2, 5))
    _sides(evaluator, camera, beside, beside_where, sides)
    credit = np.zeros((2, kinds))
    for k in range(kinds - 1):
        held = False
        for i in range(len(others)):
            low, high = problem.lowered[others[i, 0], 0], problem.lowered[others[i, 0], 1]
            begun, ended = others[i, 1] + low, others[i, 1] + high
            held |= low < high and begun < problem.stays[k, 1] and ended > problem.stays[k, 0]
        if not held:
            credit[0, 1 + k] = sharp.power * problem.likelihood * problem.stays[k, 2]
            credit[1, 1 + k] = flat.power * problem.likelihood * problem.stays[k, 2]
    follow = np.exp(credit).repeat(kinds).reshape(2, kinds, kinds).transpose(0, 2, 1).copy()
    for k in range(kinds):
        follow[0, k, k] = follow[1, k, k] = 1.0
    one = _following(sharp_segments, follow[0])
    two = _following(flat_segments, follow[1])
    nothing = np.empty(2)
    nothing[0] = _set_edges(
        evaluator, common, sharp, one, camera, beside, beside_where, sides, begin, finish,
        credit[0], room.left[0], room.right[0],
    )  # fmt: skip
    nothing[1] = _set_edges(
        evaluator, common, flat, two, camera, beside, beside_where, sides, begin, finish, credit[1],
        room.left[1], room.right[1],
    )  # fmt: skip
    totals = np.empty(2)
    totals[0] = forward(one, begin, finish, room.left[0], room.right[0], nothing[0], room.sharp)
    totals[1] = forward(two, begin, finish, room.left[1], room.right[1], nothing[1], room.flat)
    drawn = np.empty(finish - begin + 1, np.int64)
    parts = np.empty(2)
    n = len(counts)
    for i in range(n + 1):
        if i == n:
            count, sequence, places, of = len(present), present, present_where, -1
        else:
            sequence, places = sequences[i], where[i]
            of = 0 if uniforms[i, 0] < 0.5 else 1
            if of == 0:
                count = draw_sequence(
                    one, begin, finish, room.left[0], room.sharp, uniforms[i, 1:], drawn
                )
            else:
                count = draw_sequence(
                    two, begin, finish, room.left[1], room.flat, uniforms[i, 1:], drawn
                )
            counts[i] = count
            log_density[i] = -math.inf
            if count > LONGEST:
                continue
            sequence[:count] = drawn[:count]
        # The one that draws comes first: it says where the nodes stand.
        parts[:] = -math.inf
        for turn in range(2):
            table = turn if of <= 0 else 1 - turn
            if turn == 1 and of >= 0 and parts[of] == -math.inf:
                break  # it stands nowhere
            stretch = 0.0
            if turn == 0 and of == 0:
                stretch = 1.0
            elif turn == 0 and of == 1:
                stretch = 1.0 / math.sqrt(spreads[i])
            if table == 0:
                parts[0] = sequence_weight(
                    one, sequence, count, room.left[0], room.right[0], nothing[0]
                ) - totals[0] + _density_of_places(
                    evaluator, common, sharp, camera, sequence, count, sides, 0.0, normals[i % n],
                    stretch, places,
                )  # fmt: skip
            else:
                parts[1] = sequence_weight(
                    two, sequence, count, room.left[1], room.right[1], nothing[1]
                ) - totals[1] + _density_of_places(
                    evaluator, common, flat, camera, sequence, count, sides, TAIL, normals[i % n],
                    stretch, places,
                )  # fmt: skip
        highest = max(parts[0], parts[1])
        if highest > -math.inf:
            log_density[i] = highest + math.log(
                0.5 * (math.exp(parts[0] - highest) + math.exp(parts[1] - highest))
            )
        else:
            log_density[i] = -math.inf


@compiled
def _following(table: Segments, follow: Array) -> Segments:
    """The table with other factors of kinds."""
    return Segments(
        table.start, table.end, table.kind, table.by_end, table.starting, table.ending,
        table.log_weight, follow, table.gap, table.pairs, table.flush,
    )  # fmt: skip
