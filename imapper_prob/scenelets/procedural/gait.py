"""Walking along any route: each foot stands still during its stance, and the arms swing.

A route gives a person's position and yaw at any time. Each foot stands where the route is at
the middle of its stance and swings to the next such place. Straight walks, curves, turns on
the spot, side steps and stopping therefore need no separate cases.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import Placement
from imapper_prob.models.skeleton import minimum_jerk
from imapper_prob.scenelets.procedural.body import (
    ANKLE_HEIGHT,
    HIP_HEIGHT,
    SIDES,
    Trunk,
    hanging_wrists,
    reachable_height,
)

__all__ = [
    "WALK_RATIO",
    "Gait",
    "Route",
    "Walk",
    "arc",
    "come_nearer",
    "settle",
    "starting",
    "steady",
    "stopping",
    "walk_along",
]

Array = NDArray[np.float64]
Pace = Callable[[Array], Array]
"""Function from times (n,) in seconds to distances walked (n,) in metres."""

Route = Callable[[Array], Array]
"""Function from times (n,) in seconds to (n, 3) x, y in metres and yaw in radians."""

WALK_RATIO: Final = 0.0064
"""Step length (m) divided by cadence (steps a minute): the same at every comfortable speed (Sekiya
and Nagasaki 1998). It gives steps of .55 m at .8 m/s and of .69 m at 1.25 m/s."""

SWING_LIFT: Final = 0.10
"""Height in metres by which the ankle rises in mid-swing of a full step (Winter, fig. 3.14)."""

SHORT_STEP: Final = 0.15
"""Stride in metres below which the feet are lifted clearly less."""

ARM_SWING: Final = 0.38
"""Amplitude in radians of the arm swing at 1 m/s (Romkes and Bracht-Schweizer 2017: a range of
35-45 degrees at a comfortable speed)."""

GATHER: Final = 0.8
"""Seconds from standing to full speed, little more than the first step (Breniere and Do 1991)."""


def steady(speed: float) -> Pace:
    """A pace of constant speed.

    Parameters
    ----------
    speed : float
        Metres a second.

    Returns
    -------
    callable
        Maps seconds to metres walked.
    """
    return lambda times: speed * times


def starting(speed: float, *, at: float) -> Pace:
    """A pace that stands until ``at`` seconds and reaches ``speed`` after ``GATHER`` more.

    Parameters
    ----------
    speed : float
        Metres a second.
    at : float
        Seconds.

    Returns
    -------
    callable
        Maps seconds to metres walked.
    """

    def pace(times: Array) -> Array:
        u = np.clip((times - at) / GATHER, 0.0, 1.0)
        walked: Array = speed * (GATHER * u**3 * (1 - u / 2) + np.maximum(times - at - GATHER, 0.0))
        return walked

    return pace


def stopping(speed: float, *, by: float) -> Pace:
    """A pace of constant speed that slows down and stands from ``by`` seconds on.

    Parameters
    ----------
    speed : float
        Metres a second.
    by : float
        Seconds.

    Returns
    -------
    callable
        Maps seconds to metres walked.
    """
    backwards = starting(speed, at=-by)
    return lambda times: -backwards(-times)


def arc(pace: Pace, curvature: float) -> Route:
    """A route from the origin towards +y that turns left by ``curvature`` radians a metre.

    Parameters
    ----------
    pace : callable
        Maps seconds to metres walked.
    curvature : float
        Radians a metre.

    Returns
    -------
    callable
        Maps seconds to placements (x, y, yaw).
    """

    def route(times: Array) -> Array:
        walked = pace(times)
        yaw = curvature * walked
        # The mean heading of the way so far is yaw / 2; the chord is the arc shortened by a sinc.
        chord = walked * np.sinc(yaw / 2 / np.pi)
        return np.stack([-np.sin(yaw / 2) * chord, np.cos(yaw / 2) * chord, yaw], -1)

    return route


def settle(start: Placement, end: Placement, *, arrival: float) -> Route:
    """A route that stays at ``start`` until time 0, moves to ``end`` by ``arrival`` and stays.

    Parameters
    ----------
    start : Placement
    end : Placement
    arrival : float
        Seconds.

    Returns
    -------
    callable
        Maps seconds to placements (x, y, yaw).
    """
    a = np.array([start.x, start.y, start.yaw])
    b = np.array([end.x, end.y, end.yaw])

    def route(times: Array) -> Array:
        result: Array = a + minimum_jerk(times / arrival)[:, None] * (b - a)
        return result

    return route


@dataclass(frozen=True)
class Walk:
    """Trunk, ankles and wrists of a person on foot, before hands or trunk do anything else.

    Parameters
    ----------
    trunk : Trunk
        Of n frames.
    ankles, wrists : (n, 2, 3) float
        Metres, right then left.
    """

    trunk: Trunk
    ankles: Array
    wrists: Array


@dataclass(frozen=True)
class Gait:
    """Parameters of how a person walks, for any route.

    Parameters
    ----------
    step_time : float
        Seconds between the stances of the two feet. Each foot stands still for this long and
        swings for as long.
    phase : float
        Time in seconds of the middle of a stance of the right foot.
    lean : float
        Forward lean of the trunk in radians.
    half_width : float
        Distance in metres of each foot from the line of walking.
    vigour : float
        Factor on the swing of the arms.
    """

    step_time: float
    phase: float
    lean: float
    half_width: float = 0.09
    vigour: float = 1.0


def footsteps(route: Route, times: Array, gait: Gait) -> Array:
    """(n, 2, 3) ankles, right then left, that follow a route at times (n,) in seconds."""
    ankles = np.zeros((len(times), 2, 3))
    step_time, phase = gait.step_time, gait.phase
    for foot, side in enumerate(SIDES):
        first, aside = phase + foot * step_time, side * gait.half_width
        cycle = (times - first) / (2 * step_time) + 0.25
        index = np.floor(cycle)
        swing = np.clip(2 * (cycle - index) - 1, 0.0, 1.0)[:, None]
        here = _footfall(route, first + 2 * step_time * index, aside)
        there = _footfall(route, first + 2 * step_time * (index + 1), aside)
        ankles[:, foot, :2] = here + minimum_jerk(swing) * (there - here)
        stride = np.linalg.norm(there - here, axis=-1)
        # The heel rises before the foot leaves its place; the foot also clears the floor in short
        # steps.
        lift = SWING_LIFT * (1 - np.exp(-stride / SHORT_STEP)) * np.sin(np.pi * swing[:, 0])
        ankles[:, foot, 2] = ANKLE_HEIGHT + lift
    return ankles


def _footfall(route: Route, times: Array, sideways: float) -> Array:
    x, y, yaw = route(times).T
    return np.stack([x + sideways * np.cos(yaw), y + sideways * np.sin(yaw)], -1)


def walk_along(
    route: Route,
    times: Array,
    gait: Gait,
) -> Walk:
    """The motion of a person who follows a route.

    Parameters
    ----------
    route : Route
    times : (n,) float
        Seconds.
    gait : Gait

    Returns
    -------
    Walk
    """
    ankles = footsteps(route, times, gait)
    x, y, yaw = route(times).T
    ahead, behind = route(times + 0.05)[:, :2], route(times - 0.05)[:, :2]
    speed = np.minimum(np.linalg.norm(ahead - behind, axis=-1) / 0.1, 1.2)
    # One cycle is two steps. Hips turn with the forward leg, shoulders and arms against it.
    cycle = np.pi * (times - gait.phase) / gait.step_time
    rhythm = np.sin(cycle) * speed
    sway = 0.015 * np.cos(cycle)
    pelvis = np.stack(
        [x + sway * np.cos(yaw), y + sway * np.sin(yaw), np.full(len(times), HIP_HEIGHT)], -1
    )
    trunk = Trunk.of(pelvis, yaw - 0.06 * rhythm, lean=gait.lean, twist=0.15 * rhythm, nod=0.05)
    pelvis[:, 2] = np.minimum(HIP_HEIGHT, reachable_height(trunk, ankles))
    swing = ARM_SWING * gait.vigour * rhythm[:, None] * SIDES
    return Walk(trunk, ankles, hanging_wrists(trunk, swing, bend=0.08))


def come_nearer(
    rng: np.random.Generator, start: Placement, times: Array, *, arrival: float
) -> Walk:
    """The motion of a person who comes to the origin in a step or two.

    Parameters
    ----------
    rng : numpy.random.Generator
    start : Placement
        Where the person stands at first.
    times : (n,) float
        Seconds.
    arrival : float
        When the person has arrived, seconds.

    Returns
    -------
    Walk
    """
    phase, half_width = rng.uniform(-0.1, 0.4), rng.uniform(0.09, 0.14)
    gait = Gait(step_time=0.38, phase=phase, lean=0.03, half_width=half_width)
    return walk_along(settle(start, Placement(0.0, 0.0, 0.0), arrival=arrival), times, gait)
