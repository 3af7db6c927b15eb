"""Emissions of every frame, marginalised over left-right flips.

Equations (11) and (12) of ``docs/explanation/model.md``.

A detector that sees a person from behind, or in poor light, may confuse left and right joints for a
run of frames, at full confidence. Whether frame t is flipped is a two-state Markov chain s_t. The
forward recursion of a hidden Markov model (Rabiner 1989) sums it out exactly, in time linear in T:

    log p(u, c | q) = log sum over s of p(s) prod_t p(u_t, c_t | q_t, s_t)^w

with the frame weight w, which accounts for the correlation of neighbouring frames.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled, inner_inlined
from imapper_prob.models.kernels.cache import AS_DETECTED, EMISSION, FLIPPED, Cache
from imapper_prob.models.kernels.frame import (
    cap_likelihoods,
    mix_likelihoods,
    set_free_likelihoods,
    take_logs,
    visibility_probabilities,
)
from imapper_prob.models.kernels.visibility import GAP, Singles, open_bounds
from imapper_prob.models.problem import DETECTIONS, FREE_POSE, GROUND, Problem
from imapper_prob.models.settings import NOTHING_IN_SIGHT

__all__ = [
    "bound_emissions",
    "draw_flips",
    "flip_probabilities",
    "forward_filter",
    "forward_log_likelihood",
    "sum_emissions",
    "sum_free_poses",
    "update_emissions",
]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@compiled
def forward_filter(
    by_frame: Array, starts: Flags, weight: float, begins: float, ends: float
) -> tuple[Array, Array]:
    """Contribution of each frame to the log-likelihood, and probability that it is flipped.

    Parameters
    ----------
    by_frame : (T, 2) float
        Log-likelihood of each frame as it is, and with sides flipped, nats.
    starts : (T,) bool
        Frames without a predecessor, where the chain restarts.
    weight : float
        Factor on every frame's log-likelihood.
    begins, ends : float
        Probability per frame that a flip begins, and that one ends. The first frame and every other
        start are flipped with the stationary probability ``begins / (begins + ends)``.

    Returns
    -------
    shares : (T,) float
        log p(u_t, c_t | all earlier frames), nats; the sum is the log-likelihood of all frames.
    flipped : (T,) float
        Probability that a frame is flipped, given the frames up to and including it.
    """
    n, usual = len(by_frame), begins / (begins + ends)
    shares, flipped = np.empty(n), np.empty(n)
    predicted = usual
    for t in range(n):
        if starts[t]:
            predicted = usual
        as_detected, as_flipped = weight * by_frame[t, 0], weight * by_frame[t, 1]
        top = max(as_detected, as_flipped)
        stays = (1.0 - predicted) * math.exp(as_detected - top)
        turned = predicted * math.exp(as_flipped - top)
        both = stays + turned
        shares[t] = top + math.log(both)
        flipped[t] = turned / both
        predicted = (stays * begins + turned * (1.0 - ends)) / both
    return shares, flipped


@compiled
def flip_probabilities(
    by_frame: Array, starts: Flags, weight: float, begins: float, ends: float
) -> Array:
    """Probability that each frame is flipped, given all frames (forward-backward).

    Parameters
    ----------
    by_frame, starts, weight, begins, ends
        See :func:`forward_filter`.

    Returns
    -------
    (T,) float
    """
    n, forward = len(by_frame), forward_filter(by_frame, starts, weight, begins, ends)[1]
    result = forward.copy()
    for t in range(n - 2, -1, -1):
        if starts[t + 1]:
            continue
        # p(s_t | all) = sum over s_{t+1} of p(s_{t+1} | all) p(s_t | s_{t+1}, past).
        now = forward[t]
        to_flipped = (1.0 - now) * begins + now * (1.0 - ends)
        to_unflipped = (1.0 - now) * (1.0 - begins) + now * ends
        result[t] = (
            result[t + 1] * now * (1.0 - ends) / to_flipped
            + (1.0 - result[t + 1]) * now * ends / to_unflipped
        )
    return result


def draw_flips(
    rng: np.random.Generator,
    n_frames: int,
    *,
    begins: float,
    ends: float,
    starts: Flags | None = None,
) -> Flags:
    """Draw the flipped frames from the stationary two-state Markov chain.

    Parameters
    ----------
    rng : numpy.random.Generator
    n_frames : int
        T.
    begins, ends : float
        Probability per frame that a flip begins, and that one ends.
    starts : (T,) bool, optional
        Frames besides the first at which the chain restarts.

    Returns
    -------
    (T,) bool
    """
    uniform = rng.random(n_frames)
    flipped = np.zeros(n_frames, bool)
    for t in range(n_frames):
        anew = t == 0 or (starts is not None and starts[t])
        probability = 1 - ends if flipped[t - 1] else begins
        flipped[t] = uniform[t] < (begins / (begins + ends) if anew else probability)
    return flipped


_CAP = np.float32(NOTHING_IN_SIGHT)
_TINY = 1e-100
"""Products of densities are rescaled when they fall below this."""


@inner_inlined
def _set_emission(
    as_detected: float, flipped: float, weight: float, emissions: Array, row: int
) -> None:
    """Write the emission from log-likelihoods with sides as they are and flipped, nats."""
    emissions[row, 0] = weight * max(as_detected, flipped)
    less = math.exp(-weight * abs(as_detected - flipped))
    emissions[row, 1], emissions[row, 2] = (1.0, less) if as_detected > flipped else (less, 1.0)
    emissions[row, AS_DETECTED], emissions[row, FLIPPED] = as_detected, flipped


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
def update_emissions(problem: Problem, cache: Cache, n: int) -> None:
    """Compute the emissions of the frames that changed.

    Parameters
    ----------
    problem : Problem
    cache : Cache
    n : int
        Number of scenelets of the proposal.
    """
    n_emissions = _reuse_emissions(cache, n)
    cover, frames, emission_rows, rows = (
        cache.cover,
        cache.frames,
        cache.emission_rows,
        cache.pose_row,
    )
    free_likelihoods, likelihoods, seen, scratch64 = (
        cache.free_likelihoods,
        cache.likelihoods,
        cache.seen,
        cache.scratch64,
    )
    emissions, free_emissions, clearance = cache.emissions, cache.free_emissions, cache.clearance
    weight, logs = problem.frame_weight * problem.likelihood, cache.logs
    visibility_probabilities(seen, n_emissions, problem.sight_width, problem.visibility_error)
    for i in range(n_emissions):
        t = frames[i]
        if cover[1, t] >= 0:
            mix_likelihoods(likelihoods, rows[t], seen, i, scratch64, logs)
        else:
            _ensure_free_likelihoods(problem, cache, t)
            mix_likelihoods(free_likelihoods, t, seen, i, scratch64, logs)
    take_logs(logs, n_emissions)
    for i in range(n_emissions):
        t, to = frames[i], emission_rows[i]
        _set_emission(logs[0, i], logs[1, i], weight, emissions, to)
        if cover[1, t] < 0 and math.isnan(free_emissions[t, 0]) and _nothing_near(clearance, to):
            for k in range(EMISSION):
                free_emissions[t, k] = emissions[to, k]


@inner_inlined
def _ensure_free_likelihoods(problem: Problem, cache: Cache, t: int) -> None:
    """Fill in the likelihoods of frame ``t`` in its static pose, once."""
    if not cache.free_likelihoods_set[t]:
        set_free_likelihoods(problem, t, cache.scratch64, cache.free_likelihoods, t)
        cache.free_likelihoods_set[t] = 1


@inner_inlined
def bound_emissions(problem: Problem, cache: Cache) -> None:
    """Bound the emissions of a proposal from above, without its lines of sight.

    The bounds are exact in frames that are not marked as changed.

    Parameters
    ----------
    problem : Problem
    cache : Cache
        Output: ``bounds``.
    """
    n_frames, n_missing = len(cache.changed), 0
    cover, rows, ceilings = cache.cover, cache.pose_row, cache.ceilings
    changed, missing, bounds = cache.changed, cache.emission_rows, cache.bounds
    scratch64, logs = cache.scratch64, cache.logs
    for t in range(n_frames):
        row = rows[t] if cover[1, t] >= 0 else 2 * n_frames + t
        if changed[t] and math.isnan(ceilings[row, 0]):
            if cover[1, t] >= 0:
                cap_likelihoods(cache.likelihoods, row, scratch64, n_missing, logs)
            else:
                _ensure_free_likelihoods(problem, cache, t)
                cap_likelihoods(cache.free_likelihoods, t, scratch64, n_missing, logs)
            missing[n_missing] = row
            n_missing += 1
    take_logs(logs, n_missing)
    weight = problem.frame_weight * problem.likelihood
    for i in range(n_missing):
        _set_emission(logs[0, i], logs[1, i], weight, ceilings, missing[i])
    for t in range(n_frames):
        if changed[t]:
            row = rows[t] if cover[1, t] >= 0 else 2 * n_frames + t
            for k in range(3):
                bounds[t, k] = ceilings[row, k]
        else:
            row = t + n_frames * np.int64(cache.sum_at[t])
            for k in range(3):
                bounds[t, k] = cache.emissions[row, k]


@inner_inlined
def _reuse_emissions(cache: Cache, n: int) -> int:
    """Update clearances of the changed frames, and copy emissions that are already known.

    The remaining frames, their rows and their clearances are written to ``frames``,
    ``emission_rows`` and ``seen``; returns their number.
    """
    changed, moved, cover, near = cache.changed, cache.moved, cache.cover, cache.near
    rows, sum_rows = cache.pose_row, cache.sum_row
    slot_clearance, clearance, scratch32, slots = (
        cache.slot_clearance,
        cache.clearance,
        cache.scratch32,
        cache.slots,
    )
    emissions, free_emissions, seen, n_emissions = (
        cache.emissions,
        cache.free_emissions,
        cache.seen,
        0,
    )
    for t in range(len(changed)):
        if not changed[t]:
            continue
        row, to = rows[t], sum_rows[t]
        before = 2 * t + len(changed) - to
        bounded = False
        open_bounds(scratch32)
        for i in range(n):
            slot = slots[1, i]
            if near[slot, row]:
                bounded = True
                for j in range(slot_clearance.shape[2]):
                    # The redundant cap makes it three operands, as in `visibility._pass_by`.
                    scratch32[GAP + j] = min(
                        min(scratch32[GAP + j], slot_clearance[slot, row, j]), _CAP
                    )
        for j in range(clearance.shape[1]):
            clearance[to, j] = scratch32[GAP + j]
        covered = cover[1, t] >= 0
        posed = moved[t] and (covered or cover[0, t] >= 0)
        if not posed and not _differ(clearance, before, to):
            for k in range(EMISSION):
                emissions[to, k] = emissions[before, k]
        elif covered or bounded or math.isnan(free_emissions[t, 0]):
            cache.frames[n_emissions], cache.emission_rows[n_emissions] = t, to
            for j in range(seen.shape[1]):
                seen[n_emissions, j] = scratch32[GAP + j]
            n_emissions += 1
        else:
            for k in range(EMISSION):
                emissions[to, k] = free_emissions[t, k]
    return n_emissions


@inner_inlined
def forward_log_likelihood(problem: Problem, cache: Cache) -> float:
    """Compute the terms of detections, free poses and ground of a proposal.

    Parameters
    ----------
    problem : Problem
    cache : Cache
        Output: these three terms.

    Returns
    -------
    float
        Their sum, nats.
    """
    total, free = (
        sum_emissions(problem, cache.emissions, cache.sum_row),
        sum_free_poses(problem, cache),
    )
    below, poses, floor_depths, detected = 0.0, cache.pose_row, cache.floor_depths, cache.detected
    for t in range(len(poses)):
        if detected[t]:
            below += floor_depths[poses[t]]
    weight, terms = problem.frame_weight * problem.likelihood, cache.terms
    terms[DETECTIONS] = total
    terms[FREE_POSE] = -free
    terms[GROUND] = -weight * problem.motion_cost * below
    return total - free + terms[GROUND]  # type: ignore[no-any-return]


@inner_inlined
def sum_free_poses(problem: Problem, cache: Cache) -> float:
    """Cost of the poses of free frames of a proposal, nats.

    Parameters
    ----------
    problem : Problem
    cache : Cache

    Returns
    -------
    float
    """
    free, cover, free_cost = 0.0, cache.cover, problem.free_cost
    for t in range(cover.shape[1]):
        if cover[1, t] < 0:
            free += free_cost[t]
    return problem.frame_weight * problem.likelihood * free


@inner_inlined
def sum_emissions(problem: Problem, emissions: Array, rows: NDArray[np.int64]) -> float:
    """Log of equation (12) by its forward recursion, on densities that are rescaled when needed.

    Parameters
    ----------
    problem : Problem
    emissions : (R, 3 or more) float
        See ``EMISSION``.
    rows : (T,) int
        The row of each frame.

    Returns
    -------
    float
        Nats.
    """
    begins, ends = problem.flip_begins, problem.flip_ends
    usual = begins / (begins + ends)
    stays, turned = 1.0 - usual, usual
    total = 0.0
    for t in range(len(rows)):
        row = rows[t]
        if problem.path_starts[t]:
            both = stays + turned
            stays, turned = (1.0 - usual) * both, usual * both
        total += emissions[row, 0]
        stays *= emissions[row, 1]
        turned *= emissions[row, 2]
        if stays + turned < _TINY:
            scale = stays + turned
            total += math.log(scale)
            stays /= scale
            turned /= scale
        stays, turned = (
            stays * (1.0 - begins) + turned * ends,
            stays * begins + turned * (1.0 - ends),
        )
    return total + math.log(stays + turned)
