"""Answers that take no thought. What does not beat them has added nothing."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.evaluate.outline import Outline, box_corners
from imapper_prob.evaluate.prediction import Prediction
from imapper_prob.evaluate.truth import segments
from imapper_prob.models.scene import Clip
from imapper_prob.models.settings import Settings
from imapper_prob.models.skeleton import LHIP, PELV, RHIP
from imapper_prob.staged.static_path import estimate_static_path

__all__ = ["couch_where_sat", "static_path"]

Array = NDArray[np.float64]

_COUCH: Final = (2.4, 0.8, 0.45)
"""Metres of width, depth and height: the usual couch of i3DB."""


def couch_where_sat(path: Prediction, actions: tuple[str, ...]) -> Prediction:
    """A couch around the median pelvis of each stay on a seat, facing as the hips do.

    Parameters
    ----------
    path : Prediction
        Whose joints are used, and kept; its furniture is not.
    actions : tuple of str
        When somebody sits. It is told the truth about that, which nothing else is.
    """
    couches = []
    for action, frames in segments(actions):
        body = path.joints[frames]
        body = body[np.isfinite(body).all((1, 2))]
        if action == "sitting" and len(body):
            sideways = np.median(body[:, RHIP] - body[:, LHIP], axis=0) * (1, 1, 0)
            couches.append(_couch(np.median(body[:, PELV], axis=0), sideways))
    return Prediction(f"couch on {path.name}", path.joints, path.pixels, tuple(couches))


def static_path(clip: Clip) -> Prediction:
    """The smooth path through the detections that the solver starts from, without furniture.

    With constants estimated without a scene of that name.
    """
    joints = estimate_static_path(clip, settings=Settings().without(clip.name).path).joints
    return Prediction("static path", joints, clip.camera.project_camera(joints), ())


def _couch(centre: Array, sideways: Array) -> Outline:
    right = sideways / np.linalg.norm(sideways)
    up = np.array([0.0, 0.0, 1.0])
    axes = np.stack([right, np.cross(up, right), up], 1)
    return Outline.of_corners("couch", box_corners(centre, axes, _COUCH), right, has_front=True)
