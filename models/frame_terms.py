"""The contribution of each frame to the terms of the log-posterior, for reports and figures.

The contributions are computed from the model itself and add up to the terms of
:func:`imapper_prob.models.log_posterior.terms`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.kernels.detection import forward_filter
from imapper_prob.models.kernels.path import pose_jump
from imapper_prob.models.log_posterior import State, evaluate, terms
from imapper_prob.models.problem import Problem
from imapper_prob.models.published_terms import paper_energy
from imapper_prob.models.settings import PaperWeights

__all__ = ["terms_by_frame"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


def terms_by_frame(problem: Problem, state: State) -> dict[str, Array]:
    """Per-frame contributions to the log-posterior or, for the published energy, to its terms.

    Parameters
    ----------
    problem : Problem
    state : State
        A state inside the support of the posterior.

    Returns
    -------
    dict of str to (T,) float
        Nats. The detections' contribution is the weighted log p(u_t, c_t | all earlier frames, s),
        marginalised over left-right flips. A jump counts for the frame it leads to.
    """
    return _published(problem, state) if problem.of_paper else _default(problem, state)


def _published(problem: Problem, state: State) -> dict[str, Array]:
    published = paper_energy(problem, state, weights=PaperWeights(*problem.paper_nats.tolist()))
    return {name: -nats for name, nats in published.by_frame.items()}


def _default(problem: Problem, state: State) -> dict[str, Array]:
    n_frames = problem.n_frames
    _, joints, by_frame = evaluate(problem, state)
    weight = problem.frame_weight * problem.likelihood
    detections, _ = forward_filter(
        by_frame, problem.path_starts, weight, problem.flip_begins, problem.flip_ends
    )
    covered_by = np.full(n_frames, -1)
    for index in range(state.n_scenelets):
        scenelet, start = state.items[index].tolist()
        covered_by[start : start + int(problem.lengths[scenelet])] = index
    return {
        "detections": detections,
        "free_pose": np.where(covered_by < 0, -weight * problem.free_cost, 0.0),
        "smoothness": _jumps_by_frame(problem, state, covered_by, joints),
        "motion": _motion_by_frame(problem, state),
        "ground": _ground_by_frame(problem, joints),
        "support": _support_by_frame(problem, state),
    }


def _jumps_by_frame(problem: Problem, state: State, covered_by: Ints, joints: Array) -> Array:
    """(T,) log-probability of the pose jump into each frame where a scenelet begins or ends."""
    shares, scale = np.zeros(len(joints)), problem.joint_step * np.exp(state.camera[3])
    joined = ~problem.path_starts[1:]
    for t in (1 + np.flatnonzero(joined & (np.diff(covered_by) != 0))).tolist():
        shares[t] = pose_jump(joints, t - 1, t, scale)
    return -problem.smoothness_cost * problem.likelihood * shares


def _ground_by_frame(problem: Problem, joints: Array) -> Array:
    """(T,) log-probability of feet below the floor, in frames with a detection."""
    weight = problem.motion_cost * problem.frame_weight * problem.likelihood
    depth = np.maximum(-joints[:, 2].min(-1), 0.0)
    return np.where(problem.used.any(1), -weight * depth, 0.0)


def _support_by_frame(problem: Problem, state: State) -> Array:
    """(T,) log-probability of each stay without support, spread evenly over its frames."""
    shares = np.zeros(problem.n_frames)
    for stay in problem.stays:
        cost = terms(problem._replace(stays=stay[None]), state)["support"]
        first, end = int(stay[0]), int(stay[1])
        shares[first:end] += cost / (end - first)
    return shares


def _motion_by_frame(problem: Problem, state: State) -> Array:
    """(T,) motion term of each frame alone, scaled so that the sum is the whole term.

    Displacing furniture helps all frames at once, so the whole costs less than the sum of parts.
    """
    shares = np.zeros(problem.n_frames)
    for t in np.flatnonzero(problem.used.any(1)):
        alone = np.zeros_like(problem.used)
        alone[t] = problem.used[t]
        shares[t] = terms(problem._replace(used=alone), state)["motion"]
    scale = terms(problem, state)["motion"] / shares.sum() if shares.any() else 1.0
    return scale * shares
