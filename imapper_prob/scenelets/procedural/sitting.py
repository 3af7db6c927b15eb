"""Sitting down, sitting and standing up."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import Placement, SceneObject
from imapper_prob.scenelets.procedural.body import (
    ANKLE_HEIGHT,
    SIDES,
    THIGH,
    TRUNK,
    Trunk,
    pose_body,
)
from imapper_prob.scenelets.procedural.furniture import seat_front, seat_height
from imapper_prob.scenelets.procedural.gait import minimum_jerk, settle, walk_along

__all__ = ["SeatedPose", "draw_seated", "sit_down", "sit_still"]

Array = NDArray[np.float64]

HIP_ABOVE_SEAT: Final = 0.095
"""Hip joint above the surface one sits on, metres (trochanter height, sitting: Pheasant and
Haslegrave, *Bodyspace*, 2005)."""

CHEST_HALF_DEPTH: Final = 0.10
"""From the line of the spine joints to the back of the body, metres (*Bodyspace*)."""


@dataclass(frozen=True)
class SeatedPose:
    """How somebody sits, in the frame of the seat.

    Parameters
    ----------
    pelvis : (3,) float
        Metres.
    ankles, hands : (2, 3) float
        Right then left; metres. Hands are wrists relative to the pelvis.
    lean : float
        Trunk forward of the vertical, radians.
    """

    pelvis: Array
    ankles: Array
    hands: Array
    lean: float


def draw_seated(
    rng: np.random.Generator,
    piece: SceneObject,
    *,
    sideways: float = 0.0,
    even_feet: bool = False,
    upright: bool = False,
) -> SeatedPose:
    """A way to sit on a piece of furniture.

    The pelvis is drawn about 9 cm before the middle of the piece, as measured on i3DB; the
    trunk leans back no further than the backrest allows.

    Parameters
    ----------
    rng, piece
        Randomness, and a chair, stool or couch at the origin.
    sideways : float
        The x of the middle of the seat, metres.
    even_feet : bool
        Whether both feet are side by side, as they must be to get up.
    upright : bool
        Whether leaning back is ruled out, as at a table.
    """
    front = seat_front(piece)
    deep = piece.label == "couch"
    y = float(np.clip(rng.normal(0.09, 0.03), 0.02, 0.14)) if piece.label != "stool" else 0.02
    back = piece.bounds[0, 1] + next(
        (c.size[1] for c in piece.cuboids if c.part == "back"), -np.inf
    )
    leaning_back = not upright and np.isfinite(back) and rng.random() < (0.6 if deep else 0.4)
    lean = rng.uniform(-0.42, -0.15) if leaning_back else rng.uniform(-0.05, 0.15)
    room = (back + CHEST_HALF_DEPTH - y) / TRUNK
    lean = float(max(lean, np.arcsin(np.clip(room, -0.5, 0.0))))
    # Feet from tucked in to stretched out; in front of a couch, which reaches the floor.
    stretch = rng.uniform(-0.10, 0.20) + (0.0 if even_feet else rng.uniform(-0.06, 0.06, 2))
    forward = np.broadcast_to(y + THIGH + stretch, 2)
    forward = np.maximum(forward, front + 0.06)
    apart = rng.uniform(0.10, 0.17)
    ankles = np.stack([sideways + SIDES * apart, forward, np.full(2, ANKLE_HEIGHT)], -1)
    if rng.random() < 0.5:  # hands in the lap
        hands = np.array([[0.06, 0.24, 0.11], [-0.06, 0.22, 0.13]])
    else:  # hands on the thighs
        hands = np.array([[0.15, 0.34, 0.10], [-0.15, 0.34, 0.10]])
    hands += np.array([0.0, rng.uniform(-0.05, 0.05), 0.0])
    rest = next((c for c in piece.cuboids if c.part == "arm"), None)
    if rest is not None and not deep and rng.random() < 0.6:
        reach = abs(rest.centre[0])
        height = rest.centre[2] + rest.size[2] / 2 + 0.04 - seat_height(piece) - HIP_ABOVE_SEAT
        hands = np.stack([SIDES * reach, np.full(2, 0.16), np.full(2, height)], -1)
    pelvis = np.array([sideways, y, seat_height(piece) + HIP_ABOVE_SEAT])
    return SeatedPose(pelvis, ankles, hands, lean)


def at_desk(rng: np.random.Generator, pose: SeatedPose, *, edge: float, top: float) -> SeatedPose:
    """The same person with both hands on a table whose near edge is at y = ``edge``."""
    wrists = np.stack(
        [
            pose.pelvis[0] + SIDES * rng.uniform(0.10, 0.22, 2),
            edge + rng.uniform(0.04, 0.16, 2),
            np.full(2, top + 0.05),
        ],
        -1,
    )
    return replace(pose, hands=wrists - pose.pelvis, lean=float(rng.uniform(0.08, 0.25)))


def sit_still(rng: np.random.Generator, pose: SeatedPose, times: Array) -> Array:
    """(n, 16, 3) joints of somebody who sits, breathes and looks about, metres."""
    slow = 2 * np.pi * (times / rng.uniform(2.5, 4.0) + rng.random())
    pelvis = np.broadcast_to(pose.pelvis, (len(times), 3))
    trunk = Trunk.of(
        pelvis,
        rng.uniform(-0.06, 0.06),
        lean=pose.lean + 0.015 * np.sin(slow),
        twist=rng.uniform(-0.10, 0.10) + 0.04 * np.sin(0.7 * slow),
        nod=rng.uniform(0.0, 0.3) - min(pose.lean, 0.0) + 0.05 * np.sin(0.5 * slow + 1),
    )
    drift = 0.01 * np.sin(slow[:, None, None] + np.arange(6.0).reshape(2, 3))
    drift[..., 2] = np.abs(drift[..., 2])
    wrists = pose.pelvis + pose.hands + drift
    ankles = np.broadcast_to(pose.ankles, (len(times), 2, 3))
    return pose_body(trunk, ankles=ankles, wrists=wrists)


def sit_down(
    rng: np.random.Generator,
    pose: SeatedPose,
    times: Array,
    *,
    turn: float,
    approach: tuple[float, float],
) -> Array:
    """(n, 16, 3) joints of somebody who turns to a seat and sits down, metres.

    Played backwards this is standing up and turning away: both are minimum-jerk movements
    with the trunk bent forward in the middle, which brings the weight over the feet.

    Parameters
    ----------
    rng : numpy.random.Generator
    pose : SeatedPose
        How it ends; the feet must be side by side.
    times : (n,) float
        Seconds from the first movement; about two are needed.
    turn : float
        Yaw at the start, radians.
    approach : (float, float)
        Where the person stands then, relative to where the feet end, metres.
    """
    feet = pose.ankles.mean(0)
    arrival = 0.75 if approach != (0.0, 0.0) or turn else 0.1
    route = settle(
        Placement(feet[0] + approach[0], feet[1] + approach[1], turn),
        Placement(feet[0], feet[1], 0.0),
        arrival=arrival,
    )
    walk = walk_along(
        route,
        times,
        step_time=0.33,
        phase=rng.uniform(-0.1, 0.1),
        lean=0.04,
        half_width=float(abs(pose.ankles[0, 0] - feet[0])),
    )
    progress = (times - arrival) / (times[-1] - arrival - 0.05)
    down = minimum_jerk(progress)
    bow = 0.55 * np.sin(np.pi * np.clip(progress, 0.0, 1.0)) ** 2
    standing = walk.trunk.pelvis
    # Standing, the hips are a little behind the ankles once the trunk bends forward.
    behind = -0.08 * bow[:, None] * walk.trunk.forward
    pelvis = standing + down[:, None] * (pose.pelvis - standing) + behind
    trunk = Trunk.of(
        pelvis,
        walk.trunk.yaw,
        lean=(1 - down) * 0.04 + down * pose.lean + bow,
        nod=0.1 - 0.3 * bow - down * min(pose.lean, 0.0),
    )
    target = trunk.at_pelvis(pose.hands)
    wrists = walk.wrists + (trunk.shoulders - walk.trunk.shoulders)
    wrists = wrists + down[:, None, None] * (target - wrists)
    return pose_body(trunk, ankles=walk.ankles, wrists=wrists)
