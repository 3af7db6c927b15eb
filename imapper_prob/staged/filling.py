"""Poses between known ones: the trunk turns, and the limbs turn with it and by themselves.

Linear interpolation of joints would shorten the bones of a person who turns round; turning
every bone by itself would not, but takes each the shortest way, which for a half turn may be
through the floor for one and over the head for the next. So the trunk is a rotation that is
interpolated as one, and limbs are directions in its axes.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation, Slerp

from imapper_prob.models import skeleton as sk
from imapper_prob.staged.bones import TREE

__all__ = ["fill_directions", "fill_poses", "torso_axes"]

Array = NDArray[np.float64]

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
