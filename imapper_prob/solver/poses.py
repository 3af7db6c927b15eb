"""Lifted poses as bone vectors: reject implausible ones, and fill in missing ones.

A lifter processes one frame at a time. The directions of its bones are useful. Its scale and
proportions are not, because they are those of its training data, and some frames have no pose. The
neck, which no detector reports, is put midway between thorax and head.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation, Slerp

from imapper_prob.models import skeleton as sk
from imapper_prob.models.camera import Camera
from imapper_prob.models.scene import Track
from imapper_prob.models.text import brief

__all__ = [
    "ANCESTORS",
    "LENGTHS",
    "N_BONES",
    "SPREADS",
    "TREE",
    "FrameTable",
    "LiftedBody",
    "PoseSource",
    "bones_of",
    "fill_directions",
    "fill_poses",
    "implausible_poses",
    "joints_of",
    "lifted_body",
    "torso_axes",
]

Array = NDArray[np.float64]
TREE: Final = (
    (sk.PELV, sk.RHIP), (sk.RHIP, sk.RKNE), (sk.RKNE, sk.RANK),
    (sk.PELV, sk.LHIP), (sk.LHIP, sk.LKNE), (sk.LKNE, sk.LANK),
    (sk.PELV, sk.THRX), (sk.THRX, sk.HEAD),
    (sk.THRX, sk.RSHO), (sk.RSHO, sk.RELB), (sk.RELB, sk.RWRI),
    (sk.THRX, sk.LSHO), (sk.LSHO, sk.LELB), (sk.LELB, sk.LWRI),
)  # fmt: skip
"""Bones as (parent, child); each parent comes before its children."""
N_BONES: Final = len(TREE)


def _of_bones(segments: Mapping[tuple[int, int], float], *, half: float) -> Array:
    """(14,) values by bone from values by segment; ``half`` scales those of half a segment."""
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
"""(16, 14) matrix: joints relative to the pelvis are ``ANCESTORS @ bones``."""


def bones_of(poses: ArrayLike) -> Array:
    """Convert poses to bone vectors, from parent to child.

    Parameters
    ----------
    poses : (..., 16, 3) float
        Metres.

    Returns
    -------
    (..., 14, 3) float
    """
    poses = np.asarray(poses, float)
    parents, children = np.transpose(TREE)
    result: Array = poses[..., children, :] - poses[..., parents, :]
    return result


def joints_of(bones: ArrayLike) -> Array:
    """Convert bone vectors to joints relative to the pelvis.

    Parameters
    ----------
    bones : (..., 14, 3) float
        Metres.

    Returns
    -------
    (..., 16, 3) float
    """
    result: Array = ANCESTORS @ np.asarray(bones, float)
    return result


# ------------------------------------------------------------------------------------------------
# Implausible poses.
#
# Lifters mostly return bodies like those of their training data, but where a body is hidden, some
# collapse it, turn it upside down or break its knees. Detections cannot always tell, because there
# are none of hidden joints.

_PROPORTIONS: Final = 0.7
"""Limit of the root mean square log ratio of bone lengths to the person's own, without scale: about
a factor of two. i3DB's lifter is below .62 in 99 of 100 frames."""
_HEAD_DOWN: Final = -0.5
"""Limit of the upward component of the trunk's axis: more than 30 degrees head down. The 0.5 % of
i3DB's frames beyond it are wrong."""
_KNEE: Final = np.sin(np.radians(45.0))
"""Limit of the component of a shin in front of its thigh: knees do not bend that way, but lifters
err by up to 30 degrees (99 of 100 frames of i3DB)."""
_HABIT: Final = 0.5
"""Share of frames above which a sign is a systematic property of the lifter, not a failure."""
_LEGS: Final = tuple(
    (TREE.index((hip, knee)), TREE.index((knee, ankle)))
    for hip, knee, ankle in ((sk.RHIP, sk.RKNE, sk.RANK), (sk.LHIP, sk.LKNE, sk.LANK))
)


def implausible_poses(track: Track, camera: Camera) -> NDArray[np.bool_]:
    """(T,) frames with an anatomically impossible lifted pose.

    There are three signs: inconsistent bone lengths, an upside-down trunk, and a knee that bends
    forward. A sign that occurs in most of a track is ignored.

    Parameters
    ----------
    track : Track
    camera : Camera
        Its pitch and roll tell which way is up.

    Returns
    -------
    (T,) bool
    """
    frames = np.flatnonzero(track.has_pose)
    result = np.zeros(len(track.poses), dtype=bool)
    if not len(frames):
        return result
    bones = bones_of(track.poses[frames])
    lengths = np.maximum(np.linalg.norm(bones, axis=-1), 1e-6)
    directions = bones / lengths[..., None]
    ratio = np.log(lengths / np.median(lengths, axis=0))
    ratio -= np.median(ratio, axis=1, keepdims=True)
    axes = torso_axes(directions)
    signs = (
        np.sqrt((ratio**2).mean(1)) > _PROPORTIONS,
        (axes[:, :, 2] @ camera.rotation[2]) < _HEAD_DOWN,
        np.max([_forward(directions, axes, *leg) for leg in _LEGS], axis=0) > _KNEE,
    )
    for sign in signs:
        if sign.mean() < _HABIT:
            result[frames] |= sign
    return result


def _forward(directions: Array, axes: Array, thigh: int, shin: int) -> Array:
    """(T,) component of the shin in front of the line of the thigh."""
    along = (directions[:, shin] * directions[:, thigh]).sum(-1, keepdims=True)
    across = directions[:, shin] - along * directions[:, thigh]
    result: Array = (across * axes[:, :, 1]).sum(-1)
    return result


# ------------------------------------------------------------------------------------------------
# Interpolation of poses.
#
# Linear interpolation of joints would shorten the bones of a person who turns. Rotating every bone
# by itself takes the shortest way for each, which for a half turn may be down for one bone and up
# for the next. So the trunk is interpolated as one rotation, and limbs as directions in its axes.

_SPINE: Final = TREE.index((sk.PELV, sk.THRX))
_RIGHTWARD: Final = (TREE.index((sk.PELV, sk.RHIP)), TREE.index((sk.THRX, sk.RSHO)))
_LEFTWARD: Final = (TREE.index((sk.PELV, sk.LHIP)), TREE.index((sk.THRX, sk.LSHO)))


def fill_poses(directions: ArrayLike, known: ArrayLike) -> Array:
    """Interpolate the trunk's rotation, and the limbs relative to it, between known frames.

    Parameters
    ----------
    directions : (T, 14, 3) float
        Unit vectors of the bones; unknown frames are ignored.
    known : (T,) bool
        At least one frame must be known.

    Returns
    -------
    (T, 14, 3) float
        Unit vectors; constant before the first and after the last known frame.
    """
    directions = np.asarray(directions, float)
    known = np.asarray(known, bool)
    if known.all():
        return directions.copy()
    frames = np.flatnonzero(known)
    axes = torso_axes(directions[frames])
    at = np.clip(np.arange(len(directions)), frames[0], frames[-1])
    turned = np.repeat(axes, 2, axis=0) if len(frames) == 1 else axes
    times = np.arange(2) + frames[0] if len(frames) == 1 else frames
    trunk = Slerp(times, Rotation.from_matrix(turned))(at).as_matrix()
    limbs = np.zeros_like(directions)
    limbs[frames] = directions[frames] @ axes
    filled: Array = fill_directions(limbs, known) @ trunk.transpose(0, 2, 1)
    filled[frames] = directions[frames]
    return filled


def torso_axes(directions: ArrayLike) -> Array:
    """Axes of the trunk, (..., 3, 3), from bone directions: columns are right, front and up.

    Right is the mean line through hips and shoulders; up is the component of the spine
    perpendicular to it. A degenerate body has the axes of the camera.

    Parameters
    ----------
    directions : (..., 14, 3) float
        Unit vectors of the bones.

    Returns
    -------
    (..., 3, 3) float
        Columns are the body's right, front and up.
    """
    directions = np.asarray(directions, float)
    right = directions[..., _RIGHTWARD, :].sum(-2) - directions[..., _LEFTWARD, :].sum(-2)
    right_length = np.linalg.norm(right, axis=-1, keepdims=True)
    right = right / np.maximum(right_length, 1e-9)
    spine = directions[..., _SPINE, :]
    up = spine - (spine * right).sum(-1, keepdims=True) * right
    up_length = np.linalg.norm(up, axis=-1, keepdims=True)
    up = up / np.maximum(up_length, 1e-9)
    axes = np.stack([right, np.cross(up, right), up], -1)
    sound = ((right_length > 1e-6) & (up_length > 1e-6))[..., None]
    result: Array = np.where(sound, axes, np.eye(3))
    return result


def fill_directions(directions: ArrayLike, known: ArrayLike) -> Array:
    """Rotate each bone at a constant rate from one known frame to the next.

    Linear interpolation of joints would shorten the bones of a person who turns.

    Parameters
    ----------
    directions : (T, K, 3) float
        Unit vectors; unknown frames are ignored.
    known : (T,) bool
        At least one frame must be known.

    Returns
    -------
    (T, K, 3) float
        Unit vectors; constant before the first and after the last known frame.
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
    # Where the weights of a slerp are 0/0 (tiny angles, half turns), interpolate linearly.
    safe = (angle > 1e-4) & (angle < np.pi - 1e-4)
    sine = np.where(safe, np.sin(angle), 1.0)
    weight_a = np.where(safe, np.sin((1 - fraction) * angle) / sine, 1 - fraction)
    weight_b = np.where(safe, np.sin(fraction * angle) / sine, fraction)
    mixed = weight_a * a + weight_b * b
    norm = np.linalg.norm(mixed, axis=-1, keepdims=True)
    result: Array = np.where(norm > 1e-6, mixed / np.maximum(norm, 1e-6), a)
    return result


# ------------------------------------------------------------------------------------------------
# Origin of the pose of each frame.


class PoseSource(StrEnum):
    """Origin of a frame's pose; all but the first are interpolated poses, with the reason."""

    OWN = "its own"
    MISSING = "no 3D pose"
    INTERPOLATED = "filled in by the input"
    IMPLAUSIBLE = "implausible pose"
    CONTRADICTED = "bad pose"
    ELSEWHERE = "detector elsewhere"
    FAST = "joints too fast"


@dataclass(frozen=True)
class FrameTable:
    """Properties of the static path in each frame.

    Parameters
    ----------
    pose : (T,) tuple of PoseSource
        Origin of the frame's pose, or the reason why it is interpolated.
    detected : (T,) int
        Number of detected joints.
    miss : (T,) float
        Median distance in pixels from the confident detections to the fitted person; NaN without
        confident joints.
    outlier : (T,) bool
        Frames most of whose confident detections are far from the fitted person.
    """

    pose: tuple[PoseSource, ...]
    detected: NDArray[np.int64]
    miss: Array
    outlier: NDArray[np.bool_]

    __repr__ = brief

    @property
    def filled(self) -> NDArray[np.bool_]:
        """(T,) frames whose pose is interpolated."""
        return np.array([p is not PoseSource.OWN for p in self.pose], dtype=bool)

    def counts(self) -> dict[str, int]:
        """Number of frames by origin of the pose, outliers, and frames without detection.

        Returns
        -------
        dict of str to int
        """
        found = {str(source): self.pose.count(source) for source in PoseSource}
        found["outlier"] = int(self.outlier.sum())
        found["nothing detected"] = int((self.detected == 0).sum())
        return found


# ------------------------------------------------------------------------------------------------
# Reference body in lifted poses.

_LEFT, _RIGHT, _UP, _DOWN = (-1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
_UPRIGHT: Final[Array] = np.array(
    [_LEFT, _DOWN, _DOWN, _RIGHT, _DOWN, _DOWN, _UP, _UP,
     _LEFT, _DOWN, _DOWN, _RIGHT, _DOWN, _DOWN]
)  # fmt: skip
"""(14, 3) bone directions of a person who stands and faces the camera; left is the image's."""


@dataclass(frozen=True)
class LiftedBody:
    """The reference body in the lifted poses.

    Parameters
    ----------
    directions : (T, 14, 3) float
        Unit vectors in camera axes, interpolated where ``known`` is false.
    known : (T,) bool
        Frames whose directions come from their own lifted pose.
    """

    directions: Array
    known: NDArray[np.bool_]

    @property
    def lengths(self) -> Array:
        """(14,) bone lengths of the reference body in metres, the same for everyone."""
        return LENGTHS

    @property
    def bones(self) -> Array:
        """(T, 14, 3) bone vectors in metres, camera axes."""
        return self.lengths[:, None] * self.directions


def lifted_body(track: Track, trusted: NDArray[np.bool_]) -> LiftedBody:
    """Put the reference body into the lifted poses of the ``trusted`` (T,) frames of a track.

    Lifters disagree on the length of the trunk and the width of the hips, like their training data.
    The effect of a person's size on depth is left to the posterior's uncertainty of stature. The
    pelvis is put midway between the hips, the thorax midway between the shoulders.

    Without any trusted frame the person stands upright and faces the camera, as an arbitrary start.

    Parameters
    ----------
    track : Track
    trusted : (T,) bool
        Frames whose lifted pose is used.

    Returns
    -------
    LiftedBody
    """
    known = np.asarray(trusted, bool) & track.has_pose
    if not known.any():
        directions = np.broadcast_to(_UPRIGHT, (len(known), N_BONES, 3)).copy()
        return LiftedBody(directions, known)
    poses = np.where(known[:, None, None], track.poses, 0.0)
    poses[:, sk.PELV] = (poses[:, sk.RHIP] + poses[:, sk.LHIP]) / 2
    poses[:, sk.THRX] = (poses[:, sk.RSHO] + poses[:, sk.LSHO]) / 2
    bones = bones_of(poses)
    norms = np.linalg.norm(bones, axis=-1)
    usable = np.where(norms[..., None] > 0, bones / np.maximum(norms, 1e-9)[..., None], _UPRIGHT)
    return LiftedBody(fill_poses(usable, known), known)
