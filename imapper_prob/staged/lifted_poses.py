"""Poses from a lifter, brought to the reference body and filled in where they are missing.

A lifter sees one frame at a time: its bone directions and proportions are useful, its scale
is not, and some frames have none. A body is a tree of fourteen bones rooted at the pelvis;
the neck, which no detector reports, is put half-way between thorax and head.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models import skeleton as sk
from imapper_prob.models.scene import Track

__all__ = [
    "ANCESTORS",
    "LENGTHS",
    "N_BONES",
    "TREE",
    "LiftedBody",
    "bones_of",
    "fill_directions",
    "joints_of",
    "lifted_body",
]

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

_LEFT, _RIGHT, _UP, _DOWN = (-1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
_UPRIGHT: Final[Array] = np.array(
    [_LEFT, _DOWN, _DOWN, _RIGHT, _DOWN, _DOWN, _UP, _UP,
     _LEFT, _DOWN, _DOWN, _RIGHT, _DOWN, _DOWN]
)  # fmt: skip
"""(14, 3) directions of somebody who stands and looks at the camera, left being the image's."""

_LEGS: Final = tuple(
    TREE.index(bone)
    for bone in (
        (sk.RHIP, sk.RKNE), (sk.RKNE, sk.RANK), (sk.LHIP, sk.LKNE), (sk.LKNE, sk.LANK)
    )
)  # fmt: skip
_TWINS: Final = tuple(TREE.index((sk.MIRROR[p], sk.MIRROR[c])) for p, c in TREE)
_CONFIDENT: Final = 0.5
_ENOUGH_FRAMES: Final = 10


@dataclass(frozen=True)
class LiftedBody:
    """What the lifter says, at the reference stature.

    Parameters
    ----------
    lengths : (14,) float
        Bone lengths in metres, the same on both sides.
    directions : (T, 14, 3) float
        Unit vectors in camera axes, filled in where ``known`` is false.
    known : (T,) bool
        Frames whose directions are their own.
    """

    lengths: Array
    directions: Array
    known: NDArray[np.bool_]

    @property
    def bones(self) -> Array:
        """(T, 14, 3) bone vectors in metres, camera axes."""
        return self.lengths[:, None] * self.directions


def lifted_body(track: Track, trusted: NDArray[np.bool_]) -> LiftedBody:
    """One body of reference stature for all ``trusted`` (T,) frames of a track.

    The scale is that of the legs. Lifters disagree on where a trunk ends (the torso of four
    benchmark clips measures .39 or .49 m) and make arms short, but hip, knee and ankle
    are the same joints to all: thigh and shin together against the reference gave factors
    of 1.05 to 1.10 on those clips, where the true paths want 1.01 to 1.12 in the same order.
    For the same reason the pelvis is put midway between the hips.

    Without a single trusted frame the person stands upright and faces the camera, which is
    as good a start as any.
    """
    known = np.asarray(trusted, bool) & track.has_pose
    if not known.any():
        directions = np.broadcast_to(_UPRIGHT, (len(known), N_BONES, 3)).copy()
        return LiftedBody(LENGTHS, directions, known)
    poses = np.where(known[:, None, None], track.poses, 0.0)
    poses[:, sk.PELV] = (poses[:, sk.RHIP] + poses[:, sk.LHIP]) / 2
    bones = bones_of(poses)
    norms = np.linalg.norm(bones, axis=-1)
    legs = [sk.RHIP, sk.RKNE, sk.RANK, sk.LHIP, sk.LKNE, sk.LANK]
    sure = known & (track.confidences[:, legs] >= _CONFIDENT).all(1)
    frames = sure if sure.sum() >= _ENOUGH_FRAMES else known
    lengths = np.median(norms[frames], axis=0)
    lengths = (lengths + lengths[list(_TWINS)]) / 2
    lengths = np.maximum(lengths * LENGTHS[list(_LEGS)].sum() / lengths[list(_LEGS)].sum(), 0.02)
    usable = np.where(norms[..., None] > 0, bones / np.maximum(norms, 1e-9)[..., None], _UPRIGHT)
    return LiftedBody(lengths, fill_directions(usable, known), known)


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


def fill_directions(directions: ArrayLike, known: ArrayLike) -> Array:
    """Turn each bone at a constant rate from one known frame to the next.

    Linear interpolation of joints would shorten the bones of a person who turns round.

    Parameters
    ----------
    directions : (T, K, 3) float
        Unit vectors; frames that are not known are ignored.
    known : (T,) bool
        At least one frame must be known.

    Returns
    -------
    (T, K, 3) float
        Unit vectors; before the first and after the last known frame these are held.
    """
    directions = np.asarray(directions, float)
    frames = np.flatnonzero(known)
    t = np.arange(len(directions))
    after = np.searchsorted(frames, t, side="left").clip(0, len(frames) - 1)
    before = (np.searchsorted(frames, t, side="right") - 1).clip(0)
    left, right = frames[before], frames[after]
    fraction = ((t - left) / np.maximum(right - left, 1)).clip(0, 1)[:, None, None]
    a, b = directions[left], directions[right]
    angle = np.arccos(np.clip((a * b).sum(-1, keepdims=True), -1, 1))
    # Below this angle, and at half a turn, the weights of a slerp are 0/0: mix linearly there.
    safe = (angle > 1e-4) & (angle < np.pi - 1e-4)
    sine = np.where(safe, np.sin(angle), 1.0)
    weight_a = np.where(safe, np.sin((1 - fraction) * angle) / sine, 1 - fraction)
    weight_b = np.where(safe, np.sin(fraction * angle) / sine, fraction)
    mixed = weight_a * a + weight_b * b
    norm = np.linalg.norm(mixed, axis=-1, keepdims=True)
    result: Array = np.where(norm > 1e-6, mixed / np.maximum(norm, 1e-6), a)
    return result
