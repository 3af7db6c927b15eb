"""Poses from a lifter, given to the reference body and filled in where they are missing.

A lifter sees one frame at a time: the directions of its bones are useful, its scale is not, nor
are its proportions, which are those of the skeleton it was trained on, and some frames have none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models import skeleton as sk
from imapper_prob.models.scene import Track
from imapper_prob.staged.bones import LENGTHS, N_BONES, bones_of
from imapper_prob.staged.filling import fill_poses

__all__ = ["LiftedBody", "lifted_body"]

Array = NDArray[np.float64]

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
