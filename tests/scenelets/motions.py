"""Small motions and furniture with known descriptors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import Cuboid, Placement, SceneObject
from imapper_prob.models.skeleton import (
    HEAD,
    LANK,
    LELB,
    LHIP,
    LKNE,
    LSHO,
    LWRI,
    N_JOINTS,
    NECK,
    PELV,
    RANK,
    RELB,
    RHIP,
    RKNE,
    RSHO,
    RWRI,
    THRX,
)

__all__ = ["box", "standing"]


def standing(n_frames: int = 17) -> NDArray[np.float64]:
    """(n, 16, 3) somebody who stands upright with hanging arms and does not move."""
    pose = np.zeros((N_JOINTS, 3))
    pose[PELV], pose[THRX], pose[NECK], pose[HEAD] = (
        (0, 0, 0.90), (0, 0, 1.39), (0, 0, 1.50), (0, 0, 1.63)
    )  # fmt: skip
    for side, hip, knee, ankle, shoulder, elbow, wrist in (
        (1, RHIP, RKNE, RANK, RSHO, RELB, RWRI),
        (-1, LHIP, LKNE, LANK, LSHO, LELB, LWRI),
    ):
        pose[hip], pose[knee], pose[ankle] = (
            (0.12 * side, 0, 0.90), (0.12 * side, 0, 0.48), (0.12 * side, 0, 0.08)
        )  # fmt: skip
        pose[shoulder], pose[elbow], pose[wrist] = (
            (0.16 * side, 0, 1.39), (0.16 * side, 0, 1.10), (0.16 * side, 0, 0.85)
        )  # fmt: skip
    return np.repeat(pose[None], n_frames, axis=0)


def box(
    label: str, *, x: float = 0.0, y: float = 0.0, yaw: float = 0.0, side: float = 0.5
) -> SceneObject:
    """A cube of furniture on the floor."""
    cube = Cuboid("box", np.array([0.0, 0.0, side / 2]), np.full(3, side))
    return SceneObject(label, Placement(x, y, yaw), (cube,))
