"""A motion does not jump: the paper's L_s for every joint, compiled.

The pelvis walks from frame to frame (:mod:`imapper_prob.models.chain`). The other joints are
held where motions of different origin meet, a frame's own pose and a scenelet or two
scenelets: between frames of one scenelet, or of one track, how they move is given.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma

from imapper_prob.models.calibrated import calibrated
from imapper_prob.models.jit import compiled
from imapper_prob.models.skeleton import N_JOINTS, PELV

__all__ = ["DOF", "USUAL_JUMP", "pose_jump"]

DOF: Final = calibrated("joints.jump_dof")
"""Degrees of freedom of a joint's step, from a frame's own pose to a scenelet and back."""

USUAL_JUMP: Final = float(
    (N_JOINTS - 1) * (DOF + 3) / 2 * (digamma((DOF + 3) / 2) - digamma(DOF / 2))
)
"""Nats that all joints but the pelvis cost on average when their steps are as they should be,
so that a scenelet that joins the motion as true ones do neither gains nor loses by that."""


@compiled
def pose_jump(joints: NDArray[np.float64], one: int, other: int, scale: float) -> float:
    """What the change of pose between two frames costs, nats of independent joints.

    Minus the log of a trivariate Student-t density of every joint's step relative to the
    pelvis, less what it is on average.

    Parameters
    ----------
    joints : (R, 16, 3) float
        World, metres.
    one, other : int
        Rows of the two frames.
    scale : float
        Metres an axis.
    """
    product = 1.0
    for j in range(16):
        squared = 0.0
        for c in range(3):
            before = joints[one, j, c] - joints[one, PELV, c]
            step = joints[other, j, c] - joints[other, PELV, c] - before
            squared += step * step
        # Far from overflow: a body of ten metres makes each of the sixteen 10^4.
        product *= 1.0 + squared / (DOF * scale * scale)
    return 0.5 * (DOF + 3.0) * math.log(product) - USUAL_JUMP
