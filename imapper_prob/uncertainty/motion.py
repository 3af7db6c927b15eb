"""The motion over draws: positions of joints in every frame, and their uncertainty.

Two sources of uncertainty are added to the draws. A scenelet tells how people move near such
furniture, not how this person moved, and detections determine the difference only across the ray
(:mod:`imapper_prob.solver.limbs`). And the static path's error of the pelvis's height in the image
is as large as that of its bearing, but only the latter is sampled.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.calibrated import calibrated
from imapper_prob.models.camera import Camera
from imapper_prob.models.kernels.path import draw_segment
from imapper_prob.models.log_posterior import State
from imapper_prob.models.problem import Problem
from imapper_prob.models.settings import NEAREST
from imapper_prob.models.skeleton import PELV
from imapper_prob.models.text import brief
from imapper_prob.solver.limbs import Limbs, limbs_of

__all__ = ["JointSummary", "drawn_motion", "height_deviation", "joint_summary"]

Array = NDArray[np.float64]


def drawn_motion(
    rng: np.random.Generator, problem: Problem, state: State, camera: Camera, *, fps: float
) -> Array:
    """Draw the joints of a state, including the person's deviations from its pose.

    Errors are stationary AR chains: that of the height has the correlation time of the bearing.
    Those of joints have the integrated autocorrelation that errors of frames have
    (``frames.correlation_time`` of ``models/calibrated.toml``). They restart with every person.

    Parameters
    ----------
    rng : numpy.random.Generator
    problem : Problem
    state : State
    camera : Camera
        Camera of the state.
    fps : float
        Frames per second of the clip.

    Returns
    -------
    (T, 16, 3) float
        World frame of the state, metres.
    """
    limbs = limbs_of(problem, state, camera)
    # An AR(1) chain with memory a has an integrated autocorrelation of (1 + a) / (1 - a) frames.
    repeated = max(1.0, calibrated("frames.correlation_time") * fps)
    memory = np.where(problem.path_starts, 0.0, (repeated - 1) / (repeated + 1))
    joints = limbs.drawn(_chain(rng, limbs.joints.shape, memory))
    rise = _error_as_of_bearing(rng, problem)
    joints[..., 2] += (rise * height_deviation(problem, joints))[:, None]
    return joints


def height_deviation(problem: Problem, joints: Array) -> Array:
    """Standard deviation of the pelvis's height, in addition to that of the joints.

    Parameters
    ----------
    problem : Problem
    joints : (T, 16, 3) float
        World frame, metres.

    Returns
    -------
    (T,) float
        Metres.
    """
    result: Array = problem.path_scale[:, 0] * np.maximum(joints[:, PELV, 1], NEAREST)
    return result


def _error_as_of_bearing(rng: np.random.Generator, problem: Problem) -> Array:
    """(T,) an error of unit variance with the correlation of the bearing's."""
    n = problem.n_frames
    latent, drawn = np.zeros((n, 2)), np.empty((n, 2))
    latent[:, 0] = rng.standard_normal(n)
    draw_segment(
        problem.path_starts, problem.path_stay, problem.stay_steps, np.zeros((n, 2)),
        np.ones((n, 2)), problem.path_mean, problem.path_draw, np.zeros(5), latent, 0, n,
        np.empty((0, 6)), -1, -1, np.empty(n, np.int64), drawn,
    )  # fmt: skip
    return drawn[:, 0]


def _chain(rng: np.random.Generator, shape: tuple[int, ...], memory: Array) -> Array:
    """Standard normal AR(1) numbers along the first axis, by the (T,) memory of each frame."""
    numbers = rng.standard_normal(shape)
    for t in range(1, len(numbers)):
        numbers[t] *= np.sqrt(1.0 - memory[t] ** 2)
        numbers[t] += memory[t] * numbers[t - 1]
    return numbers


# ------------------------------------------------------------------------------------------------
# Summaries.


@dataclass(frozen=True)
class JointSummary:
    """Mean and covariance of every joint over draws.

    The world frame of a draw has its origin on the floor below the camera, and y along the
    horizontal viewing direction. So draws with different camera pitches can be combined.

    Parameters
    ----------
    mean : (T, 16, 3) float
        World frame, metres.
    covariance : (T, 16, 3, 3) float
        Square metres.
    """

    mean: Array
    covariance: Array

    __repr__ = brief

    @property
    def standard_deviation(self) -> Array:
        """(T, 16, 3) standard deviations along x (across the view), y (depth) and z (height),
        metres."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance, axis1=-2, axis2=-1), 0.0))


def joint_summary(motions: Iterable[Limbs], *, problem: Problem | None = None) -> JointSummary:
    """Mean and covariance of the motion over draws, which are processed one at a time.

    Parameters
    ----------
    motions : iterable of Limbs
        At least two; the covariance includes the deviations of joints from their expectation.
    problem : Problem, optional
        Determines the additional uncertainty of heights.

    Returns
    -------
    JointSummary
    """
    count = 0
    mean, scatter, own = np.zeros(()), np.zeros(()), np.zeros(())
    for limbs in motions:
        count += 1
        joints = limbs.joints
        own = own + limbs.covariance()
        before = joints - mean
        mean = mean + before / count
        # Welford's update, which is stable if the spread is small compared with the distance.
        scatter = scatter + before[..., :, None] * (joints - mean)[..., None, :]
    if count < 2:
        raise ValueError("a covariance needs two draws")
    covariance = scatter / (count - 1) + own / count
    if problem is not None:
        covariance[..., 2, 2] += height_deviation(problem, mean)[:, None] ** 2
    return JointSummary(mean, covariance)
