"""Perching on an edge, leaning on an arm, lying back in a seat: motions and recipes.

Each function takes the pose of a person who sits upright and moves pelvis, trunk, feet and hands.
If one arm carries weight, it is the right one. Lengths are in metres, angles in radians; offsets
are right, forward and up from the pelvis as it faces. Ranges of motion are those of the American
Academy of Orthopaedic Surgeons, *Joint Motion* (1965).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.scenelets.procedural import furniture
from imapper_prob.scenelets.procedural.body import (
    ANKLE_HEIGHT,
    ELBOWS,
    FOREARM,
    HALF_HIPS,
    HIP_HEIGHT,
    SHIN,
    SIDES,
    THIGH,
    TRUNK,
    UPPER_ARM,
    Drawn,
    Person,
    Recipe,
    Trunk,
    pair,
)
from imapper_prob.scenelets.procedural.seated import (
    BUTTOCK,
    CHEST_HALF_DEPTH,
    HIP_ABOVE_SEAT,
    Seat,
    SeatedPose,
    draw_hands,
    draw_seated,
    open_seat,
    seat_of,
)
from imapper_prob.scenelets.procedural.sitting import (
    Taken,
    hold_still,
    over_knees,
    table_edge,
    take_seat,
    with_room,
)

__all__ = [
    "lean_back_on_bed",
    "lean_on_armrest",
    "lean_on_bed",
    "lean_on_table",
    "perch",
    "perch_on",
    "perch_on_table",
    "prop_up_behind",
    "slouch",
    "slouch_on",
]

Array = NDArray[np.float64]
FURTHEST_TILT: Final = float(np.deg2rad(33.0))
"""Greatest tilt of the trunk to the side, radians; lumbar spine and thorax bend by 35 degrees."""
ARM_DEPTH: Final = 0.035
"""Metres from the line of the joints to the skin of forearm and elbow (*Bodyspace*)."""
PALM: Final = 0.06
"""Height in metres of the wrist above what a flat hand leans on, hand bent back (*Bodyspace*)."""
FACE: Final = (0.04, 0.11, -0.10)
"""From the middle of the head to the wrist of a hand that props it: right, forward, up, metres."""
STRETCHED: Final = 0.975
"""Reach of a nearly straight leg or arm over its length: bent by 25 degrees."""


def perch(rng: np.random.Generator, pose: SeatedPose, seat: Seat) -> SeatedPose:
    """Sitting on the front edge of a seat with nearly straight legs.

    The hip joints are up to 7 cm behind the edge, so only the buttocks are on the seat.

    Parameters
    ----------
    rng : numpy.random.Generator
    pose : SeatedPose
    seat : Seat

    Returns
    -------
    SeatedPose
    """
    pelvis = pose.pelvis.copy()
    pelvis[1] = seat.front - rng.uniform(0.02, 0.07)
    lean = float(rng.uniform(-0.05, 0.25))
    pose = replace(pose, pelvis=pelvis, lean=lean, nod=float(rng.uniform(0.0, 0.3) - 0.8 * lean))
    drop = pelvis[2] - ANKLE_HEIGHT
    reach = rng.uniform(0.88, STRETCHED, 2) * (THIGH + SHIN)
    forward = np.sqrt(reach**2 - drop**2)
    if rng.random() < 0.25:  # one foot drawn in, as before standing up
        forward[rng.integers(2)] = rng.uniform(0.22, 0.34)
    across = SIDES * rng.uniform(0.09, 0.18)
    pose = replace(pose, ankles=pose.at_pelvis(np.stack([across, forward, np.full(2, -drop)], -1)))
    # The trunk is too far from a back or armrests to rest on them.
    return draw_hands(rng, pose, replace(seat, back=-np.inf, arms=()))


def _perch_high(
    rng: np.random.Generator, pose: SeatedPose, *, edge: float, top: float
) -> SeatedPose:
    """Half sitting on the edge of a table with one or both legs straight on the floor.

    The hip joints are in front of the edge with the buttocks on it, or the thigh of the hanging leg
    lies on the top.

    Parameters
    ----------
    edge, top : float
        Front of the table (y) and height of its surface, metres.
    """
    hangs = rng.random() < 0.4
    height = min(top + HIP_ABOVE_SEAT, HIP_HEIGHT - 0.015)
    yaw = -rng.uniform(0.2, 0.5) if hangs else rng.normal(0.0, 0.09)
    pelvis = np.array([pose.pelvis[0], edge + rng.uniform(-0.02, 0.04), height])
    lean = float(rng.uniform(-0.05, 0.15))
    pose = replace(
        pose,
        pelvis=pelvis,
        yaw=float(yaw),
        lean=lean,
        nod=float(rng.uniform(0.0, 0.3) - 0.8 * lean),
    )
    drop = height - ANKLE_HEIGHT
    reach = rng.uniform(0.965, 0.985, 2) * (THIGH + SHIN)
    forward = np.sqrt(np.maximum(reach**2 - drop**2, 0.01))
    feet = pair(rng.uniform(0.08, 0.15), forward, -drop)
    knees = pair(0.12, 1.0, 0.5)
    if hangs:
        # The right thigh lies on the corner or edge; its shin hangs in front of the table.
        outward = rng.uniform(0.15, 0.40)
        down = rng.uniform(-0.10, -0.02)
        level = np.sqrt(THIGH**2 - down**2)
        knee = np.array([level * np.sin(outward), level * np.cos(outward), down])
        shin = np.array([0.0, rng.uniform(-0.05, 0.25), -1.0])
        feet[0] = (HALF_HIPS, 0.0, 0.0) + knee + SHIN * shin / np.linalg.norm(shin)
        knees[0] = knee
    pose = replace(pose, ankles=pose.at_pelvis(feet), knees=knees)
    share = rng.random()
    if share < 0.35:  # both hands on the edge
        up = top + PALM - height
        back = edge + 0.02 - pelvis[1] - rng.uniform(0.04, 0.10)
        hands = pair(rng.uniform(0.24, 0.30), back, up)
        return pose.with_hands(hands, 0.005)
    return draw_hands(rng, pose, open_seat(top, front=edge))


def _lean_on_rest(
    rng: np.random.Generator, pose: SeatedPose, rest: tuple[float, float, float]
) -> SeatedPose:
    """The pose with the trunk tilted to the right and the right forearm on an armrest.

    Parameters
    ----------
    rest : (float, float, float)
        The x of the middle of the armrest, the y of its front, and the height of its top.
    """
    x, front, top = rest
    forward = rng.uniform(0.0, 0.10)
    aside = pose.from_pelvis([x, front - 0.04, top + ARM_DEPTH])
    tilts = np.linspace(0.0, FURTHEST_TILT, 67)
    shoulders = _shoulders(tilts, pose.lean, pose.twist)
    elbows = np.broadcast_to(aside, shoulders.shape).copy()
    elbows[:, 1] = np.minimum(shoulders[:, 1] + forward, aside[1])
    best = _as_long(shoulders, elbows)
    pose = replace(pose, tilt=float(tilts[best]))
    elbow = elbows[best]
    # The forearm lies along the armrest, as far as that extends.
    ahead = np.array([rng.uniform(-0.25, 0.05), 1.0, 0.08])
    wrist = elbow + FOREARM * ahead / np.linalg.norm(ahead)
    return _with_arm(pose, shoulders[best], elbow, wrist, pose.hands[1])


def _prop_head(
    rng: np.random.Generator, pose: SeatedPose, *, edge: float, top: float
) -> SeatedPose:
    """The pose with the right elbow on a table, that hand at the face, the left forearm on it.

    Parameters
    ----------
    edge, top : float
        Near edge of the table (y) and height of its surface, metres.
    """
    leans = np.linspace(0.0, 0.58, 59)
    tilt, twist = rng.uniform(0.05, 0.22), pose.twist + rng.uniform(0.0, 0.15)
    shoulders = np.concatenate([_shoulders(np.array([tilt]), lean, twist) for lean in leans])
    place = [pose.pelvis[0], edge + rng.uniform(0.08, 0.15), top + ARM_DEPTH]
    elbows = np.broadcast_to(pose.from_pelvis(place), shoulders.shape).copy()
    elbows[:, 0] = shoulders[:, 0] + rng.uniform(-0.04, 0.06)
    best = _as_long(shoulders, elbows)
    lean = float(leans[best])
    pose = replace(pose, tilt=float(tilt), lean=lean, twist=float(twist), nod=0.15 - 0.5 * lean)
    other = pose.from_pelvis(
        [pose.pelvis[0] - rng.uniform(0.05, 0.20), edge + rng.uniform(0.05, 0.14), top + 0.05]
    )
    return _propped(pose, shoulders[best], elbows[best], other)


def _prop_on_hand(rng: np.random.Generator, pose: SeatedPose) -> SeatedPose:
    """The trunk tilted to the right, on a straight arm beside the body or slightly behind."""
    tilt, lean = float(rng.uniform(0.15, 0.36)), float(rng.uniform(-0.20, 0.08))
    pose = replace(pose, tilt=tilt, lean=lean, nod=float(rng.uniform(0.0, 0.25) - 0.8 * lean))
    (shoulder,) = _shoulders(np.array([tilt]), lean, pose.twist)
    hand = _straight_down(shoulder, backward=rng.uniform(0.1, 0.9), side=1.0)
    return pose.with_hands(np.stack([hand, pose.hands[1]]), [0.0, 0.01])


def prop_up_behind(rng: np.random.Generator, pose: SeatedPose) -> SeatedPose:
    """The pose with the trunk leaning back on two straight arms behind it.

    Parameters
    ----------
    rng : numpy.random.Generator
    pose : SeatedPose

    Returns
    -------
    SeatedPose
    """
    lean = -float(rng.uniform(0.25, 0.45))
    pose = replace(pose, lean=lean, nod=float(rng.uniform(0.1, 0.35) - 0.5 * lean))
    hands = [
        _straight_down(shoulder, backward=rng.uniform(0.9, 1.25), side=side)
        for shoulder, side in zip(pose.trunk.shoulders[0], SIDES, strict=True)
    ]
    return pose.with_hands(hands, 0.0)


def slouch(rng: np.random.Generator, pose: SeatedPose, seat: Seat) -> SeatedPose:
    """Sliding forward in a seat, back against the top of its backrest, legs stretched out.

    The trunk leans back by 25 to 45 degrees. Couches and armchairs are made for up to 30 (Panero
    and Zelnik 1979); the pelvis slides forward for the rest.

    Parameters
    ----------
    rng : numpy.random.Generator
    pose : SeatedPose
    seat : Seat

    Returns
    -------
    SeatedPose
    """
    lean = rng.uniform(0.44, 0.75)
    # Thighs can slope down to the feet once the knees are in front of the seat.
    knees_clear = seat.front - THIGH + max(seat.height - SHIN, 0.0) + 0.08
    low = max(seat.back + BUTTOCK + 0.05, knees_clear if seat.closed else -np.inf)
    behind = seat.back + CHEST_HALF_DEPTH
    pelvis = pose.pelvis.copy()
    pelvis[1] = np.clip(behind + TRUNK * np.sin(lean), low, max(low, seat.front - 0.07))
    back = -float(np.arcsin(np.clip((pelvis[1] - behind) / TRUNK, 0.0, np.sin(0.80))))
    nod = float(rng.uniform(0.20, 0.45) - 0.3 * back)
    pose = replace(pose, pelvis=pelvis, lean=back, nod=nod, twist=0.5 * pose.twist)
    forward = THIGH + rng.uniform(0.06, 0.26) + rng.uniform(-0.03, 0.03, 2)
    drop = pelvis[2] - ANKLE_HEIGHT
    forward = np.minimum(forward, np.sqrt((STRETCHED * (THIGH + SHIN)) ** 2 - drop**2))
    feet = pose.at_pelvis(pair(rng.uniform(0.08, 0.17), forward, 0.0))
    feet[:, 2] = ANKLE_HEIGHT
    return draw_hands(rng, replace(pose, ankles=feet), seat)


def _shoulders(tilts: Array, lean: float, twist: float) -> Array:
    """(n, 3) right shoulder relative to the pelvis, for n tilts."""
    trunk = Trunk.of(np.zeros((len(tilts), 3)), 0.0, lean=lean, tilt=tilts, twist=twist)
    return trunk.shoulders[:, 0]


def _as_long(shoulders: Array, elbows: Array) -> int:
    """Index of the pair, of n, whose distance is nearest to an upper arm's length."""
    return int(np.abs(np.linalg.norm(elbows - shoulders, axis=-1) - UPPER_ARM).argmin())


def _straight_down(shoulder: Array, *, backward: float, side: float) -> Array:
    """(3,) wrist of a straight arm that leans on the seat, as an offset from the pelvis.

    ``backward`` is the angle from straight sideways to straight backwards, radians.
    """
    drop = shoulder[2] + HIP_ABOVE_SEAT - PALM
    reach = STRETCHED * (UPPER_ARM + FOREARM)
    level = np.sqrt(max(reach**2 - drop**2, 0.0))
    away: Array = level * np.array([side * np.cos(backward), -np.sin(backward), 0.0])
    return shoulder + away - (0.0, 0.0, drop)


def _propped(pose: SeatedPose, shoulder: Array, elbow: Array, other: Array) -> SeatedPose:
    """The pose with the right hand at the face and the right elbow resting."""
    towards = pose.trunk.head[0] + FACE - elbow
    wrist = elbow + FOREARM * towards / np.linalg.norm(towards)
    return _with_arm(pose, shoulder, elbow, wrist, other)


def _with_arm(
    pose: SeatedPose, shoulder: Array, elbow: Array, wrist: Array, other: Array
) -> SeatedPose:
    """The pose with the right arm given by its joints, the left one by its wrist, as offsets."""
    elbows = np.stack([elbow - shoulder, [-ELBOWS[0], ELBOWS[1], ELBOWS[2]]])
    return replace(pose, elbows=elbows).with_hands([wrist, other], [0.0, 0.01])


# ------------------------------------------------------------------------------------------------
# Recipes.


HAND = 0.10
"""Free metres on the bed that a hand which carries weight needs around its wrist."""


def perch_on(kind: str) -> Recipe:
    """Recipe: sitting on the front edge of a seat.

    Parameters
    ----------
    kind : str
        Kind of furniture, such as ``"chair"``.

    Returns
    -------
    callable
        Maps rng and person to :class:`~imapper_prob.scenelets.procedural.body.Drawn`.
    """

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, seat, place = take_seat(rng, person, kind)
        pose = perch(rng, draw_seated(rng, seat, sideways=place, upright=True), seat)
        return hold_still(rng, pose, piece)

    return draw


def perch_on_table(rng: np.random.Generator, person: Person) -> Drawn:
    """Half sitting on the edge of a table, facing away from it.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person

    Returns
    -------
    Drawn
    """
    table = person.sees(furniture.table(rng))
    half, edge, top = (float(v) for v in table.bounds[1])
    place = rng.uniform(0.3 - half, half - 0.3)
    pose = draw_seated(rng, open_seat(top, front=edge), sideways=place, upright=True)
    pose = _perch_high(rng, pose, edge=edge, top=top)
    return hold_still(rng, pose, table)


def lean_on_armrest(kind: str) -> Recipe:
    """Recipe: leaning to the side on the armrest of a chair, armchair or couch.

    Parameters
    ----------
    kind : str
        Kind of furniture, such as ``"chair"``.

    Returns
    -------
    callable
        Maps rng and person to :class:`~imapper_prob.scenelets.procedural.body.Drawn`.
    """

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, seat, place = _with_arms(rng, person, kind)
        rest = max(seat.arms)  # the right one
        if kind != "chair":
            # The person sits as far from the armrest as leaning on it requires and the seat allows.
            room = rest[0] + seat.arms[0][0] if kind == "couch" else 0.0
            place = max(rest[0] - rng.uniform(0.36, 0.44), room / 2)
        lean = -rng.uniform(0.05, 0.30) if rng.random() < 0.6 else rng.uniform(-0.05, 0.12)
        pose = draw_seated(
            rng, seat, sideways=place, yaw=rng.normal(0.0, 0.05), lean=lean, upright=True
        )
        pose = replace(pose, hands=np.array([[0.06, 0.24, 0.11], [-0.12, 0.26, 0.10]]))
        pose = _lean_on_rest(rng, pose, rest)
        return hold_still(rng, pose, piece)

    return draw


def lean_on_table(rng: np.random.Generator, person: Person) -> Drawn:
    """Sitting on a chair at a table, with the head propped on a hand.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person

    Returns
    -------
    Drawn
    """
    piece, seat, place = take_seat(rng, person, "chair")
    pose = draw_seated(rng, seat, sideways=place, upright=True)
    edge = table_edge(pose, seat, gap=rng.uniform(0.18, 0.26))
    table = person.sees(furniture.table(rng))
    pose = _prop_head(rng, pose, edge=edge, top=float(table.bounds[1, 2]))
    return hold_still(rng, pose, piece, over_knees(rng, table, place, edge=edge))


def lean_on_bed(rng: np.random.Generator, person: Person) -> Drawn:
    """Sitting on the edge of a bed, leaning to the side on a straight arm.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person

    Returns
    -------
    Drawn
    """
    piece, seat, place = take_seat(rng, person, "bed")
    pose = _prop_on_hand(rng, draw_seated(rng, seat, sideways=place, upright=True))
    piece = with_room(piece, right=float(pose.hands[0, 0]) + HAND, left=0.3)
    return hold_still(rng, pose, piece)


def lean_back_on_bed(rng: np.random.Generator, person: Person) -> Drawn:
    """Sitting on the edge of a bed, leaning back on both hands.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person

    Returns
    -------
    Drawn
    """
    piece, seat, place = take_seat(rng, person, "bed")
    pose = prop_up_behind(rng, draw_seated(rng, seat, sideways=place, upright=True))
    beside = float(np.abs(pose.hands[:, 0]).max()) + HAND
    piece = with_room(piece, right=beside, left=beside)
    return hold_still(rng, pose, piece)


def slouch_on(kind: str) -> Recipe:
    """Recipe: sitting slid forward on a chair, armchair or couch.

    Parameters
    ----------
    kind : str
        Kind of furniture, such as ``"chair"``.

    Returns
    -------
    callable
        Maps rng and person to :class:`~imapper_prob.scenelets.procedural.body.Drawn`.
    """

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, seat, place = take_seat(rng, person, kind)
        pose = slouch(rng, draw_seated(rng, seat, sideways=place, upright=True), seat)
        return hold_still(rng, pose, piece)

    return draw


def _with_arms(rng: np.random.Generator, person: Person, kind: str) -> Taken:
    """A seat with armrests."""
    if kind != "chair":
        return take_seat(rng, person, kind)
    piece = person.sees(furniture.chair(rng, arms=True))
    return piece, seat_of(piece), float(rng.normal(-0.02, 0.02))
