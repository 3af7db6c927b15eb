"""One answer for those who can use only one: the scene of least expected loss.

The most probable draw is rarely the best answer: it is one draw, with one draw's errors. If a
miss costs as much as an object too many, and distances and lengths count squared, least loss is
expected of naming what is there with more than even odds, at its mean place, turned as it is on
average and of mean size, and of the mean motion. Means of places are of bearing and log distance,
because spread is relative and along the ray; means of turns are of directions, their loss the
chord's square. Sizes are those of all draws, whatever they call it: what may be a chair or a couch
is something between.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.scene import Cuboid, Scene, SceneObject
from imapper_prob.models.skeleton import PELV
from imapper_prob.results.uncertainty.clusters import (
    ObjectCluster,
    circular_mean_and_spread,
)

__all__ = ["expected_scene"]

Array = NDArray[np.float64]

_EVEN: Final = 0.5


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
        Of every draw, in its world.
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
    """The member of the most probable label that is nearest to the mean place, moved there.

    Turned as those of its label are in the mean, and stretched to the mean size of all.
    """
    x, y = cluster.positions.T
    bearing, distance = np.arctan2(x, y).mean(), np.exp(np.log(np.hypot(x, y)).mean())
    middle = distance * np.array([np.sin(bearing), np.cos(bearing)])
    members = [objects[n][k] for n, k in cluster.members]
    alike = [o for o in members if o.label == cluster.label]
    best = min(alike, key=lambda o: float(np.linalg.norm(o.centre[:2] - middle)))
    yaw, _ = circular_mean_and_spread(np.array([o.placement.yaw for o in alike]))
    size: Array = np.mean([_size(o) for o in members], axis=0)
    stretch = size / _size(best)
    cuboids = tuple(Cuboid(c.part, stretch * c.centre, stretch * c.size) for c in best.cuboids)
    turned = SceneObject(best.label, replace(best.placement, yaw=yaw), cuboids)
    place, shift = turned.placement, middle - turned.centre[:2]
    moved = replace(place, x=place.x + float(shift[0]), y=place.y + float(shift[1]))
    return SceneObject(best.label, moved, cuboids)


def _size(o: SceneObject) -> Array:
    """(3,) width and depth, and height of the top above the floor, metres."""
    low, high = o.bounds
    return np.array([high[0] - low[0], high[1] - low[1], high[2]])


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
