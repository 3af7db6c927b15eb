"""What every frame says of a scene, and the sum over which of them have sides swapped, compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.geometry import NOTHING_IN_SIGHT
from imapper_prob.models.jit import inner_inlined
from imapper_prob.models.kernels.frame import (
    find_seen,
    set_own_chances,
    take_logs,
    weigh,
)
from imapper_prob.models.kernels.memory import RIGHT, VOTE, WRONG, Memory
from imapper_prob.models.kernels.sight import GAP, Singles, open_view
from imapper_prob.models.problem import Problem
from imapper_prob.models.terms import DETECTIONS, FREE_POSE, GROUND

__all__ = ["sum_votes", "vote"]

Array = NDArray[np.float64]

_CAP = np.float32(NOTHING_IN_SIGHT)
_TINY = 1e-100
"""Products of densities are rescaled below this."""


@inner_inlined
def _set_vote(right: float, wrong: float, weight: float, votes: Array, row: int) -> None:
    """Of a frame whose log-likelihood is ``right`` as it is, ``wrong`` with sides swapped, nats."""
    votes[row, 0] = weight * max(right, wrong)
    less = math.exp(-weight * abs(right - wrong))
    votes[row, 1], votes[row, 2] = (1.0, less) if right > wrong else (less, 1.0)
    votes[row, RIGHT], votes[row, WRONG] = right, wrong


@inner_inlined
def _differ(clearance: Singles, one: int, other: int) -> bool:
    different = False
    for j in range(clearance.shape[1]):
        different |= clearance[one, j] != clearance[other, j]
    return different


@inner_inlined
def _nothing_near(clearance: Singles, row: int) -> bool:
    nothing = True
    for j in range(clearance.shape[1]):
        nothing &= clearance[row, j] == _CAP
    return nothing


@inner_inlined
def vote(problem: Problem, memory: Memory, n: int) -> None:
    """Votes of the changed frames with all ``n`` scenelets."""
    n_weighed = _recall_votes(memory, n)
    cover, frames, weighed, rows = memory.cover, memory.frames, memory.weighed, memory.pose_row
    own, chances, seen, desk = memory.own, memory.chances, memory.seen, memory.desk
    votes, bare, clearance = memory.votes, memory.bare, memory.clearance
    weight, logs = problem.frame_weight * problem.likelihood, memory.logs
    find_seen(seen, n_weighed, problem.sight_width, problem.surprise)
    for i in range(n_weighed):
        t = frames[i]
        if cover[1, t] >= 0:
            weigh(chances, rows[t], seen, i, desk, logs)
        else:
            if not memory.own_told[t]:
                set_own_chances(problem, t, desk, own, t)
                memory.own_told[t] = 1
            weigh(own, t, seen, i, desk, logs)
    take_logs(logs, n_weighed)
    for i in range(n_weighed):
        t, to = frames[i], weighed[i]
        _set_vote(logs[0, i], logs[1, i], weight, votes, to)
        if cover[1, t] < 0 and math.isnan(bare[t, 0]) and _nothing_near(clearance, to):
            for k in range(VOTE):
                bare[t, k] = votes[to, k]


@inner_inlined
def _recall_votes(memory: Memory, n: int) -> int:
    """Clearance of the changed frames, and votes of those that were cast before.

    The other frames, their rows and clearances are put into ``frames``, ``weighed`` and
    ``seen``; returns how many.
    """
    changed, moved, cover, near = memory.changed, memory.moved, memory.cover, memory.near
    rows, sum_rows = memory.pose_row, memory.sum_row
    gaps, clearance, bench, slots = memory.gaps, memory.clearance, memory.bench, memory.slots
    votes, bare, seen, n_weighed = memory.votes, memory.bare, memory.seen, 0
    for t in range(len(changed)):
        if not changed[t]:
            continue
        row, to = rows[t], sum_rows[t]
        before = 2 * t + len(changed) - to
        bounded = False
        open_view(bench)
        for i in range(n):
            slot = slots[1, i]
            if near[slot, row]:
                bounded = True
                for j in range(gaps.shape[2]):
                    # The cap, which changes nothing, makes it three, as in ``sight``.
                    bench[GAP + j] = min(min(bench[GAP + j], gaps[slot, row, j]), _CAP)
        for j in range(clearance.shape[1]):
            clearance[to, j] = bench[GAP + j]
        covered = cover[1, t] >= 0
        posed = moved[t] and (covered or cover[0, t] >= 0)
        if not posed and not _differ(clearance, before, to):
            for k in range(VOTE):
                votes[to, k] = votes[before, k]
        elif covered or bounded or math.isnan(bare[t, 0]):
            memory.frames[n_weighed], memory.weighed[n_weighed] = t, to
            for j in range(seen.shape[1]):
                seen[n_weighed, j] = bench[GAP + j]
            n_weighed += 1
        else:
            for k in range(VOTE):
                votes[to, k] = bare[t, k]
    return n_weighed


@inner_inlined
def sum_votes(problem: Problem, memory: Memory) -> float:
    """Detections of all frames, whichever are swapped, cost of free poses, and of sunken ones.

    Of the first, the log of equation (12) by its forward recursion, on densities that are rescaled
    now and then in place of probabilities.
    """
    begins, ends = problem.swap_begins, problem.swap_ends
    usual = begins / (begins + ends)
    stays, turned = 1.0 - usual, usual
    total, free, below = 0.0, 0.0, 0.0
    rows, votes, poses, sunk = memory.sum_row, memory.votes, memory.pose_row, memory.sunk
    cover, free_cost, watched = memory.cover, problem.free_cost, memory.watched
    for t in range(len(rows)):
        row = rows[t]
        if problem.path_starts[t]:
            both = stays + turned
            stays, turned = (1.0 - usual) * both, usual * both
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
        if watched[t]:
            below += sunk[poses[t]]
        if cover[1, t] < 0:
            free += free_cost[t]
    total += math.log(stays + turned)
    weight, terms = problem.frame_weight * problem.likelihood, memory.terms
    terms[DETECTIONS] = total
    terms[FREE_POSE] = -weight * free
    terms[GROUND] = -weight * problem.motion_cost * below
    return total - weight * (free + problem.motion_cost * below)
