"""All data and constants of one clip's log-posterior, packed into flat arrays."""

from __future__ import annotations

import math
from dataclasses import astuple, fields
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.detector import ERROR_EDGES, DetectionModel, student_t
from imapper_prob.models.errors import InputError
from imapper_prob.models.geometry import pack_boxes
from imapper_prob.models.kernels.stays import off_feet
from imapper_prob.models.path_prior import CameraPrior, StaticPath, path_tables, remembered
from imapper_prob.models.scene import FRONTLESS, SEATS, Clip, Track
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import ModelSettings, PaperWeights
from imapper_prob.models.skeleton import DETECTED, MIRROR, N_JOINTS, facing
from imapper_prob.models.text import brief

__all__ = [
    "ASSIGNMENT",
    "CAMERA",
    "COLLISION",
    "DETECTIONS",
    "FREE_POSE",
    "GIVEN",
    "GIVEN_KINDS",
    "GIVEN_NUMBERS",
    "GIVEN_ROW",
    "GROUND",
    "MOTION",
    "PATH",
    "PLACEMENT",
    "SMOOTHNESS",
    "SUPPORT",
    "TERMS",
    "Problem",
    "label_kinds",
    "labels_of",
    "pack_problem",
    "require_rate",
    "resample",
    "seat_chances",
]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

TERMS: Final = (
    "camera", "assignment", "placement", "path", "detections", "free_pose", "smoothness",
    "collision", "motion", "ground", "support", "given",
)  # fmt: skip
"""Names of the terms, in order of evaluation."""
(
    CAMERA, ASSIGNMENT, PLACEMENT, PATH, DETECTIONS, FREE_POSE, SMOOTHNESS, COLLISION, MOTION,
    GROUND, SUPPORT, GIVEN,
) = range(len(TERMS))  # fmt: skip
GIVEN_KINDS, GIVEN_NUMBERS, GIVEN_ROW = 7, 16, 4
"""Lengths of a statement's integer row, of its float row, and of a row of its list."""


class Problem(NamedTuple):
    """The data and constants of one actor's log-posterior.

    Sizes: T frames, 16 joints, L scenelets with N frames and B boxes in total, C categories, K
    stays, G statements. If a last axis has length 2 and is not a coordinate, index 0 is hidden and
    1 seen. Fields that are settings have the names of these
    (:class:`~imapper_prob.models.settings.ModelSettings`).

    Parameters
    ----------
    fx, fy, cx, cy : float
        Focal lengths and principal point of the nominal camera, pixels.
    keypoints : (T, 16, 2) float
        Pixels.
    used : (T, 16) bool
        Whether the joint was detected.
    confidences : (T, 16) float
        Confidence of the detector, in [0, 1].
    confidence_density : (T, 16, 2) float
        Densities p0(c) and p1(c) of these confidences.
    error_scale, error_dof : (T, 16, 2) float
        Scale (pixels) and degrees of freedom of the pixel errors.
    path_centre : (T, 2) float
        Bearing and log depth of the pelvis without scenelets.
    path_scale : (T, 2) float
        Standard deviations of ``path_centre``.
    path_starts : (T,) bool
        Frames without a predecessor: the first frame of the clip, and the first frame of each
        further person if the clip joins frames of several people.
    path_stay : (T,) int
        Index of the stay that each frame is in, -1 for none, see `with_stays`.
    stay_steps : int
        Number of steps by which the path's error along the view changes in one stay.
    path_mean, path_draw : (2, T + 1, 2), (2, T + 1, 3, 3) float
        For bearing and log depth, see :func:`~imapper_prob.models.path_prior.path_tables`.
    lift : (T,) float
        Height of the pelvis above the optical axis over its depth (tangent).
    poses : (T, 16, 3) float
        Joints of the static path relative to the pelvis, camera axes, metres.
    path_facing : (T, 2) float
        Cosine and sine of the facing direction of these poses, in the world of the mean camera;
        zeros if the likelihood is switched off.
    static_density : (2, T, 16, 2) float
        p(u, c | hidden) and p(u, c | seen) at the static path of each frame, as it is and with left
        and right flipped.
    free_cost : (T,) float
        Cost of the pose of a free frame in nats, before the frame weight.
    joints : (N, 16, 3) float
        Scenelet joints, local frame, metres.
    joint_facing : (N, 2) float
        Cosine and sine of the facing direction of the scenelet's person.
    joint_first : (L + 1,) int
        Index of the first frame of each scenelet.
    boxes : (B, 7) float
        Scenelet boxes, local frame, see :mod:`imapper_prob.models.geometry`.
    box_first : (L + 1,) int
        Index of the first box of each scenelet.
    box_object : (B,) int
        Index, within its scenelet, of the object that a box belongs to.
    box_label : (B,) int
        Category of that object.
    box_yaw : (B,) float
        Orientation of that object, radians.
    label_front : (C,) bool
        Whether front and back of the category can be told apart.
    label_chance : (C,) float
        Probability that the true category of any seat is this one by chance, whatever that of its
        scenelet, see :func:`seat_chances`; 0 for other furniture.
    label_sides : (C, 3) float
        Mean logs of width, depth and height of the library's objects, log m.
    stays : (K, 3) float
        First frame, frame after the last, and evidence in nats from the pose for being supported.
    lowered : (L, 2) int
        First frame, and frame after the last, in which the scenelet's person is off their feet.
    log_rate : (L,) float
        Log prior odds that the scenelet starts at a given frame.
    camera_mean, camera_precision : (5,), (5, 5) float
        Mean and precision of the camera prior.
    camera_constant : float
        Log normalisation of the camera prior, nats.
    start_mean, start_variance : (2,) float
        Prior bearing (tangent) and log depth (log m) of a person without any observation.
    size_spread, facing_spread : float
        See the settings.
    frame_weight : float
        Factor on a frame's log-likelihood at the clip's frame rate.
    flip_begins, flip_ends : float
        Probability per frame that a left-right flip begins, and that one ends.
    pose_tolerance : (16,) float
        Standard deviation of each joint of a person about the scenelet's, metres.
    sight_width, visibility_error, joint_step, smoothness_cost : float
        See the settings.
    collision_cost, motion_cost : float
        See the settings.
    furniture_spread : float
        Standard deviation in metres by which furniture may be displaced along the way;
        ``furniture_ahead`` of the settings.
    merge_angle, likelihood : float
        See the settings.
    paper_nats : (5,) float
        Nats per unit of each term of the published energy; 0 for the default log-posterior.
    furniture_aside, furniture_yaw : float
        See the settings.
    given_kinds : (G, 7) int
        For each statement: its kind, its row of ``given_labels``, its first row of ``given_rows``
        and the one after its last, a joint, the first frame and the one after the last.
    given : (G, 16) float
        Numbers of each statement, see :mod:`imapper_prob.models.kernels.statement_terms`.
    given_labels : (Q, C) float
        Which true categories a statement refers to, or the probability of a detected label given
        each.
    given_rows : (R, 4) float
        Rows of lists: corners (m), frames with depths (m), or boxes in the image (px).
    given_power : (G,) float
        Power to which each statement counts: 1, or less while draws are annealed from a posterior
        without it.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    keypoints: Array
    used: NDArray[np.bool_]
    confidences: Array
    confidence_density: Array
    error_scale: Array
    error_dof: Array
    path_centre: Array
    path_scale: Array
    path_starts: NDArray[np.bool_]
    path_stay: Ints
    stay_steps: int
    path_mean: Array
    path_draw: Array
    lift: Array
    poses: Array
    path_facing: Array
    static_density: Array
    free_cost: Array
    joints: Array
    joint_facing: Array
    joint_first: Ints
    boxes: Array
    box_first: Ints
    box_object: Ints
    box_label: Ints
    box_yaw: Array
    label_front: NDArray[np.bool_]
    label_chance: Array
    label_sides: Array
    stays: Array
    lowered: Ints
    log_rate: Array
    camera_mean: Array
    camera_precision: Array
    camera_constant: float
    start_mean: Array
    start_variance: Array
    size_spread: float
    facing_spread: float
    frame_weight: float
    flip_begins: float
    flip_ends: float
    pose_tolerance: Array
    sight_width: float
    visibility_error: float
    joint_step: float
    smoothness_cost: float
    collision_cost: float
    motion_cost: float
    furniture_spread: float
    merge_angle: float
    likelihood: float
    paper_nats: Array
    furniture_aside: float
    furniture_yaw: float
    given_kinds: Ints
    given: Array
    given_labels: Array
    given_rows: Array
    given_power: Array

    def __repr__(self) -> str:
        return brief(self)

    @property
    def of_paper(self) -> bool:
        """Whether the published energy replaces the default likelihood."""
        return bool(self.paper_nats.any())

    @property
    def n_frames(self) -> int:
        """T, the number of frames of the clip."""
        return len(self.lift)

    @property
    def lengths(self) -> Ints:
        """(L,) number of frames of each scenelet."""
        return np.diff(self.joint_first)


def resample(joints: Array, *, fps: float, to_fps: float) -> Array:
    """Resample a motion (n, 16, 3) to another frame rate; its middle stays the middle.

    Parameters
    ----------
    joints : (n, 16, 3) float
        Metres.
    fps, to_fps : float
        Frame rates before and after, frames per second.

    Returns
    -------
    (m, 16, 3) float
        Metres, linearly interpolated.
    """
    if fps == to_fps:
        return np.array(joints)
    n = len(joints)
    before = int(np.floor((n // 2) / fps * to_fps + 1e-9))
    after = int(np.floor((n - 1 - n // 2) / fps * to_fps + 1e-9))
    before = min(before, after + 1)  # so that the middle is frame m // 2
    at = n // 2 + np.arange(-before, after + 1) * fps / to_fps
    low = np.clip(np.floor(at).astype(int), 0, n - 2)
    part = (at - low)[:, None, None]
    result: Array = (1 - part) * joints[low] + part * joints[low + 1]
    return result


def require_rate(name: str, fps: float, library: Library) -> None:
    """Refuse a clip at whose frame rate a scenelet of the library would have a single frame.

    The path of a person continues from the last two frames of a scenelet.

    Parameters
    ----------
    name : str
        Of the clip.
    fps : float
        Frames a second.
    library : Library

    Raises
    ------
    InputError
        Says which rate is needed, and by which scenelet.
    """
    shortest = max(library, key=lambda scenelet: scenelet.slowest_film)
    if fps < shortest.slowest_film:
        raise InputError(
            f"clip {name}: {fps:g} frames a second; library {library.name} needs at "
            f"least {math.ceil(100 * shortest.slowest_film) / 100:g}, because scenelet "
            f"{shortest.name} has a single frame below that; use a film of a higher rate, or a "
            "library of longer scenelets"
        )


def pack_problem(
    clip: Clip,
    path: StaticPath,
    camera: CameraPrior,
    library: Library,
    *,
    settings: ModelSettings | None = None,
    detections: DetectionModel | None = None,
    weights: Array | None = None,
) -> Problem:
    """Pack one actor of a clip with their static path, camera prior and a library.

    Parameters
    ----------
    clip : Clip
        Its first track is that of the actor.
    path : StaticPath
        The static path of that actor.
    camera : CameraPrior
    library : Library
    settings : ModelSettings, optional
    detections : DetectionModel, optional
    weights : (L,) float, optional
        Positive weights that share the prior rate among the scenelets, normalised here. Equal if
        not given.

    Returns
    -------
    Problem

    Raises
    ------
    InputError
        The static path and the clip differ in length, no scenelet fits in the clip, or a scenelet
        has only one frame at the clip's rate.
    """
    settings = settings or ModelSettings()
    if len(path.lift) != clip.n_frames:
        raise InputError(f"clip {clip.name}: the static path has {len(path.lift)} frames")
    # As in the static path, a joint of less confidence says that it is hidden, but not where.
    placed = clip.tracks[0].confidences[:, list(DETECTED)] >= ERROR_EDGES[0]
    seen = np.any(placed, axis=1)
    problem = Problem(
        **_seen(clip, clip.tracks[0], path, detections or DetectionModel()),
        **_walked(clip, path, camera, settings, seen),
        **_library_arrays(clip, library, settings, weights),
        **_constants(settings, clip.fps),
        stays=np.zeros((0, 3)),
        given_kinds=np.zeros((0, GIVEN_KINDS), np.int64),
        given=np.zeros((0, GIVEN_NUMBERS)),
        given_labels=np.zeros((0, len(labels_of(library)))),
        given_rows=np.zeros((0, GIVEN_ROW)),
        given_power=np.zeros(0),
        camera_mean=camera.mean,
        camera_precision=np.linalg.inv(camera.covariance).astype(np.float64),
        camera_constant=-0.5 * float(np.linalg.slogdet(2 * np.pi * camera.covariance)[1]),
    )
    # Contiguous, writable copies: numba compiles a kernel for each kind of array, and arrays that
    # were sent to another process are writable.
    copies: dict[str, Any] = {
        name: np.array(a, order="C")
        for name, a in problem._asdict().items()
        if isinstance(a, np.ndarray)
    }
    return problem._replace(**copies)


def labels_of(library: Library) -> list[str]:
    """Furniture labels of a library, sorted; their index is the category number in a problem.

    Parameters
    ----------
    library : Library

    Returns
    -------
    list of str
    """
    return sorted({label for s in library for label in s.labels})


def seat_chances(library: Library, confusion: float) -> Array:
    """Probability of each category to be that of a seat by chance, whatever its scenelet says.

    Motion hardly distinguishes kinds of seats. So a seat is of the kind that it is in its scenelet
    with probability 1 - confusion, and otherwise any of the library's seats.

    Parameters
    ----------
    library : Library
    confusion : float
        Between 0 and 1.

    Returns
    -------
    (C,) float
        In the order of :func:`labels_of`. The sum is the confusion, or 0 without seats.
    """
    labels = labels_of(library)
    weights = np.zeros(len(labels))
    for scenelet in library:
        for label in SEATS.intersection(scenelet.labels):
            weights[labels.index(label)] += scenelet.weight
    return confusion * weights / weights.sum() if weights.any() else weights


def _mean_sides(library: Library) -> Array:
    """(C, 3) mean logs of the sides of the library's objects by label, log m."""
    sides: dict[str, list[Array]] = {label: [] for label in labels_of(library)}
    for scenelet in library:
        for o in scenelet.objects:
            sides[o.label].append(np.log(np.diff(o.bounds, axis=0)[0]))
    return np.array([np.mean(own, axis=0) for own in sides.values()]).reshape(-1, 3)


def label_kinds(problem: Problem) -> Array:
    """Probability of an object's true category given the one that it has in its scenelet.

    Parameters
    ----------
    problem : Problem

    Returns
    -------
    (C, C) float
        Rows are categories in scenelets, columns true ones; rows sum to 1.
    """
    kinds, chance = np.eye(len(problem.label_chance)), problem.label_chance
    seats = chance > 0
    kinds[seats] = (1.0 - chance.sum()) * kinds[seats] + chance
    return kinds


def _seen(
    clip: Clip, person: Track, path: StaticPath, detections: DetectionModel
) -> dict[str, Any]:
    """Fields of a problem that come from the detections."""
    nominal = clip.camera
    used = np.zeros((clip.n_frames, N_JOINTS), bool)
    used[:, list(DETECTED)] = person.confidences[:, list(DETECTED)] > 0
    keypoints = np.where(used[..., None], person.keypoints, 0.0)
    confidence = detections.confidence_density(person.confidences)
    scale, dof = detections.error_tables(person.confidences, short_side=nominal.short_side)
    residual = _static_residual(nominal, path, keypoints)
    return {
        "fx": nominal.fx, "fy": nominal.fy, "cx": nominal.cx, "cy": nominal.cy,
        "keypoints": keypoints,
        "used": used,
        "confidences": person.confidences,
        "confidence_density": confidence,
        "error_scale": scale,
        "error_dof": dof,
        "static_density": confidence * np.exp(student_t(residual[..., None], scale, dof)),
        "free_cost": np.zeros(clip.n_frames),
    }  # fmt: skip


def _walked(
    clip: Clip,
    path: StaticPath,
    camera: CameraPrior,
    settings: ModelSettings,
    seen: NDArray[np.bool_],
) -> dict[str, Any]:
    """Fields of a problem that describe the person's path without scenelets.

    ``seen`` (T,) says in which frames any joint is detected.
    """
    centre, deviation, rates = _path_prior(path, settings, clip.fps, seen)
    mean, draw = path_tables(rates, clip.n_frames)
    return {
        "path_centre": centre,
        "path_scale": deviation,
        "path_starts": np.arange(clip.n_frames) == 0,
        "path_stay": np.full(clip.n_frames, -1),
        "stay_steps": max(1, round(settings.stay_change * clip.fps)),
        "path_mean": mean,
        "path_draw": draw,
        "lift": path.lift,
        "poses": path.poses,
        "path_facing": _path_facing(path, camera, settings),
        "start_mean": _start_mean(settings),
        "start_variance": _start_deviation(settings) ** 2,
    }


def _library_arrays(
    clip: Clip, library: Library, settings: ModelSettings, weights: Array | None
) -> dict[str, Any]:
    """Fields of a problem that hold the scenelets, at the clip's frame rate."""
    require_rate(clip.name, clip.fps, library)
    motions = [resample(s.joints, fps=s.fps, to_fps=clip.fps) for s in library]
    lengths = np.array([len(m) for m in motions])
    if lengths.min() > clip.n_frames:
        raise InputError(
            f"clip {clip.name}: {clip.n_frames} frames, but the shortest scenelet of library "
            f"{library.name} has {lengths.min()}; use a longer clip"
        )
    shares = np.ones(len(library)) if weights is None else np.asarray(weights, float)
    labels = labels_of(library)
    counts = [sum(len(o.cuboids) for o in s.objects) for s in library]
    object_of = [(i, o) for s in library for i, o in enumerate(s.objects) for _ in o.cuboids]
    joints = np.concatenate(motions)
    lowered = [
        off_feet(m, pack_boxes(s.objects), angle=settings.support_angle)
        for m, s in zip(motions, library, strict=True)
    ]
    return {
        "joints": joints,
        "joint_facing": _directions(joints),
        "joint_first": np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
        "boxes": np.concatenate([pack_boxes(s.objects) for s in library]),
        "box_first": np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        "box_object": np.array([i for i, _ in object_of], dtype=np.int64),
        "box_label": np.array([labels.index(o.label) for _, o in object_of], dtype=np.int64),
        "box_yaw": np.array([o.placement.yaw for _, o in object_of], dtype=np.float64),
        "label_front": np.array([label not in FRONTLESS for label in labels], dtype=np.bool_),
        "label_chance": seat_chances(library, settings.seat_confusion),
        "label_sides": _mean_sides(library),
        "lowered": np.array(lowered, dtype=np.int64),
        "log_rate": np.log(settings.scenelet_rate * 10.0 / clip.fps * shares / shares.sum()),
    }


def _constants(settings: ModelSettings, fps: float) -> dict[str, Any]:
    """Fields of a problem that come from settings; rates are converted from seconds to frames."""
    nats = np.zeros(len(fields(PaperWeights)))
    if settings.energy == "paper":
        nats = settings.paper_nats * settings.likelihood * np.array(astuple(PaperWeights()))
    return {
        "size_spread": settings.size_spread,
        "facing_spread": settings.facing_spread,
        "frame_weight": settings.frame_weight * 10.0 / fps,
        "flip_begins": min(0.5, settings.side_flip_rate / fps),
        "flip_ends": min(0.5, 1.0 / (settings.side_flip_length * fps)),
        "pose_tolerance": np.array(settings.pose_tolerance, dtype=np.float64),
        "sight_width": settings.sight_width,
        "visibility_error": settings.visibility_error,
        "joint_step": settings.joint_step,
        "smoothness_cost": settings.smoothness_cost,
        "collision_cost": settings.collision_cost,
        "motion_cost": settings.motion_cost,
        "furniture_spread": settings.furniture_ahead,
        "furniture_aside": settings.furniture_aside,
        "furniture_yaw": settings.furniture_yaw,
        "merge_angle": settings.merge_angle,
        "likelihood": settings.likelihood,
        "paper_nats": nats,
    }


def with_stays(problem: Problem, stays: Array) -> Problem:
    """Add stays of its person to a problem (docs/explanation/model.md 6, 17a).

    Parameters
    ----------
    problem : Problem
        A problem of one person.
    stays : (K, 3) float
        First frame, frame after the last, and evidence in nats from the pose for being supported.

    Returns
    -------
    Problem
        The problem with a term that asks whether a scenelet supports each stay. Unless the
        likelihood is switched off, the path's error is also constant within a stay.
    """
    of_frame = np.full(problem.n_frames, -1)
    if problem.likelihood > 0:
        for k, (first, end) in enumerate(stays[:, :2].astype(int).tolist()):
            of_frame[first:end] = k
    return problem._replace(stays=stays, path_stay=of_frame)


def _start_mean(settings: ModelSettings) -> Array:
    """Prior bearing and log depth of a person without any observation."""
    return np.array([0.0, np.log(settings.start_depth)])


def _start_deviation(settings: ModelSettings) -> Array:
    return np.array([settings.start_bearing, settings.start_log_depth])


def _path_prior(
    path: StaticPath, settings: ModelSettings, fps: float, seen: NDArray[np.bool_]
) -> tuple[Array, Array, Array]:
    """Centre (T, 2), scale (T, 2) and AR rates (2, 2) of the path without scenelets."""
    if settings.likelihood > 0:
        seconds = np.array([settings.correlation_time_bearing, settings.correlation_time_depth])
        smoothing = np.array([settings.smoothing_time_bearing, settings.smoothing_time_depth])
        centre, deviation = np.array(path.estimate), np.array(path.deviation)
        # Long after the last detection, the person is known no worse than one who was never seen.
        anywhere, spread = _start_mean(settings), _start_deviation(settings)
        share = deviation[~seen] ** 2 / (deviation[~seen] ** 2 + spread**2)
        centre[~seen] += share * (anywhere - centre[~seen])
        deviation[~seen] *= np.sqrt(1.0 - share)
        return centre, deviation, remembered(seconds, smoothing, fps)
    # Without a likelihood, the path is a stationary AR(1) process about the middle of the room.
    size = (len(path.lift), 1)
    deviation = _start_deviation(settings)
    walk = np.array([settings.walk_bearing, settings.walk_log_depth]) * np.sqrt(10.0 / fps)
    rates = np.stack([np.sqrt(1.0 - (walk / deviation) ** 2), np.zeros(2)], -1)
    return np.tile(_start_mean(settings), size), np.tile(deviation, size), rates


def _path_facing(path: StaticPath, camera: CameraPrior, settings: ModelSettings) -> Array:
    """(T, 2) facing direction of the static path, in the world of the mean camera."""
    if not settings.likelihood > 0:
        return np.zeros((len(path.lift), 2))
    pitch, _, _, _, roll = camera.mean.tolist()
    mean = Camera(1, 1, 1.0, 1.0, 0.0, 0.0, pitch=pitch, roll=roll)
    return _directions(mean.to_world(path.poses))


def _directions(joints: Array) -> Array:
    """(n, 2) cosine and sine of the facing direction of bodies (n, 16, 3), z up."""
    yaw = facing(joints)
    return np.stack([np.cos(yaw), np.sin(yaw)], -1)


def _static_residual(camera: Camera, path: StaticPath, keypoints: Array) -> Array:
    """(2, T, 16) squared pixel errors of the frame's static pose, and of its left-right mirror.

    For a joint at or behind the image plane the error is the image diagonal, which has negligible
    likelihood under any detector model.
    """
    pixels = camera.project_camera(path.joints)
    error = ((np.stack([pixels, pixels[:, list(MIRROR)]]) - keypoints) ** 2).sum(-1)
    return np.where(np.isfinite(error), error, float(camera.width**2 + camera.height**2))
