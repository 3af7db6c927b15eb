"""Low down with no furniture: on the floor, squatting, kneeling, and bending down to the floor."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.scenelets.procedural.low import (
    kneel_on_both,
    kneel_on_one,
    sit_cross_legged,
    sit_knees_up,
    sit_legs_out,
    squat,
    squat_down,
)
from imapper_prob.scenelets.procedural.lying import lie_still
from imapper_prob.scenelets.procedural.person import Person
from imapper_prob.scenelets.procedural.reaching import DEEPEST_CROUCH, TRAVEL, extent, reach
from imapper_prob.scenelets.procedural.recipes.drawn import Drawn, Recipe, moments
from imapper_prob.scenelets.procedural.seated import SeatedPose
from imapper_prob.scenelets.procedural.sitting import sit_still
from imapper_prob.scenelets.procedural.standing import HELD, draw_pastime, stand

__all__ = [
    "bend_over",
    "go_into_squat",
    "lie_on_floor",
    "low_down",
    "pick_up_from_floor",
]

FROM_ABOVE: Final = (0.0, -0.04, 0.20)
"""Metres from a thing on the floor to where the hand is just before."""

KNUCKLES: Final = 0.09
"""Wrist above what the hand holds, fingers down, metres (*Bodyspace*)."""

SLOW: Final = 1.25
"""Times that a hand's way takes when the whole body goes along."""

STOOP: Final = (1.05, 1.4, 0.36)
SQUAT: Final = (0.55, 1.0, DEEPEST_CROUCH)
"""Least and greatest bend of the trunk, radians, and most that the knees lower the pelvis, metres,
of the two ways down: hips bend too far in both at once (lifting styles: Burgess-Limerick 2003)."""

_WAYS: Final[dict[str, Callable[[np.random.Generator], SeatedPose]]] = {
    "cross-legged": sit_cross_legged,
    "legs out": sit_legs_out,
    "knees up": sit_knees_up,
    "squat": squat,
    "both knees": kneel_on_both,
    "one knee": kneel_on_one,
}


def low_down(way: str) -> Recipe:
    """Staying so: cross-legged, legs out, knees up, squat, both knees, one knee."""
    draw_pose = _WAYS[way]

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        return Drawn(sit_still(rng, draw_pose(rng), moments(rng, 15, 20)), ())

    return draw


def lie_on_floor(rng: np.random.Generator, person: Person) -> Drawn:
    """On the back or on the side, with nothing below the head."""
    on_side = bool(rng.random() < 0.4)
    times = moments(rng, 15, 20)
    return Drawn(lie_still(rng, times, on_side=on_side, room=np.inf, pillow=0.08), ())


def go_into_squat(*, backwards: bool) -> Recipe:
    """Squatting down on the spot; backwards, standing up."""

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        times = moments(rng, 17, 20)
        duration = rng.uniform(1.0, 1.3)
        start = rng.uniform(0.0, times[-1] - duration)
        pose = squat(rng, flat=True)
        joints = squat_down(rng, pose, times, start=start, duration=duration)
        return Drawn(joints[::-1] if backwards else joints, ())

    return draw


def _floor_target(rng: np.random.Generator, hands: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(2, 3) wrists at something on the floor before the feet, or beside them, metres."""
    middle = np.array([rng.uniform(-0.05, 0.20), rng.uniform(0.20, 0.42)])
    apart = np.array([0.13, -0.13]) * hands.all()
    height = KNUCKLES + rng.uniform(0.0, 0.16)
    return np.stack([middle[0] + apart, np.full(2, middle[1]), np.full(2, height)], -1)


def pick_up_from_floor(*, backwards: bool) -> Recipe:
    """Bending down, taking something from the floor and coming up; backwards, putting it down.

    Some stoop over knees that are a little bent, and some bend their knees far.
    """

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        times = moments(rng, 18, 20)
        load = draw_pastime(rng, {name: HELD[name] for name in ("box", "cup", "book", "bag")})
        hands = ~np.isnan(load.hands[:, 0])
        start = rng.uniform(-0.35, 0.1)
        least, most, deepest = STOOP if rng.random() < 0.55 else SQUAT
        joints = reach(
            stand(rng, times),
            targets=_floor_target(rng, hands),
            hands=hands,
            part=extent(times, start=start, finish=start + SLOW * TRAVEL, travel=SLOW * TRAVEL),
            via=FROM_ABOVE,
            leans=(rng.uniform(least, most - 0.1), most),
            deepest=deepest,
            after=load,
        )
        return Drawn(joints[::-1] if backwards else joints, ())

    return draw


def bend_over(rng: np.random.Generator, person: Person) -> Drawn:
    """Bent down with the hands at the feet or the floor, at work there, as on a shoe."""
    times = moments(rng, 15, 20)
    hands = np.array([True, bool(rng.random() < 0.6)])
    targets = _floor_target(rng, hands)
    targets[:, 2] += rng.uniform(0.0, 0.15)
    work = 0.02 * np.sin(2 * np.pi * times / rng.uniform(1.2, 2.5))
    stays = rng.random() < 0.6
    least, most, deepest = STOOP if rng.random() < 0.55 else SQUAT
    joints = reach(
        stand(rng, times),
        targets=targets + work[:, None, None] * (1.0, 0.3, 0.5),
        hands=hands,
        part=extent(
            times,
            start=-2.0 if stays else rng.uniform(-0.2, 0.2),
            finish=np.inf,
            travel=SLOW * TRAVEL,
        ),
        via=FROM_ABOVE,
        leans=(rng.uniform(least, most - 0.1), most),
        deepest=deepest,
    )
    return Drawn(joints, ())
