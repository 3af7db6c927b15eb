"""The scene of least expected loss: a point estimate of the posterior.

The most probable draw is rarely the best point estimate. If a missed object costs as much as a
false one, and distances cost their square, the expected loss is least for the objects of
probability above one half, at their mean positions and yaws, and the mean motion. Positions are
averaged in bearing and log distance, because their spread is relative and along the ray. Yaws are
averaged as directions; their loss is the squared chord. An object's shape is one of the drawn
objects of the most frequent kind (all seats are one kind): the one with the largest mean overlap
with all drawn ones.

Furniture is displaced from its position in the scenelet, with the standard deviations of
``calibration.md``: people sit anywhere on a couch, and the detections hardly tell where
(``docs/research/preference.md``).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from shapely import area, intersection, polygons

from imapper_prob.models.camera import Camera
from imapper_prob.models.scene import FRONTLESS, SEATS, Placement, Scene, SceneObject
from imapper_prob.models.settings import ModelSettings
from imapper_prob.models.skeleton import PELV
from imapper_prob.uncertainty.clusters import ObjectCluster, circular_mean_and_spread

__all__ = ["drawn_objects", "expected_scene"]

Array = NDArray[np.float64]


def drawn_objects(
    rng: np.random.Generator, objects: Sequence[SceneObject], settings: ModelSettings
) -> tuple[SceneObject, ...]:
    """Displace objects randomly along their own axes, as the scenelet's position is uncertain.

    Parameters
    ----------
    rng : numpy.random.Generator
    objects : sequence of SceneObject
        Objects in one world frame.
    settings : ModelSettings
        Settings with the standard deviations.

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


_EVEN: Final = 0.5
"""Presence above which a cluster is part of the expected scene: it is more probable than not."""
_COMPARED: Final = 100
"""Largest number of drawn objects, evenly spaced, that are compared with each other."""


def expected_scene(
    camera: Camera,
    clusters: Sequence[ObjectCluster],
    objects: Sequence[Sequence[SceneObject]],
    motions: Iterable[tuple[Camera, Array]],
) -> Scene:
    """Compute the scene of least expected loss.

    Parameters
    ----------
    camera : Camera
        The mean camera, which defines the world frame of the result.
    clusters : sequence of ObjectCluster
    objects : sequence of sequences of SceneObject
        Displaced objects of every draw, in its world frame.
    motions : iterable of (Camera, (T, 16, 3) float)
        Motion of every draw with its camera; they are processed one at a time.

    Returns
    -------
    Scene
        Without a layout; its log-posterior is NaN.
    """
    likely = tuple(_at_its_mean(c, objects) for c in clusters if c.presence > _EVEN)
    joints = camera.to_world(_mean_motion(motions))
    return Scene(camera, likely, joints, (), float("nan"))


def _at_its_mean(cluster: ObjectCluster, objects: Sequence[Sequence[SceneObject]]) -> SceneObject:
    """The drawn object of largest mean overlap, of the most frequent kind, at the mean position.

    Its yaw is the mean over objects of the kind's most frequent label.
    """
    x, y = cluster.positions.T
    bearing, distance = np.arctan2(x, y).mean(), np.exp(np.log(np.hypot(x, y)).mean())
    middle = distance * np.array([np.sin(bearing), np.cos(bearing)])
    members = [objects[n][k] for n, k in cluster.members]
    labels = _most_frequent_kind(members)
    turns = [o.placement.yaw for o in members if o.label == labels[0]]
    yaw, _ = circular_mean_and_spread(np.array(turns), front=labels[0] not in FRONTLESS)
    others = polygons([o.footprint for o in _few(members)])
    pieces = [_stood(o, middle, yaw) for o in _few([o for o in members if o.label in labels])]
    own = polygons([piece.footprint for piece in pieces])
    shared = area(intersection(own[:, None], others))
    overlap = shared / (area(own)[:, None] + area(others) - shared)
    return pieces[int(overlap.mean(1).argmax())]


def _most_frequent_kind(members: Sequence[SceneObject]) -> tuple[str, ...]:
    """Labels of the most frequent kind, in descending order; all seats are one kind."""
    counts = dict(Counter(o.label for o in members).most_common())
    seats = tuple(label for label in counts if label in SEATS)
    kinds = [seats, *((label,) for label in counts if label not in SEATS)]
    return max(kinds, key=lambda kind: sum(counts[label] for label in kind))


def _few(members: Sequence[SceneObject]) -> list[SceneObject]:
    """At most `_COMPARED` objects, evenly spaced."""
    spread = np.linspace(0, len(members) - 1, min(len(members), _COMPARED))
    return [members[k] for k in spread.round().astype(int)]


def _stood(o: SceneObject, middle: Array, yaw: float) -> SceneObject:
    """The object with another centre on the floor and another yaw."""
    turned = SceneObject(o.label, replace(o.placement, yaw=yaw), o.cuboids)
    x, y = turned.placement.x, turned.placement.y
    shift_x, shift_y = (middle - turned.centre[:2]).tolist()
    return SceneObject(o.label, Placement(x + shift_x, y + shift_y, yaw), o.cuboids)


def _mean_motion(motions: Iterable[tuple[Camera, Array]]) -> Array:
    """(T, 16, 3) mean in camera axes: of the pelvis in image coordinates, and of the body about
    it."""
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
