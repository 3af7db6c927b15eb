"""Lying on a bed or couch."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import Cuboid, Placement
from imapper_prob.scenelets.procedural import furniture
from imapper_prob.scenelets.procedural.lying import HEAD_AT, LIMBS_END, lie_still
from imapper_prob.scenelets.procedural.person import Person
from imapper_prob.scenelets.procedural.recipes.drawn import Drawn, moments

__all__ = ["lie_on_bed", "lie_on_couch"]


def lie_on_bed(rng: np.random.Generator, person: Person) -> Drawn:
    """On the back or side, the head at the headboard."""
    bed = person.sees(furniture.bed(rng))
    seat = next(c for c in bed.cuboids if c.part == "seat")
    width, length, _ = seat.size
    aside = max(width / 2 - 0.40, 0.0)  # both arms stay on the mattress
    head = LIMBS_END + rng.uniform(0.03, 0.15)
    at = Placement(
        float(rng.uniform(-aside, aside)),
        float(seat.centre[1] - length / 2 + head + HEAD_AT),
        float(rng.normal(0.0, 0.05)),
    )
    joints = lie_still(
        rng,
        moments(rng, 15, 20),
        on_side=bool(rng.random() < 0.5),
        room=float(length - head - HEAD_AT - LIMBS_END),
    )
    return Drawn(at.apply(joints + _surface(seat)), (bed,))


def lie_on_couch(rng: np.random.Generator, person: Person) -> Drawn:
    """Along a couch of three seats, on the back, or on the side and looking into the room."""
    couch = person.sees(furniture.couch(rng, seats=3))
    seat = next(c for c in couch.cuboids if c.part == "seat")
    width = seat.size[0]
    head = LIMBS_END + rng.uniform(0.02, 0.06)
    on_side = bool(rng.random() < 0.5)
    # The right side down, one looks into the room with the head at the end of +x.
    end = 1 if on_side else int(rng.choice([-1, 1]))
    at = Placement(
        float(end * (width / 2 - head - HEAD_AT)), float(seat.centre[1] + 0.04), end * np.pi / 2
    )
    joints = lie_still(
        rng,
        moments(rng, 15, 20),
        on_side=on_side,
        room=float(width - head - HEAD_AT - LIMBS_END),
    )
    return Drawn(at.apply(joints + _surface(seat)), (couch,))


def _surface(seat: Cuboid) -> NDArray[np.float64]:
    """(3,) from the floor up to what one lies on, metres."""
    return np.array([0.0, 0.0, seat.centre[2] + seat.size[2] / 2])
