"""Detections drawn from the likelihood of a problem: what its posterior takes data to be.

Written out anew from equations (1), (2), (11) and (12) rather than read off the kernels, so
that the two can be held against each other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.energy.detections import DetectionModel
from imapper_prob.models.energy.occlusion import p_seen
from imapper_prob.models.energy.swaps import draw_swaps
from imapper_prob.models.errors import InputError
from imapper_prob.models.geometry import sight_clearance
from imapper_prob.models.kernels.world import place_boxes
from imapper_prob.models.limits import NEAREST
from imapper_prob.models.path import CameraPrior, StaticPath
from imapper_prob.models.posterior import State, motion
from imapper_prob.models.problem import Problem, pack_problem
from imapper_prob.models.scene import Clip
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import ModelSettings
from imapper_prob.models.skeleton import MIRROR

__all__ = ["Experiment"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Experiment:
    """All of a problem that is not data: what is observed is drawn, how is given.

    Free frames of the model are centred on the static path's own fit, which is an estimate from
    the data. Here it is given, so that its pixels are a constant of the density of data.

    Parameters
    ----------
    clip : Clip
        Camera, frame rate and, by confidences above 0 in its only track, which joints are
        detected in which frame.
    path : StaticPath
        The person where no scenelet is.
    camera : CameraPrior
    library : Library
    settings : ModelSettings
        With a weight of 1 a frame, and without a cost of jumps between poses.
    detections : DetectionModel

    Raises
    ------
    InputError
        The posterior of such a problem is no posterior of a model that data can be drawn from.
    """

    clip: Clip
    path: StaticPath
    camera: CameraPrior
    library: Library
    settings: ModelSettings
    detections: DetectionModel

    def __post_init__(self) -> None:
        weight = self.settings.frame_weight * 10.0 / self.clip.fps
        if self.settings.smoothness_cost or weight != 1.0:
            raise InputError(
                f"clip {self.clip.name}: data can be drawn from a model only in which jumps "
                "between poses cost nothing and frames have weight 1"
            )

    @cached_property
    def problem(self) -> Problem:
        """The problem with the detections that the clip has."""
        return pack_problem(
            self.clip, self.path, self.camera, self.library,
            settings=self.settings, detections=self.detections,
        )  # fmt: skip

    def observed(self, rng: np.random.Generator, state: State) -> Experiment:
        """The same with detections drawn of a scene, equations (11) and (12)."""
        problem, camera = self.problem, self.clip.camera
        pixels, seen, looseness = _expected(problem, state, self.path, camera)
        swapped = draw_swaps(
            rng, problem.n_frames, begins=problem.swap_begins, ends=problem.swap_ends,
            starts=problem.path_starts,
        )  # fmt: skip
        for values in (pixels, seen, looseness):
            values[swapped] = values[swapped][:, list(MIRROR)]
        keypoints, confidences = self.detections.draw(
            rng, pixels, rng.random(seen.shape) > seen,
            image_height=camera.height, looseness=looseness,
        )  # fmt: skip
        (track,) = self.clip.tracks
        track = replace(
            track,
            keypoints=np.where(problem.used[..., None], keypoints, np.nan),
            confidences=np.where(problem.used, confidences, 0.0),
        )
        return replace(self, clip=replace(self.clip, tracks=(track,)))


def _expected(
    problem: Problem, state: State, path: StaticPath, nominal: Camera
) -> tuple[Array, Array, Array]:
    """Of every joint (T, 16): pixels (.., 2), probability of being seen, pixels of looseness."""
    joints = motion(problem, state)
    camera = nominal.posed(
        pitch=state.camera[0], elevation=state.camera[1], roll=state.camera[4],
        focal_scale=math.exp(state.camera[2]),
    )  # fmt: skip
    boxes, *_ = place_boxes(problem, state.camera, state.items, state.placements, state.sizes)
    clearance = sight_clearance(camera.centre, joints, boxes)
    seen = np.vectorize(p_seen)(clearance, problem.sight_width, problem.surprise)
    pixels, looseness = nominal.project_camera(path.joints), np.zeros(seen.shape)
    for (scenelet, start), size in zip(state.items.tolist(), state.sizes, strict=True):
        own = slice(start, start + int(problem.lengths[scenelet]))
        in_camera = camera.to_camera(joints[own])
        in_camera[..., 1] = np.maximum(in_camera[..., 1], NEAREST)
        metres = problem.pose_tolerance * math.exp(state.camera[3] + size)
        pixels[own] = camera.project_camera(in_camera)
        looseness[own] = camera.fx * metres / in_camera[..., 1]
    return pixels, seen, looseness
