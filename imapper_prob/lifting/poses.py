"""The poses of a library, each once, whichever way it faces."""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.pose import facing
from imapper_prob.models.scenelet import Library
from imapper_prob.models.skeleton import MIRROR, PELV
from imapper_prob.scenelets.library import built_in_library

__all__ = ["built_in_poses", "distinct_poses"]

Array = NDArray[np.float64]

_APART: Final = 0.06
"""Metres of root-mean-square joint distance below which two poses are one."""


@cache
def built_in_poses() -> Array:
    """Those of the built-in library; found once a process."""
    return distinct_poses(built_in_library())


def distinct_poses(library: Library, *, apart: float = _APART) -> Array:
    """Poses that are not too like each other, and their mirror images.

    Parameters
    ----------
    library : Library
    apart : float
        Root-mean-square joint distance in metres that they keep.

    Returns
    -------
    (K, 16, 3) float
        Joints relative to the pelvis, metres, z up, facing +y; the first half and the second
        are mirror images of each other.
    """
    joints = np.concatenate([scenelet.joints for scenelet in library])
    poses = joints - joints[:, PELV, None]
    yaw = facing(poses)
    cos, sin = np.cos(-yaw), np.sin(-yaw)
    x, y = poses[..., 0], poses[..., 1]
    poses[..., 0], poses[..., 1] = (
        cos[:, None] * x - sin[:, None] * y,
        sin[:, None] * x + cos[:, None] * y,
    )
    # Every pose is its own neighbour at first; whoever is chosen takes its neighbours away.
    flat = poses.reshape(len(poses), -1)
    left = np.ones(len(flat), bool)
    chosen = []
    for row in range(len(flat)):
        if left[row]:
            chosen.append(row)
            squared = ((flat[left] - flat[row]) ** 2).sum(1)
            left[np.flatnonzero(left)[squared < 16 * apart**2]] = False
    kept = poses[chosen]
    mirrored = kept[:, list(MIRROR)] * (-1, 1, 1)
    result: Array = np.concatenate([kept, mirrored])
    return result
