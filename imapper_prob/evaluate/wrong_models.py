"""Simulated clips whose truth is known: plausible ones, and others that differ in one thing.

What breaks calibration, and by how much: the same program is run on clips that are as plausible
as the simulator makes them, and on clips that are wrong in one thing each, as the world may be.
Scenes that are the model's own are drawn by :mod:`imapper_prob.evaluate.drawn_scenes`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip, Truth
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import ModelSettings
from imapper_prob.models.simulate import NOMINAL_CAMERA, draw_camera, simulate_clip
from imapper_prob.results.drawn_objects import drawn_objects
from imapper_prob.scenelets.library import built_in_library

__all__ = ["MODELS", "simulated"]

MODELS: Final = {
    "plausible": "camera, body and detector as the model has them, scenelets of its library",
    "other scenelets": "performed from a library of other bodies and other furniture",
    "stronger noise": "pixel errors three times as large, at the same confidences",
    "tilted floor": "a camera rolled by eight degrees, five standard deviations",
}
"""What the clips of each model are."""

FRAMES: Final = 80
"""Of each clip, at 10 a second: somebody comes in and does one thing."""

_NOISIER: Final = 3.0
_TILT: Final = float(np.deg2rad(8.0))
_OTHER_LIBRARY: Final = 1
"""Seed of the library that is performed where another is searched."""


def simulated(model: str, seed: int) -> tuple[Clip, Library]:
    """A clip of one of :data:`MODELS`, and the library to look for it with.

    The same arguments give the same clip. Room and walk are plausible, not a draw of p(X), and
    the static path is off as it happens to be, not as it was measured on i3DB.
    """
    if model not in MODELS:
        raise InputError(f"no model {model!r}; there are {', '.join(MODELS)}")
    rng = np.random.default_rng(seed)
    library = built_in_library()
    performed = built_in_library(_OTHER_LIBRARY) if model == "other scenelets" else library
    camera = draw_camera(rng)
    if model == "tilted floor":
        camera = replace(camera, roll=camera.roll + _TILT)
    clip = simulate_clip(
        rng, performed, n_frames=FRAMES, n_interactions=1, camera=camera, name=f"{model} {seed}"
    )
    # Where furniture stands its scenelets do not quite know either.
    clip = replace(clip, truth=_displaced(rng, clip))
    # Of the camera, the program knows no more than it does of a real one.
    clip = replace(clip, camera=NOMINAL_CAMERA)
    return (_noisier(clip) if model == "stronger noise" else clip), library


def _displaced(rng: np.random.Generator, clip: Clip) -> Truth:
    truth = clip.truth
    assert truth is not None  # it is a simulated clip
    return replace(truth, objects=drawn_objects(rng, truth.objects, ModelSettings()))


def _noisier(clip: Clip) -> Clip:
    truth, track = clip.truth, clip.tracks[0]
    assert truth is not None  # it is a simulated clip
    exact = truth.camera.project(truth.joints)
    keypoints = exact + _NOISIER * (track.keypoints - exact)
    return replace(clip, tracks=(replace(track, keypoints=keypoints),))
