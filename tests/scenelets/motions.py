"""Small motions and furniture with known descriptors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import Cuboid, Placement, SceneObject
from imapper_prob.models.skeleton import (
    BONE_LENGTHS,
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
    knee_height = 0.08 + BONE_LENGTHS[RANK, RKNE]
    hips = knee_height + BONE_LENGTHS[RKNE, RHIP]
    chest = hips + BONE_LENGTHS[PELV, THRX]
    crown = chest + BONE_LENGTHS[THRX, HEAD]
    pose[PELV], pose[THRX], pose[NECK], pose[HEAD] = (
        (0, 0, hips), (0, 0, chest), (0, 0, (chest + crown) / 2), (0, 0, crown)
    )  # fmt: skip
    beside, shoulders = BONE_LENGTHS[RHIP, LHIP] / 2, BONE_LENGTHS[RSHO, LSHO] / 2
    elbows = chest - BONE_LENGTHS[RSHO, RELB]
    wrists = elbows - BONE_LENGTHS[RELB, RWRI]
    for side, hip, knee, ankle, shoulder, elbow, wrist in (
        (1, RHIP, RKNE, RANK, RSHO, RELB, RWRI),
        (-1, LHIP, LKNE, LANK, LSHO, LELB, LWRI),
    ):
        pose[hip], pose[knee], pose[ankle] = (
            (beside * side, 0, hips), (beside * side, 0, knee_height), (beside * side, 0, 0.08)
        )  # fmt: skip
        pose[shoulder], pose[elbow], pose[wrist] = (
            (shoulders * side, 0, chest), (shoulders * side, 0, elbows),
            (shoulders * side, 0, wrists),
        )  # fmt: skip
    return np.repeat(pose[None], n_frames, axis=0)


def box(
    label: str, *, x: float = 0.0, y: float = 0.0, yaw: float = 0.0, side: float = 0.5
) -> SceneObject:
    """A cube of furniture on the floor."""
    cube = Cuboid("box", np.array([0.0, 0.0, side / 2]), np.full(3, side))
    return SceneObject(label, Placement(x, y, yaw), (cube,))
