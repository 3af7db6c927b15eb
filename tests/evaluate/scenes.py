"""A made-up truth and predictions that miss it by known amounts."""

from __future__ import annotations

import numpy as np

from imapper_prob.evaluate.prediction import Prediction
from imapper_prob.evaluate.truth import Outline, TruthInView, box_corners, used_objects
from imapper_prob.models.camera import Camera
from imapper_prob.models.skeleton import N_JOINTS

CAMERA = Camera(1920, 1080, 1000.0, 1000.0, 960.0, 540.0)
N_FRAMES = 12
ACTIONS = ("sitting",) * 6 + ("walking",) * 2 + ("reaching",) * 4


def piece(
    label: str,
    x: float,
    y: float,
    *,
    yaw: float = 0.0,
    size: tuple[float, float, float] = (1.0, 0.5, 0.5),
    has_front: bool = True,
) -> Outline:
    """One box whose front is turned by ``yaw`` degrees from straight ahead."""
    angle = np.deg2rad(yaw)
    right = np.array([np.cos(angle), np.sin(angle), 0.0])
    axes = np.stack([right, [-right[1], right[0], 0.0], [0.0, 0.0, 1.0]], 1)
    corners = box_corners((x, y, 0.0), axes, size)
    return Outline.of_corners(label, corners, right, has_front=has_front)


def walk() -> np.ndarray:
    """(12, 16, 3) a body at 4 m, hands stretched out, that moves 0.1 m a frame to the right."""
    body = np.random.default_rng(5).uniform((-0.3, 3.8, -0.9), (0.3, 4.2, 0.8), (N_JOINTS, 3))
    body[[6, 10, 15]] = (0.0, 4.0, 0.0), (0.1, 4.5, 0.3), (-0.1, 4.5, 0.3)
    return body + np.arange(N_FRAMES)[:, None, None] * np.array([0.1, 0.0, 0.0])


def furniture() -> tuple[Outline, ...]:
    """A chair under the walk, a couch and a table away from it, a shelf at its end."""
    return (
        piece("chair", 0.2, 4.0),
        piece("couch", 0.2, 6.0),
        piece("table", -3.0, 4.0, has_front=False),
        piece("shelf", 1.0, 4.5, has_front=False),
    )


def truth(objects: tuple[Outline, ...] | None = None) -> TruthInView:
    """Annotated in every frame but the last; both knees are hidden in the first two."""
    objects = furniture() if objects is None else objects
    joints = walk()
    joints[-1] = np.nan
    hidden = np.zeros((N_FRAMES, N_JOINTS), bool)
    hidden[:2, (0, 1, 4, 5)] = True
    hidden[2, 0] = True
    return TruthInView(
        name="made up",
        frame_ids=np.arange(1, N_FRAMES + 1),
        joints=joints,
        pixels=CAMERA.project_camera(joints),
        hidden=hidden,
        objects=objects,
        used=used_objects(objects, joints, ACTIONS, N_FRAMES),
        actions=ACTIONS,
    )


def prediction(
    joints: np.ndarray | None = None, objects: tuple[Outline, ...] = (), *, people: int = 1
) -> Prediction:
    joints = walk() if joints is None else joints
    return Prediction("guess", joints, CAMERA.project_camera(joints), objects, people)
