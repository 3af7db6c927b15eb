"""The body as a tree of fourteen bones rooted at the pelvis.

The neck, which no detector reports, is put half-way between thorax and head.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models import skeleton as sk

__all__ = ["ANCESTORS", "LENGTHS", "N_BONES", "TREE", "bones_of", "joints_of"]

Array = NDArray[np.float64]

TREE: Final = (
    (sk.PELV, sk.RHIP), (sk.RHIP, sk.RKNE), (sk.RKNE, sk.RANK),
    (sk.PELV, sk.LHIP), (sk.LHIP, sk.LKNE), (sk.LKNE, sk.LANK),
    (sk.PELV, sk.THRX), (sk.THRX, sk.HEAD),
    (sk.THRX, sk.RSHO), (sk.RSHO, sk.RELB), (sk.RELB, sk.RWRI),
    (sk.THRX, sk.LSHO), (sk.LSHO, sk.LELB), (sk.LELB, sk.LWRI),
)  # fmt: skip
"""Bones as (parent, child), every parent before its children."""

N_BONES: Final = len(TREE)


def _length(parent: int, child: int) -> float:
    if (child, parent) in sk.BONE_LENGTHS:
        return sk.BONE_LENGTHS[child, parent]
    if (parent, child) in sk.BONE_LENGTHS:
        return sk.BONE_LENGTHS[parent, child]
    # Half a girdle: the pelvis lies midway between the hips, the thorax between the shoulders.
    width = {sk.PELV: (sk.RHIP, sk.LHIP), sk.THRX: (sk.RSHO, sk.LSHO)}[parent]
    return sk.BONE_LENGTHS[width] / 2


LENGTHS: Final[Array] = np.array([_length(*bone) for bone in TREE])
"""(14,) lengths in metres of the bones of the reference body."""


def _ancestors() -> Array:
    matrix = np.zeros((sk.N_JOINTS, N_BONES))
    for k, (parent, child) in enumerate(TREE):
        matrix[child] = matrix[parent]
        matrix[child, k] = 1.0
    matrix[sk.NECK] = (matrix[sk.THRX] + matrix[sk.HEAD]) / 2
    return matrix


ANCESTORS: Final[Array] = _ancestors()
"""(16, 14): joints relative to the pelvis are ``ANCESTORS @ bones``."""


def bones_of(poses: ArrayLike) -> Array:
    """(..., 16, 3) joints to (..., 14, 3) bone vectors from parent to child."""
    poses = np.asarray(poses, float)
    parents, children = np.transpose(TREE)
    result: Array = poses[..., children, :] - poses[..., parents, :]
    return result


def joints_of(bones: ArrayLike) -> Array:
    """(..., 14, 3) bone vectors to (..., 16, 3) joints relative to the pelvis."""
    result: Array = ANCESTORS @ np.asarray(bones, float)
    return result
