"""Scenes with their probabilities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import Scene

__all__ = ["WeightedScene"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class WeightedScene:
    """A layout of the posterior, by its most representative draw.

    Parameters
    ----------
    scene : Scene
        The representative draw.
    probability : float
        Posterior probability of the layout.
    error : float
        Monte-Carlo standard error of ``probability``.
    covariances : (n_objects, 2, 2) float
        Posterior covariance of each object's position on the floor, square metres.
    ghosts : (n_ghosts, T, 16, 3) float
        A few more draws of the motion in this layout, world frame, metres.
    """

    scene: Scene
    probability: float
    error: float
    covariances: Array
    ghosts: Array
