"""Sitting still, sitting down and standing up."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import Placement
from imapper_prob.scenelets.procedural.body import (
    ANKLE_HEIGHT,
    ELBOWS,
    Trunk,
    pose_body,
    reachable_height,
)
from imapper_prob.scenelets.procedural.gait import SWING_LIFT, Route, minimum_jerk, walk_along
from imapper_prob.scenelets.procedural.seated import SeatedPose

__all__ = ["approach", "sit_down", "sit_still"]

Array = NDArray[np.float64]

BOW: Final = 0.50
"""Radians that the trunk bends forward, beyond where it ends, half-way down: with the lean
of the end 35 to 45 degrees (Schenkman et al. 1990)."""

STEP: Final = 0.44
"""Time of a step as part of the time to arrive: the last swing of each foot then ends where it
is to stand, and none has to be moved by a few centimetres more."""

OVERLAP: Final = 0.15
"""Seconds by which the hips set off before the feet have arrived."""


def sit_still(rng: np.random.Generator, pose: SeatedPose, times: Array) -> Array:
    """(n, 16, 3) joints of somebody who sits, breathes and looks about, metres."""
    slow = 2 * np.pi * (times / rng.uniform(2.5, 4.0) + rng.random())
    trunk = Trunk.of(
        np.broadcast_to(pose.pelvis, (len(times), 3)),
        pose.yaw,
        lean=pose.lean + 0.015 * np.sin(slow),
        tilt=pose.tilt,
        twist=pose.twist + 0.04 * np.sin(0.7 * slow),
        nod=pose.nod + 0.05 * np.sin(0.5 * slow + 1),
    )
    # Hands that do something are quicker than breath.
    quick = np.where(pose.stir > 0.015, 3.0, 1.0)[:, None]
    drift = pose.stir[:, None] * np.sin(quick * slow[:, None, None] + np.arange(6.0).reshape(2, 3))
    drift[..., 2] = np.abs(drift[..., 2])
    wrists = trunk.at_pelvis(pose.hands) + drift
    ankles = np.broadcast_to(pose.ankles, (len(times), 2, 3))
    elbows = ELBOWS if pose.elbows is None else pose.elbows
    return pose_body(trunk, ankles=ankles, wrists=wrists, elbows=elbows, knees=pose.knees)


def approach(end: Placement, *, distance: float, bearing: float, arrival: float) -> Route:
    """Walk to a place before a seat and turn the back to it.

    Parameters
    ----------
    end : Placement
        Where the feet come to stand, and where they point then.
    distance : float
        How far off the walk begins, metres.
    bearing : float
        Where from: 0 straight ahead of who sits, positive to their left, radians.
    arrival : float
        When they are there, seconds.
    """
    direction = end.yaw + bearing
    offset = distance * np.array([-np.sin(direction), np.cos(direction)])
    # Whoever comes from the left faces right: a quarter turn to the left is left to do.
    turn = bearing - np.pi if bearing > 0 else bearing + np.pi

    def route(times: Array) -> Array:
        left = 1 - minimum_jerk(times / arrival)[:, None]
        way: Array = [end.x, end.y, end.yaw] + left * [*offset, turn]
        return way

    return route


def sit_down(
    rng: np.random.Generator, pose: SeatedPose, times: Array, *, route: Route, arrival: float
) -> Array:
    """(n, 16, 3) joints of somebody who follows a route to a seat and sits down, metres.

    Played backwards this is standing up and walking off: both are minimum-jerk movements.

    Parameters
    ----------
    rng : numpy.random.Generator
    pose : SeatedPose
        The end; its feet are side by side.
    times : (n,) float
        Seconds.
    route : Route
        Ends at the feet of the pose, as it faces.
    arrival : float
        When the feet are there, seconds.
    """
    walk = walk_along(
        route,
        times,
        step_time=max(STEP * arrival, 0.3),
        phase=rng.uniform(-0.02, 0.02),
        lean=0.04,
        half_width=float(np.linalg.norm(pose.ankles[0, :2] - pose.ankles[1, :2]) / 2),
    )
    ankles = walk.ankles.copy()
    # The short steps before a seat clear the floor by more than such steps of a walk would.
    ankles[..., 2] = ANKLE_HEIGHT + np.sqrt(SWING_LIFT * (ankles[..., 2] - ANKLE_HEIGHT))
    start = max(arrival - OVERLAP, 0.0)
    progress = np.clip((times - start) / (times[-1] - start - 0.05), 0.0, 1.0)
    down = minimum_jerk(progress)
    bow = BOW * np.sin(np.pi * progress) ** 2
    standing = walk.trunk.pelvis
    # The hips go behind the ankles once the trunk bends forward, to keep the balance.
    behind = -0.08 * bow[:, None] * walk.trunk.forward
    pelvis = standing + down[:, None] * (pose.pelvis - standing) + behind
    trunk = Trunk.of(
        pelvis,
        walk.trunk.yaw,
        lean=(1 - down) * 0.04 + down * pose.lean + bow,
        twist=walk.trunk.twist + down * (pose.twist - walk.trunk.twist),
        nod=0.1 - 0.3 * bow + down * (pose.nod - 0.1),
    )
    pelvis[:, 2] = np.minimum(pelvis[:, 2], reachable_height(trunk, ankles))
    wrists = walk.wrists + (trunk.shoulders - walk.trunk.shoulders)
    wrists = wrists + down[:, None, None] * (trunk.at_pelvis(pose.hands) - wrists)
    return pose_body(trunk, ankles=ankles, wrists=wrists)
