"""The published energy as a log-posterior, compiled: what the preset ``paper`` samples from.

    log pi(s) = log p(phi) + log p(X) + log p(P, G | X)
                - w_r L_r - w_o L_o - w_s L_s - w_c L_c - w_m L_m

with the priors of :mod:`imapper_prob.models.compiled`, and the terms of
:mod:`imapper_prob.models.energy.paper`, which says what they are. L_r and L_s are here.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.energy.paper_intersection import depth_of_motion, overlaps
from imapper_prob.models.energy.paper_occlusion import hidden_distance, occlusion_cost
from imapper_prob.models.jit import compiled, inner
from imapper_prob.models.kernels.change import place
from imapper_prob.models.kernels.posing import copy_joints, list_moved, pose_joints
from imapper_prob.models.kernels.session import open_session
from imapper_prob.models.kernels.world import place_boxes
from imapper_prob.models.limits import NEAREST
from imapper_prob.models.problem import Problem
from imapper_prob.models.skeleton import DETECTED, PELV
from imapper_prob.models.terms import CAMERA, LAYOUT, PATH, PLACEMENT, TERMS

__all__ = ["PAPER_TERMS", "evaluate_paper"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

PAPER_TERMS = (
    *TERMS[: PATH + 1], "reprojection", "occlusion", "smoothness", "collision", "motion"
)  # fmt: skip
"""What :func:`evaluate_paper` returns, in order; the log-posterior is their sum."""

_DETECTED = np.array(DETECTED)


@inner
def _reprojection(problem: Problem, camera: Array, joints: Array, by_frame: Array) -> None:
    """L_r: c |Pi q - u|^2 over the joints of each frame, normalised image coordinates."""
    cp, sp, elevation = math.cos(camera[0]), math.sin(camera[0]), camera[1]
    cr, sr, focal = math.cos(camera[4]), math.sin(camera[4]), math.exp(camera[2])
    for t in range(len(joints)):
        for j in _DETECTED:
            x, y, z = joints[t, 0, j], joints[t, 1, j], joints[t, 2, j] - elevation
            depth, level = max(cp * y + sp * z, NEAREST), cp * z - sp * y
            u = focal * (cr * x + sr * level) / depth
            v = focal * (sr * x - cr * level) / depth
            du = u - (problem.keypoints[t, j, 0] - problem.cx) / problem.fx
            dv = v - (problem.keypoints[t, j, 1] - problem.cy) / problem.fy
            if problem.used[t, j]:
                by_frame[t] += problem.confidences[t, j] * (du * du + dv * dv)


@inner
def _occlusion(
    problem: Problem, camera: Array, joints: Array, boxes: Array, turns: Array, by_frame: Array
) -> None:
    """L_o: F(v, c) over the joints of each frame. What a detector lost has c = 0."""
    room = np.empty(9)
    for t in range(len(joints)):
        for j in _DETECTED:
            confidence = problem.confidences[t, j] if problem.used[t, j] else 0.0
            if confidence < 0.5:
                x, y, z = joints[t, 0, j], joints[t, 1, j], joints[t, 2, j]
                distance = hidden_distance(camera[1], x, y, z, boxes, turns, room)
                by_frame[t] += occlusion_cost(distance, confidence)


@inner
def _smoothness(problem: Problem, joints: Array, by_frame: Array) -> None:
    """L_s: |p_t - p_(t-1)|^2 of the pelvis, square metres."""
    for t in range(1, len(joints)):
        if not problem.path_starts[t]:
            for axis in range(3):
                by_frame[t] += (joints[t, axis, PELV] - joints[t - 1, axis, PELV]) ** 2


@compiled
def evaluate_paper(
    problem: Problem,
    camera: Array,
    items: Ints,
    placements: Array,
    sizes: Array,
    latent: Array,
    joints: Array,
    by_frame: Array,
) -> Array:
    """The terms of one state under the published energy.

    Parameters
    ----------
    problem, camera, items, placements, sizes, latent, joints
        See :func:`imapper_prob.models.compiled.evaluate`.
    by_frame : (T, 4) float
        Out: reprojection, occlusion, smoothness and motion of each frame, unweighted; no
        occlusion where that has no weight.

    Returns
    -------
    (9,) float
        Values of ``PAPER_TERMS``, nats; the first is -inf outside the support.
    """
    terms = np.zeros(len(PAPER_TERMS))
    session = open_session(problem, len(items))
    memory = session.memory
    prior = place(
        problem, memory, -1, camera, latent, camera, items, placements, sizes, latent
    )  # fmt: skip
    if prior == -math.inf:
        terms[CAMERA] = prior
        return terms
    for i in (CAMERA, LAYOUT, PLACEMENT, PATH):
        terms[i] = memory.terms[i]
    pose_joints(problem, memory, len(items), list_moved(memory), camera)
    copy_joints(memory, joints)
    if problem.likelihood == 0.0:
        return terms
    boxes, turns, owner, yaws = place_boxes(problem, camera, items, placements, sizes)
    by_frame[:] = 0.0
    nats = problem.paper_nats
    _reprojection(problem, camera, joints, by_frame[:, 0])
    if nats[1] > 0.0:
        _occlusion(problem, camera, joints, boxes, turns, by_frame[:, 1])
    _smoothness(problem, joints, by_frame[:, 2])
    for t in range(len(joints)):
        by_frame[t, 3] = depth_of_motion(joints, t, boxes, turns)
    for t in range(len(joints)):
        for i in range(3):
            terms[4 + i] -= nats[i] * by_frame[t, i]
        terms[8] -= nats[4] * by_frame[t, 3]
    if nats[3] > 0.0:
        terms[7] = -nats[3] * overlaps(boxes, turns, owner, yaws, problem.merge_angle)
    return terms
