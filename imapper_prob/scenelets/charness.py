"""How much a motion says about the furniture around it.

Charness (Monszpart et al. 2019, section 4) is high where similar motions come with the same
kind of object in the same place: sitting implies a seat below, walking implies nothing.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.scenelet import Library
from imapper_prob.scenelets.descriptors import descriptor_distances, motion_descriptors
from imapper_prob.scenelets.object_histograms import categories, object_histograms

__all__ = ["KERNEL_WIDTH", "charness", "charness_maps", "motion_distances", "similarity"]

Array = NDArray[np.float64]

KERNEL_WIDTH: Final = 0.04
"""Standard deviation in metres of the kernel over distances of descriptors: twice the median
distance of a built-in scenelet from the next. The optimum is flat: between .035 and .06 the
charness of i3DB's sitting and reaching windows exceeds that of walking ones in 95 or 96 of 100
pairs. (The paper has 13, in units that it does not name.)"""


def motion_distances(library: Library) -> Array:
    """(L, L) distances in metres between the motions of a library."""
    return descriptor_distances(motion_descriptors([s.joints for s in library]))


def charness_maps(
    distances: Array, histograms: Array, weights: ArrayLike, *, width: float = KERNEL_WIDTH
) -> Array:
    """What stands where around people who move like this.

    Parameters
    ----------
    distances : (M, L) float
        From M motions to the L of a library, metres.
    histograms : (L, C, 5, 5) float
        Of :func:`~imapper_prob.scenelets.object_histograms.object_histograms`.
    weights : (L,) float
        :attr:`~imapper_prob.models.scenelet.Scenelet.weight` of each scenelet.
    width : float
        Standard deviation of the Gaussian kernel, metres.

    Returns
    -------
    (M, C, 5, 5) float
        Mean of the cells over motions, weighted by how similar they are.
    """
    kernel = _kernel(distances, width) * np.asarray(weights, float)
    kernel /= kernel.sum(1, keepdims=True)
    maps: Array = np.tensordot(kernel, histograms, axes=1)
    return maps


def charness(library: Library, distances: Array) -> Array:
    """(L,) in [0, 1]: the fullest cell around people who move as each scenelet does.

    The scenelet itself does not count, or a motion unlike all others would be sure of
    whatever stood around it.

    Parameters
    ----------
    library : Library
    distances : (L, L) float
        Of :func:`motion_distances`.
    """
    labels = categories(library)
    if not labels or len(library) == 1:
        return np.zeros(len(library))
    others = distances.copy()
    np.fill_diagonal(others, np.inf)
    weights = np.array([s.weight for s in library])
    maps = charness_maps(others, object_histograms(library.scenelets, labels), weights)
    largest: Array = maps.reshape(len(maps), -1).max(1)
    return largest


def similarity(distances: Array) -> Array:
    """(L, L) rows of probabilities of trying another scenelet in place of one.

    By the motion kernel, one part in ten spread evenly so that every exchange is possible.
    """
    n = len(distances)
    if n == 1:
        return np.ones((1, 1))
    others = distances.copy()
    np.fill_diagonal(others, np.inf)
    kernel = _kernel(others, KERNEL_WIDTH)
    even = (1.0 - np.eye(n)) / (n - 1)
    rows: Array = 0.9 * kernel / kernel.sum(1, keepdims=True) + 0.1 * even
    return rows


def _kernel(distances: Array, width: float) -> Array:
    """Gaussian in distance, 1 for the nearest motion of each row: only ratios matter."""
    nearest = distances.min(1, keepdims=True)
    kernel: Array = np.exp(-0.5 * (distances**2 - nearest**2) / width**2)
    return kernel
