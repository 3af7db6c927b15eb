"""What furniture really hides, against what scenelets would have it hide."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.geometry import pack_boxes, sight_clearance
from imapper_prob.models.scene import Placement, SceneObject, Truth
from imapper_prob.models.scenelet import Scenelet
from imapper_prob.models.skeleton import DETECTED

__all__ = ["sights_past"]

Array = NDArray[np.float64]
Ints = NDArray[np.intp]

_STANDS_FOR = 1.0
"""Metres from a true piece within which a scenelet's may be meant for it."""


def sights_past(truth: Truth, scenelet: Scenelet, place: Placement, frames: Ints) -> Array:
    """Lines of sight to true joints, past a scenelet's furniture and past the true one.

    Every piece of the scenelet is meant for the true piece that is nearest. Joints that
    something else hides are left out.

    Parameters
    ----------
    truth : Truth
    scenelet : Scenelet
    place : Placement
        Where it is laid upon the true motion.
    frames : (m,) int
        Annotated frames that it covers.

    Returns
    -------
    (2, n) float
        Clearance of the line of sight from the scenelet's furniture, metres, and 1 where the
        true pieces hide the joint, else 0. No joint if a piece is a metre from any true one.
    """
    claimed = [o.moved(place) for o in scenelet.objects]
    meant = [min(truth.objects, key=lambda t: _between(t, o), default=o) for o in claimed]
    if not claimed or max(map(_between, meant, claimed)) > _STANDS_FOR:
        return np.empty((2, 0))
    joints = truth.joints[frames][:, list(DETECTED)]
    camera = truth.camera.to_world(np.zeros(3))
    clearance, real = (
        sight_clearance(camera, joints, pack_boxes(pieces)) for pieces in (claimed, meant)
    )
    elsewhere = np.asarray(truth.hidden)[frames][:, list(DETECTED)] & (real >= 0)
    return np.stack([clearance, real < 0])[:, ~elsewhere]


def _between(one: SceneObject, other: SceneObject) -> float:
    """Metres on the floor."""
    return float(np.linalg.norm((one.centre - other.centre)[:2]))
