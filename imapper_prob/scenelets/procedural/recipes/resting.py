"""Sitting on an edge, on an arm, and slid forward."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from imapper_prob.models.scene import Placement
from imapper_prob.scenelets.procedural import furniture
from imapper_prob.scenelets.procedural.person import Person
from imapper_prob.scenelets.procedural.recipes.drawn import FACING_BACK, Drawn, Recipe, moments
from imapper_prob.scenelets.procedural.recipes.sitting import Taken, take_seat, with_room
from imapper_prob.scenelets.procedural.resting import (
    lean_on_rest,
    perch,
    perch_high,
    prop_head,
    prop_on_hand,
    prop_up_behind,
    slouch,
)
from imapper_prob.scenelets.procedural.seat import open_seat, seat_of
from imapper_prob.scenelets.procedural.seated import draw_seated
from imapper_prob.scenelets.procedural.sitting import sit_still

__all__ = [
    "lean_back_on_bed",
    "lean_on_armrest",
    "lean_on_bed",
    "lean_on_table",
    "perch_on",
    "perch_on_table",
    "slouch_on",
]


HAND = 0.10
"""Metres that a hand which carries needs around its wrist."""


def perch_on(kind: str) -> Recipe:
    """Sitting on the front edge of a seat."""

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, seat, place = take_seat(rng, person, kind)
        pose = perch(rng, draw_seated(rng, seat, sideways=place, upright=True), seat)
        return Drawn(sit_still(rng, pose, moments(rng, 15, 20)), (piece,))

    return draw


def perch_on_table(rng: np.random.Generator, person: Person) -> Drawn:
    """Half sitting on the edge of a table, facing away from it."""
    table = person.sees(furniture.table(rng))
    half, edge, top = (float(v) for v in table.bounds[1])
    place = rng.uniform(0.3 - half, half - 0.3)
    pose = draw_seated(rng, open_seat(top, front=edge), sideways=place, upright=True)
    pose = perch_high(rng, pose, edge=edge, top=top)
    return Drawn(sit_still(rng, pose, moments(rng, 15, 20)), (table,))


def lean_on_armrest(kind: str) -> Recipe:
    """Leaning to the side, an arm on the armrest of a chair, armchair or couch."""

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, seat, place = _with_arms(rng, person, kind)
        rest = max(seat.arms)  # the right one
        if kind != "chair":
            # One sits as far from the arm as leaning on it asks, and the seat has room.
            room = rest[0] + seat.arms[0][0] if kind == "couch" else 0.0
            place = max(rest[0] - rng.uniform(0.36, 0.44), room / 2)
        lean = -rng.uniform(0.05, 0.30) if rng.random() < 0.6 else rng.uniform(-0.05, 0.12)
        pose = draw_seated(
            rng, seat, sideways=place, yaw=rng.normal(0.0, 0.05), lean=lean, upright=True
        )
        pose = replace(pose, hands=np.array([[0.06, 0.24, 0.11], [-0.12, 0.26, 0.10]]))
        pose = lean_on_rest(rng, pose, rest)
        return Drawn(sit_still(rng, pose, moments(rng, 15, 20)), (piece,))

    return draw


def lean_on_table(rng: np.random.Generator, person: Person) -> Drawn:
    """On a chair at a table, the head propped on a hand."""
    piece, seat, place = take_seat(rng, person, "chair")
    pose = draw_seated(rng, seat, sideways=place, upright=True)
    rests = max((front for _, front, _ in seat.arms), default=-np.inf)
    edge = max(float(pose.pelvis[1]) + rng.uniform(0.18, 0.26), rests + 0.02)
    table = person.sees(furniture.table(rng))
    pose = prop_head(rng, pose, edge=edge, top=float(table.bounds[1, 2]))
    low, high = furniture.knee_room(table)
    middle, half = (low + high) / 2, max((high - low) / 2 - 0.30, 0.0)
    at = Placement(
        place + middle + rng.uniform(-half, half), edge + table.bounds[1, 1], FACING_BACK
    )
    return Drawn(sit_still(rng, pose, moments(rng, 15, 20)), (piece, table.moved(at)))


def lean_on_bed(rng: np.random.Generator, person: Person) -> Drawn:
    """On the edge of a bed, leaning to the side on a straight arm."""
    piece, seat, place = take_seat(rng, person, "bed")
    pose = prop_on_hand(rng, draw_seated(rng, seat, sideways=place, upright=True))
    piece = with_room(piece, right=float(pose.hands[0, 0]) + HAND, left=0.3)
    return Drawn(sit_still(rng, pose, moments(rng, 15, 20)), (piece,))


def lean_back_on_bed(rng: np.random.Generator, person: Person) -> Drawn:
    """On the edge of a bed, leaning back on both hands."""
    piece, seat, place = take_seat(rng, person, "bed")
    pose = prop_up_behind(rng, draw_seated(rng, seat, sideways=place, upright=True))
    beside = float(np.abs(pose.hands[:, 0]).max()) + HAND
    piece = with_room(piece, right=beside, left=beside)
    return Drawn(sit_still(rng, pose, moments(rng, 15, 20)), (piece,))


def slouch_on(kind: str) -> Recipe:
    """Slid forward on a chair, armchair or couch."""

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, seat, place = take_seat(rng, person, kind)
        pose = slouch(rng, draw_seated(rng, seat, sideways=place, upright=True), seat)
        return Drawn(sit_still(rng, pose, moments(rng, 15, 20)), (piece,))

    return draw


def _with_arms(rng: np.random.Generator, person: Person, kind: str) -> Taken:
    """A seat with armrests."""
    if kind != "chair":
        return take_seat(rng, person, kind)
    piece = person.sees(furniture.chair(rng, arms=True))
    return piece, seat_of(piece), float(rng.normal(-0.02, 0.02))
