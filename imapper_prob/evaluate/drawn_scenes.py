"""Do regions hold what was drawn from the model itself?

Clips that somebody filmed, or that a simulator makes plausible, are the model's only so far. Of a
scene drawn from the prior, and detections drawn of it, the posterior is right by construction:
what its regions do not hold as often as they say, the sampler has not found.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.calibrate.simulated import SETTINGS, Drawn, draw_and_sample
from imapper_prob.config import SampleSettings
from imapper_prob.evaluate.spread import elliptic_rank
from imapper_prob.models.camera import Camera
from imapper_prob.models.posterior import State, motion, state_camera
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
"""Draws with an object, or that hide a joint, below which their ellipse is not worth asking."""


def region_ranks(
    experiment: Experiment, seed: int, settings: SampleSettings = SETTINGS
) -> dict[str, Array]:
    """Ranks in [0, 1] of what was drawn in regions of its posterior, in the axes of the camera.

    ``objects``: centre of the first object, in order of time, among the draws that have one, where
    the scene has; ``pelvis`` and ``joints`` of all frames; ``hidden``: joints that furniture hides,
    among the draws in which it does. (Where one looks only if something is true of the scene, only
    draws of which it is true as well speak of that.)
    """
    drawn = draw_and_sample(experiment, seed, settings)
    truth = drawn.truth
    joints = np.array([_in_camera(drawn, state) for state in drawn.states])
    true = _in_camera(drawn, truth)
    hidden = np.array([_hidden(drawn, state) for state in drawn.states])
    asked = [(t, j) for t, j in np.argwhere(_hidden(drawn, truth)).tolist() if j in SCORED]
    alike = [(t, j, hidden[:, t, j]) for t, j in asked if hidden[:, t, j].sum() >= _FEWEST]
    everywhere = [(t, j) for t in range(len(true)) for j in SCORED]
    return {
        "objects": _first_object(drawn, merged_objects(drawn.problem, drawn.library, truth)),
        "pelvis": _ranks((joints[:, t, PELV], true[t, PELV]) for t in range(len(true))),
        "joints": _ranks((joints[:, t, j], true[t, j]) for t, j in everywhere),
        "hidden": _ranks((joints[those, t, j], true[t, j]) for t, j, those in alike),
    }


def _ranks(asked: Iterable[tuple[Array, Array]]) -> Array:
    return np.array([elliptic_rank(draws, point) for draws, point in asked])


def _hidden(drawn: Drawn, state: State) -> NDArray[np.bool_]:
    """(T, 16) which joints of a state its furniture hides."""
    objects = merged_objects(drawn.problem, drawn.library, state)
    return hidden_joints(_camera(state), motion(drawn.problem, state), objects)


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
