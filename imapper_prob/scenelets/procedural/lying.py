"""Lying on the back or on the side: motions and recipes.

A lying body is posed as an upright one and then turned over: the trunk is posed along +z, the limbs
reach for where they rest on the mattress, and the whole body is turned about the pelvis. The
sleeper's frame has the pelvis above its origin, the head towards -y, the feet towards +y, and z as
height above the mattress. Units are metres and radians; pairs are (right, left).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import Cuboid, Placement
from imapper_prob.models.skeleton import BONE_LENGTHS, LELB, LSHO, RELB, RSHO
from imapper_prob.scenelets.procedural import furniture
from imapper_prob.scenelets.procedural.body import (
    FOREARM,
    NECK_AND_HEAD,
    TRUNK,
    UPPER_ARM,
    Drawn,
    Person,
    Trunk,
    moments,
    pair,
    pose_body,
    two_bones,
)

__all__ = ["lie_on_bed", "lie_on_couch", "lie_still"]

Array = NDArray[np.float64]
_HEAD_AT: Final = TRUNK + NECK_AND_HEAD
"""Distance in metres from the pelvis to the head."""
_LIMBS_END: Final = 0.12
"""Metres from the middle of the head to its crown, and from ankle to sole: half the height of a
head, and half the length of a foot (*Bodyspace*)."""
BACK_DEPTH: Final = 0.10
"""Metres from the line of the joints to the back of the trunk (Pheasant and Haslegrave,
*Bodyspace*, 2005), which is the height of the trunk above what it lies on."""
LIMB_DEPTH: Final = 0.05
"""Metres from the line of the joints to the skin of arms and shins (*Bodyspace*)."""
PILLOW: Final = 0.25
"""Angle in radians by which a pillow of some 8 cm bends the head forward."""
_ELBOWS_ON_BACK: Final = np.array([[1.0, 0.3, 0.1], [-1.0, 0.3, 0.1]])
_ELBOWS_ON_SIDE: Final = np.array([[0.3, 1.0, 0.2], [0.0, 0.3, 1.0]])
"""Directions in the sleeper's frame towards which the right and the left elbow point."""


def _turned_over(roll: float) -> Array:
    """(3, 3) matrix whose rows are the body's right, front and up in the sleeper's frame.

    ``roll`` is in radians: 0 on the back, positive towards the right side.
    """
    c, s = np.cos(roll), np.sin(roll)
    return np.array([[c, 0.0, -s], [s, 0.0, c], [0.0, -1.0, 0.0]])


def _resting_legs(rng: np.random.Generator, roll: float) -> Array:
    """(2, 3) ankles in the sleeper's frame."""
    if roll > 0:
        # The lower leg is straighter; the upper one rests in front of it.
        lower, upper = rng.uniform(0.62, 0.76), rng.uniform(0.48, 0.62)
        front = rng.uniform(0.05, 0.12)
        return np.array([[0.0, lower, LIMB_DEPTH], [front + 0.06, upper, LIMB_DEPTH + 0.08]])
    straight = rng.uniform(0.79, 0.81, 2)
    bent = rng.random(2) < 0.25
    along = np.where(bent, rng.uniform(0.40, 0.55, 2), straight)
    return pair(rng.uniform(0.08, 0.16), along, LIMB_DEPTH + 0.02)


def _resting_hands(rng: np.random.Generator, roll: float) -> Array:
    """(2, 3) wrists in the sleeper's frame."""
    if roll > 0:
        # The lower hand is in front of the face, the upper one in front of the chest or on the
        # thigh.
        upper = [0.12, 0.05, 0.26] if rng.random() < 0.4 else [0.36, -0.28, LIMB_DEPTH + 0.02]
        return np.array([[0.34, -0.50, LIMB_DEPTH + 0.02], upper])
    if rng.random() < 0.5:  # alongside the body
        across = rng.uniform(0.26, 0.34, 2)
        along = rng.uniform(-0.04, 0.02, 2)
        return pair(across, along, LIMB_DEPTH + 0.02)
    belly = rng.uniform(-0.22, -0.10, 2)
    return pair(rng.uniform(0.03, 0.10, 2), belly, 0.23)


def lie_still(
    rng: np.random.Generator,
    times: Array,
    *,
    on_side: bool,
    room: float,
    pillow: float = PILLOW,
) -> Array:
    """(n, 16, 3) joints of a lying person, in the sleeper's frame.

    Parameters
    ----------
    rng : numpy.random.Generator
    times : (n,) float
        Seconds.
    on_side : bool
        Whether the person lies on the right side rather than on the back. The trunk is then rolled
        by 50 to 70 degrees, since nobody lies exactly on edge.
    room : float
        Greatest distance from the pelvis to the ankles, metres; the knees bend if it is short.
    pillow : float
        Angle in radians by which the surface below the head bends it forward.

    Returns
    -------
    (n, 16, 3) float
    """
    roll = np.deg2rad(rng.uniform(50, 70)) if on_side else 0.0
    body = _turned_over(roll)
    half_shoulders = BONE_LENGTHS[RSHO, LSHO] / 2
    # On the side, the lower shoulder carries the trunk and the pelvis is higher accordingly.
    height = max(BACK_DEPTH, LIMB_DEPTH + half_shoulders * np.sin(roll))
    pelvis = np.array([0.0, 0.0, height])
    breath = 2 * np.pi * (times / rng.uniform(3.0, 5.0) + rng.random())
    trunk = Trunk.of(np.zeros((len(times), 3)), 0.0, nod=pillow + 0.01 * np.sin(breath))
    resting = _resting_legs(rng, roll)
    resting[:, 1] = np.minimum(resting[:, 1], room)
    ankles = (resting - pelvis) @ body.T
    wrists = (_resting_hands(rng, roll) - pelvis) @ body.T
    moved = wrists + 0.008 * np.sin(breath)[:, None, None] * [0.0, 1.0, 0.0]
    joints = pose_body(trunk, ankles=np.broadcast_to(ankles, moved.shape), wrists=moved)
    # The mattress keeps the elbows from pointing backwards, as they do in an upright body. They
    # point to the sides, or to the front of a person who lies on the side.
    poles = _ELBOWS_ON_SIDE if on_side else _ELBOWS_ON_BACK
    elbows, _ = two_bones(trunk.shoulders, moved, poles @ body.T, upper=UPPER_ARM, lower=FOREARM)
    joints[:, [RELB, LELB]] = elbows
    lying: Array = joints @ body + pelvis
    return lying


# ------------------------------------------------------------------------------------------------
# Recipes.


def lie_on_bed(rng: np.random.Generator, person: Person) -> Drawn:
    """Lying on a bed on the back or side, with the head at the headboard.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person

    Returns
    -------
    Drawn
    """
    bed = person.sees(furniture.bed(rng))
    seat = furniture.seat_part(bed)
    width, length, _ = seat.size
    aside = max(width / 2 - 0.40, 0.0)  # both arms stay on the mattress
    head = _LIMBS_END + rng.uniform(0.03, 0.15)
    at = Placement(
        float(rng.uniform(-aside, aside)),
        float(seat.centre[1] - length / 2 + head + _HEAD_AT),
        float(rng.normal(0.0, 0.05)),
    )
    joints = lie_still(
        rng,
        moments(rng, 15, 20),
        on_side=bool(rng.random() < 0.5),
        room=float(length - head - _HEAD_AT - _LIMBS_END),
    )
    return Drawn(at.apply(joints + _surface(seat)), (bed,))


def lie_on_couch(rng: np.random.Generator, person: Person) -> Drawn:
    """Lying along a three-seat couch, on the back, or on the side facing the room.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person

    Returns
    -------
    Drawn
    """
    couch = person.sees(furniture.couch(rng, seats=3))
    seat = furniture.seat_part(couch)
    width = seat.size[0]
    head = _LIMBS_END + rng.uniform(0.02, 0.06)
    on_side = bool(rng.random() < 0.5)
    # With the right side down, a person faces the room when the head is at the +x end.
    end = 1 if on_side else int(rng.choice([-1, 1]))
    at = Placement(
        float(end * (width / 2 - head - _HEAD_AT)), float(seat.centre[1] + 0.04), end * np.pi / 2
    )
    joints = lie_still(
        rng,
        moments(rng, 15, 20),
        on_side=on_side,
        room=float(width - head - _HEAD_AT - _LIMBS_END),
    )
    return Drawn(at.apply(joints + _surface(seat)), (couch,))


def _surface(seat: Cuboid) -> NDArray[np.float64]:
    """(3,) vector from the floor up to the surface that one lies on, metres."""
    return np.array([0.0, 0.0, seat.centre[2] + seat.size[2] / 2])
