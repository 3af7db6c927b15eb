"""What a posterior claims to be there: its clusters of objects, in the axes of the camera."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from shapely.affinity import translate

from imapper_prob.evaluate.outline import Outline, outline_of
from imapper_prob.models.posterior import state_camera
from imapper_prob.results.posterior import Posterior

__all__ = ["Claim", "claims_of"]

Array = NDArray[np.float64]

_LEAST: Final = 0.005
"""Probability down to which clusters count; two draws of 400."""


@dataclass(frozen=True, eq=False)
class Claim:
    """One piece of furniture as the draws have it.

    Parameters
    ----------
    probability : float
        That it is there.
    label : str
        The most probable one.
    members : tuple of Outline
        It, in every draw that has it.
    """

    probability: float
    label: str
    members: tuple[Outline, ...]

    @property
    def centres(self) -> Array:
        """(n, 2) metres, top view."""
        return np.array([m.centre for m in self.members])

    @cached_property
    def representative(self) -> Outline:
        """The member of the right label nearest to the mean, moved there.

        The mean is of bearing and log distance, because spread is relative and along the ray.
        """
        away = np.linalg.norm(self.centres, axis=1)
        bearing = np.arctan2(self.centres[:, 0], self.centres[:, 1]).mean()
        middle = np.exp(np.log(away).mean()) * np.array([np.sin(bearing), np.cos(bearing)])
        alike = [m for m in self.members if m.label == self.label]
        best = min(alike, key=lambda m: float(np.linalg.norm(m.centre - middle)))
        x, y = middle - best.centre
        moved = translate(best.hull, float(x), float(y))
        corners = best.corners + np.array([x, y, 0.0])
        return Outline(best.label, middle, best.yaw, best.has_front, moved, corners)


def claims_of(posterior: Posterior) -> tuple[Claim, ...]:
    """The clusters that a run shows with their ellipses, the most probable first.

    They are made without the truth, by :mod:`imapper_prob.results.uncertainty.clusters`.
    """
    samples = posterior.samples
    cameras = [state_camera(posterior.clip.camera, state) for state in samples.states]
    return tuple(
        Claim(
            cluster.presence,
            cluster.label,
            tuple(outline_of(posterior.furniture[n][k], cameras[n]) for n, k in cluster.members),
        )
        for cluster in posterior.clusters(least=_LEAST)
    )
