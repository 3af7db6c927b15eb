"""Sitting on the floor, squatting, kneeling, bending down: motions and recipes.

Each function returns a person near the origin who faces +y, on a floor at z = 0. Lengths are in
metres, angles in radians; offsets are right, forward and up from the pelvis. In asymmetric poses it
is the right leg that differs. Hips bend by up to 125 degrees, the spine above them by 40 and knees
by 150 (American Academy of Orthopaedic Surgeons, *Joint Motion*, 1965); ankles bend by some 35
under the weight of a squatting body (Hemmerich et al. 2006).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.skeleton import minimum_jerk
from imapper_prob.scenelets.procedural.body import (
    ANKLE_HEIGHT,
    HALF_HIPS,
    HIP_HEIGHT,
    HIPS,
    SHIN,
    SIDES,
    THIGH,
    TRUNK,
    Drawn,
    Person,
    Recipe,
    Trunk,
    hanging_wrists,
    knees_of,
    moments,
    pair,
    pose_body,
    reachable_height,
)
from imapper_prob.scenelets.procedural.folded import SHIN_DEPTH, THIGH_DEPTH, tailor_fashion
from imapper_prob.scenelets.procedural.lying import lie_still
from imapper_prob.scenelets.procedural.reaching import DEEPEST_CROUCH, TRAVEL, extent, reach
from imapper_prob.scenelets.procedural.resting import prop_up_behind
from imapper_prob.scenelets.procedural.seated import SeatedPose, draw_seated, open_seat
from imapper_prob.scenelets.procedural.sitting import hold_still
from imapper_prob.scenelets.procedural.standing import HELD, draw_pastime, stand

__all__ = [
    "KNEE_ON_FLOOR",
    "bend_over",
    "go_into_squat",
    "lie_on_floor",
    "low_down",
    "pick_up_from_floor",
    "squat",
]

Array = NDArray[np.float64]
KNEE_ON_FLOOR: Final = 0.05
"""Height in metres of the knee joint above the floor it kneels on: half the depth of the front of a
bent knee (*Bodyspace*)."""
HEEL_ON_FLOOR: Final = 0.06
"""Height in metres of the ankle joint above the floor when the leg lies on its heel
(*Bodyspace*)."""
INSTEP_ON_FLOOR, TOES_ON_FLOOR = 0.05, 0.12
"""Heights in metres of the ankle joint above the floor when the foot lies on its instep, and when
it stands on bent toes. The first is half the height of the instep. In the second the ball of the
foot is .15 H of foot length from the ankle, below a raised heel (*Bodyspace*)."""
_KNEES_UP: Final = np.array([[0.15, 1.0, 1.0], [-0.15, 1.0, 1.0]])
"""Directions of the right and the left knee of bent legs on the floor, as (right, forward, up);
chosen."""


def _on_floor(rng: np.random.Generator, lean: float) -> SeatedPose:
    """A pose of sitting on the floor, with the legs still to be placed."""
    return draw_seated(rng, open_seat(0.0, front=0.5), lean=lean, upright=True)


def _sit_cross_legged(rng: np.random.Generator) -> SeatedPose:
    """A pose on the floor with the legs crossed in front of the body."""
    pose = _on_floor(rng, rng.uniform(-0.05, 0.35))
    return tailor_fashion(rng, pose, open_seat(0.0, front=0.5))


def _sit_legs_out(rng: np.random.Generator) -> SeatedPose:
    """A pose on the floor with both legs stretched out, or with one knee up."""
    pose = _on_floor(rng, rng.uniform(-0.05, 0.25))
    reach = rng.uniform(0.96, 0.985, 2) * (THIGH + SHIN)
    drop = HEEL_ON_FLOOR - pose.pelvis[2]
    ankles = np.stack([SIDES * rng.uniform(0.08, 0.20), np.sqrt(reach**2 - drop**2)], -1)
    ankles = np.concatenate([ankles, np.full((2, 1), drop)], -1)
    if rng.random() < 0.4:
        ankles[0, 1:] = THIGH * rng.uniform(0.90, 1.20), ANKLE_HEIGHT - pose.pelvis[2]
    pose = replace(pose, ankles=pose.at_pelvis(ankles), knees=_KNEES_UP)
    if rng.random() < 0.5:
        return prop_up_behind(rng, pose)
    forward = rng.uniform(0.26, 0.38, 2)
    return pose.with_hands(pair(0.15, forward, THIGH_DEPTH + 0.03))


def _sit_knees_up(rng: np.random.Generator) -> SeatedPose:
    """A pose on the floor, feet flat in front, hands round the shins, on the knees or behind."""
    pose = _on_floor(rng, rng.uniform(0.0, 0.30))
    flat = ANKLE_HEIGHT - pose.pelvis[2]
    forward = THIGH * rng.uniform(0.82, 1.10) + rng.uniform(-0.04, 0.04, 2)
    ankles = pair(rng.uniform(0.07, 0.15), forward, flat)
    pose = replace(pose, ankles=pose.at_pelvis(ankles), knees=_KNEES_UP)
    share = rng.random()
    if share < 0.3:
        return prop_up_behind(rng, pose)
    knees = knees_of(ankles, _KNEES_UP)
    if share < 0.65:  # hands round the shins
        along = rng.uniform(0.25, 0.45)
        hands = (1 - along) * knees + along * ankles + (0.0, SHIN_DEPTH + 0.03, 0.02)
        hands[:, 0] = SIDES * rng.uniform(0.03, 0.07)
    else:
        hands = knees + np.array([0.0, 0.04, THIGH_DEPTH])
    return pose.with_hands(hands)


def squat(rng: np.random.Generator, *, flat: bool | None = None) -> SeatedPose:
    """A deep squat on flat feet, or on the balls of the feet with the hips near the heels.

    ``flat`` selects which of the two; it is drawn if not given.

    Parameters
    ----------
    rng : numpy.random.Generator
    flat : bool, optional
        Whether the feet are flat; drawn if not given.

    Returns
    -------
    SeatedPose
    """
    if flat is None:
        flat = bool(rng.random() < 0.5)
    apart = rng.uniform(0.10, 0.19)
    bent = np.deg2rad(rng.uniform(122, 144) if flat else rng.uniform(135, 145))
    gap = np.sqrt(THIGH**2 + SHIN**2 + 2 * THIGH * SHIN * np.cos(bent))
    back = np.deg2rad(rng.uniform(36, 47) if flat else rng.uniform(15, 32))
    height = ANKLE_HEIGHT if flat else TOES_ON_FLOOR + rng.uniform(0.0, 0.03)
    # The shoulders are in front of the ankles by about as much as the hips are behind them.
    before = rng.uniform(0.04, 0.16) + gap * np.sin(back)
    lean = float(np.arcsin(np.clip(before / TRUNK, 0.0, 0.8)))
    pelvis = np.array([0.0, -gap * np.sin(back), height + gap * np.cos(back)])
    ankles = pair(apart, 0.0, height)
    if not flat and rng.random() < 0.5:  # one foot in front of the other
        ankles[0, 1], ankles[0, 2] = rng.uniform(0.08, 0.20), ANKLE_HEIGHT
    outward = rng.uniform(0.15, 0.45)
    knees = pair(outward, 1.0, 1.0)
    pose = SeatedPose(
        pelvis=pelvis,
        yaw=0.0,
        lean=lean,
        twist=float(np.clip(rng.normal(0.0, 0.10), -0.2, 0.2)),
        nod=float(rng.uniform(0.0, 0.3) - 0.6 * lean),
        ankles=ankles,
        knees=knees,
    )
    at_knees = knees_of(ankles - pelvis, knees)
    share = rng.random()
    if share < 0.4:  # forearms on the thighs, hands hanging or together before the knees
        before = rng.uniform(0.04, 0.12)
        inward = -0.5 * at_knees[:, 0]
        return pose.with_hands(
            at_knees + np.stack([inward, np.full(2, before), np.full(2, 0.05)], -1)
        )
    if share < 0.6:
        return pose.with_hands(at_knees + np.array([0.0, -0.02, THIGH_DEPTH + 0.02]))
    return _at_work(rng, pose, low=0.12, high=0.40)


def _squat_down(
    rng: np.random.Generator, pose: SeatedPose, times: Array, *, start: float, duration: float
) -> Array:
    """(n, 16, 3) joints in metres of a person who squats down with the feet in place.

    Played backwards, the motion is standing up: both are minimum-jerk movements.

    Parameters
    ----------
    rng : numpy.random.Generator
    pose : SeatedPose
        The final pose, on flat feet.
    times : (n,) float
        Seconds.
    start, duration : float
        Start and duration of the movement, seconds.
    """
    ankles = np.broadcast_to(pose.ankles, (len(times), 2, 3))
    down = minimum_jerk((times - start) / duration)
    standing = np.array([0.0, rng.uniform(-0.02, 0.03), HIP_HEIGHT])
    pelvis = standing + down[:, None] * (pose.pelvis - standing)
    # The trunk bends further half-way down, to keep the balance.
    bow = 0.25 * np.sin(np.pi * down) ** 2
    upright = rng.uniform(0.0, 0.06)
    trunk = Trunk.of(
        pelvis,
        pose.yaw,
        lean=upright + down * (pose.lean - upright) + bow,
        twist=down * pose.twist,
        nod=0.1 + down * (pose.nod - 0.1) - 0.4 * bow,
    )
    pelvis[:, 2] = np.minimum(pelvis[:, 2], reachable_height(trunk, ankles))
    hanging = hanging_wrists(trunk, 0.1)
    wrists = hanging + down[:, None, None] * (trunk.at_pelvis(pose.hands) - hanging)
    return pose_body(trunk, ankles=ankles, wrists=wrists, knees=pose.knees)


def _kneel_on_both(rng: np.random.Generator) -> SeatedPose:
    """A pose on both knees, with upright thighs or sitting on the heels."""
    on_heels = bool(rng.random() < 0.5)
    rise = _thigh_rise(rng, on_heels=on_heels)
    apart = rng.uniform(0.08, 0.15)
    knees = np.stack([_kneeling_thigh(side, apart, rise) for side in SIDES])
    instep = _foot_behind(rng)
    ankles = np.stack(
        [_kneeling_shin(k, side, apart, instep) for k, side in zip(knees, SIDES, strict=True)]
    )
    height = KNEE_ON_FLOOR - knees[0, 2]
    lean = float(rng.uniform(-0.03, 0.30))
    pose = _kneeling(rng, height, lean, ankles, knees)
    share = rng.random()
    if share < 0.5:
        if not on_heels:
            return pose.with_hands(_hanging(rng, lean))
        along = rng.uniform(0.45, 0.7)
        return pose.with_hands(HIPS + along * knees + (0.0, 0.02, THIGH_DEPTH + 0.03))
    return _at_work(rng, pose, low=0.15, high=0.65)


def _kneel_on_one(rng: np.random.Generator) -> SeatedPose:
    """A pose on the right knee, left foot flat in front; sometimes sitting on the right heel."""
    on_heel = bool(rng.random() < 0.3)
    right = _kneeling_thigh(1.0, rng.uniform(0.08, 0.14), _thigh_rise(rng, on_heels=on_heel))
    height = KNEE_ON_FLOOR - right[2]
    shin = _kneeling_shin(right, 1.0, rng.uniform(0.08, 0.14), _foot_behind(rng))
    before = THIGH * (rng.uniform(0.72, 0.95) if on_heel else rng.uniform(0.76, 1.10))
    foot = np.array([-rng.uniform(0.09, 0.16), before, ANKLE_HEIGHT - height])
    ankles, knees = np.stack([shin, foot]), np.stack([right, _KNEES_UP[1]])
    lean = float(rng.uniform(0.0, 0.35))
    pose = _kneeling(rng, height, lean, ankles, knees)
    share = rng.random()
    left = knees_of(ankles, knees)[1]
    over = left + np.array([0.0, -0.04, THIGH_DEPTH + 0.02])
    if share < 0.35:  # the right hand hangs, the left one is on its knee
        return pose.with_hands(np.stack([_hanging(rng, lean)[0], over]))
    if share < 0.55:  # both hands on that knee
        return pose.with_hands(over + np.array([[0.07, 0.02, 0.01], [-0.02, -0.03, 0.0]]))
    return _at_work(rng, pose, low=0.15, high=0.65)


def _thigh_rise(rng: np.random.Generator, *, on_heels: bool) -> float:
    """Angle of the thigh above the horizontal of a kneeling person, radians."""
    return float(np.deg2rad(rng.uniform(39, 45) if on_heels else rng.uniform(76, 88)))


def _foot_behind(rng: np.random.Generator) -> float:
    """Height in metres of the ankle of a kneeling leg: foot on its instep or on its toes."""
    base = INSTEP_ON_FLOOR if rng.random() < 0.6 else TOES_ON_FLOOR
    return float(base + rng.uniform(0.0, 0.015))


def _kneeling_thigh(side: float, apart: float, rise: float) -> Array:
    """(3,) vector from a hip to the knee in front; the knees are 2 ``apart`` from each other."""
    across, level = side * (apart - HALF_HIPS), THIGH * np.cos(rise)
    return np.array([across, level, -np.sqrt(THIGH**2 - across**2 - level**2)])


def _kneeling_shin(thigh: Array, side: float, apart: float, height: float) -> Array:
    """(3,) ankle behind a knee on the floor, from the pelvis: slightly nearer the midline."""
    across, up = -0.03 * side, height - KNEE_ON_FLOOR
    back = np.sqrt(SHIN**2 - across**2 - up**2)
    knee = thigh + np.array([side * HALF_HIPS, 0.0, 0.0])
    ankle: Array = knee + np.array([across, -back, up])
    return ankle


def _kneeling(
    rng: np.random.Generator, height: float, lean: float, ankles: Array, knees: Array
) -> SeatedPose:
    """A pose above the origin with the given leg offsets; the hands are still to be placed."""
    pelvis = np.array([0.0, 0.0, height])
    return SeatedPose(
        pelvis=pelvis,
        yaw=0.0,
        lean=lean,
        twist=float(np.clip(rng.normal(0.0, 0.10), -0.25, 0.25)),
        nod=float(rng.uniform(0.0, 0.35) - 0.6 * lean),
        ankles=pelvis + ankles,
        knees=knees,
    )


def _at_work(rng: np.random.Generator, pose: SeatedPose, *, low: float, high: float) -> SeatedPose:
    """The pose with one or both hands working in front, between two heights above the floor."""
    chest = pose.trunk.shoulders[0]
    up = rng.uniform(low, high) - pose.pelvis[2]
    forward = np.maximum(chest[:, 1] + rng.uniform(0.22, 0.36, 2), 0.28)
    hands = pair(rng.uniform(0.06, 0.18, 2), forward, up)
    if rng.random() < 0.3:
        knees = knees_of(pose.ankles - pose.pelvis, _of(pose))
        hands[1] = knees[1] + (0.0, 0.0, THIGH_DEPTH + 0.02)
    return replace(pose, hands=hands, stir=np.array([0.03, 0.02]), nod=pose.nod + 0.2)


def _of(pose: SeatedPose) -> Array:
    return _KNEES_UP if pose.knees is None else pose.knees


def _hanging(rng: np.random.Generator, lean: float) -> Array:
    """(2, 3) wrists of hanging arms, as offsets from the pelvis."""
    trunk = Trunk.of(np.zeros((1, 3)), 0.0, lean=lean)
    hands: Array = hanging_wrists(trunk, rng.uniform(0.0, 0.2), bend=rng.uniform(0.05, 0.12))[0]
    return hands


# ------------------------------------------------------------------------------------------------
# Recipes.

FROM_ABOVE: Final = (0.0, -0.04, 0.20)
"""Metres from a thing on the floor to the point from which the hand approaches it."""
KNUCKLES: Final = 0.09
"""Height in metres of the wrist above what the hand holds, fingers down (*Bodyspace*)."""
SLOW: Final = 1.25
"""Factor on the time of a reach when the whole body moves with the hand."""


class _Bend(NamedTuple):
    """A way to bend down: least and greatest bend of the trunk, radians, and the furthest that the
    knees lower the pelvis, metres."""

    least: float
    most: float
    deepest: float

    def leans(self, rng: np.random.Generator) -> tuple[float, float]:
        return rng.uniform(self.least, self.most - 0.1), self.most


STOOP: Final = _Bend(1.05, 1.4, 0.36)
SQUAT: Final = _Bend(0.55, 1.0, DEEPEST_CROUCH)
"""The two ways to bend down; both at once would bend the hips too far (Burgess-Limerick 2003)."""
_WAYS: Final[dict[str, Callable[[np.random.Generator], SeatedPose]]] = {
    "cross-legged": _sit_cross_legged,
    "legs out": _sit_legs_out,
    "knees up": _sit_knees_up,
    "squat": squat,
    "both knees": _kneel_on_both,
    "one knee": _kneel_on_one,
}


def low_down(way: str) -> Recipe:
    """Recipe that holds one low pose: cross-legged, legs out, knees up, squat, one or both knees.

    Parameters
    ----------
    way : str
        Name of the pose, such as ``"squat"``.

    Returns
    -------
    callable
        Maps rng and person to :class:`~imapper_prob.scenelets.procedural.body.Drawn`.
    """
    draw_pose = _WAYS[way]

    def draw(rng: np.random.Generator, person: Person) -> Drawn:
        return hold_still(rng, draw_pose(rng))

    return draw


def lie_on_floor(rng: np.random.Generator, person: Person) -> Drawn:
    """Lying on the back or on the side on the floor, without a pillow.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person

    Returns
    -------
    Drawn
    """
    on_side = bool(rng.random() < 0.4)
    times = moments(rng, 15, 20)
    return Drawn(lie_still(rng, times, on_side=on_side, room=np.inf, pillow=0.08), ())


def go_into_squat(rng: np.random.Generator, person: Person) -> Drawn:
    """Squatting down on the spot.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person

    Returns
    -------
    Drawn
    """
    times = moments(rng, 17, 20)
    duration = rng.uniform(1.0, 1.3)
    start = rng.uniform(0.0, times[-1] - duration)
    pose = squat(rng, flat=True)
    joints = _squat_down(rng, pose, times, start=start, duration=duration)
    return Drawn(joints, ())


def _floor_target(rng: np.random.Generator, hands: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(2, 3) wrists in metres at something on the floor in front of or beside the feet."""
    middle = np.array([rng.uniform(-0.05, 0.20), rng.uniform(0.20, 0.42)])
    apart = np.array([0.13, -0.13]) * hands.all()
    height = KNUCKLES + rng.uniform(0.0, 0.16)
    return np.stack([middle[0] + apart, np.full(2, middle[1]), np.full(2, height)], -1)


def pick_up_from_floor(rng: np.random.Generator, person: Person) -> Drawn:
    """Bending down, taking something from the floor and coming up.

    The person either stoops with the knees slightly bent, or bends the knees far.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person

    Returns
    -------
    Drawn
    """
    times = moments(rng, 18, 20)
    load = draw_pastime(rng, {name: HELD[name] for name in ("box", "cup", "book", "bag")})
    hands = ~np.isnan(load.hands[:, 0])
    start = rng.uniform(-0.35, 0.1)
    bend = STOOP if rng.random() < 0.55 else SQUAT
    joints = reach(
        stand(rng, times),
        targets=_floor_target(rng, hands),
        hands=hands,
        part=extent(times, start=start, finish=start + SLOW * TRAVEL, travel=SLOW * TRAVEL),
        via=FROM_ABOVE,
        leans=bend.leans(rng),
        deepest=bend.deepest,
        after=load,
    )
    return Drawn(joints, ())


def bend_over(rng: np.random.Generator, person: Person) -> Drawn:
    """Bent down and working with the hands at the feet or the floor, as on a shoe.

    Parameters
    ----------
    rng : numpy.random.Generator
    person : Person

    Returns
    -------
    Drawn
    """
    times = moments(rng, 15, 20)
    hands = np.array([True, bool(rng.random() < 0.6)])
    targets = _floor_target(rng, hands)
    targets[:, 2] += rng.uniform(0.0, 0.15)
    work = 0.02 * np.sin(2 * np.pi * times / rng.uniform(1.2, 2.5))
    stays = rng.random() < 0.6
    bend = STOOP if rng.random() < 0.55 else SQUAT
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
        leans=bend.leans(rng),
        deepest=bend.deepest,
    )
    return Drawn(joints, ())
