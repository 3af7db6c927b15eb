"""A person who walks between scenelets: the motion of the simulator.

In the frames of a scenelet the joints are exactly the scenelet's, placed and scaled; it is
played to and fro for as long as the person stays. In between the person walks, with poses of
the library's own walking scenelets played by distance so that the feet keep up with the body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.errors import InputError
from imapper_prob.models.pose import blend_poses, facing, turned
from imapper_prob.models.scene import Placement
from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.models.skeleton import LANK, PELV, RANK

__all__ = ["Gait", "Stay", "walk_between"]

Array = NDArray[np.float64]

SETTLING: Final = 1.3
"""Seconds between walking and the first pose of a scenelet: to turn and sit down."""

RAMP: Final = 0.4
"""Seconds to walking speed, and from it."""

STRIDE: Final = (0.8, 1.9)
"""Metres that two steps of an adult indoors may cover."""

PACE: Final = 1.0
"""Metres a second at which people walk indoors, about."""

CORNER: Final = 0.35
"""Metres over which a corner of the path is rounded."""


def _minimum_jerk(progress: ArrayLike) -> Array:
    """Position between 0 and 1 of a smooth movement (Flash and Hogan 1985), held outside."""
    s = np.clip(np.asarray(progress, float), 0.0, 1.0)
    position: Array = s**3 * (10 - 15 * s + 6 * s**2)
    return position


@dataclass(frozen=True)
class Gait:
    """One walking cycle, by distance.

    Parameters
    ----------
    poses : (m, 16, 3) float
        Joints relative to the point of the floor below the pelvis, facing +y, metres.
    distance : (m,) float
        Metres walked at each pose, from 0.
    stride : float
        Metres after which the first pose comes again.
    """

    poses: Array
    distance: Array
    stride: float

    @classmethod
    def of(cls, library: Library) -> Gait:
        """A cycle of a library's walk, of those that cover two steps the one nearest ``PACE``.

        Raises
        ------
        InputError
            If no scenelet without objects covers the length of two steps.
        """
        walks = [s for s in library if not s.objects and _chord(s) > STRIDE[0]]
        if not walks:
            raise InputError(
                f"library {library.name}: no walking scenelet of {STRIDE[0]} m or more; the "
                "simulator needs one, or another library that has one"
            )
        joints = min(walks, key=lambda s: abs(_chord(s) * s.fps / (s.n_frames - 1) - PACE)).joints
        ground = joints[:, PELV] * (1.0, 1.0, 0.0)
        poses = turned(joints - ground[:, None], -facing(joints))
        walked = np.concatenate([[0], np.linalg.norm(np.diff(ground, axis=0), axis=-1).cumsum()])
        gap = walked[None] - walked[:, None]
        change = np.linalg.norm(poses[None] - poses[:, None], axis=-1).mean(-1)
        change = np.where((gap >= STRIDE[0]) & (gap <= STRIDE[1]), change, np.inf)
        first, last = np.unravel_index(np.argmin(change), change.shape)
        return cls(poses[first:last], walked[first:last] - walked[first], float(gap[first, last]))

    def at(self, distance: ArrayLike) -> Array:
        """(n, 16, 3) poses after ``distance`` (n,) metres, as ``poses``."""
        along = np.mod(np.asarray(distance, float), self.stride)
        low = np.searchsorted(self.distance, along, side="right") - 1
        high = (low + 1) % len(self.distance)
        end = np.append(self.distance[1:], self.stride)[low]
        weight = (along - self.distance[low]) / (end - self.distance[low])
        return blend_poses(self.poses[low], self.poses[high], weight)


def _chord(scenelet: Scenelet) -> float:
    """Metres from the first position to the last."""
    return float(np.linalg.norm(scenelet.joints[-1, PELV] - scenelet.joints[0, PELV]))


@dataclass(frozen=True)
class Stay:
    """A scenelet somebody performs somewhere.

    Parameters
    ----------
    scenelet : Scenelet
    placement : Placement
        Of the scenelet's local frame in the world.
    approach : (2,) float
        Point of the floor in the world, metres, where walking ends and begins again.
    turn : (2,) float
        Point that draws the way between there and the first pose: before the seat, so that
        nobody cuts through its arms.
    """

    scenelet: Scenelet
    placement: Placement
    approach: Array
    turn: Array

    def joints(self, scale: float) -> Array:
        """(n, 16, 3) joints in the world of a body scaled about the floor below the pelvis."""
        return self.placement.apply(self.scenelet.joints * scale)


@dataclass(frozen=True)
class _Leg:
    """A walk: (n, 2) positions on the floor, (n,) yaw and (n,) metres walked."""

    positions: Array
    yaw: Array
    walked: Array


def _leg(corners: Array, *, speed: float, fps: float) -> _Leg:
    """Walk along a polyline (k, 2) with rounded corners."""
    lengths = np.linalg.norm(np.diff(corners, axis=0), axis=-1)
    at = np.concatenate([[0], lengths.cumsum()])
    fine = np.linspace(0.0, at[-1], max(int(at[-1] / 0.02), 2))
    line = np.stack([np.interp(fine, at, corners[:, k]) for k in range(2)], -1)
    width = 2 * int(CORNER / 0.04) + 1
    if len(line) > 2 * width:
        line = _smoothed(line, width)
    walked = np.concatenate([[0], np.linalg.norm(np.diff(line, axis=0), axis=-1).cumsum()])
    n = max(int(np.ceil((walked[-1] / speed + RAMP) * fps)), 2)
    ramp = max(RAMP * fps, 1.0)
    pace = np.clip(np.minimum(np.arange(1, n + 1), np.arange(n, 0, -1)) / ramp, 0.0, 1.0)
    along = pace.cumsum() / pace.sum() * walked[-1]
    positions = np.stack([np.interp(along, walked, line[:, k]) for k in range(2)], -1)
    direction = np.gradient(line, axis=0)
    yaw = np.unwrap(np.arctan2(-direction[:, 0], direction[:, 1]))
    return _Leg(positions, np.interp(along, walked, yaw), along)


def _smoothed(line: Array, width: int) -> Array:
    """A moving average that leaves both ends where they are."""
    reach = width // 2
    before = 2 * line[:1] - line[reach:0:-1]
    after = 2 * line[-1:] - line[-2 : -reach - 2 : -1]
    padded = np.concatenate([before, line, after])
    kernel = np.full(width, 1 / width)
    return np.stack([np.convolve(padded[:, k], kernel, "valid") for k in range(2)], -1)


def _settled(first: Array, last: Array, turn: Array, n_frames: int) -> Array:
    """(n, 16, 3) frames strictly between two poses (16, 3) in the world, feet on the floor.

    The pelvis follows the parabola that starts and ends towards the point ``turn`` (2,).
    """
    weight = _minimum_jerk(np.arange(1, n_frames + 1) / (n_frames + 1))
    yaw_change = float(np.angle(np.exp(1j * (facing(last) - facing(first)))))
    # Both poses are brought to face alike before blending, so that turning is turning.
    first_yaw = float(facing(first))
    a, b = (
        turned(first - first[PELV], -first_yaw),
        turned(last - last[PELV], -first_yaw - yaw_change),
    )
    poses = turned(blend_poses(a, b, weight), first_yaw + weight * yaw_change)
    start, end = first[PELV, :2], last[PELV, :2]
    w = weight[:, None]
    ground = (1 - w) ** 2 * start + 2 * w * (1 - w) * turn + w**2 * end
    joints = poses + np.pad(ground, ((0, 0), (0, 1)))[:, None]
    lowest = [pose[[RANK, LANK], 2].min() for pose in (first, last)]
    floor = (1 - weight) * lowest[0] + weight * lowest[1]
    joints[..., 2] += (floor - joints[:, [RANK, LANK], 2].min(1))[:, None]
    return joints


def _stayed(joints: Array, n_frames: int) -> Array:
    """A scenelet's frames, to and fro until ``n_frames`` are filled."""
    n = len(joints)
    index = np.abs((np.arange(n_frames) + n - 1) % (2 * n - 2) - (n - 1))
    return joints[index]


def walk_between(
    rng: np.random.Generator,
    stays: Sequence[Stay],
    routes: Sequence[Array],
    *,
    gait: Gait,
    n_frames: int,
    scale: float,
    fps: float,
    shortest_stay: int,
) -> tuple[Array, NDArray[np.intp]] | None:
    """The whole motion: along each route to each stay, until the frames are used up.

    Parameters
    ----------
    rng : numpy.random.Generator
        Draws the walking speed and how the spare time is shared among the stays.
    stays : sequence of Stay
        In order of time.
    routes : sequence of (k, 2) float
        Corners of the walk to each stay, from where the last one was left, metres.
    gait : Gait
    n_frames : int
        Frames in all.
    scale : float
        Body scale.
    fps : float
        Frames a second.
    shortest_stay : int
        Frames.

    Returns
    -------
    joints : (n_frames, 16, 3) float
        In the world, metres.
    which : (n_frames,) int
        The stay of each frame, -1 on the way.

    None if the walks leave too little time for the stays.
    """
    speed = rng.uniform(0.8, 1.15) * scale
    legs = [_leg(route, speed=speed, fps=fps) for route in routes]
    pause = round(SETTLING * fps)
    on_the_way = sum(len(leg.yaw) for leg in legs) + (2 * len(stays) - 1) * pause
    spare = n_frames - on_the_way - shortest_stay * len(stays)
    if spare < 0:
        return None
    lengths = shortest_stay + rng.multinomial(spare, rng.dirichlet(np.full(len(stays), 5.0)))
    parts: list[Array] = []
    which: list[int] = []
    for index, (leg, stay, length) in enumerate(zip(legs, stays, lengths, strict=True)):
        walk = turned(gait.at(leg.walked / scale) * scale, leg.yaw)
        walk[..., :2] += leg.positions[:, None]
        there = _stayed(stay.joints(scale), int(length))
        if parts:
            parts.append(_settled(parts[-1][-1], walk[0], stays[index - 1].turn, pause))
            which += [-1] * pause
        parts += [walk, _settled(walk[-1], there[0], stay.turn, pause), there]
        which += [-1] * (len(walk) + pause) + [index] * len(there)
    return np.concatenate(parts), np.array(which)
