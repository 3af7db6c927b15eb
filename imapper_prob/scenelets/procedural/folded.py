"""Recipes of sitting with legs crossed or folded.

Each function takes a person who sits upright, and changes the legs and, if needed, pelvis and
hands. The right leg is the folded one. Units are metres and radians; offsets are right, forward and
up, relative to the pelvis. Angles without a source are within the ranges of the American Academy of
Orthopaedic Surgeons, *Joint Motion* (1965): hips rotate the thigh 45 degrees outward and 30 inward,
knees bend by 150.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.scene import Placement, SceneObject
from imapper_prob.scenelets.procedural import furniture
from imapper_prob.scenelets.procedural.body import (
    ANKLE_HEIGHT,
    HALF_HIPS,
    HIPS,
    SHIN,
    THIGH,
    Drawn,
    Person,
    Recipe,
    knees_of,
    pair,
)
from imapper_prob.scenelets.procedural.seated import (
    BUTTOCK,
    HIP_ABOVE_SEAT,
    Seat,
    SeatedPose,
    draw_hands,
    draw_seated,
    open_seat,
    seat_of,
)
from imapper_prob.scenelets.procedural.sitting import Taken, hold_still, take_seat, with_room

__all__ = [
    "SHIN_DEPTH",
    "THIGH_DEPTH",
    "sit_crossed",
    "sit_on_leg",
    "sit_tailor_fashion",
    "tailor_fashion",
]

Array = NDArray[np.float64]
THIGH_DEPTH: Final = 0.065
"""Distance from the line of joints to the skin of the thigh near the knee, metres: half of the
thigh's 13 cm (thigh clearance, minus compression by the seat: Pheasant and Haslegrave, *Bodyspace*,
2005)."""
SHIN_DEPTH: Final = 0.045
"""Distance from the line of joints to the skin of the shin at knee and ankle, metres
(*Bodyspace*)."""
UP: Final = 0.5
"""Upward component, relative to 1 forward, of the direction of a knee whose foot is on the
floor."""

_AHEAD: Final = -0.03, 0.07
"""Least and largest distance of the ankle of a foot on the floor in front of the knee of a
horizontal thigh, metres; chosen."""


def _with_legs(pose: SeatedPose, ankles: ArrayLike, knees: ArrayLike) -> SeatedPose:
    """The same person with other ankles and directions of knees, both (2, 3) offsets."""
    return replace(pose, ankles=pose.at_pelvis(ankles), knees=np.asarray(knees, float))


def _foot_down(
    rng: np.random.Generator,
    pose: SeatedPose,
    seat: Seat,
    *,
    side: float,
    outward: float,
) -> tuple[Array, Array]:
    """Ankle of a foot flat on the floor, and direction of its knee, both (3,) offsets.

    Parameters
    ----------
    side : float
        1 for the right leg, -1 for the left one.
    outward : float
        Direction of the leg in radians: 0 is straight ahead, positive to its own side.
    """
    level = THIGH + rng.uniform(*_AHEAD)
    direction = np.array([side * np.sin(outward), np.cos(outward), 0.0])
    ankle = np.array([side * HALF_HIPS, 0.0, 0.0]) + level * direction
    ankle[2] = ANKLE_HEIGHT - pose.pelvis[2]
    if seat.closed:
        # Keep the foot in front of a closed seat, in the direction of the leg.
        short = seat.front + 0.06 - float(pose.at_pelvis(ankle)[1])
        ankle += max(short, 0.0) / max(np.cos(pose.yaw - side * outward), 0.5) * direction
    return ankle, direction + np.array([0.0, 0.0, UP])


def _knee_over_knee(rng: np.random.Generator, pose: SeatedPose, seat: Seat) -> SeatedPose:
    """Cross the right thigh over the left one, with the shin hanging beyond the left knee."""
    foot, below = _foot_down(rng, pose, seat, side=-1, outward=-rng.uniform(0.20, 0.28))
    lower_knee = knees_of(foot, below, hips=HIPS[1])
    across = -np.sin(rng.uniform(0.44, 0.51))
    up = lower_knee[2] + 2 * THIGH_DEPTH + rng.uniform(0.0, 0.04)
    knee = _thigh(across, up)
    # The calf hangs down, slightly forward and outward of the left shin.
    hang = np.array([-rng.uniform(0.15, 0.30), rng.uniform(0.25, 0.50), -1.0])
    ankle = HIPS[0] + knee + SHIN * _unit(hang)
    pose = _with_legs(pose, [ankle, foot], [knee, below])
    if rng.random() < 0.5:
        return draw_hands(rng, pose, seat)
    # One hand on the upper knee and the other on top, or both around it.
    upper = HIPS[0] + 0.85 * knee + (0.0, 0.0, THIGH_DEPTH + 0.02)
    hands = upper + np.array([[0.07, -0.03, 0.0], [-0.06, -0.06, 0.02]])
    return pose.with_hands(hands)


def _ankle_on_knee(rng: np.random.Generator, pose: SeatedPose, seat: Seat) -> SeatedPose:
    """Put the right ankle on the left thigh, near or on the knee, with the right knee to the
    side."""
    foot, below = _foot_down(rng, pose, seat, side=-1, outward=rng.uniform(-0.05, 0.15))
    left = knees_of(foot, below, hips=HIPS[1])
    ankle = HIPS[1] + rng.uniform(0.76, 0.92) * (left - HIPS[1])
    ankle += (rng.uniform(-0.05, 0.02), 0.0, THIGH_DEPTH + SHIN_DEPTH - 0.01)
    knee = np.array([1.0, rng.uniform(0.1, 0.45), rng.uniform(0.0, 0.20)])
    pose = _with_legs(pose, [ankle, foot], [knee, below])
    if rng.random() < 0.5:
        return draw_hands(rng, pose, seat)
    # One hand on the horizontal shin, the other one on the ankle.
    bent = knees_of(ankle, knee, hips=HIPS[0])
    over = (0.0, -0.02, SHIN_DEPTH + 0.02)
    hands = np.stack([0.75 * bent + 0.25 * ankle + over, 0.15 * bent + 0.85 * ankle + over])
    return pose.with_hands(hands)


def _leg_folded_under(rng: np.random.Generator, pose: SeatedPose, seat: Seat) -> SeatedPose:
    """Fold the right leg on the seat, its foot at the left thigh; the left foot is on the floor.

    The knee of the folded leg is on the seat or, if that is narrow, beyond its edge: the pelvis is
    turned to that side, and the other leg points straight to the front.
    """
    foot, below = _foot_down(rng, pose, seat, side=-1, outward=max(-pose.yaw, 0.0))
    ankle = np.array([-rng.uniform(0.02, 0.05), SHIN * rng.uniform(0.45, 0.60), _on_seat(rng)])
    knee = np.array([1.0, rng.uniform(0.2, 0.4), 0.08])
    pose = _with_legs(pose, [ankle, foot], [knee, below])
    if rng.random() < 0.5:
        return draw_hands(rng, pose, seat)
    bent = knees_of(ankle, knee, hips=HIPS[0])
    on_shin = 0.5 * bent + 0.5 * ankle + (0.0, 0.0, SHIN_DEPTH + 0.03)
    return pose.with_hands(np.stack([on_shin, [-0.13, 0.26, 0.10]]))


def tailor_fashion(rng: np.random.Generator, pose: SeatedPose, seat: Seat) -> SeatedPose:
    """Fold both legs on the seat, with shins crossed in front of the body.

    Parameters
    ----------
    rng : numpy.random.Generator
    pose : SeatedPose
    seat : Seat

    Returns
    -------
    SeatedPose
    """
    front, back = SHIN * rng.uniform(0.77, 0.85), SHIN * rng.uniform(0.43, 0.50)
    ankles = np.array(
        [
            [-rng.uniform(0.01, 0.05), front, _on_seat(rng)],
            [rng.uniform(0.02, 0.08), back, _on_seat(rng)],
        ]
    )
    up = rng.uniform(0.05, 0.25)
    knees = pair(1.0, rng.uniform(0.2, 0.4), up)
    pose = _with_legs(pose, ankles, knees)
    if rng.random() < 0.5:
        return draw_hands(rng, pose, seat)
    bent = knees_of(ankles, knees)
    hands = bent * (0.9, 0.85, 1.0) + (0.0, 0.0, SHIN_DEPTH + 0.03)
    return pose.with_hands(hands)


def _on_seat(rng: np.random.Generator) -> float:
    """Height of the ankle of a foot that lies on its side on the seat, relative to the hips,
    metres."""
    return float(SHIN_DEPTH + rng.uniform(0.0, 0.02) - HIP_ABOVE_SEAT)


def _thigh(across: float, up: float) -> Array:
    """(3,) from hip to knee: ``across`` relative to the thigh's length, ``up`` in metres."""
    x = across * THIGH
    return np.array([x, np.sqrt(THIGH**2 - x**2 - up**2), up])


def _unit(vector: Array) -> Array:
    direction: Array = vector / np.linalg.norm(vector)
    return direction


# ------------------------------------------------------------------------------------------------
# Recipes.

KNEE_BESIDE: Final = 0.54
"""Sideways distance from the pelvis in metres that a folded leg needs."""
LEGS_BEFORE, LEGS_BESIDE = 0.44, 0.42
"""Distances from the pelvis in metres, forward and sideways, that crossed legs need."""


def sit_crossed(kind: str) -> Recipe:
    """Sitting with one leg over the other: knee over knee, or ankle on knee.

    Parameters
    ----------
    kind : str
        Of furniture, such as ``"chair"``.

    Returns
    -------
    callable
        From rng and person to :class:`~imapper_prob.scenelets.procedural.body.Drawn`.
    """

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, seat, place = take_seat(rng, person, kind)
        leans_back = np.isfinite(seat.back) and rng.random() < 0.4
        lean = -rng.uniform(0.12, 0.40) if leans_back else rng.uniform(-0.05, 0.20)
        pose = draw_seated(rng, seat, sideways=place, lean=lean, upright=True)
        cross = _knee_over_knee if rng.random() < 0.55 else _ankle_on_knee
        return hold_still(rng, cross(rng, pose, seat), piece)

    return draw


def sit_on_leg(kind: str) -> Recipe:
    """Sitting with one leg folded on a couch, bench, chair or the edge of a bed.

    Parameters
    ----------
    kind : str
        Of furniture, such as ``"chair"``.

    Returns
    -------
    callable
        From rng and person to :class:`~imapper_prob.scenelets.procedural.body.Drawn`.
    """

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, seat, place = _wide(rng, person, kind, right=KNEE_BESIDE, left=0.24)
        # If there is room, the body turns to the side of the folded leg.
        narrow = kind in ("chair", "bench")
        turn = rng.uniform(0.0, 0.25) if narrow else rng.uniform(0.3, 0.65)
        pose = draw_seated(rng, seat, sideways=place, yaw=-turn, upright=True)
        # On a mattress or cushion, the whole shin is on it.
        pose = _back_from_edge(pose, seat, rng.uniform(0.27, 0.32 if narrow else 0.36))
        pose = _leg_folded_under(rng, pose, replace(seat, arms=()))
        if kind == "bed":
            piece = with_room(piece, right=KNEE_BESIDE, left=0.3)
        return hold_still(rng, pose, piece)

    return draw


def sit_tailor_fashion(kind: str) -> Recipe:
    """Sitting with both legs crossed on a couch or on a bed.

    Parameters
    ----------
    kind : str
        Of furniture, such as ``"chair"``.

    Returns
    -------
    callable
        From rng and person to :class:`~imapper_prob.scenelets.procedural.body.Drawn`.
    """

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        if kind == "bed":
            piece, seat = _on_bed(rng, person)
            place = 0.0
        else:
            piece, seat, place = _wide(rng, person, kind, right=LEGS_BESIDE, left=LEGS_BESIDE)
        seat = replace(seat, closed=False, arms=())  # no leg reaches the floor
        pose = draw_seated(rng, seat, sideways=place, lean=rng.uniform(-0.05, 0.30), upright=True)
        pose = _back_from_edge(pose, seat, LEGS_BEFORE - rng.uniform(0.0, 0.08))
        pose = tailor_fashion(rng, pose, seat)
        return hold_still(rng, pose, piece)

    return draw


def _wide(
    rng: np.random.Generator, person: Person, kind: str, *, right: float, left: float
) -> Taken:
    """A seat whose arms leave a given space on both sides of the pelvis, metres."""
    if kind == "chair":
        piece = person.sees(furniture.chair(rng, arms=False))
        return piece, seat_of(piece), float(rng.normal(0.0, 0.02))
    if kind != "couch":
        return take_seat(rng, person, kind)
    piece = person.sees(furniture.couch(rng, seats=int(rng.choice([2, 3]))))
    half = furniture.seat_part(piece).size[0] / 2
    return piece, seat_of(piece), float(rng.uniform(left - half, max(half - right, left - half)))


def _back_from_edge(pose: SeatedPose, seat: Seat, metres: float) -> SeatedPose:
    """Move a person behind the front edge by a distance, or as far as the back allows."""
    pelvis = pose.pelvis.copy()
    pelvis[1] = max(seat.front - metres, seat.back + BUTTOCK + 0.02)
    return replace(pose, pelvis=pelvis)


def _on_bed(rng: np.random.Generator, person: Person) -> tuple[SceneObject, Seat]:
    """A bed with a person sitting in its middle or against the headboard.

    The front of the seat is where crossed legs end, anywhere on the mattress.
    """
    bed = person.sees(furniture.bed(rng))
    seat = furniture.seat_part(bed)
    low, high = (seat.centre + seat.size / 2 * sign for sign in (-1, 1))
    facing = float(rng.choice([0.0, np.pi / 2, -np.pi / 2], p=[0.6, 0.2, 0.2]))
    before, behind, beside = LEGS_BEFORE, BUTTOCK + 0.05, LEGS_BESIDE
    # Free space in metres needed around the person: towards -x, -y, and x, y of the bed.
    if facing == 0.0:
        first, last = np.array([beside, behind]), np.array([beside, before])
    else:
        across = (behind, before) if facing < 0 else (before, behind)
        first, last = np.array([across[0], beside]), np.array([across[1], beside])
    at = _within(rng, low[:2] + first, high[:2] - last)
    if facing == 0.0 and rng.random() < 0.4:
        at[1] = low[1] + behind
    c, s = np.cos(facing), np.sin(facing)
    x, y = -(at @ [[c, -s], [s, c]])
    moved = bed.moved(Placement(float(x), float(y), -facing))
    return moved, open_seat(seat_of(bed).height, front=LEGS_BEFORE)


def _within(
    rng: np.random.Generator, low: NDArray[np.float64], high: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(2,) a random position in a rectangle, or its middle if the rectangle is empty."""
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, 0.0)
    place: NDArray[np.float64] = middle + half * rng.uniform(-1, 1, 2)
    return place
