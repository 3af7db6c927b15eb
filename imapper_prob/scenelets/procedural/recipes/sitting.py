"""Sitting, sitting down and standing up."""

from __future__ import annotations

import numpy as np

from imapper_prob.models.scene import Placement, SceneObject
from imapper_prob.scenelets.procedural import furniture
from imapper_prob.scenelets.procedural.person import Person
from imapper_prob.scenelets.procedural.recipes.drawn import FACING_BACK, Drawn, Recipe, moments
from imapper_prob.scenelets.procedural.sitting import at_desk, draw_seated, sit_down, sit_still

__all__ = ["sit", "sit_at_low_table", "sit_at_table", "sit_down_on"]


def _seat(rng: np.random.Generator, person: Person, kind: str) -> tuple[SceneObject, float]:
    """A piece to sit on, and the x of the seat that is taken."""
    if kind == "couch":
        seats = int(rng.integers(1, 4))
        piece = person.sees(furniture.couch(rng, seats=seats))
        place = furniture.couch_place(piece, seats=seats, place=int(rng.integers(seats)))
        return piece, place + rng.uniform(-0.06, 0.06)
    if kind == "stool":
        return person.sees(furniture.stool(rng)), 0.0
    return person.sees(furniture.chair(rng, arms=bool(rng.random() < 0.35))), 0.0


def sit(kind: str) -> Recipe:
    """Sitting still on a chair, stool or couch."""

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, place = _seat(rng, person, kind)
        pose = draw_seated(rng, piece, sideways=place)
        return Drawn(sit_still(rng, pose, moments(rng, 15, 20)), (piece,))

    return draw


def sit_at_low_table(rng: np.random.Generator, person: Person) -> Drawn:
    """On a couch with a coffee table before the knees."""
    piece, place = _seat(rng, person, "couch")
    pose = draw_seated(rng, piece, sideways=place, upright=True)
    table = person.sees(furniture.low_table(rng))
    knees = max(pose.ankles[:, 1].max(), pose.pelvis[1] + 0.42)
    y = knees + rng.uniform(0.15, 0.30) + table.bounds[1, 1]
    low = table.moved(Placement(place + rng.uniform(-0.2, 0.2), float(y), FACING_BACK))
    return Drawn(sit_still(rng, pose, moments(rng, 15, 20)), (piece, low))


def sit_at_table(rng: np.random.Generator, person: Person) -> Drawn:
    """On a chair at a table, hands on the top."""
    piece = person.sees(furniture.chair(rng, arms=False))
    top = person.sees(furniture.table(rng))
    pose = draw_seated(rng, piece, upright=True)
    edge = pose.pelvis[1] + rng.uniform(0.20, 0.30)
    pose = at_desk(rng, pose, edge=edge, top=float(top.bounds[1, 2]))
    half = (top.bounds[1, 0] - 0.35) * 0.8  # knees stay between the legs of the table
    at = Placement(rng.uniform(-half, half), edge + top.bounds[1, 1], FACING_BACK)
    return Drawn(sit_still(rng, pose, moments(rng, 15, 20)), (piece, top.moved(at)))


def sit_down_on(kind: str, *, backwards: bool) -> Recipe:
    """Sitting down on a chair or couch; backwards, standing up."""

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        piece, place = _seat(rng, person, kind)
        pose = draw_seated(rng, piece, sideways=place, even_feet=True)
        if rng.random() < 0.3:
            times = moments(rng, 15, 17)
            turn, approach = 0.0, (0.0, 0.0)
        else:
            times = moments(rng, 19, 20)
            turn = float(rng.choice([-1, 1]) * rng.uniform(0.3, 2.4))
            approach = (float(rng.uniform(-0.25, 0.25)), float(rng.uniform(0.10, 0.35)))
        joints = sit_down(rng, pose, times, turn=turn, approach=approach)
        return Drawn(joints[::-1] if backwards else joints, (piece,))

    return draw
