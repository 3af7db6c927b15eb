"""A motion does not jump: the paper's L_s for every joint, compiled.

The pelvis walks from frame to frame (:mod:`imapper_prob.models.kernels.path`). The other joints are
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
from imapper_prob.models.jit import inlined
from imapper_prob.models.skeleton import N_JOINTS, PELV

__all__ = ["DOF", "USUAL_JUMP", "pose_jump"]

DOF: Final = calibrated("joints.jump_dof")
"""Degrees of freedom of a joint's step, from a frame's own pose to a scenelet and back."""

USUAL_JUMP: Final = float(
    (N_JOINTS - 1) * (DOF + 3) / 2 * (digamma((DOF + 3) / 2) - digamma(DOF / 2))
)
"""Nats that all joints but the pelvis cost on average when their steps are as they should be,
so that a scenelet that joins the motion as true ones do neither gains nor loses by that."""


@inlined
def pose_jump(joints: NDArray[np.float64], one: int, other: int, scale: float) -> float:
    """What the change of pose between two frames costs, nats of independent joints.

    Minus the log of a trivariate Student-t density of every joint's step relative to the
    pelvis, less what it is on average.

    Parameters
    ----------
    joints : (R, 3, 16) float
        World, metres.
    one, other : int
        Rows of the two frames.
    scale : float
        Metres an axis, of a body as large as the person's: were it not to grow with the body, a
        smaller one would seem to move more smoothly.
    """
    x = joints[other, 0, PELV] - joints[one, 0, PELV]
    y = joints[other, 1, PELV] - joints[one, 1, PELV]
    z = joints[other, 2, PELV] - joints[one, 2, PELV]
    sharpness = 1.0 / (DOF * scale * scale)
    product = 1.0
    for j in range(16):
        dx = joints[other, 0, j] - joints[one, 0, j] - x
        dy = joints[other, 1, j] - joints[one, 1, j] - y
        dz = joints[other, 2, j] - joints[one, 2, j] - z
        # Far from overflow: a body of ten metres makes each of the sixteen 10^4.
        product *= 1.0 + (dx * dx + dy * dy + dz * dz) * sharpness
    return 0.5 * (DOF + 3.0) * math.log(product) - USUAL_JUMP
