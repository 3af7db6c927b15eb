"""The body as a tree of fourteen bones rooted at the pelvis.

The neck, which no detector reports, is put half-way between thorax and head.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models import skeleton as sk

__all__ = ["ANCESTORS", "LENGTHS", "N_BONES", "SPREADS", "TREE", "bones_of", "joints_of"]

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


def _of_bones(segments: Mapping[tuple[int, int], float], *, half: float) -> Array:
    """(14,) of the segment that each bone is, or is half of, times ``half`` then."""
    girdles = {sk.PELV: (sk.RHIP, sk.LHIP), sk.THRX: (sk.RSHO, sk.LSHO)}
    result = []
    for parent, child in TREE:
        # The pelvis lies midway between the hips, the thorax between the shoulders.
        whole = [s for s in ((child, parent), (parent, child)) if s in segments]
        result.append(segments[whole[0]] if whole else half * segments[girdles[parent]])
    return np.array(result)


LENGTHS: Final[Array] = _of_bones(sk.BONE_LENGTHS, half=0.5)
"""(14,) lengths in metres of the bones of the reference body."""
SPREADS: Final[Array] = _of_bones(sk.LENGTH_SPREADS, half=1.0)
"""(14,) standard deviations of their logs."""


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
