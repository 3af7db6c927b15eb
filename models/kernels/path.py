"""The path between two scenelets, again, where one of them or its latent numbers changed."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled
from imapper_prob.models.kernels.memory import Memory
from imapper_prob.models.problem import Problem

__all__ = ["pose_free_frames", "segment"]

Array = NDArray[np.float64]

_LOG_2PI = math.log(2 * math.pi)
_LARGE = 1e100
"""Products of variances grow to this before their logarithm is taken."""


@compiled
def segment(
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
    focal = math.exp(camera[2])
    evidence = 0.0
    filtered, pelvis = memory.filtered, memory.pelvis
    precisions, measured = problem.precision, problem.measured
    for axis in range(2):
        step = problem.step_variance[axis]
        if left >= 0:
            mean, variance = pelvis[left, 2 + axis], step
        else:
            mean, variance = problem.start_mean[axis], problem.start_variance[axis]
        # The same pixels under another focal length and body size.
        scale, offset, sharper = 1.0 / focal, 0.0, focal * focal
        if axis == 1:
            scale, offset, sharper = 1.0, camera[2] + camera[3], 1.0
        growth = 1.0
        for t in range(first, last):
            precision = sharper * precisions[t, axis]
            error = scale * measured[t, axis] + offset - mean
            grown = 1.0 + precision * variance
            variance /= grown
            evidence -= 0.5 * precision * error * error / grown
            mean += precision * variance * error
            growth *= grown
            if growth > _LARGE:
                evidence -= 0.5 * math.log(growth)
                growth = 1.0
            filtered[t, 2 * axis], filtered[t, 2 * axis + 1] = mean, variance
            variance += step
        evidence -= 0.5 * math.log(growth)
        if right >= 0:
            ahead = pelvis[right, axis]
            error = ahead - mean
            evidence -= 0.5 * (_LOG_2PI + math.log(variance) + error * error / variance)
        else:
            ahead = 0.0
        for t in range(last - 1, first - 1, -1):
            mean, variance = filtered[t, 2 * axis], filtered[t, 2 * axis + 1]
            if t + 1 < len(latent):
                gain = variance / (variance + step)
                mean += gain * (ahead - mean)
                variance *= 1.0 - gain
            ahead = mean + math.sqrt(variance) * latent[t, axis]
            filtered[t, 4 + axis] = ahead
    return evidence


@compiled
def pose_free_frames(problem: Problem, memory: Memory, camera: Array) -> None:
    """World joints of every free frame that moved: its own pose where the path goes, metres."""
    cp, sp = math.cos(camera[0]), math.sin(camera[0])
    cr, sr = math.cos(camera[4]), math.sin(camera[4])
    focal, body, elevation = math.exp(camera[2]), math.exp(camera[3]), camera[1]
    joints, path, rows = memory.joints, memory.path, memory.pose_row
    poses, lift, moved, cover = problem.poses, problem.lift, memory.moved, memory.cover
    for t in range(len(moved)):
        if moved[t] and cover[1, t] < 0:
            row = rows[t]
            depth = math.exp(path[row, 1])
            px, pz = path[row, 0] * depth, lift[t] / focal * depth
            for j in range(16):
                right = px + body * poses[t, j, 0]
                y = depth + body * poses[t, j, 1]
                up = pz + body * poses[t, j, 2]
                z = sr * right + cr * up
                joints[row, j, 0] = cr * right - sr * up
                joints[row, j, 1] = cp * y - sp * z
                joints[row, j, 2] = sp * y + cp * z + elevation
