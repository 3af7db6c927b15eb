"""Reaching into shelves: high and low, in passing, and along a board."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import Placement, SceneObject
from imapper_prob.scenelets.procedural import furniture
from imapper_prob.scenelets.procedural.gait import Walk, minimum_jerk, settle, walk_along
from imapper_prob.scenelets.procedural.person import Person
from imapper_prob.scenelets.procedural.reaching import TRAVEL, extent, reach
from imapper_prob.scenelets.procedural.recipes.drawn import FACING_BACK, Drawn, Recipe, moments
from imapper_prob.scenelets.procedural.standing import stand

__all__ = ["browse_shelf", "reach_shelf", "step_to_shelf"]

Array = NDArray[np.float64]

FROM_THE_FRONT = (0.0, -0.22, 0.02)
"""Metres from a thing in a shelf to where the hand is just before."""

LOWEST_BOARD, HIGHEST_BOARD = 0.28, 1.72
"""Heights in metres between which a person of 1.70 m reaches a board without kneeling or
standing on the toes (Panero and Zelnik 1979: .30 to 1.80)."""


class _Aim(NamedTuple):
    """A shelf before the person, what is reached for (2, 3), and with which hands."""

    piece: SceneObject
    targets: Array
    hands: tuple[bool, bool]


def _aim(
    rng: np.random.Generator, person: Person, *, turned: float = 0.0, spread: float = 0.0
) -> _Aim:
    """A shelf, and a place on one of its boards.

    Parameters
    ----------
    turned : float
        Where the shelf is, to the left of where the person faces, radians.
    spread : float
        Metres that must be free on the board to both sides of the place.
    """
    piece = person.sees(furniture.shelf(rng))
    boards = np.array([c.centre[2] + c.size[2] / 2 for c in piece.cuboids if c.part == "board"])
    highest = HIGHEST_BOARD - spread
    board = float(rng.choice(boards[(boards > LOWEST_BOARD) & (boards < highest)]))
    # Arms are too short for a high board from afar.
    front = rng.uniform(0.40, 0.52) - 0.35 * max(board - 1.25, 0.0)
    half = piece.bounds[1, 0] - 0.15
    offset = 0.7 * rng.uniform(-half, half)
    hands = (True, True) if rng.random() < 0.35 else (True, False)
    room = max(half - spread - 0.12 * all(hands), 0.05)
    place = np.clip(rng.uniform(-0.10, 0.20), offset - room, offset + room)
    across = place + np.array([0.12, -0.12]) * all(hands)
    above = board + (0.10 if board < 1.3 else 0.06)
    depth = front + rng.uniform(-0.03, 0.06)
    targets = np.stack([across, np.full(2, depth), np.full(2, above)], -1)
    at = Placement(float(offset), front + piece.bounds[1, 1], FACING_BACK)
    about = Placement(0.0, 0.0, turned)
    return _Aim(piece.moved(at).moved(about), about.apply(targets), hands)


def _via(turned: float) -> Array:
    via: Array = Placement(0.0, 0.0, turned).apply(np.array(FROM_THE_FRONT))
    return via


def reach_shelf(rng: np.random.Generator, person: Person) -> Drawn:
    """Standing before a shelf, or side-on to it, and reaching for something on a board."""
    times = moments(rng, 15, 20)
    # A single hand is the right one, so the shelf is rather on that side.
    turned = rng.uniform(-0.7, 0.3) if rng.random() < 0.4 else 0.0
    aim = _aim(rng, person, turned=turned)
    part = (
        extent(times, start=-1.0, finish=np.inf),
        extent(times, start=rng.uniform(0.0, 0.3), finish=np.inf),
        extent(times, start=rng.uniform(-0.3, 0.0), finish=times[-1] - rng.uniform(0.5, 0.7)),
    )[rng.integers(3)]
    work = 0.02 * np.sin(2 * np.pi * times / rng.uniform(1.5, 3.0))
    joints = reach(
        stand(rng, times, one_leg=bool(rng.random() < 0.2)),
        targets=aim.targets + work[:, None, None] * (1.0, 0.0, 0.0),
        hands=aim.hands,
        part=part,
        via=_via(turned),
    )
    return Drawn(joints, (aim.piece,))


def _approach(rng: np.random.Generator, times: Array) -> Walk:
    """A step or two towards the origin, from before it or from the side."""
    if rng.random() < 0.5:
        start = Placement(rng.uniform(-0.2, 0.2), -rng.uniform(0.25, 0.55), rng.uniform(-0.4, 0.4))
    else:
        side = rng.choice([-1, 1])
        start = Placement(
            side * rng.uniform(0.3, 0.6), -rng.uniform(0.0, 0.3), side * rng.uniform(0.6, 1.5)
        )
    return walk_along(
        settle(start, Placement(0.0, 0.0, 0.0), arrival=0.9),
        times,
        step_time=0.38,
        phase=rng.uniform(-0.1, 0.4),
        lean=0.03,
        half_width=rng.uniform(0.09, 0.14),
    )


def step_to_shelf(*, backwards: bool) -> Recipe:
    """A step towards a shelf and reaching into it; backwards, letting go and leaving."""

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        times = moments(rng, 18, 20)
        aim = _aim(rng, person)
        joints = reach(
            _approach(rng, times),
            targets=aim.targets,
            hands=aim.hands,
            part=extent(times, start=times[-1] - TRAVEL - rng.uniform(0.0, 0.3), finish=np.inf),
            via=_via(0.0),
        )
        return Drawn(joints[::-1] if backwards else joints, (aim.piece,))

    return draw


def browse_shelf(rng: np.random.Generator, person: Person) -> Drawn:
    """A hand that goes along a board, looking for something."""
    times = moments(rng, 15, 20)
    way = rng.uniform(0.10, 0.22)
    aim = _aim(rng, person, spread=way)
    along = rng.choice([-1, 1]) * way * (2 * minimum_jerk(times / times[-1]) - 1)
    joints = reach(
        stand(rng, times),
        targets=aim.targets + along[:, None, None] * (1.0, 0.0, 0.0),
        hands=aim.hands,
        part=extent(times, start=-1.0, finish=np.inf),
        via=_via(0.0),
    )
    return Drawn(joints, (aim.piece,))
