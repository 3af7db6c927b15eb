"""How much better each scenelet explains the detections of its frames than a free pose does.

The solver compares whole scenes, and few of them. Here every scenelet is tried at every start
frame, at the static path or, once chains have visited scenes, where these have the person, and
judged by the detections alone, as if no furniture hid anybody. At the static path its size is the
most probable one: somebody who stands in a scenelet but sits in the video fits only if they are
small. Jumps of the pose at its ends do not count, so a scenelet has the same gain alone and between
two others.

If scenes were sequences of scenelets and free frames whose gains add up, the sums over all
sequences from a frame to the end of the clip would follow from those of later frames (the backward
recursion of a semi-Markov model; Yu 2010, Artificial Intelligence 174, 215). They tell how probable
it is that a scenelet begins in a frame, and which one, given all that may come later. The reference
(:mod:`imapper_prob.sampling.reference`) draws from these probabilities.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from imapper_prob.models.camera import Camera
from imapper_prob.models.kernels.frame import (
    LIKELIHOODS,
    PARAMS,
    SCRATCH64,
    Lens,
    lens_of,
    mix_likelihoods,
    set_detections,
    set_free_likelihoods,
    set_visibility_likelihoods,
    take_logs,
    visibility_probabilities,
)
from imapper_prob.models.kernels.placement import expected_facing
from imapper_prob.models.kernels.visibility import SCRATCH32, Singles
from imapper_prob.models.problem import Problem
from imapper_prob.models.settings import NEAREST, NOTHING_IN_SIGHT
from imapper_prob.models.skeleton import PELV
from imapper_prob.models.view import floor_point
from imapper_prob.sampling.jit import compiled, inner
from imapper_prob.sampling.redraws import set_placement
from imapper_prob.sampling.reference import NONE_BEFORE, Reference
from imapper_prob.sampling.reference_placement import placement_centre

__all__ = [
    "Gains",
    "Sequences",
    "expected_placement",
    "frames_left_of",
    "gains_about",
    "gains_of",
    "sequences_of",
    "static_pelvis_on_floor",
]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_TRUST: Final = 0.7
"""Factor of gains in sums over sequences; chosen: gains are known to some nats, because placements
are guesses and furniture is left out."""
_LARGEST: Final = 3.0
"""Largest deviation of a fitted size, in standard deviations of the prior; chosen."""
_HOPELESS: Final = 15.0
"""Nats below the best of its start at which a scenelet is not judged again; chosen: about a
tenth of all remain."""


def frames_left_of(problem: Problem) -> Ints:
    """Number of frames from each frame to the end of its person's frames.

    Parameters
    ----------
    problem : Problem

    Returns
    -------
    (T + 1,) int
        The last one, for the end of the clip, is 0.
    """
    frames = np.arange(problem.n_frames)
    begins = np.append(np.flatnonzero(problem.path_starts), problem.n_frames)
    return np.append(begins[np.searchsorted(begins, frames, "right")] - frames, 0)


def static_pelvis_on_floor(problem: Problem) -> Array:
    """Bearing and log depth of the static path's pelvis on the floor, for the mean camera.

    Parameters
    ----------
    problem : Problem

    Returns
    -------
    (T, 2) float
        Tangent, and log metres.
    """
    pitch, elevation, focal, body, roll = problem.camera_mean
    depth = np.exp(problem.path_centre[:, 1] + focal + body)
    right = problem.path_centre[:, 0] * np.exp(-focal) * depth
    up = problem.lift * np.exp(-focal) * depth
    camera = Camera(
        1, 1, 1.0, 1.0, 0.0, 0.0, pitch=float(pitch), elevation=float(elevation), roll=float(roll)
    )
    x, y, _ = camera.to_world(np.stack([right, depth, up], -1)).T
    y = np.maximum(y, NEAREST)
    return np.stack([x / y, np.log(y)], -1)


@compiled
def expected_placement(
    problem: Problem, path: Array, scenelet: int, start: int
) -> tuple[float, float, float]:
    """Placement whose pelvis is on the static path in the middle frame, and which faces as the
    static path does.

    Parameters
    ----------
    problem : Problem
    path : (T, 2) float
        See :func:`static_pelvis_on_floor`.
    scenelet : int
    start : int
        Start frame.

    Returns
    -------
    x, y, yaw : float
        Metres, and radians.
    """
    first = problem.joint_first[scenelet]
    middle = (problem.joint_first[scenelet + 1] - first) // 2
    along, aside = expected_facing(problem, scenelet, start)
    yaw = math.atan2(aside, along)
    body = math.exp(problem.camera_mean[3])
    c, s = body * math.cos(yaw), body * math.sin(yaw)
    x, y = floor_point(path[start + middle, 0], path[start + middle, 1])
    local = problem.joints[first + middle, PELV]
    return x - c * local[0] + s * local[1], y - s * local[0] - c * local[1], yaw


class _GainWorkspace(NamedTuple):
    """What the gains of all scenelets need of a problem, and workspaces.

    Parameters
    ----------
    lens : tuple of 9 float
    weight : float
        Weight of a frame.
    free : (T,) float
        Log-likelihood of each frame's detections with a free pose, weighted, nats.
    seen : (1, 16) single
        Probability of joints being seen that no furniture hides.
    uv, params : array
        See :func:`imapper_prob.models.kernels.frame.set_detections`.
    joints, likelihoods, logs, scratch64, scratch32 : array
    """

    lens: Lens
    weight: float
    free: Array
    seen: Singles
    uv: Array
    params: Singles
    joints: Array
    likelihoods: Array
    logs: Array
    scratch64: Array
    scratch32: Singles


@inner
def _gain_workspace(problem: Problem) -> _GainWorkspace:
    n_frames = len(problem.lift)
    uv, params = np.empty((n_frames, 2, 2, 16)), np.empty((n_frames, 2, PARAMS, 16), np.float32)
    scratch64, scratch32 = np.empty(SCRATCH64), np.empty(SCRATCH32, np.float32)
    likelihoods, logs, free = (
        np.empty((1, LIKELIHOODS)),
        np.empty((4, n_frames)),
        np.empty(n_frames),
    )
    seen = np.full((1, 16), np.float32(NOTHING_IN_SIGHT))
    visibility_probabilities(seen, 1, problem.sight_width, problem.visibility_error)
    for t in range(n_frames):
        set_detections(problem, t, uv, params, t)
        set_free_likelihoods(problem, t, scratch64, likelihoods, 0)
        mix_likelihoods(likelihoods, 0, seen, 0, scratch64, logs[:, t:])
    take_logs(logs, n_frames)
    weight = problem.frame_weight * problem.likelihood
    for t in range(n_frames):
        free[t] = weight * (max(logs[0, t], logs[1, t]) - problem.free_cost[t])
    return _GainWorkspace(
        lens_of(problem, problem.camera_mean), weight, free, seen, uv, params,
        np.empty((1, 3, 16)), likelihoods, logs, scratch64, scratch32,
    )  # fmt: skip


@inner
def _gain(
    problem: Problem,
    workspace: _GainWorkspace,
    scenelet: int,
    start: int,
    placement: Array,
    size: float,
) -> float:
    """Gain of a scenelet at a placement (3,) and log size, at the mean camera."""
    body = math.exp(problem.camera_mean[3] + size)
    c, s = body * math.cos(placement[2]), body * math.sin(placement[2])
    first, joints = problem.joint_first[scenelet], workspace.joints
    length = problem.joint_first[scenelet + 1] - first
    for n in range(length):
        for j in range(16):
            x, y, z = problem.joints[first + n, j]
            joints[0, 0, j] = c * x - s * y + placement[0]
            joints[0, 1, j] = s * x + c * y + placement[1]
            joints[0, 2, j] = body * z
        set_visibility_likelihoods(
            workspace.lens, problem.pose_tolerance, body, joints, 0, workspace.uv, workspace.params,
            start + n, workspace.scratch64, workspace.scratch32, workspace.likelihoods, 0,
        )  # fmt: skip
        mix_likelihoods(
            workspace.likelihoods, 0, workspace.seen, 0, workspace.scratch64, workspace.logs[:, n:]
        )
    take_logs(workspace.logs, length)
    gain = 0.0
    for n in range(length):
        gain += (
            workspace.weight * max(workspace.logs[0, n], workspace.logs[1, n])
            - workspace.free[start + n]
        )
    return gain


class Gains(NamedTuple):
    """Gain of every scenelet at every start, at its most probable size on the static path.

    Parameters
    ----------
    values : (T, L) float
        Log likelihood ratio of the detections to free poses, less the cost of the size under its
        prior, nats; -inf where a scenelet would extend beyond its person's frames.
    sizes : (T, L) float
        Log sizes.
    """

    values: Array
    sizes: Array


def gains_of(problem: Problem) -> Gains:
    """Gain of every scenelet at every start over free poses in its frames, at the static path.

    Parameters
    ----------
    problem : Problem

    Returns
    -------
    Gains
    """
    return Gains(*_gains(problem, static_pelvis_on_floor(problem), frames_left_of(problem)))


@compiled
def _gains(problem: Problem, path: Array, frames_left: Ints) -> tuple[Array, Array]:
    workspace, placement = _gain_workspace(problem), np.empty(3)
    gains = np.full((len(path), len(problem.joint_first) - 1), -math.inf)
    sizes = np.zeros(gains.shape)
    for scenelet in range(gains.shape[1]):
        length = problem.joint_first[scenelet + 1] - problem.joint_first[scenelet]
        for start in range(len(gains)):
            if length <= frames_left[start]:
                placement[0], placement[1], placement[2] = expected_placement(
                    problem, path, scenelet, start
                )
                gains[start, scenelet], sizes[start, scenelet] = _fitted_size(
                    problem, workspace, scenelet, start, placement
                )
    return gains, sizes


@inner
def _fitted_size(
    problem: Problem, workspace: _GainWorkspace, scenelet: int, start: int, placement: Array
) -> tuple[float, float]:
    """The largest gain less the cost of the size, and that size, by a parabola through three."""
    spread = problem.size_spread
    small = _gain(problem, workspace, scenelet, start, placement, -spread) - 0.5
    mean = _gain(problem, workspace, scenelet, start, placement, 0.0)
    large = _gain(problem, workspace, scenelet, start, placement, spread) - 0.5
    best, size = mean, 0.0
    if small > best:
        best, size = small, -spread
    if large > best:
        best, size = large, spread
    curvature = 2.0 * mean - small - large
    if curvature > 0.0:
        vertex = min(max(0.5 * (large - small) / curvature, -_LARGEST), _LARGEST)
        value = _gain(problem, workspace, scenelet, start, placement, vertex * spread)
        value -= 0.5 * vertex * vertex
        if value > best:
            best, size = value, vertex * spread
    return best, size


@compiled
def gains_about(problem: Problem, gains: Array, reference: Reference) -> Array:
    """Gains at the placements that a reference expects, for all but hopeless scenelets.

    Parameters
    ----------
    problem : Problem
    gains : (T, L) float
        See :class:`Gains`; those of hopeless scenelets are kept.
    reference : Reference
        Its mean path, yaws, size and deviations of scenelets are used.

    Returns
    -------
    (T, L) float
        Nats, less the cost of the expected size under its prior.
    """
    workspace, placement = _gain_workspace(problem), np.empty(3)
    before, where = np.empty((2, 4)), np.empty((2, 4))
    camera, anew = reference.library_camera, gains.copy()
    for start in range(len(gains)):
        least = gains[start].max() - _HOPELESS
        for scenelet in range(gains.shape[1]):
            if gains[start, scenelet] > least:
                placement_centre(reference, camera, scenelet, start, NONE_BEFORE, before, where)
                set_placement(reference, camera, scenelet, where[0], placement)
                size = where[0, 3]
                gain = _gain(problem, workspace, scenelet, start, placement, size)
                anew[start, scenelet] = gain - 0.5 * (size / problem.size_spread) ** 2
    return anew


class Sequences(NamedTuple):
    """A distribution of sequences of scenelets by their gains.

    Parameters
    ----------
    hazard : (T + 1,) float
        Probability that a scenelet begins in a frame that no earlier one covers; 0 at the end.
    survival : (T + 1,) float
        Log probability that none began before each frame.
    scenelets : (T + 1, L) float
        Probability of each scenelet if one begins; 0 where none fits.
    """

    hazard: Array
    survival: Array
    scenelets: Array


def sequences_of(problem: Problem, gains: Array) -> Sequences:
    """Sum over all sequences of scenelets from each frame on.

    Every scenelet counts by its gain and its probability under the prior.

    Parameters
    ----------
    problem : Problem
    gains : (T, L) float
        See :class:`Gains`.

    Returns
    -------
    Sequences
    """
    n_frames, lengths = problem.n_frames, np.asarray(problem.lengths)
    values = _TRUST * gains + (problem.log_rate - logsumexp(problem.log_rate))
    sums, hazard = np.zeros(n_frames + 1), np.zeros(n_frames + 1)
    scenelets = np.zeros((n_frames + 1, len(lengths)))
    for t in range(n_frames - 1, -1, -1):
        sums[t] = sums[t + 1]
        fits = np.isfinite(values[t])
        if fits.any():
            onward = values[t, fits] + sums[t + lengths[fits]]
            begins = logsumexp(onward)
            sums[t] = np.logaddexp(sums[t + 1], begins)
            hazard[t] = math.exp(begins - sums[t])
            scenelets[t, fits] = np.exp(onward - begins)
    return Sequences(hazard, sums - sums[0], scenelets)
