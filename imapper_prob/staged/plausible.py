"""Poses nobody can take.

Lifters know bodies from training data and mostly stay near them, but where a body is hidden
some collapse, turn it upside down or break its knees. Detections cannot always say so, for
there are none of what is hidden.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models import skeleton as sk
from imapper_prob.models.scene import Track
from imapper_prob.staged.bones import TREE, bones_of
from imapper_prob.staged.filling import torso_axes

__all__ = ["implausible_poses"]

Array = NDArray[np.float64]

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
