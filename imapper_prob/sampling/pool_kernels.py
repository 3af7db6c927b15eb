"""Pools of scenelets for a stretch of time: what each is worth beside the rest of the scene.

An element of a pool is a node of a table (:mod:`imapper_prob.sampling.visits`) at a place of its
own. What it is worth in the scene without the stretch's scenelets is evaluated exactly. What two
that follow one another are worth more or less than both alone is known but for what is small: the
path's error goes on from one to the other, the pose jumps once where they join, their furniture is
in each other, and a stay needs one of them. What one hides of the other is left to the acceptance.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.kernels.cache import Evaluator
from imapper_prob.models.kernels.incremental import change, commit
from imapper_prob.models.kernels.path import pose_jump, steps_of_depth
from imapper_prob.models.kernels.placement import place_boxes
from imapper_prob.models.problem import Problem
from imapper_prob.models.view import floor_point, log_area
from imapper_prob.samplers.pools import (
    draw_sequence,
    log_arrangements,
    sequence_weight,
    sum_sequences,
)
from imapper_prob.sampling.jit import compiled
from imapper_prob.sampling.join_kernels import collision, loose_jumps, path_errors

__all__ = ["LONGEST", "TAIL", "Table", "carry", "draw_from_pool"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

LONGEST = 12
"""Most scenelets of a stretch."""
TAIL = 5.0
"""Degrees of freedom of the flat density of places."""
_WIDER = 2.0
"""Standard deviations of the flat density over those among the visits of one scenelet, which are
mostly of one passage and so too near to one another. Chosen."""
_MISSING = -1.0


class Table(NamedTuple):
    """N nodes, each a scenelet at a start frame, in order of start, then scenelet.

    Parameters
    ----------
    items : (N, 2) int
        Scenelet and start frame.
    ends : (N,) int
        Frame after the last of each.
    starting : (T + 2,) int
        Where the nodes of each start begin.
    where : (N, 4) float
        Bearing (tangent), log depth (log m), yaw (radians) and log size of each in the mean camera.
    heights : (N,) float
        Of the pelvis in the middle frame, metres of the reference body.
    sharp, flat : (N,) float
        How often each is drawn.
    factor : (4, 4) float
        Lower Cholesky factor of the covariance of places.
    film : (T,) int
        Which film a frame is of.
    loose : (T, 3, 16) float
        Joints of free frames in the mean camera, metres.
    """

    items: Ints
    ends: Ints
    starting: Ints
    where: Array
    heights: Array
    sharp: Array
    flat: Array
    factor: Array
    film: Ints
    loose: Array


@compiled
def draw_from_pool(
    evaluator: Evaluator,
    table: Table,
    power: float,
    camera: Array,
    latent: Array,
    others: Ints,
    placements: Array,
    sizes: Array,
    at: int,
    beside: Ints,
    beside_where: Array,
    begin: int,
    finish: int,
    present: Ints,
    present_where: Array,
    uniforms: Array,
    normals: Array,
    spreads: Array,
    choices: Array,
    nodes: Ints,
    where: Array,
    counts: Ints,
    sequences: Ints,
    log_density: Array,
) -> None:
    """Make a pool of M elements, and draw n sequences of it.

    Parameters
    ----------
    evaluator : Evaluator
        With room for one scenelet more than ``others``; what it remembers is lost.
    table : Table
    power : float
        Of what is tempered.
    camera, latent : (5,), (T, 2) float
    others, placements, sizes : (r, 2), (r, 3), (r,)
        Scenelets that stay.
    at : int
        How many of them are before the stretch.
    beside, beside_where : (2, 2) int, (2, 4) float
        The one before and the one after the stretch, scenelet -1 where there is none, and where
        they stand.
    begin, finish : int
        First frame of the stretch and the one after its last.
    present, present_where : (k,) int, (k, 4) float
        Nodes that are there, and where they stand.
    uniforms, normals, spreads : (M, 2), (M, 4), (M,) float
        Random numbers of the elements: in [0, 1), standard normal, and of chi square with the
        degrees of freedom of the tail, over these.
    choices : (n, LONGEST + 1) float
        Random numbers in [0, 1) of the draws.
    nodes, where : (M,) int, (M, 4) float
        Out: the pool.
    counts, sequences : (n,), (n, LONGEST)
        Out: how many elements each draw has, and which; -1 for a draw that is nothing.
    log_density : (n + 1,) float
        Out: of each draw and, last, of what is there, given the pool and up to a constant; the
        last is -inf where the pool could not have held what is there.
    """
    problem = evaluator.problem
    n, m, k = len(counts), len(nodes), len(present)
    log_density[:] = -math.inf
    sides = np.empty((2, 5))
    _sides(problem, camera, beside, beside_where, sides)
    log_q = np.empty(m)
    nodes[:k], where[:k] = present, present_where
    if not _fill(
        table, problem, camera, begin, finish, k, uniforms, normals, spreads, nodes, where, log_q
    ):
        return
    for i in range(k):
        if log_q[i] == -math.inf:
            return
    weight, alone = np.empty(m), np.empty(m)
    _judge(
        evaluator,
        table,
        power,
        camera,
        latent,
        others,
        placements,
        sizes,
        at,
        nodes,
        where,
        log_q,
        alone,
    )
    for i in range(m):
        # Elements that are worth nothing are drawn by nobody, nor are those from nowhere.
        weight[i] = alone[i] - log_q[i] - math.log(m) if log_q[i] > -math.inf else -math.inf
        if math.isnan(weight[i]):
            weight[i] = -math.inf
    pair = np.empty((m, m))
    _pair(problem, table, power, camera, others, sides, nodes, where, weight, pair)
    order, ending = np.argsort(table.items[nodes, 1], kind="mergesort"), np.empty(m)
    total = sum_sequences(order, weight, pair, ending)
    for i in range(n):
        counts[i] = draw_sequence(order, pair, ending, total, choices[i], sequences[i])
        if counts[i] >= 0:
            log_density[i] = _density(weight, pair, log_q, sequences[i], counts[i])
    log_density[n] = _density(weight, pair, log_q, np.arange(k), k)


@compiled
def _stands(height: float, where: Array, before: Array, after: Array) -> Array:
    """By how much a place has to change to look alike through another camera; NaN if nowhere.

    ``height`` is that of the pelvis in the middle frame, metres of the reference body.

    See :mod:`imapper_prob.sampling.camera_moves`.
    """
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
def carry(heights: Array, where: Array, cameras: Array, to: Array) -> Array:
    """Places (n, 4) that look through one camera as they did through others; NaN if nowhere.

    Parameters
    ----------
    heights : (n,) float
        Of the pelvis in the middle frame, metres of the reference body.
    where : (n, 4) float
        Bearing (tangent), log depth (log m), yaw (radians) and log size.
    cameras : (n, 5) float
        Through which they were looked at.
    to : (5,) float
    """
    result = where.copy()
    for i in range(len(where)):
        result[i] += _stands(heights[i], where[i], cameras[i], to)
    return result


@compiled
def _sides(
    problem: Problem, camera: Array, beside: Ints, beside_where: Array, sides: Array
) -> None:
    """Of the scenelet on the left path errors of its last two frames and its end, of that on the
    right those of its first frame and its start; missing where ``beside`` has no scenelet."""
    errors = np.empty((2, 6))
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
def _density(weight: Array, pair: Array, log_q: Array, sequence: Ints, count: int) -> float:
    """Log density of a sequence over the pool's: pi over it is what a draw is worth."""
    size = len(weight)
    total = sequence_weight(weight, pair, sequence, count) + log_arrangements(size, count)
    for i in range(count):
        total += log_q[sequence[i]]
    return total


@compiled
def _fill(
    table: Table,
    problem: Problem,
    camera: Array,
    begin: int,
    finish: int,
    first: int,
    uniforms: Array,
    normals: Array,
    spreads: Array,
    nodes: Ints,
    where: Array,
    log_q: Array,
) -> bool:
    """Draw the elements from ``first`` on, and say with what density each one is drawn."""
    low, high = table.starting[begin], table.starting[max(begin, finish)]
    sums = np.zeros((2, high - low + 1))
    for b in range(low, high):
        inside = table.ends[b] <= finish
        sums[0, b - low + 1] = sums[0, b - low] + (table.sharp[b] if inside else 0.0)
        sums[1, b - low + 1] = sums[1, b - low] + (table.flat[b] if inside else 0.0)
    total = sums[:, high - low].copy()
    if not total[0] > 0.0:
        return False
    factor = table.factor
    volume, offset = 0.0, np.empty(4)
    for i in range(4):
        volume += math.log(factor[i, i])
    for i in range(len(nodes)):
        of = -1
        if i >= first:
            of = 0 if uniforms[i, 0] < 0.5 else 1
            chosen = np.searchsorted(sums[of], uniforms[i, 1] * total[of], side="right") - 1
            nodes[i] = low + min(max(chosen, 0), high - low - 1)
            while table.ends[nodes[i]] > finish:  # at an edge, by rounding
                nodes[i] -= 1
        node = nodes[i]
        log_q[i] = -math.inf
        gone = _stands(table.heights[node], table.where[node], problem.camera_mean, camera)
        if math.isnan(gone[0]):
            continue
        if of >= 0:
            stretch = 1.0 if of == 0 else _WIDER / math.sqrt(spreads[i])
            for a in range(4):
                step = 0.0
                for c in range(a + 1):
                    step += factor[a, c] * normals[i, c]
                where[i, a] = table.where[node, a] + gone[a] + stretch * step
        square = 0.0
        for a in range(4):
            offset[a] = where[i, a] - table.where[node, a] - gone[a]
            if a == 2:
                turns = math.floor(offset[a] / (2.0 * math.pi) + 0.5)
                if turns != 0.0 and i >= first:
                    square = math.inf
                offset[a] -= 2.0 * math.pi * turns
            for c in range(a):
                offset[a] -= factor[a, c] * offset[c]
            offset[a] /= factor[a, a]
            square += offset[a] * offset[a]
        if square == math.inf:
            continue
        near = table.sharp[node] / total[0] * math.exp(-0.5 * square) / (2.0 * math.pi) ** 2
        tail = math.exp(math.lgamma(0.5 * (TAIL + 4)) - math.lgamma(0.5 * TAIL))
        tail *= (_WIDER**2 * TAIL * math.pi) ** -2
        tail *= (1.0 + square / (_WIDER**2 * TAIL)) ** (-0.5 * (TAIL + 4))
        far = table.flat[node] / total[1] * tail
        log_q[i] = math.log(0.5 * (near + far)) - volume - log_area(where[i, 1])
    return True


@compiled
def _judge(
    evaluator: Evaluator,
    table: Table,
    power: float,
    camera: Array,
    latent: Array,
    others: Ints,
    placements: Array,
    sizes: Array,
    at: int,
    nodes: Ints,
    where: Array,
    log_q: Array,
    alone: Array,
) -> None:
    """What each element adds to the log target of the others, nats; -inf outside the support."""
    problem, r = evaluator.problem, len(others)
    layout = 0.0
    for i in range(r):
        layout += problem.log_rate[others[i, 0]]
    prior, likelihood = change(
        evaluator, -1, camera, latent, camera, others, placements, sizes, latent
    )
    alone[:] = -math.inf
    if prior == -math.inf:
        return
    commit(evaluator)
    base = prior - layout + power * (layout + likelihood)
    items, places, own = np.empty((r + 1, 2), np.int64), np.empty((r + 1, 3)), np.empty(r + 1)
    for i in range(at):
        items[i], places[i], own[i] = others[i], placements[i], sizes[i]
    for i in range(at, r):
        items[i + 1], places[i + 1], own[i + 1] = others[i], placements[i], sizes[i]
    for i in range(len(nodes)):
        if log_q[i] == -math.inf:
            continue
        items[at, 0], items[at, 1] = table.items[nodes[i], 0], table.items[nodes[i], 1]
        x, y = floor_point(where[i, 0], where[i, 1])
        places[at, 0], places[at, 1], places[at, 2], own[at] = x, y, where[i, 2], where[i, 3]
        prior, likelihood = change(evaluator, r, camera, latent, camera, items, places, own, latent)
        rate = problem.log_rate[items[at, 0]]
        if prior > -math.inf:
            value = prior - layout - rate + power * (layout + rate + likelihood)
            alone[i] = value - base


@compiled
def _holds(problem: Problem, scenelet: int, start: int, stay: int) -> bool:
    """Whether a scenelet has its person off their feet in a stay."""
    low, high = problem.lowered[scenelet, 0], problem.lowered[scenelet, 1]
    begins, ends = problem.stays[stay, 0], problem.stays[stay, 1]
    result: bool = low < high and start + low < ends and start + high > begins
    return result


@compiled
def _step(
    problem: Problem, errors: Array, of: int, before: Array, known: bool, end: int, start: int
) -> float:
    """Log density, up to a constant, of path errors of a first frame given those before it.

    ``before`` (4,) are those of the last frame and of the one before that, which ends at ``end``.
    """
    total = 0.0
    for axis in range(2):
        off, frames = errors[of + axis], 0
        if known:
            frames = start - end + 1
            if axis == 1:
                frames = steps_of_depth(problem.path_stay, problem.stay_steps, end, start)
            off -= problem.path_mean[axis, frames, 0] * before[axis]
            off -= problem.path_mean[axis, frames, 1] * before[2 + axis]
        doubt = problem.path_draw[axis, frames, 0, 2]
        total -= math.log(doubt) + 0.5 * (off / doubt) ** 2
    return total


@compiled
def _pair(
    problem: Problem,
    table: Table,
    power: float,
    camera: Array,
    others: Ints,
    sides: Array,
    nodes: Ints,
    where: Array,
    weight: Array,
    pair: Array,
) -> None:
    """Nats that each element is worth right after another one, over both alone."""
    film, ends, m = table.film, table.ends, len(nodes)
    items = table.items[nodes]
    errors = np.empty((m, 6))
    path_errors(problem, camera, items, where, errors)
    joints, jumps = np.empty((2 * m, 3, 16)), np.empty((m, 2))
    loose_jumps(problem, film, items, where, table.loose, joints, jumps)
    places, sizes = np.empty((m, 3)), np.empty(m)
    for i in range(m):
        places[i, 0], places[i, 1] = floor_point(where[i, 0], where[i, 1])
        places[i, 2], sizes[i] = where[i, 2], where[i, 3]
    boxes, turns, owner, yaws = place_boxes(problem, camera, items, places, sizes)
    first_box = np.searchsorted(owner[:, 0], np.arange(m + 1))
    labels = owner[:, 2].copy()
    stays = len(problem.stays)
    held = np.zeros((m, stays), np.bool_)
    for s in range(stays):
        for i in range(len(others)):
            held[:, s] |= _holds(problem, others[i, 0], others[i, 1], s)
    holds = np.zeros((m, stays), np.bool_)
    for i in range(m):
        for s in range(stays):
            holds[i, s] = not held[i, s] and _holds(problem, items[i, 0], items[i, 1], s)
    end_before, start_after = int(sides[0, 4]), int(sides[1, 4])
    before, after = end_before != _MISSING, start_after != _MISSING
    across = before and after and film[end_before - 1] == film[start_after]
    passing = 0.0
    if after:
        passing = _step(problem, sides[1], 0, sides[0, :4], across, end_before, start_after)
    scale = problem.joint_step * math.exp(problem.camera_mean[3])
    unit = power * problem.likelihood
    entered, left = np.empty(m), np.empty(m)
    for i in range(m):
        start, end = items[i, 1], ends[nodes[i]]
        known = before and film[end_before - 1] == film[start]
        entered[i] = _step(problem, errors[i], 0, sides[0, :4], known, end_before, start)
        left[i] = 0.0
        if after:
            goes = film[end - 1] == film[start_after]
            left[i] = _step(problem, sides[1], 0, errors[i, 2:], goes, end, start_after)
            if not goes:
                left[i] = passing
    for a in range(m):
        end = ends[nodes[a]]
        for b in range(m):
            start = items[b, 1]
            if end > start or weight[a] == -math.inf or weight[b] == -math.inf:
                pair[a, b] = -math.inf
                continue
            same = film[end - 1] == film[start]
            value = _step(problem, errors[b], 0, errors[a, 2:], same, end, start)
            value += passing - entered[b] - left[a]
            if same and end == start:
                jump = pose_jump(joints, 2 * a + 1, 2 * b, scale) - jumps[a, 1] - jumps[b, 0]
                value -= unit * problem.smoothness_cost * jump
            value -= unit * collision(problem, first_box, boxes, turns, labels, yaws, a, b)
            for s in range(stays):
                if holds[a, s] and holds[b, s]:
                    value -= unit * problem.stays[s, 2]
            pair[a, b] = value
