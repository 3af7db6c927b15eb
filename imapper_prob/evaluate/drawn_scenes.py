"""Do regions hold what was drawn from the model itself?

Clips that somebody filmed, or that a simulator makes plausible, are the model's only so far. Of a
scene drawn from the prior, and detections drawn of it, the posterior is right by construction:
what its regions do not hold as often as they say, the sampler has not found.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.calibrate.simulated import SETTINGS, Drawn, draw_and_sample
from imapper_prob.config import SampleSettings
from imapper_prob.evaluate.prediction import state_camera
from imapper_prob.evaluate.spread import elliptic_rank
from imapper_prob.models.camera import Camera
from imapper_prob.models.posterior import State, motion
from imapper_prob.models.scene import SceneObject
from imapper_prob.models.simulate import NOMINAL_CAMERA
from imapper_prob.models.simulate_detections import Experiment
from imapper_prob.models.simulate_room import hidden_joints
from imapper_prob.models.skeleton import PELV, SCORED
from imapper_prob.sampling.layouts import merged_objects

__all__ = ["FRAMES", "region_ranks"]

Array = NDArray[np.float64]

FRAMES: Final = 60
"""Of each clip, at 10 a second."""

_FEWEST: Final = 20
"""Draws with an object below which its ellipse is not worth asking."""


def region_ranks(
    experiment: Experiment, seed: int, settings: SampleSettings = SETTINGS
) -> dict[str, Array]:
    """Ranks in [0, 1] of what was drawn in regions of its posterior, in the axes of the camera.

    ``objects``: centre of the first object, in order of time, among the draws that have one, where
    the scene has; ``pelvis``, ``joints`` and ``hidden`` (by furniture) joints of all frames.
    """
    drawn = draw_and_sample(experiment, seed, settings)
    truth = drawn.truth
    joints = np.array([_in_camera(drawn, state) for state in drawn.states])
    true = _in_camera(drawn, truth)
    objects = merged_objects(drawn.problem, drawn.library, truth)
    hidden = hidden_joints(_camera(truth), motion(drawn.problem, truth), objects)
    frames = range(len(true))
    ranks = np.array([[elliptic_rank(joints[:, t, j], true[t, j]) for j in SCORED] for t in frames])
    return {
        "objects": _first_object(drawn, objects),
        "pelvis": np.array([elliptic_rank(joints[:, t, PELV], true[t, PELV]) for t in frames]),
        "joints": ranks.ravel(),
        "hidden": ranks[hidden[:, list(SCORED)]],
    }


def _camera(state: State) -> Camera:
    return state_camera(NOMINAL_CAMERA, state)


def _in_camera(drawn: Drawn, state: State) -> Array:
    """(T, 16, 3) joints of a state, metres."""
    joints: Array = _camera(state).to_camera(motion(drawn.problem, state))
    return joints


def _first_object(drawn: Drawn, true: tuple[SceneObject, ...]) -> Array:
    """(1,) its rank, or (0,) where there is nothing to ask."""
    found = [(s, merged_objects(drawn.problem, drawn.library, s)) for s in drawn.states]
    centres = [_camera(s).to_camera(objects[0].centre)[:2] for s, objects in found if objects]
    if not true or len(centres) < _FEWEST:
        return np.empty(0)
    centre = _camera(drawn.truth).to_camera(true[0].centre)[:2]
    return np.array([elliptic_rank(np.array(centres), centre)])
