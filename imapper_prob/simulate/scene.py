"""A furnished room in front of a camera, and the motion of a person in it.

In the frames of a scenelet the joints are the scenelet's own, placed and scaled. The scenelet is
played forwards and backwards for as long as the person stays. In between the person walks, with the
poses of a walking scenelet as a function of distance, so that the feet do not slide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.errors import InputError
from imapper_prob.models.geometry import pack_boxes, sight_clearance
from imapper_prob.models.scene import Placement, SceneObject
from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.models.skeleton import (
    DETECTED,
    LANK,
    PELV,
    RANK,
    blend_poses,
    facing,
    minimum_jerk,
    turned,
)

__all__ = [
    "Gait",
    "Stay",
    "draw_bystander",
    "draw_entry",
    "draw_stay",
    "find_route",
    "hidden_joints",
    "in_image",
    "low_pieces",
    "walk_between",
]

Array = NDArray[np.float64]
TOUCH: Final = 0.02
"""Metres of a line of sight inside a box from which on a joint counts as hidden."""
NEAREST: Final = 2.5
FARTHEST: Final = 6.0
"""Range of depth in metres of interactions; those in i3DB are 3-6 m away."""
PASSAGE: Final = 0.15
"""Least distance in metres of furniture from the middle of a walking body (arms may graze)."""
GAP: Final = 0.45
"""Least distance in metres between the furniture of two interactions, for a passage."""
FEWEST_SEEN: Final = 0.55
"""Least fraction of visible joints in an interaction; a hidden person cannot be recovered."""
LOW: Final = 1.0
"""Height in metres below which furniture hides at most the legs of a person behind it."""
KNEE_ROOM: Final = 0.45
"""Distance in metres from a sitter's pelvis to where the person stands in front of the seat."""
SITTING: Final = 0.75
"""Height in metres of the pelvis below which a person sits."""

# End points of walks relative to the first pose: (right, forward) metres; chosen. In front of a
# seat, beside it or past the end of a table in front of it; behind a standing person.
_BEFORE_SEAT = (
    (0.0, 0.6),
    (0.55, 0.0),
    (-0.55, 0.0),
    (1.0, 0.6),
    (-1.0, 0.6),
    (1.4, 0.6),
    (-1.4, 0.6),
)
_BEHIND = ((0.0, -0.30), (0.0, -0.10))


def in_image(camera: Camera, points: Array) -> NDArray[np.bool_]:
    """Whether points of the world are inside the image.

    Parameters
    ----------
    camera : Camera
    points : (..., 3) float
        Metres.

    Returns
    -------
    (...) bool
    """
    u, v = np.moveaxis(camera.project(points), -1, 0)
    inside: NDArray[np.bool_] = (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
    return inside


def hidden_joints(
    camera: Camera, joints: Array, objects: Sequence[SceneObject]
) -> NDArray[np.bool_]:
    """Whether furniture hides each joint from the camera.

    Parameters
    ----------
    camera : Camera
    joints : (..., 16, 3) float
        World, metres.
    objects : sequence of SceneObject
        In world coordinates.

    Returns
    -------
    (..., 16) bool
    """
    hidden: NDArray[np.bool_] = sight_clearance(camera.centre, joints, pack_boxes(objects)) < -TOUCH
    return hidden


def _distance(points: Array, objects: Sequence[SceneObject]) -> float:
    """Smallest distance on the floor of points (k, 2) from the bounding boxes of objects."""
    nearest = np.inf
    for piece in objects:
        local = (points - (piece.placement.x, piece.placement.y)) @ piece.placement.rotation
        low, high = piece.bounds[:, :2]
        outside = np.maximum(np.maximum(low - local, local - high), 0.0)
        nearest = min(nearest, float(np.linalg.norm(outside, axis=-1).min()))
    return nearest


def _outline(piece: SceneObject) -> Array:
    """Points on the floor about 10 cm apart that cover an object's footprint."""
    a, b, _, d = piece.footprint
    u, v = np.meshgrid(
        np.linspace(0, 1, int(np.linalg.norm(b - a) / 0.1) + 2),
        np.linspace(0, 1, int(np.linalg.norm(d - a) / 0.1) + 2),
    )
    points: Array = a + u.reshape(-1, 1) * (b - a) + v.reshape(-1, 1) * (d - a)
    return points


def _anywhere(rng: np.random.Generator, camera: Camera) -> Array:
    """A random point on the floor whose bearing is well inside the image."""
    depth = rng.uniform(NEAREST, FARTHEST)
    side = 0.75 * camera.width / 2 / camera.fx
    return np.array([depth * rng.uniform(-side, side), depth])


def draw_stay(
    rng: np.random.Generator,
    scenelet: Scenelet,
    *,
    camera: Camera,
    scale: float,
    furniture: Sequence[SceneObject],
) -> Stay | None:
    """Try to place an interaction in view and clear of other furniture.

    Parameters
    ----------
    rng : numpy.random.Generator
    scenelet : Scenelet
    camera : Camera
    scale : float
        Factor on the size of the body and of its furniture.
    furniture : sequence of SceneObject
        Furniture in world coordinates to keep clear of.

    Returns
    -------
    Stay or None
        None if the attempt failed.
    """
    x, y = _anywhere(rng, camera)
    placement = Placement(float(x), float(y), float(rng.uniform(-np.pi, np.pi)))
    own = [piece.moved(placement) for piece in scenelet.scaled(scale).objects]
    if any(_distance(_outline(piece), furniture) < GAP for piece in own):
        return None
    if min(piece.footprint[:, 1].min() for piece in own) < NEAREST / 2:
        return None
    joints = placement.apply(scenelet.joints * scale)
    middle = joints[len(joints) // 2, list(DETECTED)]
    # The furniture of one interaction may hide part of another's person, but not most of it.
    seen = in_image(camera, middle) & ~hidden_joints(camera, middle, [*own, *furniture])
    if seen.mean() < FEWEST_SEEN:
        return None
    x, y = joints[0, PELV, :2].tolist()
    start = Placement(x, y, float(facing(joints[0])))
    for right, forward in _BEFORE_SEAT if joints[0, PELV, 2] < SITTING else _BEHIND:
        point = start.apply(np.array([right, forward, 0.0]))[:2]
        if _distance(point[None], [*own, *furniture]) > PASSAGE:
            turn = start.apply(np.array([0.0, min(forward, KNEE_ROOM), 0.0]))[:2]
            return Stay(scenelet, placement, point, turn)
    return None


def low_pieces(library: Library) -> list[SceneObject]:
    """All furniture of a library that a standing person can look over.

    Parameters
    ----------
    library : Library

    Returns
    -------
    list of SceneObject
    """
    return [o for s in library for o in s.objects if o.bounds[1, 2] < LOW]


def draw_bystander(
    rng: np.random.Generator,
    pieces: Sequence[SceneObject],
    *,
    stay: Stay,
    camera: Camera,
    scale: float,
    furniture: Sequence[SceneObject],
) -> SceneObject | None:
    """Try to place an unused piece between camera and person so that it hides some joints.

    Parameters
    ----------
    rng : numpy.random.Generator
    pieces : sequence of SceneObject
        Pieces from which one is drawn.
    stay : Stay
        Stay of the person.
    camera : Camera
    scale : float
        Factor on the size of the body and of the piece.
    furniture : sequence of SceneObject
        Furniture in world coordinates to keep clear of.

    Returns
    -------
    SceneObject or None
        None if the attempt found no room for it.
    """
    piece = pieces[int(rng.integers(len(pieces)))].scaled(scale)
    joints = stay.joints(scale)
    middle = joints[len(joints) // 2]
    x, y = middle[PELV, :2] * (1 - rng.uniform(0.8, 1.6) / np.linalg.norm(middle[PELV, :2]))
    placement = Placement(float(x), float(y), float(rng.uniform(-np.pi, np.pi)))
    piece = SceneObject(piece.label, placement, piece.cuboids)
    if piece.footprint[:, 1].min() < NEAREST / 2 or _distance(_outline(piece), furniture) < 0.1:
        return None
    before = hidden_joints(camera, middle, furniture)
    after = hidden_joints(camera, middle, [*furniture, piece])
    seen = in_image(camera, middle) & ~after
    if (after & ~before).sum() < 2 or seen[list(DETECTED)].mean() < FEWEST_SEEN:
        return None
    return piece


def draw_entry(
    rng: np.random.Generator, first: Stay, *, camera: Camera, furniture: Sequence[SceneObject]
) -> Array | None:
    """Try to find a free point on the floor in view at which the clip begins.

    Parameters
    ----------
    rng : numpy.random.Generator
    first : Stay
    camera : Camera
    furniture : sequence of SceneObject
        Furniture in world coordinates to keep clear of.

    Returns
    -------
    (2,) float or None
        Metres; None if the attempt failed.
    """
    point = _anywhere(rng, camera)
    if not 1.0 < np.linalg.norm(point - first.approach) < 3.0:
        return None
    return point if _distance(point[None], furniture) > PASSAGE else None


def find_route(
    rng: np.random.Generator,
    start: Array,
    end: Array,
    *,
    camera: Camera,
    furniture: Sequence[SceneObject],
) -> Array | None:
    """The shortest free route found between two points.

    Parameters
    ----------
    rng : numpy.random.Generator
    start, end : (2,) float
        Metres.
    camera : Camera
    furniture : sequence of SceneObject
        Furniture in world coordinates to keep clear of.

    Returns
    -------
    (2, 2) or (3, 2) float, or None
        Corners, metres; None if no route was found.
    """
    ways = [np.stack([start, end])]
    ways += [np.stack([start, _anywhere(rng, camera), end]) for _ in range(20)]
    for way in sorted(ways, key=lambda w: np.linalg.norm(np.diff(w, axis=0), axis=-1).sum()):
        steps = np.linspace(0, len(way) - 1, 80)
        line = np.stack([np.interp(steps, np.arange(len(way)), way[:, k]) for k in range(2)], -1)
        if _distance(line, furniture) > 0.9 * PASSAGE:
            return way
    return None


# ------------------------------------------------------------------------------------------------
# Motion.

SETTLING: Final = 1.3
"""Seconds between walking and the first pose of a scenelet, for turning and sitting down."""
RAMP: Final = 0.4
"""Seconds of acceleration to walking speed, and of deceleration."""
STRIDE: Final = (0.8, 1.9)
"""Range in metres of two steps of an adult indoors."""
PACE: Final = 1.0
"""Approximate walking speed indoors, metres a second."""
CORNER: Final = 0.35
"""Length in metres over which a corner of the path is rounded."""
_GRID: Final = 0.02
"""Distance in metres between the points of a path while its corners are rounded; chosen."""
_SPEEDS: Final = (0.8, 1.15)
"""Range of walking speeds of a body of the reference size, metres a second; chosen about `PACE`."""
_EVENNESS: Final = 5.0
"""Concentration of the Dirichlet distribution that divides spare time among stays; chosen."""


@dataclass(frozen=True)
class Gait:
    """One walking cycle as a function of distance.

    Parameters
    ----------
    poses : (m, 16, 3) float
        Joints relative to the point on the floor below the pelvis, facing +y, metres.
    distance : (m,) float
        Metres walked at each pose, from 0.
    stride : float
        Metres after which the cycle repeats.
    """

    poses: Array
    distance: Array
    stride: float

    @classmethod
    def of(cls, library: Library) -> Gait:
        """A cycle from the walk of a library that covers two steps at a speed nearest to ``PACE``.

        Parameters
        ----------
        library : Library

        Returns
        -------
        Gait

        Raises
        ------
        InputError
            No scenelet without objects covers the length of two steps.
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
        """Interpolated poses at some distances.

        Parameters
        ----------
        distance : (n,) float
            Metres.

        Returns
        -------
        (n, 16, 3) float
            Like ``poses``.
        """
        along = np.mod(np.asarray(distance, float), self.stride)
        low = np.searchsorted(self.distance, along, side="right") - 1
        high = (low + 1) % len(self.distance)
        end = np.append(self.distance[1:], self.stride)[low]
        weight = (along - self.distance[low]) / (end - self.distance[low])
        return blend_poses(self.poses[low], self.poses[high], weight)


def _chord(scenelet: Scenelet) -> float:
    """Distance in metres from the first position to the last."""
    return float(np.linalg.norm(scenelet.joints[-1, PELV] - scenelet.joints[0, PELV]))


@dataclass(frozen=True)
class Stay:
    """A scenelet performed at a place.

    Parameters
    ----------
    scenelet : Scenelet
    placement : Placement
        Pose of the scenelet's local frame in the world.
    approach : (2,) float
        Point on the floor in world coordinates, metres, where walking ends and begins again.
    turn : (2,) float
        Control point of the way from there to the first pose: in front of the seat, so that nobody
        passes through its arms.
    """

    scenelet: Scenelet
    placement: Placement
    approach: Array
    turn: Array

    def joints(self, scale: float) -> Array:
        """Joints of a body scaled about the point on the floor below the pelvis.

        Parameters
        ----------
        scale : float
            Factor on the size of the body.

        Returns
        -------
        (n, 16, 3) float
            World coordinates, metres.
        """
        return self.placement.apply(self.scenelet.joints * scale)

    def furniture(self, scale: float) -> list[SceneObject]:
        """Furniture of the scenelet, scaled with the body.

        Parameters
        ----------
        scale : float
            Factor on the size of the body.

        Returns
        -------
        list of SceneObject
            World coordinates.
        """
        return [o.moved(self.placement) for o in self.scenelet.scaled(scale).objects]


@dataclass(frozen=True)
class _Leg:
    """A walk: (n, 2) positions on the floor, (n,) yaw, and (n,) metres walked."""

    positions: Array
    yaw: Array
    walked: Array


def _leg(corners: Array, *, speed: float, fps: float) -> _Leg:
    """Walk along a polyline (k, 2) with rounded corners."""
    lengths = np.linalg.norm(np.diff(corners, axis=0), axis=-1)
    at = np.concatenate([[0], lengths.cumsum()])
    fine = np.linspace(0.0, at[-1], max(int(at[-1] / _GRID), 2))
    line = np.stack([np.interp(fine, at, corners[:, k]) for k in range(2)], -1)
    width = 2 * int(CORNER / (2 * _GRID)) + 1
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
    """A moving average that keeps both end points fixed."""
    reach = width // 2
    before = 2 * line[:1] - line[reach:0:-1]
    after = 2 * line[-1:] - line[-2 : -reach - 2 : -1]
    padded = np.concatenate([before, line, after])
    kernel = np.full(width, 1 / width)
    return np.stack([np.convolve(padded[:, k], kernel, "valid") for k in range(2)], -1)


def _settled(first: Array, last: Array, turn: Array, n_frames: int) -> Array:
    """(n, 16, 3) frames strictly between two poses (16, 3) in the world, feet on the floor.

    The pelvis follows a parabola whose control point is ``turn`` (2,).
    """
    weight = minimum_jerk(np.arange(1, n_frames + 1) / (n_frames + 1))
    yaw_change = float(np.angle(np.exp(1j * (facing(last) - facing(first)))))
    # Both poses are rotated to the same yaw before blending, and the yaw is interpolated
    # separately.
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
    """The frames of a scenelet, forwards and backwards until ``n_frames`` are filled."""
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
    """The whole motion along each route to each stay, until the frames are used up.

    Parameters
    ----------
    rng : numpy.random.Generator
        Draws the walking speed and the division of spare time among the stays.
    stays : sequence of Stay
        In order of time.
    routes : sequence of (k, 2) float
        Corners of the walk to each stay, from the place of the previous one, metres.
    gait : Gait
    n_frames : int
        Total number of frames.
    scale : float
        Body scale.
    fps : float
        Frames a second.
    shortest_stay : int
        Least number of frames of a stay.

    Returns
    -------
    joints : (n_frames, 16, 3) float
        World coordinates, metres.
    which : (n_frames,) int
        Index of the stay of each frame, -1 while walking.

    None if the walks leave too little time for the stays.
    """
    speed = rng.uniform(*_SPEEDS) * scale
    legs = [_leg(route, speed=speed, fps=fps) for route in routes]
    pause = round(SETTLING * fps)
    on_the_way = sum(len(leg.yaw) for leg in legs) + (2 * len(stays) - 1) * pause
    spare = n_frames - on_the_way - shortest_stay * len(stays)
    if spare < 0:
        return None
    lengths = shortest_stay + rng.multinomial(spare, rng.dirichlet(np.full(len(stays), _EVENNESS)))
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
