"""What every frame says of a scene, and the sum over which of them have sides swapped, compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.geometry import NOTHING_IN_SIGHT
from imapper_prob.models.jit import compiled
from imapper_prob.models.kernels.frame import set_own_chances, weigh
from imapper_prob.models.kernels.memory import Memory
from imapper_prob.models.kernels.sight import GAP, Singles
from imapper_prob.models.problem import Problem

__all__ = ["sum_votes", "vote", "vote_barely"]

Array = NDArray[np.float64]

_CAP = np.float32(NOTHING_IN_SIGHT)
_TINY = 1e-100
"""Products of densities are rescaled below this."""


@compiled
def set_vote(right: float, wrong: float, weight: float, votes: Array, row: int) -> None:
    """Of a frame: the greater log-density of two, weighted, and both densities over it.

    ``right`` and ``wrong`` are its log-likelihood as it is and with sides swapped, nats.
    """
    votes[row, 0] = weight * max(right, wrong)
    less = math.exp(-weight * abs(right - wrong))
    votes[row, 1], votes[row, 2] = (1.0, less) if right > wrong else (less, 1.0)


@compiled
def vote_barely(problem: Problem, memory: Memory) -> None:
    """The vote of every frame in its own pose with nothing in sight."""
    weight = problem.frame_weight * problem.likelihood
    memory.clearance[:] = _CAP
    for t in range(len(memory.bare)):
        set_own_chances(problem, t, memory.own, t)
        right, wrong = weigh(
            memory.own, t, memory.clearance, t, problem.sight_width, problem.surprise, memory.desk
        )
        set_vote(right, wrong, weight, memory.bare, t)
    # No clearance is as before where there is none yet.
    memory.clearance[:] = np.nan


@compiled
def _differ(clearance: Singles, one: int, other: int) -> bool:
    for j in range(16):
        if clearance[one, j] != clearance[other, j]:
            return True
    return False


@compiled
def vote(problem: Problem, memory: Memory, n: int) -> None:
    """Votes and depths of the changed frames with all ``n`` scenelets."""
    changed, moved, watched, cover = memory.changed, memory.moved, memory.watched, memory.cover
    rows, sum_rows, near, depths = memory.pose_row, memory.sum_row, memory.near, memory.depths
    gaps, clearance, bench, desk = memory.gaps, memory.clearance, memory.bench, memory.desk
    votes, inside, bare, sunk = memory.votes, memory.inside, memory.bare, memory.sunk
    slots, own, chances = memory.slots, memory.own, memory.chances
    weight, width, surprise = (
        problem.frame_weight * problem.likelihood, problem.sight_width, problem.surprise,
    )  # fmt: skip
    for t in range(len(changed)):
        if not changed[t]:
            continue
        row, to = rows[t], sum_rows[t]
        before = 2 * t + len(changed) - to
        depth, bounded = sunk[row] if watched[t] else 0.0, False
        for j in range(16):
            bench[GAP + j] = _CAP
        for i in range(n):
            slot = slots[1, i]
            depth += depths[slot, row]
            if near[slot, row]:
                bounded = True
                for j in range(16):
                    bench[GAP + j] = min(bench[GAP + j], gaps[slot, row, j])
        for j in range(16):
            clearance[to, j] = bench[GAP + j]
        inside[to] = depth
        covered = cover[1, t] >= 0
        posed = moved[t] and (covered or cover[0, t] >= 0)
        if not posed and not _differ(clearance, before, to):
            for k in range(3):
                votes[to, k] = votes[before, k]
        elif covered:
            right, wrong = weigh(chances, row, clearance, to, width, surprise, desk)
            set_vote(right, wrong, weight, votes, to)
        elif bounded:
            right, wrong = weigh(own, t, clearance, to, width, surprise, desk)
            set_vote(right, wrong, weight, votes, to)
        else:
            for k in range(3):
                votes[to, k] = bare[t, k]


@compiled
def sum_votes(problem: Problem, memory: Memory) -> float:
    """Detections of all frames, whichever are swapped, cost of free poses, and depth inside.

    The recursion is that of :func:`imapper_prob.models.energy.swaps.summed_over_swaps`, on
    densities that are rescaled now and then in place of probabilities.
    """
    begins, ends = problem.swap_begins, problem.swap_ends
    turned = begins / (begins + ends)
    stays = 1.0 - turned
    total, free, inside = 0.0, 0.0, 0.0
    rows, votes, depths = memory.sum_row, memory.votes, memory.inside
    cover, free_cost = memory.cover, problem.free_cost
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
        if cover[1, t] < 0:
            free += free_cost[t]
    total += math.log(stays + turned)
    weight = problem.frame_weight * problem.likelihood
    return total - weight * (free + problem.motion_cost * inside)
