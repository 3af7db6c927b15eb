"""A small room made by hand: somebody walks in and sits down on a couch."""

from __future__ import annotations

import numpy as np

from imapper_prob.models.camera import Camera
from imapper_prob.models.scene import (
    Clip,
    Cuboid,
    Placement,
    Scene,
    SceneObject,
    Track,
    Truth,
)
from imapper_prob.models.skeleton import DETECTED, PELV
from imapper_prob.recording.posterior import Certainty, DrawnChain
from imapper_prob.uncertainty.clusters import object_clusters
from imapper_prob.uncertainty.hidden import hidden_joints
from imapper_prob.uncertainty.motion import joint_summary
from imapper_prob.uncertainty.occupancy import occupancy
from imapper_prob.uncertainty.parameters import nuisances
from imapper_prob.uncertainty.scenes import WeightedScene
from tests.uncertainty.motions import exactly

# Right ankle … left wrist, in the order of JOINTS: x right, y forward, z up, metres.
STANDING = np.array([
    [0.1, 0, 0.08], [0.1, 0.02, 0.48], [0.12, 0, 0.9], [-0.12, 0, 0.9], [-0.1, 0.02, 0.48],
    [-0.1, 0, 0.08], [0, 0, 0.9], [0, 0, 1.39], [0, 0.02, 1.48], [0, 0.04, 1.64],
    [0.22, 0.08, 0.85], [0.2, 0, 1.08], [0.16, 0, 1.36], [-0.16, 0, 1.36], [-0.2, 0, 1.08],
    [-0.22, 0.08, 0.85],
])  # fmt: skip
SITTING = np.array([
    [0.1, 0.45, 0.08], [0.1, 0.42, 0.48], [0.12, 0, 0.5], [-0.12, 0, 0.5], [-0.1, 0.42, 0.48],
    [-0.1, 0.45, 0.08], [0, 0, 0.5], [0, -0.06, 0.98], [0, -0.03, 1.07], [0, 0.0, 1.23],
    [0.16, 0.3, 0.56], [0.22, 0.05, 0.68], [0.16, -0.06, 0.95], [-0.16, -0.06, 0.95],
    [-0.22, 0.05, 0.68], [-0.16, 0.3, 0.56],
])  # fmt: skip
SWING = np.zeros((16, 3))
SWING[[0, 1, 10, 11], 1] = 0.22, 0.12, -0.2, -0.08
SWING[[5, 4, 15, 14], 1] = -0.22, -0.12, 0.2, 0.08


def furniture(label: str, x: float, y: float, yaw: float) -> SceneObject:
    parts = {
        "couch": [
            ("seat", (0, 0.05, 0.22), (1.8, 0.7, 0.44)),
            ("back", (0, -0.35, 0.42), (1.8, 0.2, 0.84)),
            ("arm", (-0.95, 0, 0.31), (0.16, 0.85, 0.62)),
            ("arm", (0.95, 0, 0.31), (0.16, 0.85, 0.62)),
        ],
        "chair": [
            ("seat", (0, 0, 0.44), (0.46, 0.46, 0.06)),
            ("back", (0, -0.21, 0.72), (0.46, 0.05, 0.5)),
            *[
                ("leg", (sx * 0.2, sy * 0.2, 0.205), (0.05, 0.05, 0.41))
                for sx in (-1, 1)
                for sy in (-1, 1)
            ],
        ],
        "table": [
            ("top", (0, 0, 0.715), (1.4, 0.8, 0.05)),
            *[
                ("leg", (sx * 0.64, sy * 0.34, 0.345), (0.06, 0.06, 0.69))
                for sx in (-1, 1)
                for sy in (-1, 1)
            ],
        ],
        "shelf": [
            ("side", (-0.48, 0, 0.85), (0.04, 0.32, 1.7)),
            ("side", (0.48, 0, 0.85), (0.04, 0.32, 1.7)),
            *[("board", (0, 0, z), (0.92, 0.32, 0.03)) for z in (0.1, 0.5, 0.9, 1.3, 1.68)],
        ],
    }
    return SceneObject(label, Placement(x, y, yaw), tuple(Cuboid(*p) for p in parts[label]))


def walk_and_sit(n_frames: int, seat: tuple[float, float], yaw: float) -> np.ndarray:
    """(T, 16, 3): two thirds of the time on the way to the seat, then sitting, facing ``yaw``."""
    joints = np.empty((n_frames, 16, 3))
    arrive = 2 * n_frames // 3
    start, over = np.array([-2.2, 3.6]), np.array([-0.4, 4.0])
    front = np.array(seat) + 0.5 * np.array([-np.sin(yaw), np.cos(yaw)])
    for t in range(n_frames):
        s = min(t / arrive, 1.0)
        place = (1 - s) ** 2 * start + 2 * s * (1 - s) * over + s**2 * front
        ahead = 2 * (1 - s) * (over - start) + 2 * s * (front - over)
        heading = np.arctan2(-ahead[0], ahead[1])
        down = np.clip((t - arrive) / max(n_frames // 10, 1), 0, 1)
        pose = (1 - down) * (STANDING + np.sin(t * 0.5) * SWING) + down * SITTING
        turn = (1 - down) * heading + down * yaw
        place = (1 - down) * place + down * np.array(seat)
        joints[t] = Placement(*place, turn).apply(pose)
    return joints


def make_room(n_frames: int, n_ghosts: int = 4) -> tuple[Clip, list[WeightedScene], Truth]:
    rng = np.random.default_rng(8)
    camera = Camera(1920, 1080, 1500, 1500, 960, 540, pitch=-0.12, elevation=1.45)
    couch, table = (
        furniture("couch", 1.35, 5.0, np.pi / 2 + 0.1),
        furniture("table", -0.1, 5.2, 0.2),
    )
    chair, shelf = furniture("chair", -0.2, 4.5, 0.3), furniture("shelf", -1.8, 5.9, np.pi)
    rooms = [
        ((couch, table, chair, shelf), (1.3, 5.0), 0.62),
        ((furniture("chair", 1.25, 4.7, 1.7), table, shelf), (1.25, 4.72), 0.23),
        ((furniture("couch", 1.5, 5.6, np.pi / 2), table, chair), (1.4, 5.6), 0.11),
    ]
    scenes = []
    for objects, seat, probability in rooms:
        joints = walk_and_sit(n_frames, seat, np.pi / 2)
        joints = joints + rng.normal(0, 0.004, joints.shape)
        along = np.array([[0.01, 0.004], [0.004, 0.05]])
        depth = rng.normal(0, 0.15, (n_ghosts, 1, 1)) * joints[:, PELV] * (0.2, 0.2, 0)
        ghosts = joints + depth[:, :, None, :]
        scenes.append(
            WeightedScene(
                Scene(camera, objects, joints, (("sit-couch-1", 2 * n_frames // 3),), -120.5),
                probability,
                0.02,
                np.broadcast_to(along, (len(objects), 2, 2)) * rng.uniform(0.3, 1),
                ghosts,
            )
        )
    true = walk_and_sit(n_frames, (1.3, 5.15), np.pi / 2)
    confidences = np.zeros((n_frames, 16))
    confidences[:, list(DETECTED)] = rng.beta(4, 1.5, (n_frames, len(DETECTED)))
    keypoints = camera.project(true) + rng.normal(0, 8, (n_frames, 16, 2))
    confidences[:5, 0] = 0
    keypoints[:5, 0] = np.nan
    track = Track("actor", keypoints, confidences, true - true[:, [PELV]], np.zeros(n_frames, bool))
    truth = Truth(
        camera,
        (furniture("couch", 1.35, 5.15, np.pi / 2), furniture("table", -0.1, 5.35, 0.1), chair),
        true,
        np.zeros((n_frames, 16), bool),
    )
    clip = Clip("room", camera, 10.0, np.arange(100, 100 + n_frames), (track,), 0.005, truth)
    return clip, scenes, truth


def make_draws(n: int, scenes: list[WeightedScene]) -> list[tuple[SceneObject, ...]]:
    """``n`` draws of the furniture around that of the scenes, two chains' worth."""
    rng = np.random.default_rng(10)
    shares = np.array([s.probability for s in scenes])
    chosen = rng.choice(len(scenes), n, p=shares / shares.sum())
    return [
        tuple(
            SceneObject(
                o.label,
                Placement(*(o.placement.apply((0, 0, 0))[:2] + rng.normal(0, 0.1, 2)),
                          o.placement.yaw + rng.normal(0, 0.1)),
                o.cuboids,
            )
            for o in scenes[k].scene.objects
        )
        for k in chosen
    ]  # fmt: skip


def make_certainty(n: int, scenes: list[WeightedScene]) -> Certainty:
    """What :func:`make_draws` and the scenes' own motions say together."""
    rng = np.random.default_rng(11)
    draws = make_draws(n, scenes)
    best = scenes[0].scene
    motions = [best.joints + rng.normal(0, 0.05, 3) for _ in draws]
    clusters = object_clusters(draws, np.zeros((2, n // 2)), radius=0.8)
    elevations = [best.camera.elevation] * n
    camera = rng.normal((-0.12, 1.45, 0, 0, 0), 0.02, (2, n // 2, 5))
    return Certainty(
        occupancy(draws),
        hidden_joints(draws, motions, elevations, clusters),
        joint_summary(exactly(joints) for joints in motions),
        nuisances(camera, mean=camera.mean((0, 1)), covariance=0.002 * np.eye(5)),
    )


def make_chains(n: int, n_frames: int, scenes: list[WeightedScene]) -> list[DrawnChain]:
    """:func:`make_draws` as two chains, each with a path of its own."""
    rng = np.random.default_rng(12)
    half = n // 2
    draws = make_draws(n, scenes)
    pelvis = np.nan_to_num(scenes[0].scene.joints[:, PELV])
    paths = (pelvis + rng.normal(0, 0.05, (n, n_frames, 3)))[:, None]
    return [
        DrawnChain(np.arange(half), draws[c * half : (c + 1) * half], paths[c * half :][:half])
        for c in range(2)
    ]


def make_traces() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(9)
    energy = np.cumsum(rng.normal(0, 0.4, (4, 600)), 1) * 0.2 - 120
    return {
        "log posterior": energy,
        "number of objects": rng.integers(3, 6, (4, 600)).astype(float),
    }
