"""The motion of the draws: where every joint is in every frame, and how sure that is.

Two doubts are added to the draws. A scenelet says how somebody moves near such furniture, not how
this person moved, and detections tell only across the ray by how much joints differ
(:mod:`imapper_prob.solver.limbs`). And the static path is as wrong about how high the pelvis is in
the image as about how far to the side, of which only the latter is sampled.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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


def drawn_motion(rng: np.random.Generator, problem: Problem, state: State, camera: Camera) -> Array:
    """Draw the joints of a state: its pose, and how the person's differs.

    Errors are stationary chains: that of the height has the correlation time of the bearing, those
    of joints that of the frames that count as one.

    Parameters
    ----------
    rng : numpy.random.Generator
    problem : Problem
    state : State
    camera : Camera
        Of the state.

    Returns
    -------
    (T, 16, 3) float
        The state's world, metres.
    """
    limbs = limbs_of(problem, state, camera)
    memory = np.exp(-min(1.0, problem.frame_weight))
    joints = limbs.drawn(_chain(rng, limbs.joints.shape, memory))
    rise = _error_as_of_bearing(rng, problem)
    joints[..., 2] += (rise * height_deviation(problem, joints))[:, None]
    return joints


def height_deviation(problem: Problem, joints: Array) -> Array:
    """By how much the pelvis may be higher or lower than joints say, a standard deviation.

    Parameters
    ----------
    problem : Problem
    joints : (T, 16, 3) float
        World, metres.

    Returns
    -------
    (T,) float
        Metres.
    """
    result: Array = problem.path_scale[:, 0] * np.maximum(joints[:, PELV, 1], NEAREST)
    return result


def _error_as_of_bearing(rng: np.random.Generator, problem: Problem) -> Array:
    """(T,) an error of unit deviation that goes on as the bearing's does."""
    n = problem.n_frames
    latent, drawn = np.zeros((n, 2)), np.empty((n, 2))
    latent[:, 0] = rng.standard_normal(n)
    draw_segment(
        problem.path_starts, problem.path_stay, problem.stay_steps, np.zeros((n, 2)),
        np.ones((n, 2)), problem.path_mean, problem.path_draw, np.zeros(5), latent, 0, n,
        np.empty((0, 6)), -1, -1, np.empty(n, np.int64), drawn,
    )  # fmt: skip
    return drawn[:, 0]


def _chain(rng: np.random.Generator, shape: tuple[int, ...], memory: float) -> Array:
    """Standard normal numbers, each of which remembers the one a frame before."""
    numbers = rng.standard_normal(shape)
    numbers[1:] *= np.sqrt(1.0 - memory**2)
    for t in range(1, len(numbers)):
        numbers[t] += memory * numbers[t - 1]
    return numbers


# ------------------------------------------------------------------------------------------------
# Summaries.


@dataclass(frozen=True)
class JointSummary:
    """Mean and covariance of every joint.

    The world of a draw has its origin on the floor below the camera and y along the
    horizontal viewing direction, so draws whose cameras look down by different angles can be
    held together.

    Parameters
    ----------
    mean : (T, 16, 3) float
        World, metres.
    covariance : (T, 16, 3, 3) float
        Square metres.
    """

    mean: Array
    covariance: Array

    __repr__ = brief

    @property
    def standard_deviation(self) -> Array:
        """(T, 16, 3) along x (across the view), y (depth) and z (height), metres."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance, axis1=-2, axis2=-1), 0.0))


def joint_summary(motions: Iterable[Limbs], *, problem: Problem | None = None) -> JointSummary:
    """Mean and covariance over draws of the motion, of which one at a time is held.

    Parameters
    ----------
    motions : iterable of Limbs
        At least two; how far joints may be from where they are expected comes on top.
    problem : Problem, optional
        By how much heights are off besides.

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
        # Welford's update: stable where the spread is small beside the distance.
        scatter = scatter + before[..., :, None] * (joints - mean)[..., None, :]
    if count < 2:
        raise ValueError("a covariance needs two draws")
    covariance = scatter / (count - 1) + own / count
    if problem is not None:
        covariance[..., 2, 2] += height_deviation(problem, mean)[:, None] ** 2
    return JointSummary(mean, covariance)
