"""Where every joint is in every frame, and how sure that is."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.skeleton import N_JOINTS, PELV

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

    @property
    def standard_deviation(self) -> Array:
        """(T, 16, 3) along x (across the view), y (depth) and z (height), metres."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance, axis1=-2, axis2=-1), 0.0))


def joint_summary(motions: Iterable[Array], *, pose_tolerance: float = 0.0) -> JointSummary:
    """Mean and covariance over draws of the motion, of which one at a time is held.

    Parameters
    ----------
    motions : iterable of (T, 16, 3) float
        World, metres. At least two.
    pose_tolerance : float
        Metres an axis by which the person's limbs differ from a scenelet's; it comes on top
        for all joints but the pelvis (:mod:`imapper_prob.results.drawn_motion`).
    """
    count = 0
    mean, scatter = np.zeros(()), np.zeros(())
    for joints in motions:
        count += 1
        before = joints - mean
        mean = mean + before / count
        # Welford's update: stable where the spread is small beside the distance.
        scatter = scatter + before[..., :, None] * (joints - mean)[..., None, :]
    if count < 2:
        raise ValueError("a covariance needs two draws")
    covariance = scatter / (count - 1)
    limbs = [j for j in range(N_JOINTS) if j != PELV]
    covariance[:, limbs] += pose_tolerance**2 * np.eye(3)
    return JointSummary(mean, covariance)
