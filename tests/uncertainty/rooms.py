"""A scene made by hand, whose numbers a test can work out."""

from __future__ import annotations

import numpy as np

from imapper_prob.models.camera import Camera
from imapper_prob.models.scene import Clip, Cuboid, Placement, Scene, SceneObject, Track
from imapper_prob.models.skeleton import DETECTED
from tests.models.worlds import walk

CAMERA = Camera(
    1920, 1080, 1900.0, 1950.0, 960.0, 540.0,
    pitch=np.radians(-6.0), roll=np.radians(2.0), elevation=1.3,
)  # fmt: skip
FRAME_IDS = np.arange(7, 27)


def couch_and_table(camera: Camera = CAMERA) -> Scene:
    """Somebody walks between a couch with two arms and a table, at 4 m."""
    couch = SceneObject(
        "couch",
        Placement(0.5, 4.8, 2.8),
        (
            Cuboid("seat", np.array([0.0, 0.0, 0.2]), np.array([2.0, 0.8, 0.4])),
            Cuboid("back", np.array([0.0, -0.35, 0.6]), np.array([2.0, 0.1, 0.4])),
            Cuboid("arm", np.array([0.95, 0.0, 0.5]), np.array([0.1, 0.8, 0.2])),
            Cuboid("arm", np.array([-0.95, 0.0, 0.5]), np.array([0.1, 0.8, 0.2])),
        ),
    )
    table = SceneObject(
        "table",
        Placement(-1.0, 3.0, 0.3),
        (
            Cuboid("top", np.array([0.0, 0.0, 0.7]), np.array([1.2, 0.6, 0.05])),
            Cuboid("left leg", np.array([-0.5, 0.0, 0.3375]), np.array([0.1, 0.6, 0.675])),
        ),
    )
    joints = walk(len(FRAME_IDS))
    return Scene(camera, (couch, table), joints, (("walk-1", 0),), -12.5)


def clip_of_scene(scene: Scene) -> Clip:
    """What a perfect detector says of it."""
    n_frames = len(scene.joints)
    confidences = np.zeros((n_frames, 16))
    confidences[:, list(DETECTED)] = 0.9
    poses = scene.camera.to_camera(scene.joints)
    track = Track(
        "walker",
        scene.camera.project(scene.joints),
        confidences,
        poses - poses[:, [6]],
        np.zeros(n_frames, bool),
    )
    return Clip("hall", scene.camera, 10.0, FRAME_IDS, (track,))
