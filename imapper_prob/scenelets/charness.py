"""How much a motion says about the furniture around it.

Charness (Monszpart et al. 2019, section 4) is high where similar motions come with the same
object: sitting implies a seat, walking implies nothing. Here an object's place is taken as
given by its scenelet, and the share of similar motions that have an object of the category
is measured over the whole library.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scenelet import Library
from imapper_prob.models.skeleton import SCORED

__all__ = ["charness", "motion_distances", "similarity"]

Array = NDArray[np.float64]

_SAMPLES = 5
"""Moments of a scenelet that are compared, evenly spaced in time."""


def motion_distances(library: Library) -> Array:
    """(L, L) root mean square distance in metres between the joints of two scenelets.

    Joints are compared in the local frames at five evenly spaced moments.
    """
    rows = []
    for scenelet in library:
        at = np.linspace(0, scenelet.n_frames - 1, _SAMPLES).round().astype(int)
        rows.append(scenelet.joints[at][:, list(SCORED)].ravel())
    features = np.stack(rows)
    squared = (features**2).sum(1)
    squared = squared[:, None] + squared[None] - 2 * features @ features.T
    result: Array = np.sqrt(np.maximum(squared, 0.0) / (_SAMPLES * len(SCORED)))
    return result


def _kernel(distances: Array) -> Array:
    """Gaussian in distance; its width is the median distance to the third nearest motion."""
    ranked = np.sort(distances, axis=1)
    width = max(float(np.median(ranked[:, min(3, len(ranked) - 1)])), 1e-3)
    kernel: Array = np.exp(-0.5 * (distances / width) ** 2)
    return kernel


def charness(library: Library, distances: Array) -> Array:
    """(L,) in [0, 1]: over categories, the largest share of similar motions that have one."""
    labels = sorted({label for s in library for label in s.labels})
    has = np.array([[label in s.labels for label in labels] for s in library], float)
    kernel = _kernel(distances)
    if not labels:
        return np.zeros(len(library))
    largest: Array = ((kernel @ has) / kernel.sum(1, keepdims=True)).max(1)
    return largest


def similarity(distances: Array) -> Array:
    """(L, L) rows of probabilities of trying another scenelet in place of one.

    By the motion kernel, one part in ten spread evenly so that every exchange is possible.
    """
    n = len(distances)
    if n == 1:
        return np.ones((1, 1))
    kernel = _kernel(distances)
    np.fill_diagonal(kernel, 0.0)
    kernel += 1e-12
    np.fill_diagonal(kernel, 0.0)
    even = (1.0 - np.eye(n)) / (n - 1)
    rows: Array = 0.9 * kernel / kernel.sum(1, keepdims=True) + 0.1 * even
    return rows
