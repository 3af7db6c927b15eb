"""The body of recipes: sixteen joints by inverse kinematics from trunk, ankles and wrists; noise.

Segment lengths are fixed fractions of stature (Drillis and Contini 1966), so a person of any
stature is the reference body in a scaled room. Recipes pose only the reference body, among the
furniture of :meth:`Person.sees`. So all scenelets are of the reference body, and the height of a
seat relative to the person varies as among people.
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
"""Root mean square error of a tracked joint in metres: between that of markers on the skin (a few
millimetres) and that of depth cameras (a few centimetres)."""
TRACKER_MEMORY: Final = 0.3
"""Correlation time of the error in seconds, because skin and clothes move with the limb."""


def as_tracked(rng: np.random.Generator, joints: ArrayLike, *, fps: float) -> Array:
    """Add smooth errors to joints, independent between joints and axes.

    The errors are a Gaussian process with Matérn 3/2 covariance.

    Parameters
    ----------
    rng : numpy.random.Generator
    joints : (n, 16, 3) float
        Metres.
    fps : float
        Frames per second.

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
# People of a given stature, and furniture in their scale.

STATURE: Final = (1.70, 0.07)
"""Mean and standard deviation in metres over adults of both sexes (Pheasant and Haslegrave,
*Bodyspace*, 2005)."""
STATURE_RANGE: Final = (1.55, 1.85)
"""Range of statures in metres; beyond it, furniture of usual sizes does not fit."""


@dataclass(frozen=True)
class Person:
    """A person of a given stature.

    Parameters
    ----------
    stature : float
        Metres.
    """

    stature: float

    def sees(self, piece: SceneObject) -> SceneObject:
        """Furniture in the scale in which this person has the reference stature.

        Parameters
        ----------
        piece : SceneObject

        Returns
        -------
        SceneObject
        """
        return piece.scaled(REFERENCE_STATURE / self.stature)


def draw_person(rng: np.random.Generator) -> Person:
    """Draw an adult.

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
"""Height of the ankle joint above the floor in a flat foot, metres: .039 H of a 1.70 m adult plus
the sole of a shoe (Winter, *Biomechanics and Motor Control of Human Movement*, fig. 4.1)."""
STRAIGHTEST: Final = 0.995
"""Longest reach of a limb relative to its length: people do not lock knees and elbows."""
HIP_HEIGHT: Final = ANKLE_HEIGHT + STRAIGHTEST * (SHIN + THIGH) - 0.01
"""Height of the hip joints of a standing person, metres; reduced by a centimetre because the feet
are apart."""
LARGEST_FLEXION: Final = np.deg2rad(150.0)
"""Largest flexion of knees and elbows (American Academy of Orthopaedic Surgeons, 1965)."""
ELBOWS: Final = (0.5, -0.7, -0.5)
"""Direction of the elbows of working arms: outward, forward (negative, so backward) and up."""
SIDES: Final = np.array([1.0, -1.0])
"""Sign of the sideways coordinate for the right and the left limb."""
_UP: Final = np.array([0.0, 0.0, 1.0])


def pair(across: ArrayLike, forward: ArrayLike, up: ArrayLike) -> Array:
    """(2, 3) mirror-symmetric positions of a right and a left limb.

    Parameters
    ----------
    across : () or (2,) float
        Distance from the middle, metres.
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
"""Positions of the hip joints relative to the pelvis, metres."""


@dataclass(frozen=True)
class Trunk:
    """Pelvis, chest and head over n frames.

    Parameters
    ----------
    pelvis : (n, 3) float
        Middle of the hip joints.
    yaw : (n,) float
        Facing direction of the pelvis: 0 is +y, counter-clockwise.
    lean, tilt, twist, nod : (n,) float
        Bend of the trunk forward and to the right, rotation of the shoulders to the left relative
        to the pelvis, and bend of the head forward relative to the trunk.
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
        """Make a trunk from arrays, or from constants for all frames of ``pelvis``.

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
        """(n, 3) unit vector from the left to the right hip."""
        return np.stack([np.cos(self.yaw), np.sin(self.yaw), np.zeros_like(self.yaw)], -1)

    @cached_property
    def forward(self) -> Array:
        """(n, 3) unit vector in which the pelvis faces, horizontal."""
        return np.stack([-np.sin(self.yaw), np.cos(self.yaw), np.zeros_like(self.yaw)], -1)

    def at_pelvis(self, offsets: ArrayLike) -> Array:
        """Convert offsets from the pelvis (right, forward, up), (n, 2, 3) or (2, 3), to positions.

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
        """Convert directions relative to the pelvis, (n, 2, 3) or (2, 3), to the common frame.

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
        """(n, 3) unit vector from the pelvis to the middle of the shoulders."""
        level = np.sin(self.lean)[:, None] * self.forward + np.sin(self.tilt)[:, None] * self.right
        up = np.sqrt(np.clip(1 - (level**2).sum(-1, keepdims=True), 0.0, 1.0))
        spine: Array = level + up * _UP
        return spine

    @property
    def thorax(self) -> Array:
        """(n, 3) positions of the middle of the shoulders."""
        return self.pelvis + TRUNK * self.spine

    @property
    def head(self) -> Array:
        """(n, 3) positions of the middle of the head."""
        bent = self.lean + self.nod
        # The head compensates half of the trunk's tilt.
        aside = np.sin(self.tilt / 2)[:, None] * self.right
        direction = np.sin(bent)[:, None] * self.forward + np.cos(bent)[:, None] * _UP + aside
        direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
        head: Array = self.thorax + NECK_AND_HEAD * direction
        return head

    @property
    def shoulders(self) -> Array:
        """(n, 2, 3) positions of the shoulder joints, on a line perpendicular to the spine."""
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
    """Two-bone inverse kinematics: middle and end joint of a limb from ``root`` to ``target``.

    Parameters
    ----------
    root, target : (..., 3) float
        Fixed joint, and desired position of the end, metres. A target out of reach is approached
        along the straight line.
    pole : (..., 3) float
        Direction in which the middle joint bends; it need not be perpendicular to the limb.
    upper, lower : float
        Bone lengths in metres.

    Returns
    -------
    middle, end : (..., 3) float
        Metres; bone lengths are exact.
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
    """Knees between hips and ankles, for both legs or for one.

    Parameters
    ----------
    ankles : (2, 3) or (3,) float
        Right, forward and up of the pelvis, metres.
    directions : (2, 3) or (3,) float
        Directions of the knees.
    hips : (2, 3) or (3,) float
        As for ankles.

    Returns
    -------
    (2, 3) or (3,) float
        As for ankles.
    """
    knees, _ = two_bones(hips, ankles, directions, upper=THIGH, lower=SHIN)
    return knees


def reachable_height(trunk: Trunk, ankles: ArrayLike) -> Array:
    """(n,) largest height of the pelvis in metres at which both ankles (n, 2, 3) can be reached.

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
    """(n, 2, 3) wrists of hanging arms.

    Parameters
    ----------
    trunk : Trunk
    swing : (n, 2) float
        Angle of the arms forward of the vertical, radians.
    bend : float
        Relative shortening of the arm by a bent elbow.

    Returns
    -------
    (n, 2, 3) float
    """
    swing = np.broadcast_to(np.asarray(swing, float), (len(trunk.yaw), 2))[..., None]
    down = np.sin(swing) * trunk.forward[:, None] - np.cos(swing) * _UP
    outward = 0.12 * SIDES[:, None] * trunk.right[:, None]  # keeps the hands clear of the hips
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
    """Compute all joints from the trunk and the positions of hands and feet.

    Parameters
    ----------
    trunk : Trunk
        Of n frames.
    ankles, wrists : (n, 2, 3) float
        Targets in metres, right then left.
    elbows : (3,) or (2, 3) float
        Directions of the elbows: outward, forward and up; or right, forward and up for each.
    knees : (2, 3) float, optional
        Directions of the knees: right, forward and up. By default forward and a little up.

    Returns
    -------
    (n, 16, 3) float
        Joints in metres, in the frame of the trunk.
    """
    forward, outward = trunk.forward[:, None], SIDES[:, None] * trunk.right[:, None]
    # Knees bend forward, and up when the thigh is horizontal.
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
# Generated motions.

FRAMES_PER_SECOND: Final = 10.0
"""Frame rate of i3DB, fast enough for everything people do in a room."""


class Drawn(NamedTuple):
    """A motion and its furniture, in a common frame and in the person's scale.

    Parameters
    ----------
    joints : (n, 16, 3) float
        Metres.
    objects : tuple of SceneObject
    """

    joints: Array
    objects: tuple[SceneObject, ...]


Recipe = Callable[[np.random.Generator, Person], Drawn]
"""Draws a motion of the reference body among furniture in the person's scale."""


def backwards(recipe: Recipe) -> Recipe:
    """The same motions played backwards, e.g. standing up from sitting down.

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
    """(n,) times in seconds of a clip with ``fewest`` to ``most`` frames.

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
