"""All that one clip with its truth says of the constants, gathered in three steps.

The first needs the truth alone; the second a static path, made with what the first step has
estimated; the third the solver's fits, made with what the first two have. So nothing depends
on the constants in use, and estimating again gives the same numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imapper_prob.calibrate.matches import FitErrors, Nearest, nearest_scenelets, observe_fits
from imapper_prob.calibrate.neighbours import repeats
from imapper_prob.calibrate.observations import (
    Detections,
    Lifted,
    Motion,
    PathErrors,
    Thighs,
    observe_detections,
    observe_lifted,
    observe_motion,
    observe_path,
    observe_thighs,
)
from imapper_prob.models.calibrated import Number, with_values
from imapper_prob.models.energy.detections import DetectionModel, DetectorSettings
from imapper_prob.models.path import StaticPath
from imapper_prob.models.problem import pack_problem
from imapper_prob.models.scene import Clip, Truth
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import CameraSettings, ModelSettings, StaticPathSettings
from imapper_prob.staged.calibration import estimate_camera
from imapper_prob.staged.elsewhere import own_detections
from imapper_prob.staged.fit import fit_windows
from imapper_prob.staged.free_poses import free_pose_cost
from imapper_prob.staged.path_fit import REFERENCE_RATE
from imapper_prob.staged.static_path import estimate_static_path

__all__ = [
    "Fitted",
    "Placed",
    "Seen",
    "detection_model",
    "fit_library",
    "look",
    "path_settings",
    "place",
]

Array = NDArray[np.float64]
Values = Mapping[str, Number]


@dataclass(frozen=True)
class Seen:
    """A clip and its truth, and what follows from these two."""

    clip: Clip
    truth: Truth
    detections: Detections
    motion: Motion
    lifted: Lifted


@dataclass(frozen=True)
class Placed(Seen):
    """With a static path, and the scenelets nearest to the truth."""

    static: StaticPath
    path: PathErrors
    thighs: Thighs
    nearest: Nearest


@dataclass(frozen=True)
class Fitted(Placed):
    """With the library fitted to the detections.

    Parameters
    ----------
    repeats : (n,) float
        How often detections repeat each other about which scenelet it is
        (:func:`imapper_prob.calibrate.neighbours.repeats`).
    """

    fits: FitErrors
    repeats: Array


def _members(evidence: Seen) -> dict[str, Any]:
    return {f.name: getattr(evidence, f.name) for f in fields(evidence)}


def look(clip: Clip, truth: Truth) -> Seen:
    """The first step: clip and truth."""
    clip = own_detections(clip)
    return Seen(
        clip,
        truth,
        observe_detections(clip, truth),
        observe_motion(truth),
        observe_lifted(clip, truth),
    )


def place(seen: Seen, library: Library, values: Values) -> Placed:
    """The second step: a static path by the first step's constants, held against the truth."""
    static = estimate_static_path(seen.clip, settings=path_settings(values))
    return Placed(
        **_members(seen),
        static=static,
        path=observe_path(seen.truth, static),
        thighs=observe_thighs(seen.clip, seen.truth, static, estimate_camera(seen.clip, static)),
        nearest=nearest_scenelets(seen.clip, seen.truth, static, library),
    )


def fit_library(placed: Placed, library: Library, values: Values) -> Fitted:
    """The third step: every scenelet in every window, by the first two steps' constants."""
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
        fits=observe_fits(clip, placed.truth, problem, fits),
        repeats=np.concatenate(told),
    )


def path_settings(values: Values) -> StaticPathSettings:
    """The static path's settings with some constants' values."""
    return with_values(StaticPathSettings(), values)


def detection_model(values: Values) -> DetectionModel:
    """The detector's tables with some constants' values."""
    return DetectionModel.of(with_values(DetectorSettings(), values))
