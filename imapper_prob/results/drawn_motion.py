"""The motion of one draw, limbs included.

A scenelet says how somebody moves near such furniture, not how this person moved, and detections
tell only across the ray by how much joints differ (:mod:`imapper_prob.results.limbs`). And the
static path is as wrong about how high the pelvis is in the image as about how far to the side, of
which only the latter is sampled. What is drawn of scene and path leaves both out, and so would be
far too sure of hands, feet and heights.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.kernels.path import draw_segment
from imapper_prob.models.limits import NEAREST
from imapper_prob.models.posterior import State
from imapper_prob.models.problem import Problem
from imapper_prob.models.skeleton import PELV
from imapper_prob.results.limbs import limbs_of

__all__ = ["drawn_motion", "height_deviation"]

Array = NDArray[np.float64]


def drawn_motion(rng: np.random.Generator, problem: Problem, state: State, camera: Camera) -> Array:
    """(T, 16, 3) joints in the state's world, metres: the pose, and how the person's differs.

    Errors are stationary chains: that of the height forgets itself as that of the bearing does,
    those of joints in as many frames as count as one. ``camera`` is that of the state.
    """
    limbs = limbs_of(problem, state, camera)
    memory = np.exp(-min(1.0, problem.frame_weight))
    joints = limbs.drawn(_chain(rng, limbs.joints.shape, memory))
    rise = _error_as_of_bearing(rng, problem)
    joints[..., 2] += (rise * height_deviation(problem, joints))[:, None]
    return joints


def height_deviation(problem: Problem, joints: Array) -> Array:
    """(T,) metres by which the pelvis may be higher or lower than ``joints`` (T, 16, 3) say."""
    result: Array = problem.path_scale[:, 0] * np.maximum(joints[:, PELV, 1], NEAREST)
    return result


def _error_as_of_bearing(rng: np.random.Generator, problem: Problem) -> Array:
    """(T,) an error of unit deviation that goes on as the bearing's does."""
    n = problem.n_frames
    latent, drawn = np.zeros((n, 2)), np.empty((n, 2))
    latent[:, 0] = rng.standard_normal(n)
    draw_segment(
        problem.path_starts, np.zeros((n, 2)), np.ones((n, 2)), problem.path_mean,
        problem.path_draw, np.zeros(5), latent, 0, n, np.empty((0, 6)), -1, -1, drawn,
    )  # fmt: skip
    return drawn[:, 0]


def _chain(rng: np.random.Generator, shape: tuple[int, ...], memory: float) -> Array:
    """Standard normal numbers, each of which remembers the one a frame before."""
    numbers = rng.standard_normal(shape)
    numbers[1:] *= np.sqrt(1.0 - memory**2)
    for t in range(1, len(numbers)):
        numbers[t] += memory * numbers[t - 1]
    return numbers
