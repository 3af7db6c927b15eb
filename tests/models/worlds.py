"""Small hand-made worlds for the tests of the model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from imapper_prob.models.camera import Camera
from imapper_prob.models.detector import DetectionModel
from imapper_prob.models.path_prior import CameraPrior, StaticPath
from imapper_prob.models.problem import Problem, pack_problem
from imapper_prob.models.scene import Clip, Cuboid, Placement, SceneObject, Track
from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.models.settings import ModelSettings
from imapper_prob.models.skeleton import DETECTED, N_JOINTS, PELV
from lab.prior import Experiment

CAMERA = Camera(1920, 1080, 1955.0, 1955.0, 960.0, 540.0, pitch=np.radians(-4), elevation=1.5)
POSE = np.zeros((N_JOINTS, 3))
POSE[:, 2] = [
    -0.8, -0.4, 0.0, 0.0, -0.4, -0.8, 0.0, 0.5, 0.6, 0.75, -0.05, 0.2, 0.45, 0.45, 0.2, -0.05,
]  # fmt: skip
POSE[:, 0] = [
    0.1, 0.1, 0.12, -0.12, -0.1, -0.1, 0.0, 0.0, 0.0, 0.0, 0.25, 0.22, 0.16, -0.16, -0.22, -0.25,
]  # fmt: skip
"""A person standing upright, relative to the pelvis, facing +y."""
PELVIS_HEIGHT = 0.9


def couch(x: float = 0.0, y: float = 0.0, yaw: float = 0.0, label: str = "couch") -> SceneObject:
    """A seat of 1.6 m with a back, at a placement."""
    parts = (
        Cuboid("seat", np.array([0.0, 0.0, 0.22]), np.array([1.6, 0.8, 0.44])),
        Cuboid("back", np.array([0.0, -0.35, 0.6]), np.array([1.6, 0.15, 0.7])),
    )
    return SceneObject(label, Placement(x, y, yaw), parts)


def with_errors(piece: SceneObject, errors: np.ndarray) -> SceneObject:
    """A piece turned, moved along and across its width, and of other sides, on the floor."""
    low, high = piece.bounds
    size = (high - low) * np.exp(errors[2:5])
    turned = replace(piece.placement, yaw=piece.placement.yaw + errors[5])
    x, y = piece.centre[:2] + turned.rotation @ errors[:2]
    part = Cuboid("all", np.array([0.0, 0.0, low[2] * np.exp(errors[4]) + size[2] / 2]), size)
    return SceneObject(piece.label, Placement(x, y, turned.yaw), (part,))


def library(n_frames: int = 6, *, n_scenelets: int = 3, objects: bool = True) -> Library:
    """Scenelets of a standing person who drifts a little, before a couch, the third a chair."""
    drift = 0.05 * (np.arange(n_frames) - n_frames // 2)
    scenelets = []
    for k in range(n_scenelets):
        joints = np.repeat(POSE[None], n_frames, 0) + np.array([0.0, 0.0, PELVIS_HEIGHT])
        joints[..., 0] += (k - 1) * drift[:, None]
        joints[..., 2] *= 1 + 0.02 * k
        label = "chair" if k == 2 else "couch"
        furniture = (couch(0.1 * k, -0.6, label=label),) if objects else ()
        scenelets.append(Scenelet(f"stand-{k}", "stand", joints, furniture))
    return Library("test", tuple(scenelets))


def mixed_library() -> Library:
    """Scenelets of two lengths, with and without furniture, that move and turn differently."""
    long = [replace(s, name=f"long-{s.name}") for s in library(9)]
    bare = [replace(s, name=f"bare-{s.name}") for s in library(6, n_scenelets=1, objects=False)]
    return Library("mixed", (*library(6), long[0], long[2], *bare))


def walk(n_frames: int, *, depth: float = 4.0, span: float = 1.6) -> np.ndarray:
    """(T, 16, 3) joints in the world of somebody walking ``span`` metres across the view."""
    pelvis = np.stack(
        [
            np.linspace(-span / 2, span / 2, n_frames),
            np.full(n_frames, depth),
            np.full(n_frames, 0.9),
        ],
        -1,
    )
    return pelvis[:, None] + POSE


def clip_of(joints: np.ndarray, rng: np.random.Generator, *, noise: float = 5.0) -> Clip:
    """Detections of world joints seen by ``CAMERA``, all confident."""
    in_camera = CAMERA.to_camera(joints)
    confidences = np.zeros(joints.shape[:2])
    confidences[:, list(DETECTED)] = rng.uniform(0.5, 1.0, (len(joints), len(DETECTED)))
    track = Track(
        "person",
        CAMERA.project(joints) + noise * rng.standard_normal((*joints.shape[:2], 2)),
        confidences,
        in_camera - in_camera[:, [PELV]],
        np.zeros(len(joints), bool),
    )
    return Clip("test", CAMERA, 10.0, np.arange(len(joints)), (track,))


def path_of(joints: np.ndarray, *, sd: tuple[float, float] = (0.02, 0.1)) -> StaticPath:
    """The static path that knows the world joints, with a stated doubt."""
    in_camera = CAMERA.to_camera(joints)
    pelvis = in_camera[:, PELV]
    seen = np.stack([pelvis[:, 0] / pelvis[:, 1], np.log(pelvis[:, 1])], -1)
    return StaticPath(
        seen,
        pelvis[:, 2] / pelvis[:, 1],
        np.tile(sd, (len(joints), 1)),
        in_camera - pelvis[:, None],
        np.ones(len(joints), bool),
    )


def camera_prior() -> CameraPrior:
    """The mean of ``CAMERA``, and some doubt."""
    mean = np.array([CAMERA.pitch, CAMERA.elevation, 0.0, 0.0, CAMERA.roll])
    return CameraPrior(mean, np.diag([0.05, 0.1, 0.05, 0.05, 0.02]) ** 2)


def deviations(prior: CameraPrior) -> np.ndarray:
    """(5,) standard deviations of a camera prior, in the units of its mean."""
    return np.sqrt(np.diag(prior.covariance))


def facing_about(problem: Problem, *, seed: int = 0) -> Problem:
    """The same, but persons turn, on the path and in the scenelets, as they please."""
    rng = np.random.default_rng(seed)

    def directions(n: int) -> np.ndarray:
        yaw = rng.uniform(-np.pi, np.pi) + np.cumsum(0.3 * rng.standard_normal(n))
        return np.stack([np.cos(yaw), np.sin(yaw)], -1)

    return problem._replace(
        path_facing=directions(problem.n_frames), joint_facing=directions(len(problem.joints))
    )


def problem(
    n_frames: int = 20,
    *,
    seed: int = 0,
    settings: ModelSettings | None = None,
    scenelets: Library | None = None,
    span: float = 1.6,
    starts: np.ndarray | None = None,
) -> Problem:
    """A whole problem: somebody walks across the view, with the test library."""
    joints = walk(n_frames, span=span)
    clip = clip_of(joints, np.random.default_rng(seed))
    packed = pack_problem(
        clip, path_of(joints), camera_prior(), scenelets or library(), settings=settings
    )
    if starts is None:
        return packed
    return packed._replace(path_starts=starts | packed.path_starts)


def experiment(
    n_frames: int = 20,
    *,
    joints_a_frame: int = len(DETECTED),
    doubt: tuple[float, float] = (0.1, 0.2),
    settings: ModelSettings | None = None,
    scenelets: Library | None = None,
) -> Experiment:
    """What data can be drawn of: somebody walks across the view where no scenelet is."""
    rng = np.random.default_rng(0)
    joints = walk(n_frames)
    clip = clip_of(joints, rng)
    (track,) = clip.tracks
    unused = np.ones((n_frames, N_JOINTS), bool)
    for row in unused:
        row[rng.choice(DETECTED, joints_a_frame, replace=False)] = False
    track = replace(track, confidences=np.where(unused, 0.0, track.confidences))
    settings = settings or ModelSettings(scenelet_rate=0.1)
    return Experiment(
        replace(clip, tracks=(track,)),
        path_of(joints, sd=doubt),
        camera_prior(),
        scenelets or library(),
        replace(settings, frame_weight=1.0, smoothness_cost=0.0, motion_cost=50 / 12),
        DetectionModel(),
    )
