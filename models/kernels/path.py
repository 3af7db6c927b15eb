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
    ``memory.predicted``. Returns nats.
    """
    predicted, pelvis = memory.predicted, memory.pelvis
    centres, scales = problem.path_centre, problem.path_scale
    # The same pixels under another focal length and body size.
    shrunk, offset = math.exp(-camera[2]), camera[2] + camera[3]
    keep, depth_keep = problem.path_memory[0], problem.path_memory[1]
    new, depth_new = 1.0 - keep * keep, 1.0 - depth_keep * depth_keep
    if left >= 0:
        t = first - 1
        bearing = keep * (pelvis[left, 2] - shrunk * centres[t, 0]) / (shrunk * scales[t, 0])
        depth = depth_keep * (pelvis[left, 3] - offset - centres[t, 1]) / scales[t, 1]
        doubt, depth_doubt = new, depth_new
    else:
        bearing, depth, doubt, depth_doubt = 0.0, 0.0, 1.0, 1.0
    for t in range(first, last):
        predicted[t, 0], predicted[t, 1], predicted[t, 2], predicted[t, 3] = (
            bearing, doubt, depth, depth_doubt,
        )  # fmt: skip
        bearing *= keep
        depth *= depth_keep
        doubt = keep * keep * doubt + new
        depth_doubt = depth_keep * depth_keep * depth_doubt + depth_new
    evidence, ahead, depth_ahead = 0.0, 0.0, 0.0
    if right >= 0:
        width, depth_width = shrunk * scales[last, 0], scales[last, 1]
        ahead = (pelvis[right, 0] - shrunk * centres[last, 0]) / width
        depth_ahead = (pelvis[right, 1] - offset - centres[last, 1]) / depth_width
        error, depth_error = ahead - bearing, depth_ahead - depth
        evidence -= _LOG_2PI + 0.5 * math.log(doubt * depth_doubt) + math.log(width * depth_width)
        evidence -= 0.5 * (error * error / doubt + depth_error * depth_error / depth_doubt)
    for t in range(last - 1, first - 1, -1):
        bearing, doubt, depth, depth_doubt = (
            predicted[t, 0], predicted[t, 1], predicted[t, 2], predicted[t, 3],
        )  # fmt: skip
        if t + 1 < len(latent):
            gain = keep * doubt / (keep * keep * doubt + new)
            depth_gain = depth_keep * depth_doubt
            depth_gain /= depth_keep * depth_keep * depth_doubt + depth_new
            bearing += gain * (ahead - keep * bearing)
            depth += depth_gain * (depth_ahead - depth_keep * depth)
            doubt *= 1.0 - keep * gain
            depth_doubt *= 1.0 - depth_keep * depth_gain
        ahead = bearing + math.sqrt(doubt) * latent[t, 0]
        depth_ahead = depth + math.sqrt(depth_doubt) * latent[t, 1]
        predicted[t, 4] = shrunk * (centres[t, 0] + scales[t, 0] * ahead)
        predicted[t, 5] = offset + centres[t, 1] + scales[t, 1] * depth_ahead
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
    path, drawn = memory.path, memory.predicted
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
