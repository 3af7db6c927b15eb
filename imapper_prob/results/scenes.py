"""Scenes with their probabilities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.brief import brief
from imapper_prob.models.scene import Scene, SceneObject

__all__ = ["Explains", "WeightedScene"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Explains:
    """What a scene accounts for.

    Parameters
    ----------
    frames : tuple of (int, int)
        First and last frame of each scenelet, by the clip's own numbers.
    n_frames : int
        Frames of the clip, of everybody in it.
    unsure : int
        Detections, one a joint and frame, that the detector is not sure of.
    unsure_behind : int
        Those of them that the scene has behind furniture: hidden joints that it explains.
    sure_behind : int
        Detections behind furniture that the detector is sure of all the same.
    """

    frames: tuple[tuple[int, int], ...]
    n_frames: int
    unsure: int
    unsure_behind: int
    sure_behind: int

    @property
    def covered(self) -> int:
        """Frames that some scenelet covers."""
        return sum(last - first + 1 for first, last in self.frames)

    @property
    def text(self) -> str:
        """A sentence of it, to follow "it"."""
        return (
            f"covers {self.covered} of {self.n_frames} frames with scenelets, and has "
            f"{self.unsure_behind} of {self.unsure} unsure detections behind furniture "
            f"({self.sure_behind} sure ones too)"
        )


@dataclass(frozen=True)
class WeightedScene:
    """A scene of the posterior, or one layout, by its most representative draw.

    Parameters
    ----------
    scene : Scene
        The representative draw.
    probability : float
        Posterior probability.
    error : float
        Monte-Carlo standard error of ``probability``.
    covariances : (n_objects, 2, 2) float
        Posterior covariance of each object's position on the floor, square metres.
    ghosts : (n_ghosts, T, 16, 3) float
        A few more draws of the motion, world frame, metres.
    layouts : tuple of int
        Numbers, from 1, of the layouts that it holds, the most probable first.
    explains : Explains, optional
        What it accounts for.
    difference : str
        How it differs from the best scene; empty for the best.
    draw : int
        Number of the representative draw, chain by chain; -1 where nobody says.
    """

    scene: Scene
    probability: float
    error: float
    covariances: Array
    ghosts: Array
    layouts: tuple[int, ...] = ()
    explains: Explains | None = None
    difference: str = ""
    draw: int = -1

    __repr__ = brief

    @property
    def objects(self) -> tuple[SceneObject, ...]:
        """The furniture of the representative draw, in its world."""
        return self.scene.objects
