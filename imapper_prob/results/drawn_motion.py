"""The motion of one draw, limbs included.

A scenelet says how somebody moves near such furniture, not how this person moved: the posterior
lets detections scatter about its pose by the pose tolerance (``docs/model.md`` 11). What is drawn
of scene and path leaves that out, and so would be far too sure of hands and feet.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.posterior import State, motion
from imapper_prob.models.problem import Problem
from imapper_prob.models.skeleton import PELV

__all__ = ["drawn_motion"]

Array = NDArray[np.float64]


def drawn_motion(rng: np.random.Generator, problem: Problem, state: State) -> Array:
    """(T, 16, 3) joints in the state's world, metres: the pose, and how the person's differs.

    Each joint about the pelvis is off by a stationary chain of the pose tolerance, which forgets
    itself in the time over which frames repeat their errors.
    """
    joints = motion(problem, state)
    memory = np.exp(-min(1.0, problem.frame_weight))
    steps = rng.standard_normal(joints.shape)
    steps[1:] *= np.sqrt(1.0 - memory**2)
    off = steps
    for t in range(1, len(off)):
        off[t] += memory * off[t - 1]
    off[:, PELV] = 0.0
    return joints + problem.pose_tolerance * off
