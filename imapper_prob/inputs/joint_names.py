"""The sixteen joints under the names that other programs give them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.errors import InputError
from imapper_prob.models.skeleton import (
    HEAD,
    JOINTS,
    LHIP,
    LSHO,
    N_JOINTS,
    NECK,
    PELV,
    RHIP,
    RSHO,
    THRX,
)

__all__ = ["joints_by_name"]

Array = NDArray[np.float64]

_LIMBS: Final = {
    "ANK": ("ank", "ankle", "foot"),
    "KNE": ("kne", "knee", "leg", "lowerleg", "shin"),
    "HIP": ("hip", "upleg", "upperleg", "thigh"),
    "WRI": ("wri", "wrist", "hand"),
    "ELB": ("elb", "elbow", "forearm", "lowerarm"),
    "SHO": ("sho", "shoulder", "arm", "upperarm"),
}
"""Names of joints, and of the bones that begin at them, as motion capture files have them.
The first that is there counts: a foot is an ankle only where there is no ankle."""

_MIDDLE: Final = {
    "PELV": ("pelv", "pelvis", "midhip", "root", "hips", "hip", "spinebase"),
    "THRX": ("thrx", "thorax", "spineshoulder", "upperchest", "chest", "spine3", "spine2"),
    "NECK": ("neck",),
    "HEAD": ("head", "headtop", "topofhead"),
}

_MIDDLE_OF: Final = {THRX: (RSHO, LSHO), PELV: (RHIP, LHIP), NECK: (THRX, HEAD)}
"""Joints that lie between two others and need not be there, in the order they are made."""


def joints_by_name(positions: ArrayLike, names: Sequence[str]) -> Array:
    """The sixteen joints out of any others, by name.

    Parameters
    ----------
    positions : (T, J, 3) float
        Joints of some other skeleton.
    names : sequence of J str
        ``"right_ankle"``, ``"RAnkle"``, ``"AnkleRight"``, ``"mixamorig:RightFoot"``, …; case
        and punctuation do not matter. Joints that are not needed are left out.

    Returns
    -------
    (T, 16, 3) float
        Thorax, pelvis and neck are put half-way between shoulders, hips, and thorax and head
        where they are not there.

    Raises
    ------
    InputError
        A joint is missing, or two have the same name.
    """
    positions = np.asarray(positions, float)
    plain = [re.sub(r"[^a-z0-9]", "", name.lower().rpartition(":")[2]) for name in names]
    if len(set(plain)) != len(plain):
        twice = next(name for name, p in zip(names, plain, strict=True) if plain.count(p) > 1)
        raise InputError(f"joint name {twice!r} occurs twice")
    column = {name: i for i, name in enumerate(plain)}
    joints = np.full((len(positions), N_JOINTS, 3), np.nan)
    missing = []
    for index, joint in enumerate(JOINTS):
        found = [column[name] for name in _synonyms(joint) if name in column]
        if found:
            joints[:, index] = positions[:, found[0]]
        else:
            missing.append(index)
    for index, (one, other) in _MIDDLE_OF.items():
        if index in missing:
            joints[:, index] = (joints[:, one] + joints[:, other]) / 2
    missing = [index for index in missing if index not in _MIDDLE_OF]
    if missing:
        raise InputError(
            f"no joint called {', '.join(JOINTS[i] for i in missing)} or the like among "
            f"{', '.join(names)}"
        )
    return joints


def _synonyms(joint: str) -> list[str]:
    """All plain names of one of the sixteen joints, the best first."""
    if joint in _MIDDLE:
        return list(_MIDDLE[joint])
    sides = ("r", "right") if joint[0] == "R" else ("l", "left")
    parts = _LIMBS[joint[1:]]
    return [name for part in parts for side in sides for name in (side + part, part + side)]
