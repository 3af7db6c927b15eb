"""The scene of least expected loss: one answer for those who can use only one.

The most probable draw is rarely the best answer. If a miss costs as much as an object too many, and
distances count squared, least loss is expected of naming what is there with more than even odds, at
its mean place, turned as it is on average, and of the mean motion. Means of places are of bearing
and log distance, because spread is relative and along the ray; means of turns are of directions,
their loss the chord's square. Of the drawn pieces of the most probable kind, all seats being one
kind, that is chosen whose outline overlaps most on average with where and how large all may stand.

Furniture stands about where its scenelet says, by the spreads of ``calibration.md``: people
sit at any place of a couch, and the detections hardly tell (``docs/research/preference.md``).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from shapely import area, intersection, polygons

from imapper_prob.layouts import SEATS
from imapper_prob.models.camera import Camera
from imapper_prob.models.scene import FRONTLESS, Placement, Scene, SceneObject
from imapper_prob.models.settings import ModelSettings
from imapper_prob.models.skeleton import PELV
from imapper_prob.models.statement_rows import ROOM_AREA
from imapper_prob.models.statements import ObjectAt, Statement
from imapper_prob.uncertainty.clusters import ObjectCluster, circular_mean_and_spread

__all__ = ["as_told", "drawn_objects", "expected_scene"]

Array = NDArray[np.float64]


def drawn_objects(
    rng: np.random.Generator, objects: Sequence[SceneObject], settings: ModelSettings
) -> tuple[SceneObject, ...]:
    """The same objects, each moved along its own axes by what its scenelet cannot know.

    Parameters
    ----------
    rng : numpy.random.Generator
    objects : sequence of SceneObject
        In one world.
    settings : ModelSettings
        For the spreads.

    Returns
    -------
    tuple of SceneObject
    """
    return tuple(_moved(o, rng.standard_normal(2), settings) for o in objects)


def _moved(o: SceneObject, errors: Array, settings: ModelSettings) -> SceneObject:
    low, high = o.bounds
    scale = (settings.furniture_aside * (high[0] - low[0]), settings.furniture_ahead)
    x, y = o.placement.rotation @ (scale * errors)
    place = replace(o.placement, x=o.placement.x + float(x), y=o.placement.y + float(y))
    return SceneObject(o.label, place, o.cuboids)


def as_told(
    rng: np.random.Generator,
    placed: Sequence[SceneObject],
    drawn: Sequence[SceneObject],
    statements: Sequence[Statement],
    settings: ModelSettings,
) -> tuple[SceneObject, ...]:
    """Drawn objects given where somebody measured one of them.

    A draw of a normal density becomes one of its conditional by adding the gain times what is left
    of the measurement, with an error of its own (Matheron's rule). Which object was measured, or
    none, is drawn by how well each agrees.

    Parameters
    ----------
    rng : numpy.random.Generator
    placed : sequence of SceneObject
        Where scenelets say that they stand.
    drawn : sequence of SceneObject
        The same as they may stand, see :func:`drawn_objects`.
    statements : sequence of Statement
        Of which those count that say a place.
    settings : ModelSettings

    Returns
    -------
    tuple of SceneObject
    """
    result = list(drawn)
    for said in statements:
        if not isinstance(said, ObjectAt) or said.place is None:
            continue
        place, error = np.array(said.place), said.place_std**2 * np.eye(2)
        ours = [k for k, o in enumerate(placed) if o.label in said.labels]
        spreads = [_spread(placed[k], settings) for k in ours]
        weights = [
            (1 - said.doubt) * _normal(place - placed[k].centre[:2], spread + error) / len(ours)
            for k, spread in zip(ours, spreads, strict=True)
        ]
        chances = np.array([*weights, said.doubt / 2 / ROOM_AREA])
        which = int(rng.choice(len(chances), p=chances / chances.sum()))
        noise = said.place_std * rng.standard_normal(2)
        if which < len(ours):
            o = result[ours[which]]
            gain = spreads[which] @ np.linalg.inv(spreads[which] + error)
            x, y = gain @ (place + noise - o.centre[:2])
            at = replace(o.placement, x=o.placement.x + float(x), y=o.placement.y + float(y))
            result[ours[which]] = SceneObject(o.label, at, o.cuboids)
    return tuple(result)


def _spread(o: SceneObject, settings: ModelSettings) -> Array:
    """(2, 2) covariance of where an object stands, m^2."""
    low, high = o.bounds
    scale = (settings.furniture_aside * (high[0] - low[0]), settings.furniture_ahead)
    turn = o.placement.rotation
    return np.asarray(turn @ np.diag(np.square(scale)) @ turn.T)


def _normal(off: Array, covariance: Array) -> float:
    """Density of a normal error on the floor, per m^2."""
    square = off @ np.linalg.solve(covariance, off)
    return float(np.exp(-0.5 * square) / (2 * np.pi * np.sqrt(np.linalg.det(covariance))))


_EVEN: Final = 0.5
_COMPARED: Final = 100
"""Draws of an object, evenly spread, that are compared with each other: a moment's work."""


def expected_scene(
    camera: Camera,
    clusters: Sequence[ObjectCluster],
    objects: Sequence[Sequence[SceneObject]],
    motions: Iterable[tuple[Camera, Array]],
) -> Scene:
    """The scene of least expected loss.

    Parameters
    ----------
    camera : Camera
        The mean one, in whose world the answer is.
    clusters : sequence of ObjectCluster
    objects : sequence of sequences of SceneObject
        Of every draw, in its world, as they may stand.
    motions : iterable of (Camera, (T, 16, 3) float)
        Of every draw, with its own camera; one at a time is held.

    Returns
    -------
    Scene
        Without layout, and of a log-posterior that nobody knows (NaN).
    """
    likely = tuple(_at_its_mean(c, objects) for c in clusters if c.presence > _EVEN)
    joints = camera.to_world(_mean_motion(motions))
    return Scene(camera, likely, joints, (), float("nan"))


def _at_its_mean(cluster: ObjectCluster, objects: Sequence[Sequence[SceneObject]]) -> SceneObject:
    """The piece of most expected overlap among those of the most probable kind, at the mean place.

    Turned as those of the kind's most probable label are in the mean.
    """
    x, y = cluster.positions.T
    bearing, distance = np.arctan2(x, y).mean(), np.exp(np.log(np.hypot(x, y)).mean())
    middle = distance * np.array([np.sin(bearing), np.cos(bearing)])
    labels = _most_probable_kind(cluster)
    members = [objects[n][k] for n, k in cluster.members]
    turns = [o.placement.yaw for o in members if o.label == labels[0]]
    yaw, _ = circular_mean_and_spread(np.array(turns), front=labels[0] not in FRONTLESS)
    others = polygons([o.footprint for o in _few(members)])
    pieces = [_stood(o, middle, yaw) for o in _few([o for o in members if o.label in labels])]
    own = polygons([piece.footprint for piece in pieces])
    shared = area(intersection(own[:, None], others))
    overlap = shared / (area(own)[:, None] + area(others) - shared)
    return pieces[int(overlap.mean(1).argmax())]


def _most_probable_kind(cluster: ObjectCluster) -> tuple[str, ...]:
    """Its labels, most probable first; what one sits on is one kind, any other label its own."""
    seats = tuple(label for label in cluster.labels if label in SEATS)
    kinds = [seats, *((label,) for label in cluster.labels if label not in SEATS)]
    return max(kinds, key=lambda kind: sum(cluster.labels[label] for label in kind))


def _few(members: Sequence[SceneObject]) -> list[SceneObject]:
    """At most as many as are compared, evenly spread."""
    spread = np.linspace(0, len(members) - 1, min(len(members), _COMPARED))
    return [members[k] for k in spread.round().astype(int)]


def _stood(o: SceneObject, middle: Array, yaw: float) -> SceneObject:
    """The object with its centre elsewhere on the floor, and turned."""
    turned = SceneObject(o.label, replace(o.placement, yaw=yaw), o.cuboids)
    x, y = turned.placement.x, turned.placement.y
    shift_x, shift_y = (middle - turned.centre[:2]).tolist()
    return SceneObject(o.label, Placement(x + shift_x, y + shift_y, yaw), o.cuboids)


def _mean_motion(motions: Iterable[tuple[Camera, Array]]) -> Array:
    """(T, 16, 3) in camera axes: the pelvis as it is seen, the body about it as it is."""
    place, body = np.zeros(()), np.zeros(())
    for count, (camera, world) in enumerate(motions, 1):
        joints = camera.to_camera(world)
        pelvis = joints[:, PELV]
        depth = pelvis[:, 1]
        seen = np.stack([pelvis[:, 0] / depth, np.log(depth), pelvis[:, 2] / depth], -1)
        place = place + (seen - place) / count
        body = body + (joints - pelvis[:, None] - body) / count
    depth = np.exp(place[:, 1])
    pelvis = np.stack([place[:, 0] * depth, depth, place[:, 2] * depth], -1)
    result: Array = pelvis[:, None] + body
    return result
