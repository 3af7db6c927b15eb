"""A posterior as many predictions: what every draw says, in the axes of the camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.evaluate.outline import Outline, outline_of
from imapper_prob.evaluate.prediction import Prediction
from imapper_prob.models.posterior import state_camera
from imapper_prob.results.drawn_motion import drawn_motion
from imapper_prob.results.posterior import Posterior

__all__ = ["Draws", "draws_of"]

Array = NDArray[np.float64]

_MOST: Final = 200
"""Draws that are looked at. Ranks among 200 are good to .035, and neighbours are alike."""


@dataclass(frozen=True, eq=False)
class Draws:
    """Evenly spaced draws of all chains.

    Parameters
    ----------
    joints : (N, T, 16, 3) float
        In the axes of the camera, metres.
    pixels : (N, T, 16, 2) float
        As each draw's own camera sees them.
    objects : tuple of N tuples of Outline
    """

    joints: Array
    pixels: Array
    objects: tuple[tuple[Outline, ...], ...]

    def __len__(self) -> int:
        return len(self.objects)

    def prediction(self, draw: int, *, name: str) -> Prediction:
        """One draw as an answer."""
        return Prediction(name, self.joints[draw], self.pixels[draw], self.objects[draw])


def draws_of(posterior: Posterior) -> Draws:
    """At most 200 draws of a posterior, evenly spaced over its chains."""
    samples, source = posterior.samples, posterior.solution
    count = len(samples.states)
    chosen = np.unique(np.linspace(0, count - 1, min(count, _MOST)).round().astype(int))
    joints, pixels, objects = [], [], []
    rng = np.random.default_rng(posterior.config.seed)
    for k in chosen.tolist():
        state = samples.states[k]
        camera = state_camera(posterior.clip.camera, state)
        world = drawn_motion(rng, source.problem, state, camera)
        joints.append(camera.to_camera(world))
        pixels.append(camera.project(world))
        objects.append(tuple(outline_of(o, camera) for o in posterior.furniture[k]))
    return Draws(np.array(joints), np.array(pixels), tuple(objects))
