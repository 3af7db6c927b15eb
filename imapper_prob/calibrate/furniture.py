"""Where furniture stands about a person, against what the library says of such a motion."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import Placement, SceneObject, Truth
from imapper_prob.models.scenelet import Scenelet
from imapper_prob.results.scene_distance import group_of

__all__ = ["furniture_errors"]

Array = NDArray[np.float64]

_NEAR = 1.0
"""Metres within which a true piece is the one that a scenelet speaks of, as scenes are scored."""


def furniture_errors(truth: Truth, placed: Iterable[tuple[Scenelet, Placement]]) -> Array:
    """Errors of the places that scenelets give to furniture when they stand where they should.

    Parameters
    ----------
    truth : Truth
    placed : iterable of (Scenelet, Placement)
        Scenelets nearest to the true motion, laid upon it in the world of the truth.

    Returns
    -------
    (n, 2) float
        One row for each true piece that somebody used: the mean over scenelets of how far it
        stands from where they say, along its own axes: sideways as a share of its width, and
        ahead in metres.
    """
    errors: dict[int, list[Array]] = defaultdict(list)
    for scenelet, placement in placed:
        for said in (o.moved(placement) for o in scenelet.objects):
            near = [
                (float(np.linalg.norm(o.centre[:2] - said.centre[:2])), k)
                for k, o in enumerate(truth.objects)
                if group_of(o.label) == group_of(said.label)
            ]
            distance, k = min(near, default=(np.inf, -1))
            if distance <= _NEAR:
                errors[k].append(_along_axes(truth.objects[k], said))
    return np.array([np.mean(own, axis=0) for own in errors.values()]).reshape(-1, 2)


def _along_axes(o: SceneObject, said: SceneObject) -> Array:
    low, high = o.bounds
    offset = o.placement.rotation.T @ (o.centre - said.centre)[:2]
    result: Array = offset / (high[0] - low[0], 1.0)
    return result
