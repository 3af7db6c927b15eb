"""Whether draws predict detections like those of the clip, and have a seat for who needs one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from imapper_prob.models.camera import Camera
from imapper_prob.models.energy.occlusion import p_seen
from imapper_prob.models.energy.support import unsupported
from imapper_prob.models.geometry import sight_clearance
from imapper_prob.models.kernels.world import place_boxes
from imapper_prob.models.limits import NEAREST
from imapper_prob.models.posterior import State, camera_at, motion, swapped
from imapper_prob.models.problem import Problem
from imapper_prob.models.skeleton import MIRROR
from imapper_prob.results.check import RATE, Check

__all__ = ["prediction"]

Array = NDArray[np.float64]


def prediction(
    problem: Problem, states: Sequence[State], nominal: Camera, *, rng: np.random.Generator
) -> Check:
    """Whether the draws predict detections like those of the clip.

    A posterior predictive probability (Gelman, Meng and Stern 1996), averaged over draws, of
    detections that fit no better. Of a draw's frames with scenelets it takes the log-density of
    where used joints were detected, given the confidences, and holds it against detections drawn
    from the same scene; frames count ``frame_weight``, for they repeat each other. And a draw that
    leaves somebody sitting on air for S nats has a probability of exp(-S) or less: S is the log of
    a likelihood ratio (:mod:`imapper_prob.models.energy.support`). The rarer of the two, doubled.

    Parameters
    ----------
    problem : Problem
    states : sequence of State
        Draws.
    nominal : Camera
    rng : Generator
        For the detections that are drawn.
    """
    of_detections = float(
        np.mean([_tail(problem, s, camera_at(nominal, s.camera), rng) for s in states])
    )
    on_air = [unsupported(problem.stays, problem.lowered, state.items) for state in states]
    carried = float(np.mean(np.exp(-np.asarray(on_air))))
    value = min(1.0, 2.0 * min(of_detections, carried))
    if not value < RATE:
        sentence = f"The scenes predict such detections (posterior predictive p = {value:.2f})."
        return Check("prediction", value, RATE, False, sentence)
    what = (
        f"somebody is off their feet for seconds and the scenes have nothing to carry them "
        f"({np.mean(on_air):.0f} nats against it)"
        if carried < of_detections
        else "the people in it are not where the joints were detected"
    )
    sentence = (
        f"The scenes do not explain the clip (posterior predictive p = {value:.4f}): {what}. Do "
        "not believe them; the library lacks what is done here, or camera or joints are wrong."
    )
    return Check("prediction", value, RATE, True, sentence)


_REPEATS: Final = 8
"""Detections drawn of every joint."""


def _tail(problem: Problem, state: State, seen_by: Camera, rng: np.random.Generator) -> float:
    """Probability of detections that fit a draw no better; 1 if it has no scenelet."""
    covered = np.zeros(problem.n_frames, bool)
    bodies = np.full(problem.n_frames, state.camera[3])
    for (scenelet, start), size in zip(state.items.tolist(), state.sizes.tolist(), strict=True):
        own = slice(start, start + int(problem.lengths[scenelet]))
        covered[own], bodies[own] = True, state.camera[3] + size
    if not (covered[:, None] & problem.used).any():
        return 1.0
    frames = np.flatnonzero(covered)
    turned = swapped(problem, state)[frames, None] > 0.5
    of = (frames[:, None], np.where(turned, MIRROR, np.arange(len(MIRROR))))
    joints = motion(problem, state)[frames]
    depth = np.maximum(seen_by.to_camera(joints)[..., 1], NEAREST)
    loose = seen_by.fx * problem.pose_tolerance * np.exp(bodies[frames])[:, None] / depth
    boxes, *_ = place_boxes(problem, state.camera, state.items, state.placements, state.sizes)
    clear = sight_clearance(seen_by.centre, joints, boxes)
    in_view = np.vectorize(p_seen)(clear, problem.sight_width, problem.surprise)
    used = problem.used[of] & np.isfinite(seen_by.project(joints)).all(-1)
    squared = ((seen_by.project(joints) - problem.keypoints[of]) ** 2).sum(-1)[used]
    # Hidden, then seen, as the confidence has it.
    share = np.stack([1.0 - in_view, in_view], -1)[used] * problem.confidence_density[of][used]
    share /= share.sum(-1, keepdims=True)
    scale = np.hypot(problem.error_scale[of], loose[..., None])[used]
    dof = problem.error_dof[of][used]
    found = _log_density(squared, share, scale, dof)
    state_of = (rng.random((_REPEATS, len(share))) < share[:, 1]).astype(np.int64)
    row = np.arange(len(share))
    tails, width = dof[row, state_of], scale[row, state_of]
    # (r / s)^2 / nu exceeds x with probability (1 + x)^(-nu / 2).
    radius = width**2 * tails * np.expm1(-2.0 / tails * np.log1p(-rng.random(state_of.shape)))
    drawn = _log_density(radius, share, scale, dof)
    spread = math.sqrt(float(drawn.var(0).sum()) / min(1.0, problem.frame_weight))
    return float(norm.cdf((found.sum() - drawn.mean(0).sum()) / max(spread, 1e-9)))


def _log_density(squared: Array, share: Array, scale: Array, dof: Array) -> Array:
    """(..., K) nats per square pixel, of squared distances (..., K) and rows (K, 2) of tables."""
    distance = squared[..., None] / (dof * scale**2)
    each = share / (2 * np.pi * scale**2) * (1.0 + distance) ** (-(dof / 2 + 1))
    result: Array = np.log(np.maximum(each.sum(-1), np.finfo(float).tiny))
    return result
