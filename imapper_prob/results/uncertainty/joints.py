"""Where every joint is in every frame, and how sure that is."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.brief import brief
from imapper_prob.models.problem import Problem
from imapper_prob.results.drawn_motion import height_deviation
from imapper_prob.results.limbs import Limbs

__all__ = ["JointSummary", "joint_summary"]

Array = NDArray[np.float64]


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
        By how much heights are off beside that (:mod:`imapper_prob.results.drawn_motion`).
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
