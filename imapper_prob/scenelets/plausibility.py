"""Checks of anatomical and physical plausibility: joint angles, sliding feet, penetration.

Ranges of motion are those of the American Academy of Orthopaedic Surgeons, *Joint Motion: Method of
Measuring and Recording* (1965), in degrees. A skeleton of sixteen joints has one straight spine
bone from hips to shoulders; it rotates by half of the bend of an evenly bent spine.

Every function returns one sentence per fault, and none for a plausible motion.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.scene import SceneObject
from imapper_prob.models.skeleton import (
    BONES,
    HEAD,
    JOINTS,
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
    THRX,
)
from imapper_prob.scenelets.procedural.body import ANKLE_HEIGHT, SIDES

__all__ = [
    "depth_inside",
    "faults",
    "floor_faults",
    "furniture_faults",
    "motion_faults",
    "posture_faults",
]

Array = NDArray[np.float64]

SPINE: Final = {"flexion": 80.0, "extension": 25.0, "to the side": 35.0, "twist": 45.0}
"""Range of thorax and loins together, degrees."""

KNEE, ELBOW = (0.0, 150.0), (0.0, 150.0)
"""Flexion in degrees; for the knee under the weight of the body (135 by its own muscles)."""

HIP: Final = (-30.0 - SPINE["extension"] / 2, 125.0 + SPINE["flexion"] / 2)
"""Extension and flexion of the thigh relative to the trunk: of hip and spine together, degrees."""

HIP_SIDEWAYS: Final = (-30.0, 45.0)
"""Thigh inward and outward, degrees."""

SHOULDER_BACKWARD, SHOULDER_INWARD = 60.0, 45.0
"""Upper arm behind the trunk, and across the chest beyond straight ahead, degrees."""

NECK: Final = 45.0
"""Head relative to the trunk, in any direction, degrees."""

KNEE_BACKWARD: Final = 10.0
"""Knee extension beyond straight, degrees."""

MEASURED_WITHIN: Final = 7.0
"""Tolerance in degrees: an error of 8 mm in each of three joints changes the angle between two
bones of .27 m by a standard deviation of 2.4, and this is three of them."""

FOOT_BELOW_FLOOR: Final = 0.03
"""Metres by which an ankle may be lower than in a flat foot."""

FOOT_LIES: Final = 0.5
"""Vertical component of the shin below which the foot cannot be flat, but lies on its side or
instep: an ankle 60 degrees from upright, while it stretches by 50."""

LYING_FOOT: Final = 0.02
"""Least height in metres of the ankle of a lying foot."""

CONTACT: Final = 0.015
"""Height in metres above a flat foot's ankle up to which the foot counts as standing."""

LARGEST_SLIDE: Final = 0.03
"""Largest distance in metres between two positions of a foot in one stance."""

STANDS: Final = 0.75
"""Height of the pelvis in metres above which only feet can support a body of 1.70 m, unless it
lies."""

UPRIGHT: Final = 0.25
"""Height of the shoulders above the pelvis, metres, for a person who does not lie: half of the
trunk."""

LOWEST_FOOT: Final = 0.045
"""Height in metres above a flat foot's ankle up to which a foot supports: standing on the toes."""

FASTEST_PELVIS: Final = 2.0
"""Largest speed of the pelvis in m/s, at which people begin to run (Hreljac 1993)."""

FASTEST_JOINT: Final = 6.0
"""Largest speed of a joint in m/s; a swinging foot is up to four times as fast as the walk."""

LARGEST_STRETCH: Final = 0.03
"""Metres by which a bone may differ from its median length in the clip: bones are rigid, but
trackers have errors."""

DEEPEST: Final = 0.05
"""Metres by which the line of a bone may penetrate a cuboid: cushions and clothes give way."""

_SIDE_NAMES: Final = ("right", "left")


def faults(joints: ArrayLike, objects: Iterable[SceneObject], *, fps: float) -> list[str]:
    """All implausible things in a motion.

    Parameters
    ----------
    joints : (n, 16, 3) float
        A body of about the reference stature, metres, z up, floor at z = 0.
    objects : iterable of SceneObject
        Furniture in the same frame.
    fps : float
        Frames per second.

    Returns
    -------
    list of str
        A sentence for each fault; empty if there is none.
    """
    joints = np.asarray(joints, float)
    return [
        *posture_faults(joints),
        *floor_faults(joints),
        *motion_faults(joints, fps=fps),
        *furniture_faults(joints, objects),
    ]


def posture_faults(joints: ArrayLike) -> list[str]:
    """Joints bent beyond their range in any frame of joints (n, 16, 3).

    Parameters
    ----------
    joints : (n, 16, 3) float
        Metres.

    Returns
    -------
    list of str
    """
    joints = np.asarray(joints, float)
    spine = _unit(joints[:, THRX] - joints[:, PELV])
    hips = _unit(joints[:, RHIP] - joints[:, LHIP])
    shoulders = _unit(joints[:, RSHO] - joints[:, LSHO])
    head = _unit(joints[:, HEAD] - joints[:, THRX])
    thighs = _unit(joints[:, [RKNE, LKNE]] - joints[:, [RHIP, LHIP]])
    shins = _unit(joints[:, [RANK, LANK]] - joints[:, [RKNE, LKNE]])
    upper_arms = _unit(joints[:, [RELB, LELB]] - joints[:, [RSHO, LSHO]])
    forearms = _unit(joints[:, [RWRI, LWRI]] - joints[:, [RELB, LELB]])

    loin = _unit(hips - _dot(hips, spine)[:, None] * spine)
    ahead = np.cross(spine, loin)
    chest = _unit(shoulders - _dot(shoulders, spine)[:, None] * spine)
    before_chest = np.cross(spine, chest)
    twist = np.arctan2(_dot(np.cross(loin, chest), spine), _dot(loin, chest))

    pelvis_up, pelvis_ahead, pelvis_right = spine[:, None], ahead[:, None], loin[:, None]
    flexion = np.arctan2(_dot(thighs, pelvis_ahead), -_dot(thighs, pelvis_up))
    # A thigh folded beyond the trunk is over-flexed, not extended.
    flexion = np.where(flexion < -np.pi / 2, flexion + 2 * np.pi, flexion)
    outward = np.arcsin(np.clip(_dot(thighs, pelvis_right) * SIDES, -1, 1))
    knee_backward = np.arcsin(np.clip(_dot(np.cross(thighs, shins), pelvis_right), -1, 1))
    arm_backward = -np.arcsin(np.clip(_dot(upper_arms, before_chest[:, None]), -1, 1))
    arm_inward = -np.arcsin(np.clip(_dot(upper_arms, chest[:, None]) * SIDES, -1, 1))

    sides = SPINE["to the side"]
    return [
        *_outside("knee bends by", _between(thighs, shins), KNEE),
        *_outside("knee bends backward by", knee_backward, (-180.0, KNEE_BACKWARD)),
        *_outside("elbow bends by", _between(upper_arms, forearms), ELBOW),
        *_outside("hip bends by", flexion, HIP),
        *_outside("thigh goes outward by", outward, HIP_SIDEWAYS),
        *_outside("upper arm goes backward by", arm_backward, (-180.0, SHOULDER_BACKWARD)),
        *_outside("upper arm goes inward by", arm_inward, (-180.0, SHOULDER_INWARD)),
        *_outside("trunk bends sideways by", np.arcsin(_dot(spine, hips)), (-sides, sides)),
        *_outside("trunk twists by", twist, (-SPINE["twist"], SPINE["twist"])),
        *_outside("neck bends by", _between(spine, head), (0.0, NECK)),
    ]


def floor_faults(joints: ArrayLike) -> list[str]:
    """Feet that are below the floor, slide, or do not support, in joints (n, 16, 3).

    Parameters
    ----------
    joints : (n, 16, 3) float
        Metres.

    Returns
    -------
    list of str
    """
    joints = np.asarray(joints, float)
    found = []
    lowest = joints[..., 2].copy()
    shins = _unit(joints[:, [RKNE, LKNE]] - joints[:, [RANK, LANK]])
    flat = ANKLE_HEIGHT - FOOT_BELOW_FLOOR
    lowest[:, [RANK, LANK]] -= np.where(shins[..., 2] < FOOT_LIES, LYING_FOOT, flat)
    if lowest.min() < 0:
        frame, joint = np.unravel_index(lowest.argmin(), lowest.shape)
        found.append(f"{JOINTS[joint]} is {-100 * lowest.min():.0f} cm too low in frame {frame}")
    ankles = joints[:, [RANK, LANK]]
    lift = ankles[..., 2] - ANKLE_HEIGHT
    pelvis, thorax = joints[:, PELV, 2], joints[:, THRX, 2]
    upright = (pelvis > STANDS) & (thorax > pelvis + UPRIGHT)
    floating = upright & (lift.min(1) > LOWEST_FOOT)
    if floating.any():
        found.append(f"stands on nothing in frame {int(floating.argmax())}")
    stands = np.abs(lift) < CONTACT
    for foot, name in enumerate(_SIDE_NAMES):
        stance = np.cumsum(~stands[:, foot])
        same = stance[:, None] == stance[None]
        same &= stands[:, foot, None] & stands[None, :, foot]
        places = ankles[:, foot, :2]
        slide = np.linalg.norm(places[:, None] - places[None], axis=-1)[same].max(initial=0.0)
        if slide > LARGEST_SLIDE:
            found.append(f"{name} foot slides by {100 * slide:.0f} cm")
    return found


def motion_faults(joints: ArrayLike, *, fps: float) -> list[str]:
    """Joints (n, 16, 3) that move too fast, and bones that change length.

    Parameters
    ----------
    joints : (n, 16, 3) float
        Metres.
    fps : float
        Frames per second.

    Returns
    -------
    list of str
    """
    joints = np.asarray(joints, float)
    speed = np.linalg.norm(np.diff(joints, axis=0), axis=-1) * fps
    limit = np.full(len(JOINTS), FASTEST_JOINT)
    limit[PELV] = FASTEST_PELVIS
    found = [
        f"{JOINTS[j]} moves at {speed[:, j].max():.1f} m/s in frame {speed[:, j].argmax()}"
        for j in np.flatnonzero((speed > limit).any(0))
    ]
    far, near = np.array(BONES).T
    length = np.linalg.norm(joints[:, far] - joints[:, near], axis=-1)
    change = np.abs(length - np.median(length, axis=0)).max(0)
    return found + [
        f"{_bone(b)} changes its length by {100 * change[b]:.0f} cm"
        for b in np.flatnonzero(change > LARGEST_STRETCH).tolist()
    ]


def furniture_faults(joints: ArrayLike, objects: Iterable[SceneObject]) -> list[str]:
    """Bones of a body (n, 16, 3) inside furniture.

    Parameters
    ----------
    joints : (n, 16, 3) float
        Metres.
    objects : iterable of SceneObject

    Returns
    -------
    list of str
    """
    joints = np.asarray(joints, float)
    found = []
    for piece in objects:
        depth = depth_inside(joints, piece)
        worst = depth.max(0)
        found += [
            f"{_bone(b)} is {100 * worst[b, k]:.0f} cm inside the {piece.cuboids[k].part} of the "
            f"{piece.label} in frame {depth[:, b, k].argmax()}"
            for b, k in np.argwhere(worst > DEEPEST).tolist()
        ]
    return found


def depth_inside(joints: ArrayLike, piece: SceneObject) -> Array:
    """Distance by which bones would have to move to be outside each cuboid of an object.

    A segment and a box are disjoint if and only if they are separated along a normal of the box or
    along a direction perpendicular to the segment and an edge; the smallest overlap along any of
    these is the distance. Unlike the depth of points on the segment, it is not limited to half the
    thickness of a board: an arm through a shelf is as deep as its hand is beyond.

    Parameters
    ----------
    joints : (n, 16, 3) float
        Metres, in the parent frame of ``piece``.
    piece : SceneObject
        With K cuboids.

    Returns
    -------
    (n, 15, K) float
        Metres, for each bone of :data:`~imapper_prob.models.skeleton.BONES`; not positive (and not
        a distance) if it is outside.
    """
    joints = np.asarray(joints, float)
    at = piece.placement
    local = joints - (at.x, at.y, 0.0)
    local[..., :2] = local[..., :2] @ at.rotation
    far, near = np.array(BONES).T
    middle = (local[:, far] + local[:, near])[:, :, None] / 2
    half = ((local[:, far] - local[:, near]) / 2)[:, :, None]
    centres = np.array([c.centre for c in piece.cuboids])
    extents = np.array([c.size / 2 for c in piece.cuboids])
    offset = middle - centres
    depth: Array = (extents + np.abs(half) - np.abs(offset)).min(-1)
    frame, bone, cuboid = np.nonzero(depth > 0)
    if len(frame):
        line, apart = half[frame, bone, 0], offset[frame, bone, cuboid]
        for edge in np.eye(3):
            across = np.cross(edge, line)
            size = np.linalg.norm(across, axis=-1)
            overlap = _dot(extents[cuboid], np.abs(across)) - np.abs(_dot(apart, across))
            overlap = np.where(size > 1e-9, overlap / np.maximum(size, 1e-9), np.inf)
            depth[frame, bone, cuboid] = np.minimum(depth[frame, bone, cuboid], overlap)
    return depth


def _dot(a: Array, b: Array) -> Array:
    product: Array = (a * b).sum(-1)
    return product


def _unit(vectors: Array) -> Array:
    direction: Array = vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)
    return direction


def _between(a: Array, b: Array) -> Array:
    angle: Array = np.arccos(np.clip(_dot(a, b), -1.0, 1.0))
    return angle


def _outside(what: str, angles: Array, limits: Sequence[float]) -> list[str]:
    """A sentence for each side whose angles (n,) or (n, 2) in radians exceed a range in degrees."""
    degrees = np.degrees(angles).reshape(len(angles), -1)
    low, high = limits
    beyond = np.maximum(degrees - high, low - degrees)
    sides = [""] if degrees.shape[1] == 1 else [f"{name} " for name in _SIDE_NAMES]
    return [
        f"{sides[k]}{what} {degrees[t, k]:.0f} degrees in frame {t}"
        for k, t in enumerate(beyond.argmax(0))
        if beyond[t, k] > MEASURED_WITHIN
    ]


def _bone(index: int) -> str:
    far, near = BONES[index]
    return f"{JOINTS[far]}-{JOINTS[near]}"
