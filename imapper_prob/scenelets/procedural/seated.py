"""Seated poses: where pelvis, trunk, feet and hands are on a given seat.

A pose is drawn in that order; each step is a function of the seat and of the pose so far. Units are
metres and radians; the frame is that of the seat, with its front towards +y. Pairs are (right,
left).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.scene import SceneObject
from imapper_prob.models.skeleton import BONE_LENGTHS, LHIP, RHIP
from imapper_prob.scenelets.procedural import furniture
from imapper_prob.scenelets.procedural.body import (
    ANKLE_HEIGHT,
    NECK_AND_HEAD,
    SHIN,
    SIDES,
    THIGH,
    TRUNK,
    Trunk,
    pair,
)

__all__ = [
    "BUTTOCK",
    "CHEST_HALF_DEPTH",
    "HIP_ABOVE_SEAT",
    "Seat",
    "SeatedPose",
    "at_table",
    "draw_hands",
    "draw_seated",
    "open_seat",
    "seat_of",
]


@dataclass(frozen=True)
class Seat:
    """The dimensions of a piece of furniture that matter for sitting on it.

    Parameters
    ----------
    height : float
        Height of its surface, metres.
    front, back : float
        The y of the front edge and of the face of the backrest (-inf without one), metres.
    closed : bool
        Whether the feet cannot go below it.
    deep : bool
        Whether it is a deep, soft seat such as a couch.
    arms : tuple of (float, float, float)
        The x of each armrest's middle, the y of its front, and the height of its top.
    """

    height: float
    front: float
    back: float
    closed: bool
    deep: bool
    arms: tuple[tuple[float, float, float], ...]


def seat_of(piece: SceneObject, *, edge: float | None = None) -> Seat:
    """The seat of a piece of furniture that stands at the origin.

    Parameters
    ----------
    piece : SceneObject
        Has a part named ``seat``.
    edge : float, optional
        The y in metres of the edge to sit on, if it is not the piece's own front, as for a bed.
        The rest of the bed is then behind the person and there is no backrest.

    Returns
    -------
    Seat
    """
    seat = furniture.seat_part(piece)
    low, high = seat.centre - seat.size / 2, seat.centre + seat.size / 2
    backs = [c.centre[1] + c.size[1] / 2 for c in piece.cuboids if c.part == "back"]
    arms = tuple(
        (
            float(c.centre[0]),
            float(c.centre[1] + c.size[1] / 2),
            float(c.centre[2] + c.size[2] / 2),
        )
        for c in piece.cuboids
        if c.part == "arm"
    )
    return Seat(
        height=float(high[2]),
        front=float(high[1]) if edge is None else edge,
        back=float(backs[0]) if backs and edge is None else -np.inf,
        closed=bool(low[2] < 0.3),
        deep=piece.label == "couch",
        arms=arms,
    )


def open_seat(height: float, *, front: float) -> Seat:
    """A seat without back or armrests, such as a floor or the middle of a bed.

    Parameters
    ----------
    height : float
        Metres.
    front : float
        The y in metres at which the seat ends in front.

    Returns
    -------
    Seat
    """
    return Seat(height=height, front=front, back=-np.inf, closed=False, deep=False, arms=())


# ------------------------------------------------------------------------------------------------
# Ways to sit.

Array = NDArray[np.float64]
HIP_ABOVE_SEAT: Final = 0.095
"""Height in metres of the hip joint above the seat's surface (trochanter height, sitting: Pheasant
and Haslegrave, *Bodyspace*, 2005)."""
CHEST_HALF_DEPTH: Final = 0.10
"""Metres from the line of the spine joints to the back of the body (*Bodyspace*)."""
BUTTOCK: Final = 0.13
"""Metres from the hip joint backwards to the end of the body (*Bodyspace*)."""
FURTHEST_LEAN: Final = 0.58
"""Greatest forward lean in radians. With level thighs, more would bend the hips beyond their range
of 125 degrees (American Academy of Orthopaedic Surgeons, 1965)."""
SQUARE: Final = 0.09
"""Standard deviation in radians of the yaw of a sitter relative to the seat: half of them are
within 4 degrees and 90 % within 11, as measured on i3DB."""
STIR: Final = 0.01
"""Amplitude in metres of the movement of a resting hand about its place."""
_ARM_REACH: Final = 0.46
"""Greatest sideways distance in metres from the pelvis to an armrest that is used."""


@dataclass(frozen=True)
class SeatedPose:
    """The pose of a person who sits, squats, kneels or otherwise does not stand on straight legs.

    Parameters
    ----------
    pelvis : (3,) float
        Metres.
    yaw : float
        Yaw of the pelvis, counter-clockwise; 0 faces the front of the seat.
    lean, twist, nod : float
        Angles of the trunk, as in :class:`~imapper_prob.scenelets.procedural.body.Trunk`.
    ankles : (2, 3) float
        Metres.
    hands : (2, 3) float
        Wrists relative to the pelvis: right, forward and up as the pelvis faces, metres. They are
        at the pelvis if not given.
    stir : (2,) float
        Amplitude of each hand's movement about its place, metres; that of rest if not given.
    tilt : float
        Sideways tilt of the trunk, as in the trunk's class.
    knees, elbows : (2, 3) float, optional
        Directions in which they point: right, forward and up as the pelvis faces. If not given,
        those of a sitter with the feet on the floor and the hands at work.
    """

    pelvis: Array
    yaw: float
    lean: float
    twist: float
    nod: float
    ankles: Array
    hands: Array = field(default_factory=lambda: np.zeros((2, 3)))
    stir: Array = field(default_factory=lambda: np.full(2, STIR))
    tilt: float = 0.0
    knees: Array | None = None
    elbows: Array | None = None

    def from_pelvis(self, points: ArrayLike) -> Array:
        """Positions (..., 3) in the seat's frame as right, forward and up from the pelvis.

        Parameters
        ----------
        points : (..., 3) float
            Metres.

        Returns
        -------
        (..., 3) float
        """
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        offset: Array = (np.asarray(points, float) - self.pelvis) @ [
            [c, -s, 0.0],
            [s, c, 0.0],
            [0.0, 0.0, 1.0],
        ]
        return offset

    def at_pelvis(self, offsets: ArrayLike) -> Array:
        """Offsets (..., 3) right, forward and up from the pelvis as positions in the seat's frame.

        Parameters
        ----------
        offsets : (..., 3) float
            Right, forward, up, metres.

        Returns
        -------
        (..., 3) float
        """
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        turn = [[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]
        positions: Array = self.pelvis + np.asarray(offsets, float) @ turn
        return positions

    def with_hands(self, hands: ArrayLike, stir: ArrayLike = STIR) -> SeatedPose:
        """The same pose with other hand positions.

        Parameters
        ----------
        hands : (2, 3) float
            Wrists from the pelvis, metres.
        stir : () or (2,) float
            Metres.

        Returns
        -------
        SeatedPose
        """
        return replace(self, hands=np.array(hands, float), stir=np.array(np.broadcast_to(stir, 2)))

    @property
    def trunk(self) -> Trunk:
        """The trunk of one frame, with the pelvis at the origin and its front towards +y."""
        angles = {"lean": self.lean, "tilt": self.tilt, "twist": self.twist, "nod": self.nod}
        return Trunk.of(np.zeros((1, 3)), 0.0, **angles)

    @property
    def head(self) -> tuple[float, float]:
        """Distances forward and up from the pelvis to the head, metres."""
        bent = self.lean + self.nod
        forward = TRUNK * np.sin(self.lean) + NECK_AND_HEAD * np.sin(bent)
        return float(forward), float(TRUNK * np.cos(self.lean) + NECK_AND_HEAD * np.cos(bent))


Step = Callable[[np.random.Generator, SeatedPose, Seat], SeatedPose]


def _knees_clear(seat: Seat, yaw: float) -> float:
    """The y of the pelvis, metres, at which both knees are in front of the seat's front edge."""
    half_hips = BONE_LENGTHS[RHIP, LHIP] / 2
    knees = THIGH * np.cos(yaw) - half_hips * abs(np.sin(yaw))
    # Thighs slope down from a seat that is higher than the shins are long.
    return float(seat.front - knees + max(seat.height - SHIN, 0.0))


def _place(
    rng: np.random.Generator, seat: Seat, *, sideways: float, yaw: float, lean: float
) -> SeatedPose:
    """A pose with pelvis and trunk on the seat; feet and hands are still to be placed."""
    # A person who leans forward sits nearer the front; the hips stay on the seat, clear of its
    # back.
    innermost = max(seat.back + BUTTOCK, seat.front - 0.40)
    if seat.closed:
        innermost = max(innermost, _knees_clear(seat, yaw))
    forward = rng.normal(0.07 if lean < 0.2 else 0.13, 0.05)
    forward = np.clip(forward, innermost, seat.front - 0.10)
    pelvis = np.array([sideways, forward, seat.height + HIP_ABOVE_SEAT])
    furthest_back = (seat.back + CHEST_HALF_DEPTH - pelvis[1]) / TRUNK
    lean = max(lean, float(np.arcsin(np.clip(furthest_back, -0.5, 0.0))))
    return SeatedPose(
        pelvis=pelvis,
        yaw=yaw,
        lean=lean,
        twist=float(np.clip(rng.normal(0.0, 0.08), -0.2, 0.2)),
        nod=float(rng.uniform(0.0, 0.3) - 0.8 * lean),
        ankles=np.broadcast_to(pelvis, (2, 3)),
    )


def _feet(pose: SeatedPose, seat: Seat, *, across: ArrayLike, forward: ArrayLike) -> SeatedPose:
    """The pose with feet flat on the floor, ``across`` and ``forward`` (2,) from the pelvis."""
    across, forward = np.broadcast_to(across, 2), np.broadcast_to(forward, 2)
    c, s = np.cos(pose.yaw), np.sin(pose.yaw)
    x = pose.pelvis[0] + c * across - s * forward
    y = pose.pelvis[1] + s * across + c * forward
    if seat.closed:
        y = np.maximum(y, seat.front + 0.06)
    return replace(pose, ankles=np.stack([x, y, np.full(2, ANKLE_HEIGHT)], -1))


def _feet_flat(rng: np.random.Generator, pose: SeatedPose, seat: Seat) -> SeatedPose:
    """Feet side by side, below the knees or slightly in front of them."""
    across = SIDES * rng.uniform(0.10, 0.17)
    return _feet(pose, seat, across=across, forward=THIGH + rng.uniform(-0.06, 0.10))


def _feet_apart(rng: np.random.Generator, pose: SeatedPose, seat: Seat) -> SeatedPose:
    """One foot in front of the other."""
    forward = THIGH + rng.uniform(-0.04, 0.04) + SIDES * rng.uniform(0.05, 0.09)
    return _feet(pose, seat, across=SIDES * rng.uniform(0.10, 0.17, 2), forward=forward)


def _slid_forward(pose: SeatedPose, seat: Seat) -> SeatedPose:
    """The pose moved forward on the seat, for knees that are lower than the seat."""
    pelvis = pose.pelvis.copy()
    pelvis[1] = max(pelvis[1], _knees_clear(seat, pose.yaw) + 0.06)
    return replace(pose, pelvis=pelvis)


def _feet_stretched(rng: np.random.Generator, pose: SeatedPose, seat: Seat) -> SeatedPose:
    """Both legs stretched out."""
    pose = _slid_forward(pose, seat)
    forward = THIGH + rng.uniform(0.12, 0.22) + rng.uniform(-0.03, 0.03, 2)
    return _feet(pose, seat, across=SIDES * rng.uniform(0.08, 0.16), forward=forward)


def _feet_tucked(rng: np.random.Generator, pose: SeatedPose, seat: Seat) -> SeatedPose:
    """Both feet drawn in below the seat."""
    forward = THIGH - rng.uniform(0.10, 0.18) + rng.uniform(-0.03, 0.03, 2)
    return _feet(pose, seat, across=SIDES * rng.uniform(0.07, 0.11), forward=forward)


def _ankles_crossed(rng: np.random.Generator, pose: SeatedPose, seat: Seat) -> SeatedPose:
    """Legs stretched out, the right ankle crossed over to the left and in front of the other."""
    pose = _slid_forward(pose, seat)
    forward = THIGH + rng.uniform(0.02, 0.09) + SIDES * 0.09
    return _feet(pose, seat, across=[-0.03, 0.03], forward=forward)


def _leg_over(rng: np.random.Generator, pose: SeatedPose, seat: Seat) -> SeatedPose:
    """The right leg crossed over the left one, its foot hanging in front of the left shin."""
    pose = _feet(pose, seat, across=[0.0, -0.06], forward=THIGH + rng.uniform(-0.04, 0.04))
    return _raised(pose, [-0.20, 0.56 + rng.uniform(-0.02, 0.02), -0.17 + rng.uniform(-0.03, 0.03)])


def _ankle_on_knee(rng: np.random.Generator, pose: SeatedPose, seat: Seat) -> SeatedPose:
    """The right ankle on the left knee, the right knee out to the side."""
    pose = _feet(pose, seat, across=[0.0, -0.12], forward=THIGH + rng.uniform(-0.02, 0.06))
    return _raised(pose, [-0.17, 0.37 + rng.uniform(-0.02, 0.02), 0.11])


def _raised(pose: SeatedPose, offset: ArrayLike) -> SeatedPose:
    """The pose with the right ankle raised to an offset (right, forward, up) from the pelvis."""
    c, s = np.cos(pose.yaw), np.sin(pose.yaw)
    right, forward, up = np.asarray(offset, float)
    foot = pose.pelvis + np.array([c * right - s * forward, s * right + c * forward, up])
    return replace(pose, ankles=np.stack([foot, pose.ankles[1]]))


def _hands_in_lap(rng: np.random.Generator, pose: SeatedPose, seat: Seat) -> SeatedPose:
    forward = rng.uniform(0.19, 0.27)
    return pose.with_hands([[0.06, forward + 0.02, 0.11], [-0.06, forward, 0.13]])


def _hands_on_thighs(rng: np.random.Generator, pose: SeatedPose, seat: Seat) -> SeatedPose:
    forward = 0.32 + 0.3 * np.sin(min(pose.lean, 0.0)) + rng.uniform(-0.04, 0.04, 2)
    return pose.with_hands(pair(0.15, forward, 0.10))


def _hands_on_knees(rng: np.random.Generator, pose: SeatedPose, seat: Seat) -> SeatedPose:
    """Forearms over the thighs, hands together in front of the knees, for a forward lean."""
    across, forward = rng.uniform(0.03, 0.07), rng.uniform(0.42, 0.50)
    return pose.with_hands(pair(across, forward, 0.09))


def _arms_folded(rng: np.random.Generator, pose: SeatedPose, seat: Seat) -> SeatedPose:
    chest = TRUNK * np.sin(pose.lean) * 0.55 + 0.19
    return pose.with_hands([[-0.09, chest + 0.02, 0.27], [0.09, chest, 0.24]])


def _hand_to_face(rng: np.random.Generator, pose: SeatedPose, seat: Seat) -> SeatedPose:
    """The right hand at chin or cheek, the other hand on the thigh."""
    pose = _hands_on_thighs(rng, pose, seat)
    forward, up = pose.head
    face = [
        rng.uniform(0.06, 0.12),
        forward + rng.uniform(0.14, 0.19),
        up - rng.uniform(0.17, 0.23),
    ]
    return pose.with_hands([face, pose.hands[1]])


def _gesture(rng: np.random.Generator, pose: SeatedPose, seat: Seat) -> SeatedPose:
    """Both hands, or one, moving in the air in front of the body."""
    pose = _hands_on_thighs(rng, pose, seat)
    chest = TRUNK * np.sin(pose.lean)
    air = pair(
        rng.uniform(0.10, 0.28, 2), chest + rng.uniform(0.26, 0.38, 2), rng.uniform(0.24, 0.38, 2)
    )
    both = rng.random() < 0.6
    return pose.with_hands(
        [air[0], air[1] if both else pose.hands[1]], [0.07, 0.07 if both else 0.01]
    )


def _hands_on_seat(rng: np.random.Generator, pose: SeatedPose, seat: Seat) -> SeatedPose:
    """Hands beside the hips, on a seat without armrests."""
    forward = rng.uniform(-0.02, 0.08)
    return pose.with_hands(pair(0.26, forward, -0.04))


def _hands_on_arms(rng: np.random.Generator, pose: SeatedPose, seat: Seat) -> SeatedPose:
    """Hands on the armrests within reach; a hand without one is on the thigh."""
    pose = _hands_on_thighs(rng, pose, seat)
    hands = pose.hands.copy()
    for x, front, top in seat.arms:
        side = 0 if x > pose.pelvis[0] else 1
        if abs(x - pose.pelvis[0]) < _ARM_REACH:
            forward = min(pose.pelvis[1] + rng.uniform(0.12, 0.24), front - 0.02)
            hands[side] = pose.from_pelvis([x, forward, top + 0.04])
    return pose.with_hands(hands)


def _pick(rng: np.random.Generator, weights: Mapping[Step, float]) -> Step:
    steps = list(weights)
    shares = np.fromiter(weights.values(), float)
    return steps[int(np.searchsorted(np.cumsum(shares / shares.sum()), rng.random()))]


def _legs(seat: Seat, lean: float) -> dict[Step, float]:
    """Leg variants and their weights; no data are published, so no variant is made rare."""
    legs: dict[Step, float] = {_feet_flat: 4.0, _feet_apart: 2.0}
    if not seat.closed:
        legs[_feet_tucked] = 2.0
    if lean < 0.25:
        legs |= {_feet_stretched: 2.0, _ankles_crossed: 1.0, _leg_over: 1.0, _ankle_on_knee: 0.5}
    return legs


def _arms(seat: Seat, pose: SeatedPose, *, at_rest: bool) -> dict[Step, float]:
    """Hand variants and their weights."""
    if pose.lean > 0.35:
        return {_hands_on_knees: 3.0, _hands_on_thighs: 1.0, _hand_to_face: 1.0}
    arms: dict[Step, float] = {_hands_in_lap: 3.0, _hands_on_thighs: 3.0}
    if any(abs(x - pose.pelvis[0]) < _ARM_REACH for x, _, _ in seat.arms):
        arms[_hands_on_arms] = 4.0
    elif not np.isfinite(seat.back) and abs(pose.yaw) < 0.3:
        arms[_hands_on_seat] = 1.0
    if not at_rest:
        arms |= {_gesture: 1.3, _hand_to_face: 1.0, _arms_folded: 0.7}
    return arms


def _draw_lean(rng: np.random.Generator, seat: Seat) -> float:
    """Lean of the trunk in radians: against the backrest, upright or forward."""
    leans_back = 0.0 if not np.isfinite(seat.back) else 0.50 if seat.deep else 0.35
    share = rng.random()
    if share < leans_back:
        return float(rng.uniform(-0.42, -0.12))
    if share < 0.82:
        return float(rng.uniform(-0.05, 0.16))
    return float(rng.uniform(0.35, FURTHEST_LEAN))


def draw_seated(
    rng: np.random.Generator,
    seat: Seat,
    *,
    sideways: float = 0.0,
    yaw: float | None = None,
    lean: float | None = None,
    upright: bool = False,
) -> SeatedPose:
    """Draw a pose of sitting on a seat.

    Parameters
    ----------
    rng, seat
        Random generator, and the seat.
    sideways : float
        The x of the middle of the place to sit at, metres.
    yaw : float, optional
        Yaw of the pelvis; drawn about the seat's front if not given.
    lean : float, optional
        Lean of the trunk, limited backwards by the seat; drawn if not given.
    upright : bool
        Whether the trunk is upright, both feet are side by side and the hands rest, as before
        standing up.

    Returns
    -------
    SeatedPose
    """
    if lean is None:
        lean = rng.uniform(-0.05, 0.12) if upright else _draw_lean(rng, seat)
    if yaw is None:
        yaw = float(np.clip(rng.normal(0.0, SQUARE), -0.2, 0.2))
    pose = _place(rng, seat, sideways=sideways, yaw=yaw, lean=lean)
    move_legs = _feet_flat if upright else _pick(rng, _legs(seat, pose.lean))
    return draw_hands(rng, move_legs(rng, pose, seat), seat, at_rest=upright)


def draw_hands(
    rng: np.random.Generator, pose: SeatedPose, seat: Seat, *, at_rest: bool = False
) -> SeatedPose:
    """The same pose with the hands drawn again; with ``at_rest`` they are not busy.

    Parameters
    ----------
    rng : numpy.random.Generator
    pose : SeatedPose
    seat : Seat
    at_rest : bool
        Whether the hands rest.

    Returns
    -------
    SeatedPose
    """
    return _pick(rng, _arms(seat, pose, at_rest=at_rest))(rng, pose, seat)


def at_table(rng: np.random.Generator, pose: SeatedPose, *, edge: float, top: float) -> SeatedPose:
    """The same pose with the hands at a table whose near edge is at y = ``edge``.

    Both hands write or type, or one works while the other is at the face or in the lap.

    Parameters
    ----------
    rng : numpy.random.Generator
    pose : SeatedPose
    edge : float
        The y of the near edge, metres.
    top : float
        Height of the top, metres.

    Returns
    -------
    SeatedPose
    """
    forward = edge + rng.uniform(0.04, 0.16, 2)
    wrists = np.stack(
        [pose.pelvis[0] + SIDES * rng.uniform(0.08, 0.22, 2), forward, np.full(2, top + 0.05)], -1
    )
    lean = float(rng.uniform(0.05, 0.25))
    pose = replace(pose, lean=lean, nod=float(rng.uniform(0.0, 0.35)))
    work = pose.from_pelvis(wrists)
    share = rng.random()
    if share < 0.65:
        return pose.with_hands(work, 0.02)
    if share < 0.85:
        return pose.with_hands([work[0], [-0.10, 0.20, 0.12]], [0.03, 0.01])
    forward_of_face, up = pose.head
    return pose.with_hands([work[0], [-0.09, forward_of_face + 0.16, up - 0.20]], [0.02, 0.01])
