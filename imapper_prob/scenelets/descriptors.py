"""What a motion looks like, whatever its place, heading and speed.

A motion is described by fourteen distances of joints from lines at fifteen moments evenly
spaced along its trajectory (Monszpart et al. 2019, section 4; joint-line distances after
Zhang, Liu and Xiao 2017). The paper does not say which lines. Here eight distances are from
the vertical through the pelvis, which tells sitting, leaning, reaching and lying from
standing; four from the line through the hips, which tells raised hands and legs from hanging
ones; two from the line between shoulder and wrist, which tell bent elbows.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.skeleton import (
    LANK,
    LELB,
    LHIP,
    LKNE,
    LSHO,
    LWRI,
    PELV,
    RANK,
    RELB,
    RHIP,
    RKNE,
    RSHO,
    RWRI,
)

__all__ = [
    "N_FEATURES",
    "N_SAMPLES",
    "descriptor_distances",
    "joint_line_distances",
    "motion_descriptors",
]

Array = NDArray[np.float64]

N_SAMPLES: Final = 15
"""Moments along a motion (Monszpart et al. 2019)."""

SAMPLE_SPREAD: Final = 2.33
"""Standard deviation, in samples, of the weight that falls off from the middle one (ibid.)."""

FROM_VERTICAL: Final = (RANK, LANK, RKNE, LKNE, RSHO, LSHO, RWRI, LWRI)
"""Joints whose distance from the vertical through the pelvis counts."""

FROM_LINES: Final = (
    (RANK, RHIP, LHIP),
    (LANK, RHIP, LHIP),
    (RWRI, RHIP, LHIP),
    (LWRI, RHIP, LHIP),
    (RELB, RSHO, RWRI),
    (LELB, LSHO, LWRI),
)
"""A joint, and the two joints its line goes through."""

N_FEATURES: Final = len(FROM_VERTICAL) + len(FROM_LINES)


def joint_line_distances(joints: Array) -> Array:
    """Distances of joints from lines.

    Parameters
    ----------
    joints : (..., 16, 3) float
        Metres, z up.

    Returns
    -------
    (..., 14) float
        Metres.
    """
    from_pelvis = joints[..., FROM_VERTICAL, :2] - joints[..., None, PELV, :2]
    joint, first, second = (joints[..., list(index), :] for index in zip(*FROM_LINES, strict=True))
    along = second - first
    along /= np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-9)
    away = joint - first
    away -= (away * along).sum(-1, keepdims=True) * along
    distances = [np.linalg.norm(from_pelvis, axis=-1), np.linalg.norm(away, axis=-1)]
    return np.concatenate(distances, axis=-1)


def motion_descriptors(motions: Sequence[Array]) -> Array:
    """Descriptors of motions, all at once; linear in the number of frames.

    Parameters
    ----------
    motions : sequence of L arrays (n, 16, 3)
        Joints in metres, z up; at least two frames each.

    Returns
    -------
    (L, 15, 14) float
        Metres. The fifteen moments are evenly spaced along the trajectory in the space of
        the fourteen features and the pelvis, so that a slow motion is described as a fast
        one; where nothing moves, evenly in time.
    """
    lengths = np.array([len(m) for m in motions])
    joints = np.concatenate([np.asarray(m, float) for m in motions])
    features = joint_line_distances(joints)
    trajectory = np.concatenate([features, joints[:, PELV]], axis=1)
    steps = np.linalg.norm(np.diff(trajectory, axis=0, prepend=trajectory[:1]), axis=1)
    first = np.concatenate([[0], np.cumsum(lengths)[:-1]])
    # The smallest of steps keeps the way increasing where nothing moves.
    steps = np.maximum(steps, 1e-9)
    steps[first] = 0.0
    walked = np.cumsum(steps)
    own = np.repeat(np.arange(len(lengths)), lengths)
    walked -= walked[first][own]
    way = walked / walked[first + lengths - 1][own]
    # One interpolation for all: motion l lives on [2 l, 2 l + 1].
    at = 2.0 * np.arange(len(lengths))[:, None] + np.linspace(0.0, 1.0, N_SAMPLES)
    columns = [np.interp(at, way + 2.0 * own, column) for column in features.T]
    return np.stack(columns, axis=-1)


def descriptor_distances(one: Array, other: Array | None = None) -> Array:
    """Distances between motions: root mean square over features and weighted samples.

    Parameters
    ----------
    one : (L, 15, 14) float
        Of :func:`motion_descriptors`.
    other : (M, 15, 14) float, optional
        ``one`` itself if not given.

    Returns
    -------
    (L, M) float
        Metres.
    """
    a = _weighted(one)
    b = a if other is None else _weighted(other)
    squared = (a**2).sum(1)[:, None] + (b**2).sum(1) - 2.0 * a @ b.T
    if other is None:
        np.fill_diagonal(squared, 0.0)
    distances: Array = np.sqrt(np.maximum(squared, 0.0))
    return distances


def _weighted(descriptors: Array) -> Array:
    """(L, 210) such that plain Euclidean distances are the weighted ones."""
    offset = (np.arange(N_SAMPLES) - N_SAMPLES // 2) / SAMPLE_SPREAD
    weight = np.exp(-0.5 * offset**2)
    weight /= weight.sum() * N_FEATURES
    flat: Array = (descriptors * np.sqrt(weight)[:, None]).reshape(len(descriptors), -1)
    return flat
