"""The body that performs recipes: sixteen joints from trunk, ankles and wrists, and noise.

Segment lengths are fixed parts of stature (Drillis and Contini 1966), so a person of any stature is
the reference body in a room that has shrunk or grown. Recipes pose the reference body only, among
furniture that :meth:`Person.sees`; the catalogue undoes the scaling of the furniture. Motions of
the library are all of the reference body, while how high a seat is for whoever sits there varies as
it does among people.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.scene import SceneObject
from imapper_prob.models.skeleton import (
    BONE_LENGTHS,
    HEAD,
    LANK,
    LELB,
    LHIP,
    LKNE,
    LSHO,
    LWRI,
    N_JOINTS,
    NECK,
    PELV,
    RANK,
    REFERENCE_STATURE,
    RELB,
    RHIP,
    RKNE,
    RSHO,
    RWRI,
    THRX,
)
from imapper_prob.scenelets.frames import resized

__all__ = [
    "ANKLE_HEIGHT",
    "ELBOWS",
    "FRAMES_PER_SECOND",
    "HIPS",
    "HIP_HEIGHT",
    "SIDES",
    "TRACKER_ERROR",
    "TRACKER_MEMORY",
    "Drawn",
    "Person",
    "Recipe",
    "Trunk",
    "as_tracked",
    "backwards",
    "draw_person",
    "hanging_wrists",
    "knees_of",
    "moments",
    "pair",
    "pose_body",
    "reachable_height",
    "two_bones",
]

Array = NDArray[np.float64]
TRACKER_ERROR: Final = 0.008
"""Metres, root mean square of a joint's error in space: between markers on the skin (a few
millimetres) and depth cameras (a few centimetres)."""
TRACKER_MEMORY: Final = 0.3
"""Seconds over which an error is forgotten: skin and clothes move with the limb."""


def as_tracked(rng: np.random.Generator, joints: ArrayLike, *, fps: float) -> Array:
    """Joints with smooth errors, independent between joints and axes.

    The errors are a Gaussian process with the Matérn covariance of smoothness 3/2, which moves
    without jerks but is not as stiff as a sine.

    Parameters
    ----------
    rng : numpy.random.Generator
    joints : (n, 16, 3) float
        Metres.
    fps : float
        Frames a second.

    Returns
    -------
    (n, 16, 3) float
        Metres.
    """
    joints = np.asarray(joints, float)
    n_frames, *rest = joints.shape
    frames = np.arange(n_frames)
    lag = np.sqrt(3) * np.abs(frames[:, None] - frames) / (fps * TRACKER_MEMORY)
    spread = np.linalg.cholesky((1 + lag) * np.exp(-lag))
    errors = spread @ rng.standard_normal((n_frames, int(np.prod(rest))))
    noisy: Array = joints + TRACKER_ERROR / np.sqrt(3) * errors.reshape(joints.shape)
    return noisy


# ------------------------------------------------------------------------------------------------
# People: a stature, and furniture as seen from it.

STATURE: Final = (1.70, 0.07)
"""Mean and standard deviation in metres over adults of both sexes (Pheasant and Haslegrave,
*Bodyspace*, 2005)."""
STATURE_RANGE: Final = (1.55, 1.85)
"""Shortest and tallest performer, metres; beyond, furniture of usual sizes no longer fits."""


@dataclass(frozen=True)
class Person:
    """Somebody of a stature in metres.

    Parameters
    ----------
    stature : float
        Metres.
    """

    stature: float

    def sees(self, piece: SceneObject) -> SceneObject:
        """Furniture in units in which this person is of the reference stature.

        Parameters
        ----------
        piece : SceneObject

        Returns
        -------
        SceneObject
        """
        return resized(piece, REFERENCE_STATURE / self.stature)

    def returns(self, piece: SceneObject) -> SceneObject:
        """Furniture in metres again.

        Parameters
        ----------
        piece : SceneObject

        Returns
        -------
        SceneObject
        """
        return resized(piece, self.stature / REFERENCE_STATURE)


def draw_person(rng: np.random.Generator) -> Person:
    """An adult.

    Parameters
    ----------
    rng : numpy.random.Generator

    Returns
    -------
    Person
    """
    return Person(float(np.clip(rng.normal(*STATURE), *STATURE_RANGE)))


# ------------------------------------------------------------------------------------------------
# Poses of the reference body.
#
# The trunk is posed directly; arms and legs follow by two-bone inverse kinematics, so that every
# bone keeps the length of :data:`~imapper_prob.models.skeleton.BONE_LENGTHS` in every frame.
# Metres, radians, z up; n frames; sides are ordered (right, left).

SHIN: Final = BONE_LENGTHS[RANK, RKNE]
THIGH: Final = BONE_LENGTHS[RKNE, RHIP]
UPPER_ARM: Final = BONE_LENGTHS[RSHO, RELB]
FOREARM: Final = BONE_LENGTHS[RELB, RWRI]
TRUNK: Final = BONE_LENGTHS[PELV, THRX]
NECK_AND_HEAD: Final = BONE_LENGTHS[THRX, HEAD]
HALF_HIPS: Final = BONE_LENGTHS[RHIP, LHIP] / 2
ANKLE_HEIGHT: Final = 0.085
"""Ankle joint above the floor of a flat foot, metres: .039 H of a shod 1.70 m adult plus
the sole (Winter, *Biomechanics and Motor Control of Human Movement*, fig. 4.1)."""
STRAIGHTEST: Final = 0.995
"""Longest reach of a limb as part of its length: people do not lock knees and elbows."""
HIP_HEIGHT: Final = ANKLE_HEIGHT + STRAIGHTEST * (SHIN + THIGH) - 0.01
"""Hip joints above the floor of somebody who stands, metres; the last centimetre is what
standing with the feet apart costs."""
LARGEST_FLEXION: Final = np.deg2rad(150.0)
"""Knees and elbows bend no further (American Academy of Orthopaedic Surgeons, 1965)."""
ELBOWS: Final = (0.5, -0.7, -0.5)
"""Where the elbows of arms at work point: outward, forward (they point back) and up."""
SIDES: Final = np.array([1.0, -1.0])
"""Sign of the sideways coordinate of the right and the left limb."""
_UP: Final = np.array([0.0, 0.0, 1.0])


def pair(across: ArrayLike, forward: ArrayLike, up: ArrayLike) -> Array:
    """(2, 3) places of two limbs of which the left one mirrors the right one.

    Parameters
    ----------
    across : () or (2,) float
        Away from the middle, metres.
    forward, up : () or (2,) float
        Metres.

    Returns
    -------
    (2, 3) float
        Right, forward and up of the right limb, and of the left one.
    """
    rest = (np.broadcast_to(np.asarray(v, float), 2) for v in (forward, up))
    return np.stack([SIDES * np.asarray(across, float), *rest], -1)


HIPS: Final = pair(HALF_HIPS, 0.0, 0.0)
"""Hip joints from the pelvis, metres."""


@dataclass(frozen=True)
class Trunk:
    """Pelvis, chest and head over n frames.

    Parameters
    ----------
    pelvis : (n, 3) float
        Middle of the hip joints.
    yaw : (n,) float
        Where the pelvis faces: 0 is +y, counter-clockwise.
    lean, tilt, twist, nod : (n,) float
        Trunk bent forward and to the right, shoulders turned to the left against the
        pelvis, head bent forward against the trunk.
    """

    pelvis: Array
    yaw: Array
    lean: Array
    tilt: Array
    twist: Array
    nod: Array

    @classmethod
    def of(
        cls,
        pelvis: ArrayLike,
        yaw: ArrayLike,
        *,
        lean: ArrayLike = 0.0,
        tilt: ArrayLike = 0.0,
        twist: ArrayLike = 0.0,
        nod: ArrayLike = 0.0,
    ) -> Trunk:
        """A trunk from arrays or constants, which hold for all frames of ``pelvis``.

        Parameters
        ----------
        pelvis : (n, 3) float
            Metres.
        yaw, lean, tilt, twist, nod : (n,) or () float
            Radians, see :class:`Trunk`.

        Returns
        -------
        Trunk
        """
        pelvis = np.asarray(pelvis, float)
        angles = [np.broadcast_to(np.asarray(a, float), len(pelvis)) for a in (yaw, lean, tilt)]
        more = [np.broadcast_to(np.asarray(a, float), len(pelvis)) for a in (twist, nod)]
        return cls(pelvis, *angles, *more)

    @cached_property
    def right(self) -> Array:
        """(n, 3) from the left hip to the right one, unit length."""
        return np.stack([np.cos(self.yaw), np.sin(self.yaw), np.zeros_like(self.yaw)], -1)

    @cached_property
    def forward(self) -> Array:
        """(n, 3) where the pelvis faces, unit length, level."""
        return np.stack([-np.sin(self.yaw), np.cos(self.yaw), np.zeros_like(self.yaw)], -1)

    def at_pelvis(self, offsets: ArrayLike) -> Array:
        """(n, 2, 3) or (2, 3) offsets (right, forward, up) from the pelvis to positions.

        Parameters
        ----------
        offsets : (..., 3) float
            Right, forward, up, metres.

        Returns
        -------
        (..., 3) float
        """
        axes = np.stack([self.right, self.forward, np.broadcast_to(_UP, self.pelvis.shape)], 1)
        offsets = np.broadcast_to(np.asarray(offsets, float), (len(axes), 2, 3))
        positions: Array = self.pelvis[:, None] + offsets @ axes
        return positions

    def directions(self, offsets: ArrayLike) -> Array:
        """(n, 2, 3) or (2, 3) directions (right, forward, up) of the pelvis in the frame.

        Parameters
        ----------
        offsets : (..., 3) float
            Right, forward, up, metres.

        Returns
        -------
        (..., 3) float
        """
        return self.at_pelvis(offsets) - self.pelvis[:, None]

    @property
    def hips(self) -> Array:
        """(n, 2, 3) hip joints."""
        half = BONE_LENGTHS[RHIP, LHIP] / 2
        hips: Array = self.pelvis[:, None] + half * SIDES[:, None] * self.right[:, None]
        return hips

    @cached_property
    def spine(self) -> Array:
        """(n, 3) from the pelvis to the middle of the shoulders, unit length."""
        level = np.sin(self.lean)[:, None] * self.forward + np.sin(self.tilt)[:, None] * self.right
        up = np.sqrt(np.clip(1 - (level**2).sum(-1, keepdims=True), 0.0, 1.0))
        spine: Array = level + up * _UP
        return spine

    @property
    def thorax(self) -> Array:
        """(n, 3) middle of the shoulders."""
        return self.pelvis + TRUNK * self.spine

    @property
    def head(self) -> Array:
        """(n, 3) middle of the head."""
        bent = self.lean + self.nod
        # The head rights itself against half of what the trunk is tilted.
        aside = np.sin(self.tilt / 2)[:, None] * self.right
        direction = np.sin(bent)[:, None] * self.forward + np.cos(bent)[:, None] * _UP + aside
        direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
        head: Array = self.thorax + NECK_AND_HEAD * direction
        return head

    @property
    def shoulders(self) -> Array:
        """(n, 2, 3) shoulder joints, on a line across the spine."""
        turned = (
            np.cos(self.twist)[:, None] * self.right + np.sin(self.twist)[:, None] * self.forward
        )
        across = turned - (turned * self.spine).sum(-1, keepdims=True) * self.spine
        across /= np.linalg.norm(across, axis=-1, keepdims=True)
        half = BONE_LENGTHS[RSHO, LSHO] / 2
        shoulders: Array = self.thorax[:, None] + half * SIDES[:, None] * across[:, None]
        return shoulders


def two_bones(
    root: ArrayLike, target: ArrayLike, pole: ArrayLike, *, upper: float, lower: float
) -> tuple[Array, Array]:
    """The middle and end joint of a limb that reaches from ``root`` for ``target``.

    Parameters
    ----------
    root, target : (..., 3) float
        Fixed joint, and where the end should be, metres. A target out of reach is
        approached along the straight line.
    pole : (..., 3) float
        Direction the middle joint bends to; need not be a right angle to the limb.
    upper, lower : float
        Bone lengths in metres.

    Returns
    -------
    middle, end : (..., 3) float
        Metres; the bone lengths hold exactly.
    """
    root, target, pole = (np.asarray(a, float) for a in (root, target, pole))
    offset = target - root
    distance = np.linalg.norm(offset, axis=-1, keepdims=True)
    axis = offset / np.maximum(distance, 1e-9)
    shortest = np.sqrt(upper**2 + lower**2 + 2 * upper * lower * np.cos(LARGEST_FLEXION))
    reach = np.clip(distance, shortest, STRAIGHTEST * (upper + lower))
    along = (upper**2 - lower**2 + reach**2) / (2 * reach)
    bend = pole - (pole * axis).sum(-1, keepdims=True) * axis
    bend = bend / np.maximum(np.linalg.norm(bend, axis=-1, keepdims=True), 1e-9)
    middle = root + along * axis + np.sqrt(np.maximum(upper**2 - along**2, 0.0)) * bend
    return middle, root + reach * axis


def knees_of(ankles: ArrayLike, directions: ArrayLike, *, hips: ArrayLike = HIPS) -> Array:
    """Knees between hips and ankles: both, or one where ``hips`` is one.

    Parameters
    ----------
    ankles : (2, 3) or (3,) float
        Right, forward and up of the pelvis, metres.
    directions : (2, 3) or (3,) float
        Where the knees point.
    hips : (2, 3) or (3,) float
        As ankles.

    Returns
    -------
    (2, 3) or (3,) float
        As ankles.
    """
    knees, _ = two_bones(hips, ankles, directions, upper=THIGH, lower=SHIN)
    return knees


def reachable_height(trunk: Trunk, ankles: ArrayLike) -> Array:
    """(n,) greatest height in metres of the pelvis at which both ankles (n, 2, 3) are in reach.

    Parameters
    ----------
    trunk : Trunk
    ankles : (n, 2, 3) float
        Metres.

    Returns
    -------
    (n,) float
    """
    ankles = np.asarray(ankles, float)
    level = ((trunk.hips - ankles)[..., :2] ** 2).sum(-1)
    reach = STRAIGHTEST * (SHIN + THIGH)
    height: Array = (ankles[..., 2] + np.sqrt(np.maximum(reach**2 - level, 0.0))).min(1)
    return height


def hanging_wrists(trunk: Trunk, swing: ArrayLike = 0.0, *, bend: float = 0.06) -> Array:
    """(n, 2, 3) wrists of arms that hang from the shoulders.

    Parameters
    ----------
    trunk : Trunk
    swing : (n, 2) float
        Angle of the arms forward of the vertical, radians.
    bend : float
        How much of its length the arm gives up to a bent elbow.

    Returns
    -------
    (n, 2, 3) float
    """
    swing = np.broadcast_to(np.asarray(swing, float), (len(trunk.yaw), 2))[..., None]
    down = np.sin(swing) * trunk.forward[:, None] - np.cos(swing) * _UP
    outward = 0.12 * SIDES[:, None] * trunk.right[:, None]  # the hands clear the hips
    direction = down + outward
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    hands: Array = trunk.shoulders + (1 - bend) * (UPPER_ARM + FOREARM) * direction
    return hands


def pose_body(
    trunk: Trunk,
    *,
    ankles: ArrayLike,
    wrists: ArrayLike,
    elbows: ArrayLike = ELBOWS,
    knees: ArrayLike | None = None,
) -> Array:
    """All joints, from the trunk and where hands and feet are.

    Parameters
    ----------
    trunk : Trunk
        Of n frames.
    ankles, wrists : (n, 2, 3) float
        Targets in metres, right then left.
    elbows : (3,) or (2, 3) float
        Where elbows point: outward, forward and up, or right, forward and up one by one.
    knees : (2, 3) float, optional
        Where knees point: right, forward and up. Forward and a little up, if not given.

    Returns
    -------
    (n, 16, 3) float
        Joints in metres, in the frame of the trunk.
    """
    forward, outward = trunk.forward[:, None], SIDES[:, None] * trunk.right[:, None]
    # Knees bend forward and, when the thigh is level, up.
    ahead = forward + 0.5 * _UP + 0.12 * outward if knees is None else trunk.directions(knees)
    bent_knees, ankles = two_bones(trunk.hips, ankles, ahead, upper=THIGH, lower=SHIN)
    elbows = np.asarray(elbows, float)
    if elbows.ndim == 1:
        aside = elbows[0] * outward + elbows[1] * forward + elbows[2] * _UP
    else:
        aside = trunk.directions(elbows)
    bent, wrists = two_bones(trunk.shoulders, wrists, aside, upper=UPPER_ARM, lower=FOREARM)
    joints = np.zeros((len(trunk.yaw), N_JOINTS, 3))
    joints[:, PELV], joints[:, THRX], joints[:, HEAD] = trunk.pelvis, trunk.thorax, trunk.head
    joints[:, NECK] = (trunk.thorax + trunk.head) / 2
    for pair, positions in (
        ((RHIP, LHIP), trunk.hips),
        ((RKNE, LKNE), bent_knees),
        ((RANK, LANK), ankles),
        ((RSHO, LSHO), trunk.shoulders),
        ((RELB, LELB), bent),
        ((RWRI, LWRI), wrists),
    ):
        joints[:, pair] = positions
    return joints


# ------------------------------------------------------------------------------------------------
# Performances.

FRAMES_PER_SECOND: Final = 10.0
"""Of i3DB, and fast enough for everything people do in a room."""


class Drawn(NamedTuple):
    """One motion and its furniture, in a common frame and in the units of a person.

    Parameters
    ----------
    joints : (n, 16, 3) float
        Metres.
    objects : tuple of SceneObject
    """

    joints: Array
    objects: tuple[SceneObject, ...]


Recipe = Callable[[np.random.Generator, Person], Drawn]
"""Draws a motion of the reference body among furniture as the person sees it."""


def backwards(recipe: Recipe) -> Recipe:
    """The same motions played backwards, as standing up is sitting down.

    Parameters
    ----------
    recipe : Recipe

    Returns
    -------
    Recipe
    """

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        joints, objects = recipe(rng, person)
        return Drawn(joints[::-1], objects)

    return draw


def moments(rng: np.random.Generator, fewest: int, most: int) -> Array:
    """(n,) times in seconds of a clip of ``fewest`` to ``most`` frames.

    Parameters
    ----------
    rng : numpy.random.Generator
    fewest : int
    most : int

    Returns
    -------
    (n,) float
    """
    return np.arange(int(rng.integers(fewest, most + 1))) / FRAMES_PER_SECOND
