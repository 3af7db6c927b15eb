"""Standing: positions of feet, weight and hands, and leaning on or against furniture."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.scenelets.procedural.body import (
    ANKLE_HEIGHT,
    ELBOWS,
    FOREARM,
    HIP_HEIGHT,
    SIDES,
    UPPER_ARM,
    Trunk,
    hanging_wrists,
    pair,
    pose_body,
    reachable_height,
)
from imapper_prob.scenelets.procedural.gait import Walk

__all__ = [
    "HELD",
    "Pastime",
    "draw_pastime",
    "held",
    "lean_against",
    "lean_on",
    "stand",
    "stand_idle",
    "sway",
    "upright",
]

Array = NDArray[np.float64]

HALF_DEPTH: Final = 0.12
"""Metres from the hip joints to the back of the body (buttock depth is .24: Pheasant and
Haslegrave, *Bodyspace*, 2005)."""


@dataclass(frozen=True)
class Pastime:
    """What a standing person does with the hands.

    Parameters
    ----------
    hands : (2, 3) float
        Wrists, right then left, as right, forward and up from the pelvis, metres. NaN for a hand
        that hangs.
    elbows : (float, float, float)
        Direction in which the elbows point: outward, forward and up.
    nod : float
        Forward bend of the head, radians.
    """

    hands: Array
    elbows: tuple[float, float, float] = ELBOWS
    nod: float = 0.1


_HANGS: Final = (np.nan, np.nan, np.nan)
"""A hand that has nothing to do."""
_OUT, _WIDE, _DOWN = (1.0, -0.7, -0.5), (2.0, -0.7, -0.5), (0.4, 0.2, -1.0)
"""Directions of elbows: outward, forward, up; chosen by eye."""

_PASTIMES: Final[dict[str, Pastime]] = {
    "arms hanging": Pastime(np.array([_HANGS, _HANGS])),
    "arms crossed": Pastime(np.array([[-0.08, 0.24, 0.26], [0.08, 0.20, 0.22]]), elbows=_OUT),
    "hands on hips": Pastime(np.array([[0.20, 0.02, 0.07], [-0.20, 0.02, 0.07]]), elbows=_WIDE),
    "hands clasped": Pastime(np.array([[0.04, 0.17, 0.02], [-0.04, 0.18, 0.02]]), elbows=_OUT),
    "hand to face": Pastime(np.array([[0.06, 0.16, 0.62], _HANGS]), elbows=_DOWN),
    "on the phone": Pastime(np.array([[0.14, 0.10, 0.62], _HANGS]), elbows=_DOWN),
    "looking at a phone": Pastime(np.array([[0.06, 0.28, 0.32], [-0.02, 0.26, 0.28]]), nod=0.5),
    "cup in hand": Pastime(np.array([[0.12, 0.27, 0.30], _HANGS])),
}
"""Ways to wait; the positions of the hands are those of a body of 1.70 m."""

HELD: Final[dict[str, Pastime]] = {
    "tray": Pastime(np.array([[0.17, 0.30, 0.22], [-0.17, 0.30, 0.22]])),
    "box": Pastime(np.array([[0.15, 0.26, 0.12], [-0.15, 0.26, 0.12]])),
    "cup": _PASTIMES["cup in hand"],
    "book": Pastime(np.array([[0.14, 0.10, 0.30], _HANGS]), elbows=_OUT),
    "bag": Pastime(np.array([[0.24, 0.02, -0.03], _HANGS])),
    "phone": _PASTIMES["on the phone"],
}
"""Ways to hold something, by what is held."""


def draw_pastime(rng: np.random.Generator, among: dict[str, Pastime]) -> Pastime:
    """Draw one of several, with hands moved by a few centimetres.

    Parameters
    ----------
    rng : numpy.random.Generator
    among : dict of str to Pastime
        By name.

    Returns
    -------
    Pastime
    """
    chosen = among[list(among)[rng.integers(len(among))]]
    return replace(
        chosen,
        hands=chosen.hands + rng.normal(0.0, 0.015, (2, 3)),
        nod=chosen.nod + float(rng.uniform(-0.1, 0.15)),
    )


def held(pastime: Pastime, trunk: Trunk, hanging: ArrayLike) -> Array:
    """(n, 2, 3) wrists of a pastime; a hand that hangs is taken from ``hanging`` (n, 2, 3).

    Parameters
    ----------
    pastime : Pastime
    trunk : Trunk
    hanging : (n, 2, 3) float
        Wrists of hanging arms, metres.

    Returns
    -------
    (n, 2, 3) float
    """
    return np.where(np.isnan(pastime.hands), hanging, trunk.at_pelvis(pastime.hands))


def sway(rng: np.random.Generator, times: Array) -> Array:
    """(n, 2) slow shifts of weight in metres: 1 cm sideways and half of that back and forth.

    Parameters
    ----------
    rng : numpy.random.Generator
    times : (n,) float
        Seconds.

    Returns
    -------
    (n, 2) float
    """
    slow = 2 * np.pi * (times / rng.uniform(2.5, 5.0) + rng.random())
    return np.stack([0.010 * np.sin(slow), 0.005 * np.sin(1.3 * slow + 1)], -1)


def stand(rng: np.random.Generator, times: Array, *, one_leg: bool = False) -> Walk:
    """The motion of a person who stands about the origin, facing +y, with hanging arms.

    Parameters
    ----------
    rng : numpy.random.Generator
    times : (n,) float
        Seconds.
    one_leg : bool
        Whether one leg carries the weight and the other foot rests ahead and to the side.

    Returns
    -------
    Walk
    """
    feet = _feet(rng)
    level, yaw, tilt = sway(rng, times), 0.0, 0.0
    if one_leg:
        carrying, free = rng.permutation(2)
        feet[free, :2] += SIDES[free] * rng.uniform(0.0, 0.10), rng.uniform(0.03, 0.16)
        level[:, 0] += 0.6 * feet[carrying, 0]
        yaw, tilt = rng.uniform(-0.1, 0.1), -SIDES[carrying] * rng.uniform(0.0, 0.06)
    ankles = np.broadcast_to(feet, (len(times), 2, 3))
    lean, nod = rng.uniform(0.0, 0.06), rng.uniform(0.0, 0.2)
    trunk = upright(level, ankles, yaw=yaw, lean=lean, tilt=tilt, nod=nod)
    wrists = hanging_wrists(trunk, rng.uniform(-0.05, 0.2), bend=rng.uniform(0.04, 0.12))
    return Walk(trunk, ankles, wrists)


def _feet(rng: np.random.Generator) -> Array:
    """(2, 3) ankles of two feet side by side."""
    apart, ahead = rng.uniform(0.09, 0.15), rng.uniform(-0.04, 0.04)
    return pair(apart, SIDES * ahead, ANKLE_HEIGHT)


def upright(
    level: Array,
    ankles: Array,
    *,
    yaw: ArrayLike,
    lean: ArrayLike = 0.0,
    tilt: ArrayLike = 0.0,
    twist: ArrayLike = 0.0,
    nod: ArrayLike = 0.0,
    crouch: ArrayLike = 0.0,
) -> Trunk:
    """A trunk as high as the legs allow, less ``crouch``.

    Parameters
    ----------
    level : (n, 2) float
        Position of the pelvis in top view, metres.
    ankles : (n, 2, 3) float
        Metres.
    yaw, lean, tilt, twist, nod
        As in :class:`~imapper_prob.scenelets.procedural.body.Trunk`.
    crouch : (n,) float
        Metres by which bent knees lower the pelvis.

    Returns
    -------
    Trunk
    """
    pelvis = np.concatenate([level, np.full((len(level), 1), HIP_HEIGHT)], -1)
    trunk = Trunk.of(pelvis, yaw, lean=lean, tilt=tilt, twist=twist, nod=nod)
    height = np.minimum(HIP_HEIGHT, reachable_height(trunk, ankles)) - crouch
    return replace(trunk, pelvis=np.concatenate([level, height[:, None]], -1))


def stand_idle(rng: np.random.Generator, times: Array) -> Array:
    """(n, 16, 3) joints in metres of a person who stands and waits.

    Parameters
    ----------
    rng : numpy.random.Generator
    times : (n,) float
        Seconds.

    Returns
    -------
    (n, 16, 3) float
    """
    body = stand(rng, times, one_leg=bool(rng.random() < 0.5))
    pastime = draw_pastime(rng, _PASTIMES)
    trunk = replace(body.trunk, nod=np.full(len(times), pastime.nod))
    wrists = held(pastime, trunk, body.wrists)
    return pose_body(trunk, ankles=body.ankles, wrists=wrists, elbows=pastime.elbows)


def lean_on(rng: np.random.Generator, times: Array, *, top: float) -> tuple[Array, float]:
    """The motion of leaning on a table or counter with both hands and straight arms.

    Parameters
    ----------
    rng : numpy.random.Generator
    times : (n,) float
        Seconds.
    top : float
        Height of the surface, metres.

    Returns
    -------
    joints : (n, 16, 3) float
        Metres; the feet are about the origin, facing +y.
    edge : float
        The y of the edge of the surface, metres.
    """
    # A low surface needs more lean; otherwise the arms would not reach down to it.
    lean = 0.35 + 1.6 * max(0.93 - top, 0.0) + rng.uniform(0.0, 0.25)
    hands = top + 0.05
    ankles = np.broadcast_to(_feet(rng), (len(times), 2, 3))
    level = 0.5 * sway(rng, times)
    level[:, 1] += rng.uniform(0.0, 0.12)
    slow = np.sin(2 * np.pi * times / rng.uniform(2.5, 5.0))
    trunk = upright(level, ankles, yaw=0.0, lean=lean + 0.01 * slow, nod=0.15 - 0.6 * lean)
    apart = rng.uniform(0.18, 0.28)
    shoulder = trunk.shoulders.mean(0)[0]
    straight = 0.97 * (UPPER_ARM + FOREARM)
    room = straight**2 - (shoulder[2] - hands) ** 2 - (apart - shoulder[0]) ** 2
    ahead = shoulder[1] + np.sqrt(max(room, 0.0))
    wrists = pair(apart, ahead, hands)
    joints = pose_body(trunk, ankles=ankles, wrists=np.broadcast_to(wrists, ankles.shape))
    return joints, float(ahead - rng.uniform(0.03, 0.08))


def lean_against(rng: np.random.Generator, times: Array, *, top: float) -> tuple[Array, float]:
    """The motion of leaning back against a table or counter, facing away from it.

    Parameters
    ----------
    rng : numpy.random.Generator
    times : (n,) float
        Seconds.
    top : float
        Height of the surface, metres.

    Returns
    -------
    joints : (n, 16, 3) float
        Metres; the pelvis is about the origin, facing +y.
    edge : float
        The y of the edge of the surface behind, metres.
    """
    feet = _feet(rng)
    feet[:, 1] += rng.uniform(0.15, 0.32)
    ankles = np.broadcast_to(feet, (len(times), 2, 3))
    lean = rng.uniform(-0.12, 0.12)
    trunk = upright(0.4 * sway(rng, times), ankles, yaw=0.0, lean=lean, nod=rng.uniform(0.0, 0.3))
    edge = -rng.uniform(HALF_DEPTH, HALF_DEPTH + 0.04)
    if rng.random() < 0.5:
        pastime = draw_pastime(rng, _PASTIMES)
    else:  # both hands behind, on the edge
        up = top + 0.05 - float(trunk.pelvis[:, 2].mean())
        beside = SIDES * rng.uniform(0.22, 0.32)
        pastime = Pastime(np.stack([beside, np.full(2, edge - 0.02), np.full(2, up)], -1))
    hanging = hanging_wrists(trunk, 0.15)
    wrists = held(pastime, trunk, hanging)
    return pose_body(trunk, ankles=ankles, wrists=wrists, elbows=pastime.elbows), edge
