"""Map other programs' keypoints to the sixteen joints, by name.

Programs number their keypoints differently, so only names identify them. :data:`KEYPOINT_SETS` has
the names of each set in file order. ``docs/reference/inputs.md`` shows the same table.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.errors import InputError
from imapper_prob.models.skeleton import (
    DETECTED,
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

__all__ = ["KEYPOINT_SETS", "joints_by_name", "not_reported", "sixteen"]

Array = NDArray[np.float64]
_LIMB_PARTS: Final = {
    "ANK": ("ank", "ankle", "foot"),
    "KNE": ("kne", "knee", "leg", "lowerleg", "shin"),
    "HIP": ("hip", "upleg", "upperleg", "thigh"),
    "WRI": ("wri", "wrist", "hand"),
    "ELB": ("elb", "elbow", "forearm", "lowerarm"),
    "SHO": ("sho", "shoulder", "arm", "upperarm"),
}
"""Names of joints, and of the bones that begin at them, in motion capture files. The first name
that is present is used: a foot stands for an ankle only if there is no ankle."""
_MIDDLE: Final = {
    "PELV": ("pelv", "pelvis", "midhip", "root", "hips", "hip", "spinebase"),
    "THRX": ("thrx", "thorax", "spineshoulder", "upperchest", "chest", "spine3", "spine2"),
    "NECK": ("neck",),
    "HEAD": ("head", "headtop", "topofhead"),
}
_MIDDLE_OF: Final = {THRX: (RSHO, LSHO), PELV: (RHIP, LHIP), NECK: (THRX, HEAD)}
"""Joints that may be computed as the midpoint of two others, in order of computation."""


def joints_by_name(positions: ArrayLike, names: Sequence[str]) -> Array:
    """Select the sixteen joints from the joints of another skeleton, by name.

    Parameters
    ----------
    positions : (T, J, 3) float
        Joints of the other skeleton.
    names : sequence of J str
        ``"right_ankle"``, ``"RAnkle"``, ``"AnkleRight"``, ``"mixamorig:RightFoot"``, …; case
        and punctuation are ignored. Joints that are not needed are left out.

    Returns
    -------
    (T, 16, 3) float
        Missing thorax, pelvis and neck are midpoints: of the shoulders, of the hips, and of thorax
        and head.

    Raises
    ------
    InputError
        A joint is missing, or a name occurs twice.
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
    """All normalised names of one of the sixteen joints, in order of preference."""
    if joint in _MIDDLE:
        return list(_MIDDLE[joint])
    sides = ("r", "right") if joint[0] == "R" else ("l", "left")
    parts = _LIMB_PARTS[joint[1:]]
    return [name for part in parts for side in sides for name in (side + part, part + side)]


# ------------------------------------------------------------------------------------------------
# Keypoint sets of 2D detectors.

_COCO_17: Final = (
    "nose", "left_eye", "right_eye", "left_ear", "right_ear", "left_shoulder", "right_shoulder",
    "left_elbow", "right_elbow", "left_wrist", "right_wrist", "left_hip", "right_hip",
    "left_knee", "right_knee", "left_ankle", "right_ankle",
)  # fmt: skip
_LEFT_THEN_RIGHT_FOOT: Final = (
    "left_big_toe", "left_small_toe", "left_heel", "right_big_toe", "right_small_toe",
    "right_heel",
)  # fmt: skip
KEYPOINT_SETS: Final[dict[str, tuple[str, ...]]] = {
    "body_25": (
        "nose", "neck", "right_shoulder", "right_elbow", "right_wrist", "left_shoulder",
        "left_elbow", "left_wrist", "mid_hip", "right_hip", "right_knee", "right_ankle",
        "left_hip", "left_knee", "left_ankle", "right_eye", "left_eye", "right_ear", "left_ear",
        *_LEFT_THEN_RIGHT_FOOT,
    ),
    "body_25b": (*_COCO_17, "upper_neck", "head_top", *_LEFT_THEN_RIGHT_FOOT),
    "coco_18": (
        "nose", "neck", "right_shoulder", "right_elbow", "right_wrist", "left_shoulder",
        "left_elbow", "left_wrist", "right_hip", "right_knee", "right_ankle", "left_hip",
        "left_knee", "left_ankle", "right_eye", "left_eye", "right_ear", "left_ear",
    ),
    "coco_17": _COCO_17,
    "halpe_26": (
        *_COCO_17, "head_top", "neck", "mid_hip", "left_big_toe", "right_big_toe",
        "left_small_toe", "right_small_toe", "left_heel", "right_heel",
    ),
    "mediapipe_33": (
        "nose", "left_eye_inner", "left_eye", "left_eye_outer", "right_eye_inner", "right_eye",
        "right_eye_outer", "left_ear", "right_ear", "mouth_left", "mouth_right",
        "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist",
        "right_wrist", "left_pinky", "right_pinky", "left_index", "right_index", "left_thumb",
        "right_thumb", "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle",
        "right_ankle", "left_heel", "right_heel", "left_foot_index", "right_foot_index",
    ),
}  # fmt: skip
"""Names of each set in file order; left and right are the person's own."""
_LIMB_JOINTS: Final = {
    "ANK": "ankle", "KNE": "knee", "HIP": "hip", "WRI": "wrist", "ELB": "elbow",
    "SHO": "shoulder",
}  # fmt: skip
_FOUND_AS: Final[dict[int, tuple[tuple[str, ...], ...]]] = {
    **{
        index: (({"R": "right", "L": "left"}[joint[0]] + "_" + _LIMB_JOINTS[joint[1:]],),)
        for index, joint in enumerate(JOINTS)
        if joint[1:] in _LIMB_JOINTS
    },
    PELV: (("left_hip", "right_hip"), ("mid_hip",)),
    THRX: (("neck",), ("left_shoulder", "right_shoulder")),
    HEAD: (
        ("left_ear", "right_ear"), ("left_ear",), ("right_ear",), ("left_eye", "right_eye"),
        ("nose",),
    ),
}  # fmt: skip
"""For each of the sixteen joints the keypoints that may stand for it, in order of preference;
several names mean their midpoint. HEAD is the middle of the head, not the crown. The upper neck of
BODY_25B is too high for THRX, which is level with the shoulders."""
_LIMB_ENDS: Final = frozenset(
    ways[0][0] for index, ways in _FOUND_AS.items() if index not in (PELV, THRX, HEAD)
)


def sixteen(points: ArrayLike, scores: ArrayLike, names: Sequence[str]) -> tuple[Array, Array]:
    """Select the sixteen joints from a set of keypoints, by name.

    Parameters
    ----------
    points : (N, J, D) float
        Keypoints, in 2D or 3D.
    scores : (N, J) float
        The detector's score of each point, in its own units. A point is missing if its score is not
        above 0 or its position is not finite.
    names : sequence of J str
        As in :data:`KEYPOINT_SETS`.

    Returns
    -------
    points : (N, 16, D) float
        NaN where missing.
    scores : (N, 16) float
        The least score of the points that a joint is made of. It is 0 where missing, and for joints
        computed from others of the sixteen, because those add no evidence.
    """
    points = np.asarray(points, float)
    scores = np.asarray(scores, float)
    there = (scores > 0) & np.isfinite(points).all(-1)
    found = np.full((len(points), N_JOINTS, points.shape[-1]), np.nan)
    sure = np.zeros((len(points), N_JOINTS))
    column = {name: i for i, name in enumerate(names)}
    for joint, ways in _FOUND_AS.items():
        for way in ways:
            if not all(name in column for name in way):
                continue
            columns = [column[name] for name in way]
            usable = there[:, columns].all(1) & ~np.isfinite(found[:, joint]).all(-1)
            found[usable, joint] = points[usable][:, columns].mean(1)
            if _is_evidence(joint, way):
                sure[usable, joint] = scores[usable][:, columns].min(1)
    found[:, NECK] = (found[:, THRX] + found[:, HEAD]) / 2
    return found, sure


def _is_evidence(joint: int, way: tuple[str, ...]) -> bool:
    return joint in DETECTED and (len(way) == 1 or not set(way) <= _LIMB_ENDS)


def not_reported(names: Sequence[str]) -> tuple[str, ...]:
    """The detected joints that a set of keypoints never contains.

    Parameters
    ----------
    names : sequence of str
        Keypoint names of the set.

    Returns
    -------
    tuple of str
    """
    own = set(names)
    return tuple(
        JOINTS[joint]
        for joint in DETECTED
        if not any(set(way) <= own and _is_evidence(joint, way) for way in _FOUND_AS[joint])
    )
