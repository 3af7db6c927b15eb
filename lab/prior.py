"""Scenes and detections drawn from the model itself, for which the posterior is exact.

(No command of its own: ``lab.sbc``, ``lab.coverage`` and tests of the sampler draw from here.)

States are drawn independently from the prior of a problem, without a chain. The prior is the
posterior without detections: camera and body from their Gaussian, scenelets by a recursion over
frames, the pelvis along its chain, sizes and latent variables from their normal distributions.
Scenes with collisions are rejected with the probability that their cost gives. Detections are drawn
from the likelihood, which is written from equations (1), (2), (11) and (12) and not taken from the
kernels, so that each can be checked against the other. Both together make data sets for testing
samplers (Talts et al. 2018).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.detector import DetectionModel
from imapper_prob.models.errors import InputError
from imapper_prob.models.geometry import sight_clearance
from imapper_prob.models.kernels.detection import draw_flips
from imapper_prob.models.kernels.placement import expected_facing, in_support, place_boxes
from imapper_prob.models.kernels.visibility import visibility_probability
from imapper_prob.models.log_posterior import State, motion, terms
from imapper_prob.models.path_prior import CameraPrior, StaticPath
from imapper_prob.models.problem import Problem, pack_problem
from imapper_prob.models.scene import Clip
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import NEAREST, ModelSettings
from imapper_prob.models.skeleton import MIRROR, PELV

__all__ = ["Experiment", "draw_layout", "draw_state", "path_in_view"]


Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_TRIES = 10_000
"""Rejected scenes before an error; then collisions are almost certain."""


def draw_state(rng: np.random.Generator, problem: Problem) -> State:
    """One scene from the prior, including the costs of collision, motion and ground.

    It is exact if the prior is a density over scenes: no cost of free frames, stays or jumps
    between poses. With the likelihood switched off that holds, and no scene is rejected.

    Raises
    ------
    InputError
        The problem has no such prior, or almost all its scenes are rejected.
    """
    costs = problem.free_cost.any() or problem.smoothness_cost or len(problem.stays)
    unknown = problem.likelihood and costs
    if unknown or problem.of_paper:
        raise InputError(
            "scenes can be drawn from the prior of a problem only if neither free frames nor "
            "stays nor jumps between poses cost anything"
        )
    for _ in range(_TRIES):
        state = _unhindered(rng, problem)
        if not problem.likelihood:
            return state
        nats = terms(problem, state)
        # None of the three is positive, so the exponential of their sum is a probability.
        if -rng.standard_exponential() < nats["collision"] + nats["motion"] + nats["ground"]:
            return state
    raise InputError(f"none of {_TRIES} scenes was free of collisions; lower the costs of them")


def draw_layout(rng: np.random.Generator, problem: Problem) -> Ints:
    """(k, 2) scenelets and their start frames, drawn from p(X).

    The weight of all ways to fill the first t frames is summed frame by frame (a frame is free, or
    the last one of a scenelet); one way is then drawn backwards.
    """
    lengths, rates = problem.lengths, problem.log_rate
    start = _latest_start(problem)
    log_weight = np.zeros(problem.n_frames + 1)
    ways: list[Array] = []
    for t in range(1, problem.n_frames + 1):
        fits = lengths <= t - start[t - 1]
        ends = np.where(fits, rates + log_weight[np.maximum(t - lengths, 0)], -np.inf)
        ways.append(np.append(ends, log_weight[t - 1]))
        log_weight[t] = np.logaddexp.reduce(ways[-1])
    items, t = [], problem.n_frames
    while t > 0:
        shares = np.exp(ways[t - 1] - log_weight[t]).cumsum()
        which = int(np.searchsorted(shares, rng.random() * shares[-1], side="right"))
        if which == len(lengths):
            t -= 1
            continue
        t -= int(lengths[which])
        items.append((which, t))
    return np.array(items[::-1], dtype=np.int64).reshape(-1, 2)


def _unhindered(rng: np.random.Generator, problem: Problem) -> State:
    """A scene drawn without the rejection of collisions."""
    camera, items = _draw_camera(rng, problem), draw_layout(rng, problem)
    placements = np.empty((len(items), 3))
    sizes = problem.size_spread * rng.standard_normal(len(items))
    # Errors of the static path in units of their deviation, in the frame `at` and the one before.
    error, before, at = np.zeros(2), np.zeros(2), -1
    since = _latest_start(problem)
    for index, (scenelet, start) in enumerate(items.tolist()):
        rows = [0, 0]
        if at >= since[start]:
            stay = problem.path_stay
            rows = [start - at, _steps_of_depth(stay, problem.stay_steps, at + 1, start)]
        mean, deviation = problem.path_mean[[0, 1], rows], problem.path_draw[[0, 1], rows, 0, 2]
        error = mean[:, 0] * error + mean[:, 1] * before
        error = error + deviation * rng.standard_normal(2)
        centre, scale = path_in_view(problem, camera, start)
        seen = centre + scale * error
        body, yaw = math.exp(camera[3] + sizes[index]), _draw_yaw(rng, problem, scenelet, start)
        own = slice(*problem.joint_first[scenelet : scenelet + 2])
        pelvis = body * _turned(problem.joints[own, PELV], yaw)
        placements[index] = (*(_on_floor(camera, seen, pelvis[0, 2]) - pelvis[0, :2]), yaw)
        at = start + len(pelvis) - 1
        before, error = (
            _error(problem, camera, at - k, pelvis[-1 - k] + (*placements[index, :2], 0.0))
            for k in (1, 0)
        )
    return State(camera, items, placements, sizes, rng.standard_normal((problem.n_frames, 2)))


def _steps_of_depth(stay: Ints, most: int, first: int, last: int) -> int:
    """Steps of the error along the view from the frame before ``first`` to ``last``.

    In one stay (``stay`` is -1 in frames of none) there are ``most`` at the most.
    """
    steps, own = 1, 1
    for t in range(first + 1, last + 1):
        own = own + 1 if stay[t] >= 0 and stay[t] == stay[t - 1] else 1
        steps += own <= most
    return steps


def _draw_yaw(rng: np.random.Generator, problem: Problem, scenelet: int, start: int) -> float:
    """A yaw in (-pi, pi] from its wrapped Cauchy distribution."""
    along, aside = expected_facing(problem, scenelet, start)
    if not (along or aside):
        return rng.uniform(-math.pi, math.pi)
    yaw = math.atan2(aside, along) + problem.facing_spread * rng.standard_cauchy()
    return math.remainder(yaw, 2 * math.pi)


def _latest_start(problem: Problem) -> Ints:
    """(T,) the last frame, up to each frame, at which the path starts anew."""
    frames = np.arange(problem.n_frames)
    return np.maximum.accumulate(np.where(problem.path_starts, frames, 0))


def _error(problem: Problem, camera: Array, frame: int, pelvis: Array) -> Array:
    """(2,) error of a pelvis (3,) in world coordinates from the static path, in deviations."""
    centre, scale = path_in_view(problem, camera, frame)
    result: Array = (_as_seen(camera, pelvis) - centre) / scale
    return result


def path_in_view(problem: Problem, camera: Array, frame: int) -> tuple[Array, Array]:
    """Centre and scale (2,) of bearing and log depth of the path in a frame, for this camera."""
    unit = np.array([math.exp(-camera[2]), 1.0])
    centre = unit * problem.path_centre[frame] + [0.0, camera[2] + camera[3]]
    return centre, unit * problem.path_scale[frame]


def _draw_camera(rng: np.random.Generator, problem: Problem) -> Array:
    """phi (5,) from its Gaussian, truncated to its support."""
    factor = np.linalg.cholesky(np.linalg.inv(problem.camera_precision))
    while True:
        camera: Array = problem.camera_mean + factor @ rng.standard_normal(len(factor))
        if in_support(camera):
            return camera


def _turned(points: Array, yaw: float) -> Array:
    """Points (n, 3) rotated about z."""
    c, s = math.cos(yaw), math.sin(yaw)
    result: Array = points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return result


def _as_seen(camera: Array, point: Array) -> Array:
    """Bearing and log depth of a point (3,) in world coordinates: equation (1)."""
    level, depth = _level_and_depth(camera, point)
    right = math.cos(camera[4]) * point[0] + math.sin(camera[4]) * level
    return np.array([right / depth, math.log(depth)])


def _level_and_depth(camera: Array, point: Array) -> tuple[float, float]:
    cp, sp, above = math.cos(camera[0]), math.sin(camera[0]), point[2] - camera[1]
    return cp * above - sp * point[1], max(cp * point[1] + sp * above, NEAREST)


def _on_floor(camera: Array, seen: Array, height: float) -> Array:
    """(x, y) of the point at a given height with this bearing and log depth (2,)."""
    depth = math.exp(seen[1])
    above = height - camera[1]
    y = (depth - math.sin(camera[0]) * above) / math.cos(camera[0])
    level, _ = _level_and_depth(camera, np.array([0.0, y, height]))
    x = (seen[0] * depth - math.sin(camera[4]) * level) / math.cos(camera[4])
    return np.array([x, y])


@dataclass(frozen=True)
class Experiment:
    """A problem without its data: everything that is fixed while data are drawn.

    The model centres free frames on the static path, which is normally estimated from the data.
    Here the path is given, so that its pixels are a constant of the density of data.

    Parameters
    ----------
    clip : Clip
        Camera, frame rate and, by confidences above 0 in its only track, which joints are detected
        in which frame.
    path : StaticPath
        Motion of the person in frames without scenelet.
    camera : CameraPrior
    library : Library
    settings : ModelSettings
        With weight 1 of each frame, and without a cost of jumps between poses.
    detections : DetectionModel

    Raises
    ------
    InputError
        The problem does not define a generative model of data.
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
        """The problem with the clip's detections."""
        return pack_problem(
            self.clip, self.path, self.camera, self.library,
            settings=self.settings, detections=self.detections,
        )  # fmt: skip

    def observed(self, rng: np.random.Generator, state: State) -> Experiment:
        """The experiment with detections drawn for a scene, equations (11) and (12)."""
        problem, camera = self.problem, self.clip.camera
        pixels, seen, looseness = _expected(problem, state, self.path, camera)
        flipped = draw_flips(
            rng, problem.n_frames, begins=problem.flip_begins, ends=problem.flip_ends,
            starts=problem.path_starts,
        )  # fmt: skip
        for values in (pixels, seen, looseness):
            values[flipped] = values[flipped][:, list(MIRROR)]
        keypoints, confidences = self.detections.draw(
            rng, pixels, rng.random(seen.shape) > seen,
            short_side=camera.short_side, looseness=looseness,
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
    """For each joint (T, 16): pixels (.., 2), probability of visibility, tolerance in pixels."""
    joints = motion(problem, state)
    camera = nominal.posed(
        pitch=state.camera[0], elevation=state.camera[1], roll=state.camera[4],
        focal_scale=math.exp(state.camera[2]),
    )  # fmt: skip
    boxes, *_ = place_boxes(problem, state.camera, state.items, state.placements, state.sizes)
    clearance = sight_clearance(camera.centre, joints, boxes)
    seen = np.vectorize(visibility_probability)(
        clearance, problem.sight_width, problem.visibility_error
    )
    pixels, looseness = nominal.project_camera(path.joints), np.zeros(seen.shape)
    for (scenelet, start), size in zip(state.items.tolist(), state.sizes, strict=True):
        own = slice(start, start + int(problem.lengths[scenelet]))
        in_camera = camera.to_camera(joints[own])
        in_camera[..., 1] = np.maximum(in_camera[..., 1], NEAREST)
        metres = problem.pose_tolerance * math.exp(state.camera[3] + size)
        pixels[own] = camera.project_camera(in_camera)
        looseness[own] = camera.fx * metres / in_camera[..., 1]
    return pixels, seen, looseness
