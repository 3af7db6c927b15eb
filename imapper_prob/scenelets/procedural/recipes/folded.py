"""Sitting on furniture with legs crossed or folded."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import Placement, SceneObject
from imapper_prob.scenelets.procedural import furniture
from imapper_prob.scenelets.procedural.folded import (
    ankle_on_knee,
    knee_over_knee,
    leg_folded_under,
    tailor_fashion,
)
from imapper_prob.scenelets.procedural.person import Person
from imapper_prob.scenelets.procedural.recipes.drawn import Drawn, Recipe, moments
from imapper_prob.scenelets.procedural.recipes.sitting import Taken, take_seat, with_room
from imapper_prob.scenelets.procedural.seat import Seat, open_seat, seat_of
from imapper_prob.scenelets.procedural.seated import BUTTOCK, SeatedPose, draw_seated
from imapper_prob.scenelets.procedural.sitting import sit_still

__all__ = ["sit_crossed", "sit_on_leg", "sit_tailor_fashion"]

KNEE_BESIDE: Final = 0.54
"""Metres from the pelvis to the side within which a folded leg ends."""

LEGS_BEFORE, LEGS_BESIDE = 0.44, 0.42
"""Metres from the pelvis, forward and to the sides, within which legs crossed before it end."""


def sit_crossed(kind: str) -> Recipe:
    """Sitting with one leg over the other: knee over knee, or ankle on knee."""

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, seat, place = take_seat(rng, person, kind)
        leans_back = np.isfinite(seat.back) and rng.random() < 0.4
        lean = -rng.uniform(0.12, 0.40) if leans_back else rng.uniform(-0.05, 0.20)
        pose = draw_seated(rng, seat, sideways=place, lean=lean, upright=True)
        cross = knee_over_knee if rng.random() < 0.55 else ankle_on_knee
        return Drawn(sit_still(rng, cross(rng, pose, seat), moments(rng, 15, 20)), (piece,))

    return draw


def sit_on_leg(kind: str) -> Recipe:
    """Sitting with one leg folded on a couch, bench, chair or the edge of a bed."""

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, seat, place = _wide(rng, person, kind, right=KNEE_BESIDE, left=0.24)
        # Where there is room the body turns to the side of the folded leg.
        narrow = kind in ("chair", "bench")
        turn = rng.uniform(0.0, 0.25) if narrow else rng.uniform(0.3, 0.65)
        pose = draw_seated(rng, seat, sideways=place, yaw=-turn, upright=True)
        # Where there is a mattress or a cushion, the whole shin is on it.
        pose = _back_from_edge(pose, seat, rng.uniform(0.27, 0.32 if narrow else 0.36))
        pose = leg_folded_under(rng, pose, replace(seat, arms=()))
        if kind == "bed":
            piece = with_room(piece, right=KNEE_BESIDE, left=0.3)
        return Drawn(sit_still(rng, pose, moments(rng, 15, 20)), (piece,))

    return draw


def sit_tailor_fashion(kind: str) -> Recipe:
    """Sitting with both legs crossed on a couch or on a bed."""

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        if kind == "bed":
            piece, seat = _on_bed(rng, person)
            place = 0.0
        else:
            piece, seat, place = _wide(rng, person, kind, right=LEGS_BESIDE, left=LEGS_BESIDE)
        seat = replace(seat, closed=False, arms=())  # nothing goes to the floor
        pose = draw_seated(rng, seat, sideways=place, lean=rng.uniform(-0.05, 0.30), upright=True)
        pose = _back_from_edge(pose, seat, LEGS_BEFORE - rng.uniform(0.0, 0.08))
        pose = tailor_fashion(rng, pose, seat)
        return Drawn(sit_still(rng, pose, moments(rng, 15, 20)), (piece,))

    return draw


def _wide(
    rng: np.random.Generator, person: Person, kind: str, *, right: float, left: float
) -> Taken:
    """A seat whose arms leave so much room to both sides of the pelvis, metres."""
    if kind == "chair":
        piece = person.sees(furniture.chair(rng, arms=False))
        return piece, seat_of(piece), float(rng.normal(0.0, 0.02))
    if kind != "couch":
        return take_seat(rng, person, kind)
    piece = person.sees(furniture.couch(rng, seats=int(rng.choice([2, 3]))))
    half = next(c.size[0] for c in piece.cuboids if c.part == "seat") / 2
    return piece, seat_of(piece), float(rng.uniform(left - half, max(half - right, left - half)))


def _back_from_edge(pose: SeatedPose, seat: Seat, metres: float) -> SeatedPose:
    """The same person so far behind the front edge, or as far as the back lets them."""
    pelvis = pose.pelvis.copy()
    pelvis[1] = max(seat.front - metres, seat.back + BUTTOCK + 0.02)
    return replace(pose, pelvis=pelvis)


def _on_bed(rng: np.random.Generator, person: Person) -> tuple[SceneObject, Seat]:
    """A bed below somebody who sits in the middle of it, or against the headboard.

    The seat's front is where crossed legs end, anywhere on the mattress.
    """
    bed = person.sees(furniture.bed(rng))
    seat = next(c for c in bed.cuboids if c.part == "seat")
    low, high = (seat.centre + seat.size / 2 * sign for sign in (-1, 1))
    facing = float(rng.choice([0.0, np.pi / 2, -np.pi / 2], p=[0.6, 0.2, 0.2]))
    before, behind, beside = LEGS_BEFORE, BUTTOCK + 0.05, LEGS_BESIDE
    # Metres that must be free of where one sits: to -x, -y, and to x, y of the bed.
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
    """(2,) a place between two, or in their middle where there is no room."""
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, 0.0)
    place: NDArray[np.float64] = middle + half * rng.uniform(-1, 1, 2)
    return place
