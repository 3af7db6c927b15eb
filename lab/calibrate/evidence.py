"""The evidence of one clip with ground truth on the constants, gathered in three steps.

The first step needs only the truth; the second a static path, made with the estimates of the first;
the third the solver's fits, made with the estimates of the first two. So nothing depends on the
constants in use, and repeated estimation gives the same numbers.

The scenelet nearest to the true motion is the one that should be found. Its remaining difference
from the truth, and from the free frames beside it, is what the model should expect. The size
differences of the scenelets that *are* found are measured on the solver's own fits.

The model adds up log-densities of joints and frames as if they were independent given the scenelet.
But a motion that deviates from this person's is wrong in many joints at once and for as long as it
lasts. The resulting exaggeration is measured between the scenelet nearest to the truth and its
neighbours: the variance of the score along the way from one to another should be the expected
information, and exceeds it by the number of detections that count as one. Dividing by that number
is the magnitude adjustment of a composite likelihood (Pauli, Racugno and Ventura, Bayesian
composite marginal likelihoods, Statistica Sinica 21, 2011).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.calibrated import Number, with_values
from imapper_prob.models.detector import DetectionModel, DetectorSettings
from imapper_prob.models.path_prior import StaticPath
from imapper_prob.models.problem import Problem, labels_of, pack_problem, resample, seat_chances
from imapper_prob.models.scene import Clip, Placement, Truth
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import CameraSettings, ModelSettings, StaticPathSettings
from imapper_prob.models.skeleton import DETECTED, PELV, facing, turned
from imapper_prob.scenelets.build import body_scale
from imapper_prob.solver.camera_prior import estimate_camera
from imapper_prob.solver.detections import own_detections
from imapper_prob.solver.fits import Fits, fit_windows, free_pose_cost
from imapper_prob.solver.path_fit import REFERENCE_RATE
from imapper_prob.solver.static_path import estimate_static_path
from lab.calibrate.observations import (
    Detections,
    Lifted,
    Motion,
    PathErrors,
    Thighs,
    furniture_errors,
    observe_detections,
    observe_lifted,
    observe_motion,
    observe_path,
    observe_seats,
    observe_thighs,
    sights_past,
    stretches,
)

__all__ = [
    "Fitted",
    "Neighbours",
    "Placed",
    "Seen",
    "detection_model",
    "fit_library",
    "look",
    "neighbours",
    "path_settings",
    "place",
    "repeats",
]


Array = NDArray[np.float64]
Values = Mapping[str, Number]


@dataclass(frozen=True)
class Seen:
    """A clip, its truth, and observations that follow from both."""

    clip: Clip
    truth: Truth
    detections: Detections
    motion: Motion
    lifted: Lifted


@dataclass(frozen=True)
class Placed(Seen):
    """Evidence with a static path, and the scenelets nearest to the truth."""

    static: StaticPath
    path: PathErrors
    thighs: Thighs
    nearest: Nearest


@dataclass(frozen=True)
class Fitted(Placed):
    """Evidence with the library fitted to the detections.

    Parameters
    ----------
    repeats : (n,) float
        Number of detections that count as one about which scenelet it is (:func:`repeats`).
    """

    fits: FitErrors
    repeats: Array


def _members(evidence: Seen) -> dict[str, Any]:
    return {f.name: getattr(evidence, f.name) for f in fields(evidence)}


def look(clip: Clip, truth: Truth) -> Seen:
    """The first step: evidence from clip and truth."""
    clip = own_detections(clip)
    return Seen(
        clip,
        truth,
        observe_detections(clip, truth),
        observe_motion(truth),
        observe_lifted(clip, truth),
    )


def place(seen: Seen, library: Library, values: Values) -> Placed:
    """The second step: a static path by the first step's constants, compared with the truth."""
    # With the deviations that the fit itself states.
    bare = replace(path_settings(values), bias_factor_along=1.0, bias_factor_across=1.0)
    static = estimate_static_path(seen.clip, settings=bare)
    camera = estimate_camera(seen.clip, static)
    return Placed(
        **_members(seen),
        static=static,
        path=observe_path(seen.clip, seen.truth, static, camera),
        thighs=observe_thighs(seen.clip, seen.truth, static, camera),
        nearest=_nearest_scenelets(seen.clip, seen.truth, static, library),
    )


def fit_library(placed: Placed, library: Library, values: Values) -> Fitted:
    """The third step: fits of every scenelet in every window, by the first two steps' constants."""
    clip = placed.clip
    camera = with_values(CameraSettings(), values)
    detections = detection_model(values)
    settings = replace(
        with_values(ModelSettings(), values),
        frame_weight=path_settings(values).frame_weight(REFERENCE_RATE),
    )
    problem = pack_problem(
        clip,
        placed.static,
        estimate_camera(clip, placed.static, settings=camera),
        library,
        settings=settings,
        detections=detections,
    )
    fits = fit_windows(problem, placed.static, fps=clip.fps)
    problem = problem._replace(free_cost=free_pose_cost(problem, fits))
    told = [
        repeats(one, clip, placed.truth, detections=detections, tolerance=settings.pose_tolerance)
        for one in placed.nearest.beside
    ]
    return Fitted(
        **_members(placed),
        fits=_observe_fits(clip, placed.truth, problem, fits),
        repeats=np.concatenate(told),
    )


def path_settings(values: Values) -> StaticPathSettings:
    """The static path's settings with the given values of constants."""
    return with_values(StaticPathSettings(), values)


def detection_model(values: Values) -> DetectionModel:
    """The detector's tables with the given values of constants."""
    return DetectionModel.of(with_values(DetectorSettings(), values))


_EVERY = 0.6
"""Seconds between the windows that are compared with the truth."""
_FEWEST_KNOWN = 1 / 3
"""Least fraction of a scenelet's frames that must be annotated."""
_BEST = 10
"""Number of fits of a window whose depths are averaged, and of neighbours compared with the
scenelet nearest to the truth; the library has many similar ones."""


@dataclass(frozen=True)
class Nearest:
    """Observations on the scenelets nearest to the true motion.

    Parameters
    ----------
    across : (n, 16, 2) float
        Differences of true joints from theirs in metres across the viewing ray, right and up, after
        optimal placement and rotation.
    jumps : (m, 16, 3) float
        Their first and last pose minus the static pose of the frame next to it, both
        relative to the pelvis, world axes, metres.
    turns : (n,) float
        Radians between their yaw after that placement and the yaw of the static path, both averaged
        over their frames.
    clearance, hidden : (j,) float, (j,) bool
        For true joints of a person who stays in place: clearance of their lines of sight from the
        scenelet's furniture, metres, and whether the corresponding true pieces hide them. Joints
        hidden by other pieces are left out.
    furniture : (k, 3) float
        Errors of the places and yaws that they give to true furniture
        (:func:`lab.calibrate.observations.furniture_errors`).
    seats : (s, 2) float
        How often the nearest one's seat has the label of the true seat
        (:func:`lab.calibrate.observations.observe_seats`).
    beside : tuple of Neighbours
        Each with its ten nearest neighbours.
    """

    across: Array
    jumps: Array
    turns: Array
    clearance: Array
    hidden: NDArray[np.bool_]
    furniture: Array
    seats: Array
    beside: tuple[Neighbours, ...]


def _nearest_scenelets(clip: Clip, truth: Truth, path: StaticPath, library: Library) -> Nearest:
    """Find the scenelet nearest to the truth in regularly spaced windows.

    Poses are compared unscaled, because annotated shins and forearms are short. Furniture is placed
    about a scenelet that is scaled to the true body, as in the model.
    """
    size = body_scale(truth.joints)
    joints = truth.joints - truth.joints[:, [PELV]]
    known: NDArray[np.bool_] = np.all(np.isfinite(joints), axis=(1, 2))
    static = truth.camera.to_world(path.joints)
    faces = np.exp(1j * facing(static))
    static = static - static[:, [PELV]]
    motions = [resample(s.joints, fps=s.fps, to_fps=clip.fps) for s in library]
    travels = [m[:, PELV] for m in motions]
    own_faces = [np.exp(1j * facing(m)) for m in motions]
    motions = [m - m[:, [PELV]] for m in motions]
    stays = {t for s in stretches(truth, clip.fps) for t in range(s.start, s.stop)}
    across, jumps, turns, placed, sights, beside = [], [], [], [], [], []
    best_placed = []
    for centre in range(0, clip.n_frames, round(_EVERY * clip.fps)):
        candidates = []
        for number, motion in enumerate(motions):
            first = centre - len(motion) // 2
            if first < 1 or first + len(motion) >= clip.n_frames:
                continue
            own = np.flatnonzero(known[first : first + len(motion)])
            if len(own) < _FEWEST_KNOWN * len(motion):
                continue
            yaw, gap = _turn(motion[own], joints[first + own])
            candidates.append((gap, number, first, yaw))
        if not candidates:
            continue
        candidates.sort()
        near = [
            (first, turned(motions[n], np.full(len(motions[n]), yaw)))
            for _, n, first, yaw in candidates[: _BEST + 1]
        ]
        beside.append(neighbours(truth, near))
        _, number, start, yaw = candidates[0]
        best = near[0][1]
        end = start + len(best)
        own = np.flatnonzero(known[start:end])
        apart = joints[start + own] - best[own]
        apart = (apart - apart.mean((0, 1))) @ truth.camera.rotation
        across.append(apart[..., [0, 2]])
        jumps += [best[0] - static[start - 1], best[-1] - static[end]]
        expected = (faces[start:end] * own_faces[number].conj()).mean()
        turns.append(np.angle(np.exp(1j * yaw) * expected.conj()))
        if centre in stays:
            for rank, (_, number, first, yaw) in enumerate(candidates[:_BEST]):
                own = np.flatnonzero(known[first : first + len(travels[number])])
                middle = truth.joints[first + own, PELV].mean(0)
                scenelet = library[number].scaled(size)
                laid = _laid_upon(middle, yaw, size * travels[number][own])
                placed.append((scenelet, laid))
                if not rank:
                    best_placed.append((scenelet, laid))
                sights.append(sights_past(truth, scenelet, laid, first + own))
    clearance, hidden = np.concatenate(sights, axis=1)
    return Nearest(
        np.concatenate(across),
        np.stack(jumps),
        np.array(turns),
        clearance,
        hidden.astype(bool),
        furniture_errors(truth, placed),
        observe_seats(truth, best_placed, _seat_shares(library)),
        tuple(beside),
    )


def _seat_shares(library: Library) -> dict[str, float]:
    """Shares of labels among the library's seats."""
    chances = seat_chances(library, 1.0).tolist()
    return {label: share for label, share in zip(labels_of(library), chances, strict=True) if share}


def _turn(motion: Array, joints: Array) -> tuple[float, float]:
    """Yaw that brings a motion (n, 16, 3) nearest to another, and the remaining mean square gap."""
    along = float((motion[..., :2] * joints[..., :2]).sum())
    aside = float((motion[..., 0] * joints[..., 1] - motion[..., 1] * joints[..., 0]).sum())
    level = float((motion[..., 2] * joints[..., 2]).sum())
    squares = float((motion**2).sum() + (joints**2).sum())
    return np.arctan2(aside, along), (squares - 2 * (np.hypot(along, aside) + level)) / len(motion)


def _laid_upon(middle: Array, yaw: float, travel: Array) -> Placement:
    """The placement that brings a rotated pelvis path (n, 3) to a mean position (3,)."""
    turned_only = Placement(0.0, 0.0, yaw).apply(travel.mean(0))
    x, y = (middle - turned_only)[:2].tolist()
    return Placement(x, y, yaw)


@dataclass(frozen=True)
class FitErrors:
    """Errors of the solver's independent fits against the truth.

    Parameters
    ----------
    sizes : tuple of (k,) float
        Log of fitted over true depth in each interval in which somebody stays in place, which the
        size of the scenelet's person would have to explain. The scene's median, which camera and
        body explain, is subtracted.
    free_cost : (T,) float
        Cost in nats of the pose of each free frame.
    """

    sizes: tuple[Array, ...]
    free_cost: Array


def _observe_fits(clip: Clip, truth: Truth, problem: Problem, fits: Fits) -> FitErrors:
    """Compare the best fits of every window with the truth; the free cost is the problem's."""
    frames = np.arange(clip.n_frames)
    known = np.isfinite(truth.joints).all((1, 2))
    depth = truth.camera.to_camera(truth.joints[known])[:, PELV, 1]
    true = np.interp(frames, frames[known], depth)[fits.centres]
    pitch, elevation, _, body = problem.camera_mean[:4]
    middles = problem.joint_first[:-1] + problem.lengths // 2
    height = np.exp(body) * problem.joints[middles, PELV, 2] - elevation
    fitted = np.cos(pitch) * fits.placements[..., 1] + np.sin(pitch) * height
    order = np.argsort(fits.cost, axis=1, kind="stable")[:, :_BEST]
    usable = np.isfinite(np.take_along_axis(fits.cost, order, 1)).all(1)
    ratio = np.log(np.take_along_axis(fitted, order, 1).clip(0.1) / true[:, None]).mean(1)
    ratio -= np.median(ratio[usable])
    sizes = []
    for stretch in stretches(truth, clip.fps):
        inside = usable & (fits.centres >= stretch.start) & (fits.centres < stretch.stop)
        if inside.any():
            sizes.append(ratio[inside])
    return FitErrors(tuple(sizes), problem.free_cost)


@dataclass(frozen=True)
class Neighbours:
    """The scenelet nearest to an interval of the true motion, and others, in the image.

    Parameters
    ----------
    frames : (m,) int
        Annotated frames covered by the nearest scenelet.
    pixels : (m, 14, 2) float
        Projections of its joints.
    per_metre : (m, 14) float
        Pixels per metre across the viewing ray at each joint.
    apart : (k, m, 14, 2) float
        Pixels from its joints to those of the others; NaN in frames that another does not cover.
    """

    frames: NDArray[np.intp]
    pixels: Array
    per_metre: Array
    apart: Array


def neighbours(truth: Truth, poses: Sequence[tuple[int, Array]]) -> Neighbours:
    """Place scenelets at the true motion and project them.

    Parameters
    ----------
    truth : Truth
    poses : sequence of (int, (n, 16, 3) float)
        First frame, and joints relative to the pelvis with the person's yaw, in metres; the nearest
        scenelet first.
    """
    known: NDArray[np.bool_] = np.all(np.isfinite(truth.joints), axis=(1, 2))
    looks = []
    for first, pose in poses:
        frames = first + np.flatnonzero(known[first : first + len(pose)])
        joints, own = truth.joints[frames], pose[frames - first]
        pelvis = joints[:, [PELV]]
        laid = own + pelvis + (joints - own - pelvis).mean((0, 1))
        looks.append((frames, laid[:, list(DETECTED)]))
    frames, nearest = looks[0]
    pixels = truth.camera.project(nearest)
    others = np.full((len(looks) - 1, *pixels.shape), np.nan)
    for other, (covered, laid) in zip(others, looks[1:], strict=True):
        _, here, there = np.intersect1d(frames, covered, return_indices=True)
        other[here] = truth.camera.project(laid[there])
    depth = truth.camera.to_camera(nearest)[..., 1]
    return Neighbours(frames, pixels, truth.camera.fx / depth, others - pixels)


def repeats(
    beside: Neighbours,
    clip: Clip,
    truth: Truth,
    *,
    detections: DetectionModel,
    tolerance: Number,
) -> Array:
    """Ratio of squared scores to those of independent detections, from one scenelet to others.

    Parameters
    ----------
    beside : Neighbours
    clip : Clip
    truth : Truth
        Gives the hidden joints.
    detections : DetectionModel
    tolerance : tuple of 16 float
        Difference of each joint from the scenelet's, metres an axis.

    Returns
    -------
    (at most k,) float
        For the scenelets that some detection distinguishes from the nearest one; its mean is one
        for independent detections.
    """
    joints = list(DETECTED)
    confidence = clip.tracks[0].confidences[beside.frames][:, joints]
    error = clip.tracks[0].keypoints[beside.frames][:, joints] - beside.pixels
    seen = np.where(np.asarray(truth.hidden)[beside.frames][:, joints], 0, 1)[..., None]
    scale, dof = (
        np.take_along_axis(table, seen, -1)[..., 0]
        for table in detections.error_tables(confidence, short_side=clip.camera.short_side)
    )
    used = (confidence > 0) & np.isfinite(error).all(-1)
    error = np.where(used[..., None], error, 0.0)
    variance = scale**2 + (np.array(tolerance)[joints] * beside.per_metre) ** 2
    listened = (dof + 2) / (dof * variance + (error**2).sum(-1))
    score = listened[..., None] * error
    information = np.where(used, (dof + 2) / ((dof + 4) * variance), 0.0)
    along = np.nan_to_num(beside.apart)
    total = (score * along).sum((1, 2, 3))
    expected = (information * (along**2).sum(-1)).sum((1, 2))
    result: Array = total[expected > 0] ** 2 / expected[expected > 0]
    return result
