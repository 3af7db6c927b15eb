"""Poses of the frames as vectors of bones: implausible ones, and how missing ones are filled.

A lifter sees one frame at a time. The directions of its bones are useful, its scale and its
proportions are not, which are those of the skeleton it was trained on, and some frames have no
pose. The neck, which no detector reports, is put half-way between thorax and head.
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
    """Bone vectors of poses, from parent to child.

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
    """Joints of bone vectors, relative to the pelvis.

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
# Lifters mostly stay near bodies of their training data, but where a body is hidden some collapse,
# turn it upside down or break its knees. Detections cannot always tell, for there are none of what
# is hidden.

_PROPORTIONS: Final = 0.7
"""Root mean square over the bones of the log of their lengths over the person's own, scale
aside: wrong by a factor of two on average. i3DB's lifter is below .62 in 99 of 100 frames."""
_HEAD_DOWN: Final = -0.5
"""Upward part of the trunk's own up: more than 30 degrees head down. The 0.5 % of i3DB's frames
below are wrong."""
_KNEE: Final = np.sin(np.radians(45.0))
"""Part of a shin that is in front of the line of its thigh: knees do not bend that way, though
lifters err by up to 30 degrees (99 of 100 frames of i3DB)."""
_HABIT: Final = 0.5
"""Part of the frames from which on an oddity is the lifter's idea of a body and no failure."""
_LEGS: Final = tuple(
    (TREE.index((hip, knee)), TREE.index((knee, ankle)))
    for hip, knee, ankle in ((sk.RHIP, sk.RKNE, sk.RANK), (sk.LHIP, sk.LKNE, sk.LANK))
)


def implausible_poses(track: Track) -> NDArray[np.bool_]:
    """(T,) frames with a lifted pose that no body can take.

    Three signs, each of which counts unless most of the track has it: bones whose lengths do
    not go together, a trunk that is upside down, a knee that bends forward.

    Parameters
    ----------
    track : Track

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
        axes[:, 2, 2] < _HEAD_DOWN,
        np.max([_forward(directions, axes, *leg) for leg in _LEGS], axis=0) > _KNEE,
    )
    for sign in signs:
        if sign.mean() < _HABIT:
            result[frames] |= sign
    return result


def _forward(directions: Array, axes: Array, thigh: int, shin: int) -> Array:
    """(T,) how much of the shin is in front of the line of the thigh."""
    along = (directions[:, shin] * directions[:, thigh]).sum(-1, keepdims=True)
    across = directions[:, shin] - along * directions[:, thigh]
    result: Array = (across * axes[:, :, 1]).sum(-1)
    return result


# ------------------------------------------------------------------------------------------------
# Poses between known ones.
#
# Linear interpolation of joints would shorten the bones of a person who turns round. Turning every
# bone by itself takes each the shortest way, which for a half turn may be through the floor for one
# and over the head for the next. So the trunk is a rotation that is interpolated as one, and limbs
# are directions in its axes.

_SPINE: Final = TREE.index((sk.PELV, sk.THRX))
_RIGHTWARD: Final = (TREE.index((sk.PELV, sk.RHIP)), TREE.index((sk.THRX, sk.RSHO)))
_LEFTWARD: Final = (TREE.index((sk.PELV, sk.LHIP)), TREE.index((sk.THRX, sk.LSHO)))


def fill_poses(directions: ArrayLike, known: ArrayLike) -> Array:
    """Turn the trunk, and the limbs about it, at constant rates between known frames.

    Parameters
    ----------
    directions : (T, 14, 3) float
        Unit vectors of the bones; frames that are not known are ignored.
    known : (T,) bool
        At least one frame must be known.

    Returns
    -------
    (T, 14, 3) float
        Unit vectors; before the first and after the last known frame these are held.
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
    """(..., 14, 3) bones to (..., 3, 3) trunks: columns are the body's right, front and up.

    Right is the mean line through hips and shoulders, up the spine as far as it is across
    that. A body without either (a lifter's worst) has the axes of the camera.

    Parameters
    ----------
    directions : (..., 14, 3) float
        Of the bones.

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


# ------------------------------------------------------------------------------------------------
# Where the pose of each frame comes from.


class PoseSource(StrEnum):
    """Where the pose of a frame comes from; all but the first were filled in."""

    OWN = "its own"
    MISSING = "no 3D pose"
    INTERPOLATED = "filled in by the input"
    IMPLAUSIBLE = "implausible pose"
    CONTRADICTED = "bad pose"
    ELSEWHERE = "detector elsewhere"
    FAST = "joints too fast"


@dataclass(frozen=True)
class FrameTable:
    """The static path frame by frame.

    Parameters
    ----------
    pose : (T,) tuple of PoseSource
        Whose pose a frame has, or why it is not its own.
    detected : (T,) int
        Joints with a detection.
    miss : (T,) float
        Median distance in pixels from the confident detections to the fitted person; NaN
        where no joint is confident.
    outlier : (T,) bool
        Frames most of whose confident detections are so far off that the path leaves them.
    """

    pose: tuple[PoseSource, ...]
    detected: NDArray[np.int64]
    miss: Array
    outlier: NDArray[np.bool_]

    __repr__ = brief

    @classmethod
    def unexamined(cls, detected: NDArray[np.int64]) -> FrameTable:
        """Of a path that was given: all poses their own, nothing known of how well they fit.

        Parameters
        ----------
        detected : (T,) int
            How many joints of each frame were detected.

        Returns
        -------
        FrameTable
        """
        n = len(detected)
        return cls((PoseSource.OWN,) * n, detected, np.full(n, np.nan), np.zeros(n, dtype=bool))

    @property
    def filled(self) -> NDArray[np.bool_]:
        """(T,) frames whose pose is made from those around them."""
        return np.array([p is not PoseSource.OWN for p in self.pose], dtype=bool)

    @property
    def elsewhere(self) -> NDArray[np.bool_]:
        """(T,) frames in which the detector was not on the person."""
        return np.array([p is PoseSource.ELSEWHERE for p in self.pose], dtype=bool)

    def counts(self) -> dict[str, int]:
        """How many frames, outliers included, by what became of them.

        Returns
        -------
        dict of str to int
        """
        found = {str(source): self.pose.count(source) for source in PoseSource}
        found["outlier"] = int(self.outlier.sum())
        found["nothing detected"] = int((self.detected == 0).sum())
        return found


# ------------------------------------------------------------------------------------------------
# The reference body in lifted poses.

_LEFT, _RIGHT, _UP, _DOWN = (-1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
_UPRIGHT: Final[Array] = np.array(
    [_LEFT, _DOWN, _DOWN, _RIGHT, _DOWN, _DOWN, _UP, _UP,
     _LEFT, _DOWN, _DOWN, _RIGHT, _DOWN, _DOWN]
)  # fmt: skip
"""(14, 3) directions of somebody who stands and looks at the camera, left being the image's."""


@dataclass(frozen=True)
class LiftedBody:
    """The reference body in the poses that the lifter says.

    Parameters
    ----------
    directions : (T, 14, 3) float
        Unit vectors in camera axes, filled in where ``known`` is false.
    known : (T,) bool
        Frames whose directions are their own.
    """

    directions: Array
    known: NDArray[np.bool_]

    @property
    def lengths(self) -> Array:
        """(14,) bone lengths in metres: those of the reference body, whoever it is."""
        return LENGTHS

    @property
    def bones(self) -> Array:
        """(T, 14, 3) bone vectors in metres, camera axes."""
        return self.lengths[:, None] * self.directions


def lifted_body(track: Track, trusted: NDArray[np.bool_]) -> LiftedBody:
    """The reference body in the poses of the ``trusted`` (T,) frames of a track.

    Lifters disagree on where a trunk ends and how wide hips are, for their training data do.
    What a person's size does to depth is left to the doubt of stature in the posterior. The
    pelvis is put midway between the hips, the thorax between the shoulders.

    Without a single trusted frame the person stands upright and faces the camera, which is
    as good a start as any.

    Parameters
    ----------
    track : Track
    trusted : (T,) bool
        Frames whose pose counts.

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
    bones = bones_of(poses)
    norms = np.linalg.norm(bones, axis=-1)
    usable = np.where(norms[..., None] > 0, bones / np.maximum(norms, 1e-9)[..., None], _UPRIGHT)
    return LiftedBody(fill_poses(usable, known), known)
