"""The path between two scenelets, again, where one of them or its latent numbers changed."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import inlined
from imapper_prob.models.kernels.memory import ADDED, Memory
from imapper_prob.models.problem import Problem

__all__ = ["find_path"]

Array = NDArray[np.float64]

_LOG_2PI = math.log(2 * math.pi)
_LARGE = 1e100
"""Products of variances grow to this before their logarithm is taken."""
_STILL = 1e-9
"""A pelvis whose bearing and log depth changed by less than this since its frame was last
worked out counts as where it was. That is a few nanometres, a hundredth of what lines of sight
in single precision can tell; the sum changes by less than 1e-6 nats."""


@inlined
def _segment(
    problem: Problem,
    memory: Memory,
    camera: Array,
    latent: Array,
    first: int,
    last: int,
    left: int,
    right: int,
) -> float:
    """Evidence and draw of frames ``first`` to ``last - 1`` between two slots, -1 for none.

    The chain of :mod:`imapper_prob.models.chain` from the last pelvis of ``left`` up to and
    with the first pelvis of ``right``. The path drawn is left in the last two columns of
    ``memory.filtered``. Returns nats.
    """
    filtered, pelvis = memory.filtered, memory.pelvis
    if left >= 0:
        bearing, depth = pelvis[left, 2], pelvis[left, 3]
        doubt, depth_doubt = problem.step_variance[0], problem.step_variance[1]
    else:
        bearing, depth = problem.start_mean[0], problem.start_mean[1]
        doubt, depth_doubt = problem.start_variance[0], problem.start_variance[1]
    step, depth_step = problem.step_variance[0], problem.step_variance[1]
    # The same pixels under another focal length and body size.
    focal, offset = math.exp(camera[2]), camera[2] + camera[3]
    precisions, measured = problem.precision, problem.measured
    # Both coordinates in one loop: while one waits for a division, the other goes on.
    cost, grown, log_grown = 0.0, 1.0, 0.0
    for t in range(first, last):
        precision, depth_precision = focal * focal * precisions[t, 0], precisions[t, 1]
        error, depth_error = measured[t, 0] / focal - bearing, measured[t, 1] + offset - depth
        growth, depth_growth = 1.0 + precision * doubt, 1.0 + depth_precision * depth_doubt
        doubt, depth_doubt = doubt / growth, depth_doubt / depth_growth
        cost += precision * error * error / growth
        cost += depth_precision * depth_error * depth_error / depth_growth
        bearing += precision * doubt * error
        depth += depth_precision * depth_doubt * depth_error
        grown *= growth * depth_growth
        if grown > _LARGE:
            log_grown += math.log(grown)
            grown = 1.0
        filtered[t, 0], filtered[t, 1], filtered[t, 2], filtered[t, 3] = (
            bearing, doubt, depth, depth_doubt,
        )  # fmt: skip
        doubt += step
        depth_doubt += depth_step
    evidence = -0.5 * (cost + log_grown + math.log(grown))
    ahead, depth_ahead = 0.0, 0.0
    if right >= 0:
        ahead, depth_ahead = pelvis[right, 0], pelvis[right, 1]
        error, depth_error = ahead - bearing, depth_ahead - depth
        evidence -= _LOG_2PI + 0.5 * math.log(doubt * depth_doubt)
        evidence -= 0.5 * (error * error / doubt + depth_error * depth_error / depth_doubt)
    for t in range(last - 1, first - 1, -1):
        bearing, doubt, depth, depth_doubt = (
            filtered[t, 0], filtered[t, 1], filtered[t, 2], filtered[t, 3],
        )  # fmt: skip
        if t + 1 < len(latent):
            gain, depth_gain = doubt / (doubt + step), depth_doubt / (depth_doubt + depth_step)
            bearing += gain * (ahead - bearing)
            depth += depth_gain * (depth_ahead - depth)
            doubt, depth_doubt = doubt * (1.0 - gain), depth_doubt * (1.0 - depth_gain)
        ahead = bearing + math.sqrt(doubt) * latent[t, 0]
        depth_ahead = depth + math.sqrt(depth_doubt) * latent[t, 1]
        filtered[t, 4], filtered[t, 5] = ahead, depth_ahead
    return evidence


@inlined
def find_path(
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
            memory.evidence[1, i] = _segment(
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
