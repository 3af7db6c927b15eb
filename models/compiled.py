"""The log-posterior of a scene, compiled.

    log pi(s) = log p(phi) + log p(X) + log p(P, G | X) + log p(u, c | s)
                - free poses - E_s - E_c - E_m - E_g - E_u

over a state s = (phi, X, P, b, z): camera and body scale phi, the assignment X of scenelets
to start frames, their placements P and sizes b, and standard normal numbers z that say which
path G is drawn where no scenelet lies (see :mod:`imapper_prob.models.chain`). The density is
with respect to d phi dP db and the normal law of z, so that it has the same dimension of z
whatever the number of scenelets.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.energy.intersection import (
    BOTH,
    N_DISPLACED,
    depth_below_floor,
    displaced_cost,
    give_way,
)
from imapper_prob.models.energy.smoothness import pose_jump
from imapper_prob.models.energy.support import unsupported
from imapper_prob.models.energy.swaps import summed_over_swaps
from imapper_prob.models.jit import compiled, inner, inner_inlined
from imapper_prob.models.kernels.frame import (
    CHANCES,
    DESK,
    FACTS,
    find_seen,
    lens_of,
    set_chances,
    set_detections,
    set_own_chances,
    take_logs,
    weigh,
)
from imapper_prob.models.kernels.room import (
    collision_depths,
    find_clearances,
    find_footprints,
    motion_depths,
)
from imapper_prob.models.kernels.sight import BENCH, Singles
from imapper_prob.models.kernels.world import place_boxes, weigh_priors
from imapper_prob.models.problem import Problem

__all__ = ["TERMS", "evaluate"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

TERMS = (
    "camera", "layout", "placement", "path", "detections", "free_pose", "smoothness", "collision",
    "motion", "ground", "support",
)  # fmt: skip
"""What :func:`evaluate` returns, in order; the log-posterior is their sum."""


@compiled
def evaluate(
    problem: Problem,
    camera: Array,
    items: Ints,
    placements: Array,
    sizes: Array,
    latent: Array,
    joints: Array,
    by_frame: Array,
) -> Array:
    """The terms of the log-posterior of one state.

    Parameters
    ----------
    problem : Problem
    camera : (5,) float
        phi: pitch (rad), elevation (m), log focal scale, log body scale, roll (rad).
    items : (k, 2) int
        Scenelet and start frame, sorted by start.
    placements : (k, 3) float
        x, y (m), yaw (rad) of each scenelet's local frame in the world.
    sizes : (k,) float
        Log size of each scenelet's person, on top of the body scale.
    latent : (T, 2) float
        Standard normal numbers of the path.
    joints : (T, 3, 16) float
        Out: the motion in the world, metres.
    by_frame : (T, 2) float
        Out: log-likelihood of each frame's detections, as they are and with left and right
        swapped, nats, unweighted; left as it is where the likelihood is switched off.

    Returns
    -------
    (11,) float
        Values of ``TERMS``; the first is -inf outside the support.
    """
    terms = np.zeros(11)
    item_of = np.full(problem.lift.shape[0], -1, dtype=np.int64)
    if not weigh_priors(
        problem, camera, items, placements, sizes, latent, item_of, joints, terms
    ) or problem.likelihood == 0.0:  # fmt: skip
        return terms
    weight = problem.frame_weight * problem.likelihood
    terms[10] = -problem.likelihood * unsupported(problem.stays, problem.lowered, items)
    boxes, turns, owner, yaws = place_boxes(problem, camera, items, placements, sizes)
    footprints = find_footprints(boxes, turns)
    gaps = find_clearances(camera[1], joints, boxes, turns)
    _weigh_frames(problem, camera, item_of, sizes, joints, gaps, by_frame)
    terms[4] = summed_over_swaps(
        by_frame, problem.path_starts, weight, problem.swap_begins, problem.swap_ends
    )
    terms[6] = _smoothness(problem, camera, item_of, joints)
    overlaps = collision_depths(problem, len(items), boxes, turns, footprints, owner, yaws)
    terms[7] = -problem.likelihood * _collisions(problem, overlaps)
    depths = motion_depths(len(items), item_of, joints, boxes, turns, footprints, owner)
    terms[8] = -_motion(problem, weight, depths)
    for t in range(len(item_of)):
        if item_of[t] < 0:
            terms[5] -= weight * problem.free_cost[t]
        if _watched(problem, t):
            terms[9] -= weight * problem.motion_cost * depth_below_floor(joints, t)
    return terms


@inner_inlined
def _watched(problem: Problem, t: int) -> bool:
    """Whether anything of the frame was detected."""
    watched = False
    for j in range(16):
        watched |= problem.used[t, j]
    return watched


@inner
def _collisions(problem: Problem, overlaps: Array) -> float:
    """E_c of furniture of two items that is in each other by ``overlaps`` (k, k) metres."""
    total, sums = 0.0, np.empty(N_DISPLACED)
    for i in range(len(overlaps)):
        for j in range(i + 1, len(overlaps)):
            sums[:] = 0.0
            give_way(overlaps[i, j], BOTH * problem.furniture_spread, sums)
            total += displaced_cost(sums, problem.collision_cost)
    return total


@inner
def _motion(problem: Problem, weight: float, depths: Array) -> float:
    """E_m of a body that stands in the furniture of each item by ``depths`` (k, T) metres."""
    total, sums = 0.0, np.empty(N_DISPLACED)
    for i in range(len(depths)):
        sums[:] = 0.0
        for t in range(depths.shape[1]):
            if depths[i, t] > 0.0 and _watched(problem, t):
                give_way(depths[i, t], problem.furniture_spread, sums)
        total += displaced_cost(sums, weight * problem.motion_cost)
    return total


@inner
def _weigh_frames(
    problem: Problem,
    camera: Array,
    item_of: Ints,
    sizes: Array,
    joints: Array,
    gaps: Singles,
    by_frame: Array,
) -> None:
    """log p(u, c | q, m) of every frame into ``by_frame``: as it is, and with sides swapped."""
    n, lens, body, of = len(item_of), lens_of(problem, camera), 1.0, -1
    chances, desk = np.empty((1, CHANCES)), np.empty(DESK)
    bench = np.empty(BENCH, np.float32)
    places, facts = np.empty((1, 2, 2, 16)), np.empty((1, 2, FACTS, 16), np.float32)
    seen, logs = gaps.copy(), np.empty((4, n))
    find_seen(seen, n, problem.sight_width, problem.surprise)
    for t in range(n):
        if item_of[t] >= 0:
            if item_of[t] != of:
                of = item_of[t]
                body = math.exp(camera[3] + sizes[of])
            set_detections(problem, t, places, facts, 0)
            set_chances(lens, body, joints, t, places, facts, 0, desk, bench, chances, 0)
        else:
            set_own_chances(problem, t, desk, chances, 0)
        weigh(chances, 0, seen, t, desk, logs)
    take_logs(logs, n)
    for t in range(n):
        by_frame[t, 0], by_frame[t, 1] = logs[0, t], logs[1, t]


@inner
def _smoothness(problem: Problem, camera: Array, item_of: Ints, joints: Array) -> float:
    """E_s: what it costs that the pose jumps where a scenelet begins or ends."""
    total, scale = 0.0, problem.joint_step * math.exp(camera[3])
    for t in range(1, len(item_of)):
        if item_of[t] != item_of[t - 1] and not problem.path_starts[t]:
            total += pose_jump(joints, t - 1, t, scale)
    return -problem.smoothness_cost * problem.likelihood * total
