"""A furnished room before a camera: the scene of the simulator."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.geometry import pack_boxes, sight_clearance
from imapper_prob.models.pose import facing
from imapper_prob.models.scene import Placement, SceneObject
from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.models.simulate_motion import Stay
from imapper_prob.models.skeleton import DETECTED, PELV

__all__ = [
    "draw_bystander",
    "draw_entry",
    "draw_stay",
    "find_route",
    "hidden_joints",
    "in_image",
    "low_pieces",
]

Array = NDArray[np.float64]

TOUCH: Final = 0.02
"""Metres by which a line of sight must cut a box: grazing an edge is not being hidden."""

NEAREST: Final = 2.5
FARTHEST: Final = 6.0
"""Depth in metres at which people do things; i3DB's do them 3-6 m away."""

PASSAGE: Final = 0.15
"""Metres between furniture and the middle of a walking body (arms may graze)."""

GAP: Final = 0.45
"""Metres between one interaction's furniture and the next's: a way to squeeze through."""

FEWEST_SEEN: Final = 0.55
"""Part of the joints that an interaction must show; of somebody hidden nothing is known."""

LOW: Final = 1.0
"""Metres; lower furniture hides no more than the legs of somebody who stands behind it."""

KNEE_ROOM: Final = 0.45
"""Metres from the pelvis of somebody seated to where they stand before the seat."""

SITTING: Final = 0.75
"""Metres; whose pelvis is lower sits."""

# Where walking ends, relative to the first pose: (right, forward) metres. Before a seat, beside
# it if there is a table before it, or past the end of that table; behind somebody who stands.
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
    """Which points (..., 3) of the world fall into the image."""
    u, v = np.moveaxis(camera.project(points), -1, 0)
    inside: NDArray[np.bool_] = (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
    return inside


def hidden_joints(
    camera: Camera, joints: Array, objects: Sequence[SceneObject]
) -> NDArray[np.bool_]:
    """Which joints (..., 16, 3) furniture hides from the camera."""
    hidden: NDArray[np.bool_] = sight_clearance(camera.centre, joints, pack_boxes(objects)) < -TOUCH
    return hidden


def _distance(points: Array, objects: Sequence[SceneObject]) -> float:
    """Smallest distance on the floor of any point (k, 2) from any object's bounding box."""
    nearest = np.inf
    for piece in objects:
        local = (points - (piece.placement.x, piece.placement.y)) @ piece.placement.rotation
        low, high = piece.bounds[:, :2]
        outside = np.maximum(np.maximum(low - local, local - high), 0.0)
        nearest = min(nearest, float(np.linalg.norm(outside, axis=-1).min()))
    return nearest


def _outline(piece: SceneObject) -> Array:
    """Points of the floor about 10 cm apart all over an object's footprint."""
    a, b, _, d = piece.footprint
    u, v = np.meshgrid(
        np.linspace(0, 1, int(np.linalg.norm(b - a) / 0.1) + 2),
        np.linspace(0, 1, int(np.linalg.norm(d - a) / 0.1) + 2),
    )
    points: Array = a + u.reshape(-1, 1) * (b - a) + v.reshape(-1, 1) * (d - a)
    return points


def _anywhere(rng: np.random.Generator, camera: Camera) -> Array:
    """A point of the floor whose bearing is well inside the image."""
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
    """A place for an interaction that is in view and clear of other furniture, or None."""
    x, y = _anywhere(rng, camera)
    placement = Placement(float(x), float(y), float(rng.uniform(-np.pi, np.pi)))
    own = [piece.moved(placement) for piece in scenelet.objects]
    if any(_distance(_outline(piece), furniture) < GAP for piece in own):
        return None
    if min(piece.footprint[:, 1].min() for piece in own) < NEAREST / 2:
        return None
    joints = placement.apply(scenelet.joints * scale)
    middle = joints[len(joints) // 2, list(DETECTED)]
    # The furniture of one interaction may hide part of another, but not most of it.
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
    """All furniture of a library that one looks over when standing."""
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
    """One of ``pieces``, used by nobody, between camera and person and hiding part of them.

    None if this attempt found no room for it.
    """
    piece = pieces[int(rng.integers(len(pieces)))]
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
    """A free point (2,) of the floor in view where the clip begins, a few steps away, or None."""
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
    """Corners (2, 2) or (3, 2) of the shortest free way found between two points, or None."""
    ways = [np.stack([start, end])]
    ways += [np.stack([start, _anywhere(rng, camera), end]) for _ in range(20)]
    for way in sorted(ways, key=lambda w: np.linalg.norm(np.diff(w, axis=0), axis=-1).sum()):
        steps = np.linspace(0, len(way) - 1, 80)
        line = np.stack([np.interp(steps, np.arange(len(way)), way[:, k]) for k in range(2)], -1)
        if _distance(line, furniture) > 0.9 * PASSAGE:
            return way
    return None
