"""Motions as points of a plane, alike near alike.

Isomap (Tenenbaum, de Silva and Langford 2000): distances are measured along chains of similar
motions, then laid out by classical scaling. How often the ten nearest neighbours of a point do
the same as it does, mean over sitting, standing, walking and reaching in the built-in library,
and the mean silhouette: .80 and .53, against .77 and .42 for principal components of the
weighted descriptors (the same as classical scaling of their distances) and .78 and .48 for
diffusion maps of the kernel (width .08 m); .90 is what the descriptors themselves reach
without being flattened.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.sparse import csr_array
from scipy.sparse.csgraph import minimum_spanning_tree, shortest_path

__all__ = ["embed"]

Array = NDArray[np.float64]

_NEIGHBOURS: Final = 15
"""Similar motions each is linked with; from 10 to 20 the picture is the same."""
_CLOSEST: Final = 1e-9
"""Metres: equal motions are linked too, where a graph would take 0 for no link."""


def embed(distances: Array) -> Array:
    """Points of a plane.

    Parameters
    ----------
    distances : (L, L) float
        Between motions, metres; see
        :func:`~imapper_prob.scenelets.charness.motion_distances`.

    Returns
    -------
    (L, 2) float
        Metres along chains of similar motions, centred; the first axis is the longer. The
        same distances give the same points: the farthest one on each axis is positive.
    """
    n = len(distances)
    if n < 3:
        # Nothing can be bent: one motion, or two at their distance.
        first = np.arange(n) * distances[0, -1]
        return np.column_stack([first - first.mean(), np.zeros(n)])
    squared = _along_chains(distances) ** 2
    inner = -0.5 * (squared - squared.mean(0) - squared.mean(1)[:, None] + squared.mean())
    values, vectors = eigh(inner, subset_by_index=[n - 2, n - 1])
    points = (vectors * np.sqrt(np.maximum(values, 0.0)))[:, ::-1]
    farthest = points[np.abs(points).argmax(0), [0, 1]]
    oriented: Array = points * np.where(farthest < 0, -1.0, 1.0)
    return oriented


def _along_chains(distances: Array) -> Array:
    """(L, L) metres along the shortest chains of neighbours."""
    n = len(distances)
    lengths = np.maximum(distances, _CLOSEST)
    np.fill_diagonal(lengths, 0.0)
    # The spanning tree links what neighbours alone would leave in pieces.
    links = minimum_spanning_tree(csr_array(lengths)).toarray()
    nearest = np.argsort(distances, axis=1, kind="stable")[:, : _NEIGHBOURS + 1]
    rows = np.arange(n)[:, None]
    links[rows, nearest] = lengths[rows, nearest]
    chains: Array = shortest_path(csr_array(np.maximum(links, links.T)), directed=False)
    return chains
