"""The sixteen joints, their connections, body proportions, and functions of poses.

Left and right are the person's own. The order of joints is that of the i3DB benchmark (Monszpart et
al. 2019), so that its files and scores can be compared directly. Code uses the names, not the
numbers.
"""

from __future__ import annotations

import math
import statistics
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "BONES",
    "BONE_LENGTHS",
    "DETECTED",
    "HEAD",
    "JOINTS",
    "LANK",
    "LELB",
    "LENGTH_SPREADS",
    "LHIP",
    "LKNE",
    "LSHO",
    "LWRI",
    "MIRROR",
    "NECK",
    "N_JOINTS",
    "PELV",
    "RANK",
    "REFERENCE_STATURE",
    "RELB",
    "RHIP",
    "RKNE",
    "RSHO",
    "RWRI",
    "SCORED",
    "THRX",
    "TOUCHING",
    "blend_poses",
    "facing",
    "minimum_jerk",
    "thigh_angle",
    "turned",
]

Array = NDArray[np.float64]

JOINTS: Final = (
    "RANK", "RKNE", "RHIP", "LHIP", "LKNE", "LANK", "PELV", "THRX",
    "NECK", "HEAD", "RWRI", "RELB", "RSHO", "LSHO", "LELB", "LWRI",
)  # fmt: skip
N_JOINTS: Final = len(JOINTS)
(
    RANK, RKNE, RHIP, LHIP, LKNE, LANK, PELV, THRX,
    NECK, HEAD, RWRI, RELB, RSHO, LSHO, LELB, LWRI,
) = range(N_JOINTS)  # fmt: skip
MIRROR: Final = (
    LANK, LKNE, LHIP, RHIP, RKNE, RANK, PELV, THRX,
    NECK, HEAD, LWRI, LELB, LSHO, RSHO, RELB, RWRI,
)  # fmt: skip
"""``MIRROR[j]`` is the same joint on the other side of the body."""
BONES: Final = (
    (RANK, RKNE), (RKNE, RHIP), (RHIP, PELV), (LANK, LKNE), (LKNE, LHIP), (LHIP, PELV),
    (THRX, PELV), (NECK, THRX), (HEAD, NECK),
    (RWRI, RELB), (RELB, RSHO), (RSHO, THRX), (LWRI, LELB), (LELB, LSHO), (LSHO, THRX),
)  # fmt: skip
"""Pairs of connected joints: the one farther from the pelvis, then the nearer one."""
SCORED: Final = tuple(j for j in range(N_JOINTS) if j not in (PELV, NECK))
"""The fourteen joints of the benchmark's pose score."""
DETECTED: Final = SCORED
"""Joints that a detector reports directly; PELV and NECK are synthesised from others."""
TOUCHING: Final = (PELV, RKNE, LKNE, RWRI, LWRI)
"""Joints with which a person touches furniture; the first sits on it."""
REFERENCE_STATURE: Final = 1.70
"""Stature in metres of the body that ``BONE_LENGTHS`` and the built-in library describe."""
_SKELETONS: Final[dict[str, dict[str, float]]] = {
    "Drillis and Contini (1966)": {
        "thigh": .245, "shin": .246, "torso": .288, "head": .146,
        "upper arm": .186, "forearm": .146,
    },
    "de Leva (1996)": {
        "thigh": .2275, "shin": .2492, "torso": .2916, "head": .1675,
        "upper arm": .1602, "forearm": .1534,
    },
    "ANSUR II (Gordon et al. 2014)": {
        "thigh": .233, "shin": .243, "upper arm": .191, "forearm": .1505,
    },
    "Human3.6M (Ionescu et al. 2014)": {
        "half hips": .0741, "thigh": .2469, "shin": .2532, "torso": .2734, "head": .1318,
        "half shoulders": .0842, "upper arm": .1555, "forearm": .1403,
    },
    "Rajagopal et al. (2016)": {
        "half hips": .0454, "shin": .2353, "torso": .3139, "half shoulders": .1000,
        "upper arm": .1686, "forearm": .1471,
    },
}  # fmt: skip
"""Distances between joint centres divided by stature, as published.

Drillis and Contini as in Winter, *Biomechanics and Motor Control of Human Movement*, fig. 4.1; de
Leva, *J. Biomechanics* 29, table 4, and ANSUR II (4,082 men and 1,986 women) as the mean of both
sexes; the skeletons of a data set and of a musculoskeletal model. Only distances between joints are
used: not breadths over acromia or trochanters, nor trunks up to the seventh vertebra. The torso
reaches from mid-hip to mid-shoulder, and the head from there to where detectors put it. Some put it
between the ears and some at the crown, so for the first two sources it is the geometric mean of
both. Human3.6M has no published stature; it is set so that thigh, shin and torso together are as
long as the mean of the first two sources."""


_PEOPLE: Final = 0.047
"""Standard deviation between people of log (bone length / stature) (ANSUR II: .033 to .051 for
limbs and trunk, largest for the thigh)."""


def _logs(bone: str) -> list[float]:
    return [math.log(skeleton[bone]) for skeleton in _SKELETONS.values() if bone in skeleton]


def _published(bone: str) -> float:
    """Bone length in metres at the reference stature: geometric mean of all sources that have
    it."""
    return REFERENCE_STATURE * math.exp(statistics.fmean(_logs(bone)))


def _spread(bone: str) -> float:
    """Standard deviation of the log length: between people, and between sources."""
    return math.hypot(_PEOPLE, statistics.stdev(_logs(bone)))


BONE_LENGTHS: Final[dict[tuple[int, int], float]] = {
    (RANK, RKNE): _published("shin"), (LANK, LKNE): _published("shin"),
    (RKNE, RHIP): _published("thigh"), (LKNE, LHIP): _published("thigh"),
    (RHIP, LHIP): 2 * _published("half hips"),
    (RSHO, LSHO): 2 * _published("half shoulders"),
    (RSHO, RELB): _published("upper arm"), (LSHO, LELB): _published("upper arm"),
    (RELB, RWRI): _published("forearm"), (LELB, LWRI): _published("forearm"),
    (PELV, THRX): _published("torso"),
    (THRX, HEAD): _published("head"),
}  # fmt: skip
"""Segment lengths in metres of an adult of the reference stature, from the literature only."""
LENGTH_SPREADS: Final[dict[tuple[int, int], float]] = {
    (RANK, RKNE): _spread("shin"), (LANK, LKNE): _spread("shin"),
    (RKNE, RHIP): _spread("thigh"), (LKNE, LHIP): _spread("thigh"),
    (RHIP, LHIP): _spread("half hips"),
    (RSHO, LSHO): _spread("half shoulders"),
    (RSHO, RELB): _spread("upper arm"), (LSHO, LELB): _spread("upper arm"),
    (RELB, RWRI): _spread("forearm"), (LELB, LWRI): _spread("forearm"),
    (PELV, THRX): _spread("torso"),
    (THRX, HEAD): _spread("head"),
}  # fmt: skip
"""Standard deviations of log segment lengths of a person of known stature."""

# ------------------------------------------------------------------------------------------------
# Poses: facing direction, rotation and interpolation.


def _outward() -> tuple[tuple[int, int], ...]:
    """Bones as (far, near) joints in order from the pelvis outward."""
    order: list[tuple[int, int]] = []
    reached = [PELV]
    for near in reached:  # the list grows during the loop
        ends = [a + b - near for a, b in BONES if near in (a, b)]
        order += [(far, near) for far in ends if far not in reached]
        reached += [far for far in ends if far not in reached]
    return tuple(order)


_OUTWARD = _outward()


def facing(joints: ArrayLike) -> Array:
    """Facing direction of a person, from the lines through hips and shoulders.

    The body's right is the sum of both lines, from left to right, on the floor; forward is a
    quarter turn counter-clockwise from it. Head and feet are not used, because they turn
    independently.

    Parameters
    ----------
    joints : (..., 16, 3) float
        Metres, z up.

    Returns
    -------
    (...) float
        Yaw in radians: 0 faces +y, counter-clockwise, in (-pi, pi].
    """
    joints = np.asarray(joints, float)
    hips = joints[..., RHIP, :] - joints[..., LHIP, :]
    shoulders = joints[..., RSHO, :] - joints[..., LSHO, :]
    right = hips + shoulders
    yaw: Array = np.arctan2(right[..., 1], right[..., 0])
    return yaw


def thigh_angle(joints: ArrayLike) -> Array:
    """Mean angle of both thighs to the vertical in radians; 0 for a person who stands upright.

    Parameters
    ----------
    joints : (..., 16, 3) float
        Metres, z up.

    Returns
    -------
    (...) float
    """
    joints = np.asarray(joints, float)
    thighs = joints[..., [RKNE, LKNE], :] - joints[..., [RHIP, LHIP], :]
    level = np.linalg.norm(thighs[..., :2], axis=-1)
    angles: Array = np.arctan2(level, -thighs[..., 2]).mean(-1)
    return angles


def turned(joints: ArrayLike, yaw: ArrayLike) -> Array:
    """Rotate joints about the z axis.

    Parameters
    ----------
    joints : (..., 16, 3) float
        Metres.
    yaw : (...) float
        Radians, counter-clockwise.

    Returns
    -------
    (..., 16, 3) float
    """
    joints, yaw = np.asarray(joints, float), np.asarray(yaw, float)[..., None]
    x, y, z = np.moveaxis(joints, -1, 0)
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack([c * x - s * y, s * x + c * y, z + np.zeros_like(c)], -1)


def blend_poses(first: ArrayLike, second: ArrayLike, weight: ArrayLike) -> Array:
    """Interpolate between two poses; bones rotate and keep their lengths.

    Parameters
    ----------
    first, second : (..., 16, 3) float
        Joints in metres; the pelvis is interpolated, too.
    weight : (...) float
        0 gives ``first``, 1 ``second``.

    Returns
    -------
    (..., 16, 3) float
        Joints in metres; each bone has the weighted mean of its two lengths.
    """
    first, second = np.asarray(first, float), np.asarray(second, float)
    weight = np.asarray(weight, float)[..., None]
    shape = np.broadcast_shapes(first.shape, second.shape, (*weight.shape[:-1], N_JOINTS, 3))
    joints = np.zeros(shape)
    joints[..., PELV, :] = (1 - weight) * first[..., PELV, :] + weight * second[..., PELV, :]
    for far, near in _OUTWARD:
        a = first[..., far, :] - first[..., near, :]
        b = second[..., far, :] - second[..., near, :]
        mean = (1 - weight) * a + weight * b
        length = (1 - weight) * np.linalg.norm(a, axis=-1, keepdims=True)
        length = length + weight * np.linalg.norm(b, axis=-1, keepdims=True)
        size = np.linalg.norm(mean, axis=-1, keepdims=True)
        joints[..., far, :] = joints[..., near, :] + mean * length / np.maximum(size, 1e-9)
    return joints


def minimum_jerk(progress: ArrayLike) -> Array:
    """Minimum-jerk position (Flash and Hogan 1985): 0 to 1, constant outside that progress.

    Parameters
    ----------
    progress : (n,) float

    Returns
    -------
    (n,) float
    """
    s = np.clip(np.asarray(progress, float), 0.0, 1.0)
    position: Array = s**3 * (10 - 15 * s + 6 * s**2)
    return position
