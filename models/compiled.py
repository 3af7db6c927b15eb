"""The log-posterior of a scene, compiled.

    log pi(s) = log p(phi) + log p(X) + log p(P, G | X) + log p(u, c | s)
                - free poses - E_s - E_c - E_m - E_g - E_u

over a state s = (phi, X, P, b, z): camera and body scale phi, the assignment X of scenelets
to start frames, their placements P and sizes b, and standard normal numbers z that say which
path G is drawn where no scenelet lies (see :mod:`imapper_prob.models.kernels.path`). The density
is with respect to d phi dP db and the normal law of z, so that it has the same dimension of z
whatever the number of scenelets.

An evaluation is a change (:mod:`imapper_prob.models.kernels.change`) that has nothing to go on
from.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled
from imapper_prob.models.kernels.change import change
from imapper_prob.models.kernels.memory import RIGHT, WRONG
from imapper_prob.models.kernels.posing import copy_joints, list_moved, pose_joints
from imapper_prob.models.kernels.session import open_session
from imapper_prob.models.problem import Problem
from imapper_prob.models.terms import CAMERA

__all__ = ["evaluate"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


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
        Out: the motion in the world, metres; left as it is outside the support. Empty where nobody
        asks for it, as the next.
    by_frame : (T, 2) float
        Out: log-likelihood of each frame's detections, as they are and with left and right
        swapped, nats, unweighted; left as it is outside the support, and where the likelihood is
        switched off.

    Returns
    -------
    (11,) float
        Values of :data:`imapper_prob.models.terms.TERMS`; the first is -inf outside the support.
    """
    session = open_session(problem, len(items))
    prior, _ = change(session, -1, camera, latent, camera, items, placements, sizes, latent)
    memory = session.memory
    terms = memory.terms
    if prior == -math.inf:
        terms[:] = 0.0
        terms[CAMERA] = -math.inf
        return terms
    if problem.likelihood == 0.0:
        pose_joints(problem, memory, len(items), list_moved(memory), camera)
    else:
        votes, rows = memory.votes, memory.sum_row
        for t in range(len(by_frame)):
            by_frame[t, 0], by_frame[t, 1] = votes[rows[t], RIGHT], votes[rows[t], WRONG]
    copy_joints(memory, joints)
    return terms
