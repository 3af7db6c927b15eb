"""Everything the log-posterior of one clip needs, packed into flat arrays."""

from __future__ import annotations

from dataclasses import astuple, fields
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.detector import DetectionModel, student_t
from imapper_prob.models.errors import InputError
from imapper_prob.models.geometry import pack_boxes
from imapper_prob.models.kernels.stays import off_feet
from imapper_prob.models.path_prior import CameraPrior, StaticPath, path_tables, remembered
from imapper_prob.models.scene import FRONTLESS, Clip
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import ModelSettings, PaperWeights
from imapper_prob.models.skeleton import DETECTED, MIRROR, N_JOINTS, facing
from imapper_prob.models.text import brief

__all__ = [
    "CAMERA",
    "COLLISION",
    "DETECTIONS",
    "FREE_POSE",
    "GROUND",
    "LAYOUT",
    "MOTION",
    "PATH",
    "PLACEMENT",
    "SMOOTHNESS",
    "SUPPORT",
    "TERMS",
    "Problem",
    "pack_problem",
    "resample",
]

TERMS: Final = (
    "camera", "layout", "placement", "path", "detections", "free_pose", "smoothness", "collision",
    "motion", "ground", "support",
)  # fmt: skip
"""In the order in which they are evaluated."""
(
    CAMERA, LAYOUT, PLACEMENT, PATH, DETECTIONS, FREE_POSE, SMOOTHNESS, COLLISION, MOTION, GROUND,
    SUPPORT,
) = range(len(TERMS))  # fmt: skip

# ------------------------------------------------------------------------------------------------
# Everything the log-posterior of one clip needs, packed into flat arrays.

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


class Problem(NamedTuple):
    """The data and constants of one actor's log-posterior.

    T frames, 16 joints, L scenelets of N frames in all, B boxes in all. Index 0 is hidden
    and 1 seen wherever a last axis has length 2 without being a coordinate.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    keypoints: Array  # (T, 16, 2) pixels
    used: NDArray[np.bool_]  # (T, 16) detected joints
    confidences: Array  # (T, 16) of the detector, in [0, 1]
    confidence_density: Array  # (T, 16, 2) p0(c), p1(c)
    error_scale: Array  # (T, 16, 2) pixels
    error_dof: Array  # (T, 16, 2)
    path_centre: Array  # (T, 2) bearing, log depth of the pelvis without scenelets
    path_scale: Array  # (T, 2) by how much it may be off
    path_starts: NDArray[np.bool_]  # (T,) frames that follow upon nothing: the clip's first, and
    # those in which the film of another person begins
    path_stay: Ints  # (T,) the stay of each frame, -1 for none, see `with_stays`
    stay_steps: int  # that the path's error along the view makes in a stay
    path_mean: Array  # (2, T + 1, 2) of bearing and log depth, see path_tables
    path_draw: Array  # (2, T + 1, 3, 3)
    lift: Array  # (T,)
    poses: Array  # (T, 16, 3) camera axes, metres
    path_facing: Array  # (T, 2) cosine and sine of where they face in the world of the mean
    # camera; zeros where nobody has looked
    static_density: Array  # (2, T, 16, 2) p(u, c | hidden), p(u, c | seen) at the frame's own
    # fit, as it is and with left and right swapped
    free_cost: Array  # (T,) nats a free frame pays for its pose, before the frame weight
    joints: Array  # (N, 16, 3) scenelet joints, local frame, metres
    joint_facing: Array  # (N, 2) cosine and sine of where its person faces
    joint_first: Ints  # (L + 1,) where each scenelet's frames start
    boxes: Array  # (B, 7) scenelet boxes, local frame
    box_first: Ints  # (L + 1,)
    box_object: Ints  # (B,) which object of its scenelet a box is of
    box_label: Ints  # (B,) category of that object
    box_yaw: Array  # (B,) orientation of that object, radians
    label_front: NDArray[np.bool_]  # by category, whether its front can be told from its back
    stays: Array  # (K, 3) first frame, frame after the last, nats; see energy.support
    lowered: Ints  # (L, 2) frames of each scenelet in which its person is off their feet
    log_rate: Array  # (L,) log prior odds of the scenelet at a given start
    camera_mean: Array  # (5,)
    camera_precision: Array  # (5, 5)
    camera_constant: float
    start_mean: Array  # (2,)
    start_variance: Array  # (2,)
    size_spread: float
    facing_spread: float  # radians between where a scenelet faces and where the path does
    frame_weight: float
    swap_begins: float  # probability a frame
    swap_ends: float
    pose_tolerance: float
    sight_width: float
    surprise: float
    joint_step: float  # metres between two frames
    smoothness_cost: float
    collision_cost: float
    motion_cost: float
    furniture_spread: float  # metres that furniture may stand out of the way
    merge_angle: float
    likelihood: float
    paper_nats: Array  # (5,) nats a unit of each term of the published energy; 0 by default

    def __repr__(self) -> str:
        return brief(self)

    @property
    def of_paper(self) -> bool:
        """Whether the published energy takes the place of the likelihood."""
        return bool(self.paper_nats.any())

    @property
    def n_frames(self) -> int:
        """Frames of the clip, T."""
        return len(self.lift)

    @property
    def lengths(self) -> Ints:
        """(L,) frames of each scenelet."""
        return np.diff(self.joint_first)


def resample(joints: Array, *, fps: float, to_fps: float) -> Array:
    """A motion (n, 16, 3) at another frame rate, its middle frame kept in the middle."""
    if fps == to_fps:
        return np.array(joints)
    n = len(joints)
    before = int(np.floor((n // 2) / fps * to_fps + 1e-9))
    after = int(np.floor((n - 1 - n // 2) / fps * to_fps + 1e-9))
    at = n // 2 + np.arange(-before, after + 1) * fps / to_fps
    low = np.clip(np.floor(at).astype(int), 0, n - 2)
    part = (at - low)[:, None, None]
    result: Array = (1 - part) * joints[low] + part * joints[low + 1]
    return result


def pack_problem(
    clip: Clip,
    path: StaticPath,
    camera: CameraPrior,
    library: Library,
    *,
    track: int = 0,
    settings: ModelSettings | None = None,
    detections: DetectionModel | None = None,
    weights: Array | None = None,
    starts: NDArray[np.bool_] | None = None,
) -> Problem:
    """Pack one actor of a clip with its static path, camera prior and a library.

    ``weights`` (L,), positive, say how the prior rate is shared among the scenelets; they
    are normalised, and equal if not given. ``starts`` (T,) bool are the frames that follow upon
    nothing, where a clip is made of the frames of several people, one person after the
    other: errors of the path and swaps of sides begin anew there, and no scenelet goes on. The
    first frame is one anyway, and the only one if not given.

    Raises
    ------
    InputError
        If the static path and the clip differ in length, no scenelet fits in the clip, or one
        is a single frame at the clip's rate.
    """
    settings = settings or ModelSettings()
    detections = detections or DetectionModel()
    person, nominal = clip.tracks[track], clip.camera
    if len(path.lift) != clip.n_frames:
        raise InputError(f"clip {clip.name}: the static path has {len(path.lift)} frames")
    used = np.zeros((clip.n_frames, N_JOINTS), bool)
    used[:, list(DETECTED)] = person.confidences[:, list(DETECTED)] > 0
    keypoints = np.where(used[..., None], person.keypoints, 0.0)
    confidence = detections.confidence_density(person.confidences)
    scale, dof = detections.error_tables(person.confidences, image_height=nominal.height)
    residual = _static_residual(nominal, path, keypoints)
    static = confidence * np.exp(student_t(residual[..., None], scale, dof))

    motions = [resample(s.joints, fps=s.fps, to_fps=clip.fps) for s in library]
    lengths = np.array([len(m) for m in motions])
    if lengths.min() > clip.n_frames:
        raise InputError(
            f"clip {clip.name}: {clip.n_frames} frames, but the shortest scenelet of library "
            f"{library.name} has {lengths.min()}; use a longer clip"
        )
    if lengths.min() < 2:
        short = library[int(lengths.argmin())].name
        raise InputError(
            f"clip {clip.name}: at {clip.fps:g} frames a second scenelet {short} of library "
            f"{library.name} is a single frame; leave it out, or use a film of a higher rate"
        )
    shares = np.ones(len(library)) if weights is None else np.asarray(weights, float)
    labels = sorted({label for s in library for label in s.labels})
    counts = [sum(len(o.cuboids) for o in s.objects) for s in library]
    object_of = [(i, o) for s in library for i, o in enumerate(s.objects) for _ in o.cuboids]
    nats = np.zeros(len(fields(PaperWeights)))
    if settings.energy == "paper":
        nats = settings.paper_nats * settings.likelihood * np.array(astuple(PaperWeights()))
    centre, deviation, rates = _path_prior(path, settings, clip.fps)
    mean, draw = path_tables(rates, clip.n_frames)
    begins = np.zeros(clip.n_frames, bool) if starts is None else np.array(starts, bool)
    begins[0] = True
    problem = Problem(
        fx=nominal.fx, fy=nominal.fy, cx=nominal.cx, cy=nominal.cy,
        keypoints=keypoints,
        used=used,
        confidences=person.confidences,
        confidence_density=confidence,
        error_scale=scale,
        error_dof=dof,
        path_centre=centre,
        path_scale=deviation,
        path_starts=begins,
        path_stay=np.full(clip.n_frames, -1),
        stay_steps=max(1, round(settings.stay_change * clip.fps)),
        path_mean=mean,
        path_draw=draw,
        lift=path.lift,
        poses=path.poses,
        path_facing=_path_facing(path, camera, settings),
        static_density=static,
        free_cost=np.zeros(clip.n_frames),
        joints=np.concatenate(motions),
        joint_facing=_directions(np.concatenate(motions)),
        joint_first=np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
        boxes=np.concatenate([pack_boxes(s.objects) for s in library]),
        box_first=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        box_object=np.array([i for i, _ in object_of], dtype=np.int64),
        box_label=np.array([labels.index(o.label) for _, o in object_of], dtype=np.int64),
        box_yaw=np.array([o.placement.yaw for _, o in object_of], dtype=np.float64),
        label_front=np.array([label not in FRONTLESS for label in labels], dtype=np.bool_),
        stays=np.zeros((0, 3)),
        lowered=np.array(
            [
                off_feet(m, pack_boxes(s.objects), angle=settings.support_angle)
                for m, s in zip(motions, library, strict=True)
            ],
            dtype=np.int64,
        ),
        log_rate=np.log(settings.scenelet_rate * shares / shares.sum()),
        camera_mean=camera.mean,
        camera_precision=np.linalg.inv(camera.covariance).astype(np.float64),
        camera_constant=-0.5 * float(np.linalg.slogdet(2 * np.pi * camera.covariance)[1]),
        start_mean=_start_mean(settings),
        start_variance=_start_deviation(settings) ** 2,
        size_spread=settings.size_spread,
        facing_spread=settings.facing_spread,
        frame_weight=settings.frame_weight * 10.0 / clip.fps,
        swap_begins=min(0.5, settings.swap_rate / clip.fps),
        swap_ends=min(0.5, 1.0 / (settings.swap_length * clip.fps)),
        pose_tolerance=settings.pose_tolerance,
        sight_width=settings.sight_width,
        surprise=settings.surprise,
        joint_step=settings.joint_step,
        smoothness_cost=settings.smoothness_cost,
        collision_cost=settings.collision_cost,
        motion_cost=settings.motion_cost,
        furniture_spread=settings.furniture_ahead,
        merge_angle=settings.merge_angle,
        likelihood=settings.likelihood,
        paper_nats=nats,
    )  # fmt: skip
    # All problems alike, here and in other processes: the compiler makes a kernel for each kind
    # of array it meets, and arrays that were sent elsewhere can be written.
    copies: dict[str, Any] = {
        name: np.array(a, order="C")
        for name, a in problem._asdict().items()
        if isinstance(a, np.ndarray)
    }
    return problem._replace(**copies)


def with_stays(problem: Problem, stays: Array) -> Problem:
    """The problem with the stays of its person (docs/explanation/model.md 6, 17a).

    Parameters
    ----------
    problem : Problem
        Of one person.
    stays : (K, 3) float
        First frame, frame after the last, and nats by which the pose speaks of being carried.

    Returns
    -------
    Problem
        Whether a scenelet holds a stay is asked, and the path's error stands still in it unless
        the likelihood is switched off.
    """
    of_frame = np.full(problem.n_frames, -1)
    if problem.likelihood > 0:
        for k, (first, end) in enumerate(stays[:, :2].astype(int).tolist()):
            of_frame[first:end] = k
    return problem._replace(stays=stays, path_stay=of_frame)


def _start_mean(settings: ModelSettings) -> Array:
    """Bearing and log depth of somebody nobody has looked at."""
    return np.array([0.0, np.log(settings.start_depth)])


def _start_deviation(settings: ModelSettings) -> Array:
    return np.array([settings.start_bearing, settings.start_log_depth])


def _path_prior(
    path: StaticPath, settings: ModelSettings, fps: float
) -> tuple[Array, Array, Array]:
    """Centre (T, 2), scale (T, 2) and rates (2, 2) of the path without scenelets."""
    if settings.likelihood > 0:
        seconds = np.array([settings.memory_bearing, settings.memory_depth])
        ease = np.array([settings.ease_bearing, settings.ease_depth])
        return np.array(path.estimate), np.array(path.deviation), remembered(seconds, ease, fps)
    # Nobody has looked at the clip: somebody strays about in the middle of the room.
    size = (len(path.lift), 1)
    deviation = _start_deviation(settings)
    walk = np.array([settings.walk_bearing, settings.walk_log_depth]) * np.sqrt(10.0 / fps)
    rates = np.stack([np.sqrt(1.0 - (walk / deviation) ** 2), np.zeros(2)], -1)
    return np.tile(_start_mean(settings), size), np.tile(deviation, size), rates


def _path_facing(path: StaticPath, camera: CameraPrior, settings: ModelSettings) -> Array:
    """(T, 2) where the static path has somebody face, in the world of the mean camera."""
    if not settings.likelihood > 0:
        return np.zeros((len(path.lift), 2))
    pitch, _, _, _, roll = camera.mean.tolist()
    mean = Camera(1, 1, 1.0, 1.0, 0.0, 0.0, pitch=pitch, roll=roll)
    return _directions(mean.to_world(path.poses))


def _directions(joints: Array) -> Array:
    """(n, 2) cosine and sine of where bodies (n, 16, 3) face, z up."""
    yaw = facing(joints)
    return np.stack([np.cos(yaw), np.sin(yaw)], -1)


def _static_residual(camera: Camera, path: StaticPath, keypoints: Array) -> Array:
    """(2, T, 16) squared pixels between detections and the frame's own pose, and its mirror.

    The pose stands at the frame's smoothed estimate; behind the camera the residual is that
    of a point at the image's edge, which no detector model calls likely.
    """
    pixels = camera.project_camera(path.joints)
    error = ((np.stack([pixels, pixels[:, list(MIRROR)]]) - keypoints) ** 2).sum(-1)
    return np.where(np.isfinite(error), error, float(camera.width**2 + camera.height**2))
