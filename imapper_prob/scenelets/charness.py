"""Charness: how informative a motion is about the furniture around it.

Monszpart et al. (2019, section 4). Motions have descriptors that do not depend on place, heading
and speed. Furniture has histograms over cells around the person. A motion is characteristic if
similar motions have similar histograms: sitting implies a seat below, walking implies nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.distance import cdist

from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.models.skeleton import (
    LANK,
    LELB,
    LHIP,
    LKNE,
    LSHO,
    LWRI,
    PELV,
    RANK,
    RELB,
    RHIP,
    RKNE,
    RSHO,
    RWRI,
)

__all__ = [
    "CELL",
    "EDGES",
    "KERNEL_WIDTH",
    "N_FEATURES",
    "N_SAMPLES",
    "categories",
    "charness",
    "charness_maps",
    "descriptor_distances",
    "joint_line_distances",
    "motion_descriptors",
    "motion_distances",
    "object_histograms",
    "similarity",
]

Array = NDArray[np.float64]
N_SAMPLES: Final = 15
"""Number of samples along a motion (Monszpart et al. 2019)."""
SAMPLE_SPREAD: Final = 2.33
"""Standard deviation, in samples, of the Gaussian weight about the middle sample (ibid.)."""
FROM_VERTICAL: Final = (RANK, LANK, RKNE, LKNE, RSHO, LSHO, RWRI, LWRI)
"""Joints whose distances from the vertical line through the pelvis are features."""
FROM_LINES: Final = (
    (RANK, RHIP, LHIP),
    (LANK, RHIP, LHIP),
    (RWRI, RHIP, LHIP),
    (LWRI, RHIP, LHIP),
    (RELB, RSHO, RWRI),
    (LELB, LSHO, LWRI),
)
"""For each feature a joint, and the two joints that define its line."""
N_FEATURES: Final = len(FROM_VERTICAL) + len(FROM_LINES)


def joint_line_distances(joints: Array) -> Array:
    """Features of poses: distances of joints from lines.

    Parameters
    ----------
    joints : (..., 16, 3) float
        Metres, z up.

    Returns
    -------
    (..., 14) float
        Metres.
    """
    from_pelvis = joints[..., FROM_VERTICAL, :2] - joints[..., None, PELV, :2]
    joint, first, second = (joints[..., list(index), :] for index in zip(*FROM_LINES, strict=True))
    along = second - first
    along /= np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-9)
    away = joint - first
    away -= (away * along).sum(-1, keepdims=True) * along
    distances = [np.linalg.norm(from_pelvis, axis=-1), np.linalg.norm(away, axis=-1)]
    return np.concatenate(distances, axis=-1)


def motion_descriptors(motions: Sequence[Array]) -> Array:
    """Compute the descriptors of all motions, in time linear in the number of frames.

    Parameters
    ----------
    motions : sequence of L arrays (n, 16, 3)
        Joints in metres, z up; at least two frames each.

    Returns
    -------
    (L, 15, 14) float
        Metres. The fifteen samples are evenly spaced along the trajectory in the space of the
        fourteen features and the pelvis, so that speed does not matter; where nothing moves, evenly
        in time.
    """
    lengths = np.array([len(m) for m in motions])
    joints = np.concatenate([np.asarray(m, float) for m in motions])
    features = joint_line_distances(joints)
    trajectory = np.concatenate([features, joints[:, PELV]], axis=1)
    steps = np.linalg.norm(np.diff(trajectory, axis=0, prepend=trajectory[:1]), axis=1)
    first = np.concatenate([[0], np.cumsum(lengths)[:-1]])
    # A minimum step keeps the trajectory length increasing where nothing moves.
    steps = np.maximum(steps, 1e-9)
    steps[first] = 0.0
    walked = np.cumsum(steps)
    own = np.repeat(np.arange(len(lengths)), lengths)
    walked -= walked[first][own]
    way = walked / walked[first + lengths - 1][own]
    # One interpolation for all motions: motion l has parameters [2 l, 2 l + 1].
    at = 2.0 * np.arange(len(lengths))[:, None] + np.linspace(0.0, 1.0, N_SAMPLES)
    columns = [np.interp(at, way + 2.0 * own, column) for column in features.T]
    return np.stack(columns, axis=-1)


def descriptor_distances(one: Array, other: Array | None = None) -> Array:
    """Distances between motions: root mean square over features and weighted samples.

    Parameters
    ----------
    one : (L, 15, 14) float
        Descriptors by :func:`motion_descriptors`.
    other : (M, 15, 14) float, optional
        ``one`` if not given.

    Returns
    -------
    (L, M) float
        Metres.
    """
    a = _weighted(one)
    b = a if other is None else _weighted(other)
    # Not by a product of matrices, whose last bits depend on the number of threads.
    distances: Array = cdist(a, b)
    return distances


def _weighted(descriptors: Array) -> Array:
    """(L, 210) vectors whose Euclidean distances are the weighted distances."""
    offset = (np.arange(N_SAMPLES) - N_SAMPLES // 2) / SAMPLE_SPREAD
    weight = np.exp(-0.5 * offset**2)
    weight /= weight.sum() * N_FEATURES
    flat: Array = (descriptors * np.sqrt(weight)[:, None]).reshape(len(descriptors), -1)
    return flat


# ------------------------------------------------------------------------------------------------
# Furniture histograms: a grid of five by five cells, aligned with the person's facing direction.
#
# A cell contains the largest overlap with an object of the category, relative to the smaller of
# both areas. The paper does not give the cell size; with half a metre the grid covers the reach of
# a person in the middle cell.

CELL: Final = 0.5
"""Side of a cell in metres."""
EDGES: Final = CELL * (np.arange(6) - 2.5)
"""(6,) edges of the cells in the local frame, metres: of columns along x, of rows along y."""


def categories(scenelets: Iterable[Scenelet]) -> tuple[str, ...]:
    """All object labels, sorted.

    Parameters
    ----------
    scenelets : iterable of Scenelet

    Returns
    -------
    tuple of str
    """
    return tuple(sorted({label for s in scenelets for label in s.labels}))


def object_histograms(scenelets: Sequence[Scenelet], labels: Sequence[str]) -> Array:
    """Overlap of furniture with the cells around the person, by category.

    Parameters
    ----------
    scenelets : sequence of L Scenelet
    labels : sequence of C str
        Categories; objects of other categories are left out.

    Returns
    -------
    (L, C, 5, 5) float
        In [0, 1]; rows from behind the person to the front, columns from left to right. Areas are
        those of the bounding rectangles of objects, computed exactly.
    """
    histograms = np.zeros((len(scenelets), len(labels), 5, 5))
    column = {label: i for i, label in enumerate(labels)}
    objects = [
        (i, column[o.label], o) for i, s in enumerate(scenelets) for o in s.objects
        if o.label in column
    ]  # fmt: skip
    if not objects:
        return histograms
    footprints = shapely.polygons(np.stack([o.footprint for _, _, o in objects]))
    cells = shapely.box(EDGES[None, :-1], EDGES[:-1, None], EDGES[None, 1:], EDGES[1:, None])
    shared = shapely.area(shapely.intersection(footprints[:, None, None], cells))
    smaller = np.minimum(shapely.area(footprints), CELL**2)
    overlap = shared / smaller[:, None, None]
    owner = np.array([(i, c) for i, c, _ in objects])
    np.maximum.at(histograms, (owner[:, 0], owner[:, 1]), np.clip(overlap, 0.0, 1.0))
    return histograms


# ------------------------------------------------------------------------------------------------
# Charness.

KERNEL_WIDTH: Final = 0.04
"""Standard deviation in metres of the kernel over descriptor distances: twice the median distance
of a built-in scenelet to its nearest neighbour. The optimum is flat: between .035 and .06 the
charness of i3DB's sitting and reaching windows exceeds that of walking ones in 95 or 96 of 100
pairs. (The paper has 13, in units that it does not state.)"""


def motion_distances(library: Library) -> Array:
    """(L, L) distances in metres between the motions of a library.

    Parameters
    ----------
    library : Library

    Returns
    -------
    (L, L) float
    """
    return descriptor_distances(motion_descriptors([s.joints for s in library]))


def charness_maps(distances: Array, histograms: Array, weights: ArrayLike) -> Array:
    """Mean furniture histograms of the motions similar to each motion.

    Parameters
    ----------
    distances : (M, L) float
        Distances from M motions to the L motions of a library, metres.
    histograms : (L, C, 5, 5) float
        Of :func:`~imapper_prob.scenelets.charness.object_histograms`.
    weights : (L,) float
        :attr:`~imapper_prob.models.scenelet.Scenelet.weight` of each scenelet.

    Returns
    -------
    (M, C, 5, 5) float
        Mean over library motions, weighted by similarity.
    """
    kernel = _kernel(distances) * np.asarray(weights, float)
    kernel /= kernel.sum(1, keepdims=True)
    # As above, no product of matrices.
    maps: Array = np.einsum("ml,lcij->mcij", kernel, histograms, optimize=False)
    return maps


def charness(library: Library, distances: Array) -> Array:
    """Charness of each scenelet, (L,) in [0, 1]: the largest cell of similar motions' histograms.

    The scenelet itself is left out; otherwise a motion unlike all others would be certain of its
    own furniture.

    Parameters
    ----------
    library : Library
    distances : (L, L) float
        Result of :func:`motion_distances`.

    Returns
    -------
    (L,) float
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


_EVEN: Final = 0.1
"""Part of the probability of a proposal that is spread evenly; chosen."""


def similarity(distances: Array) -> Array:
    """(L, L) rows of probabilities of proposing another scenelet instead of one.

    A part is spread evenly, so that every exchange is possible; the rest follows the kernel.

    Parameters
    ----------
    distances : (L, L) float
        Distances between its motions, metres.

    Returns
    -------
    (L, L) float
    """
    n = len(distances)
    if n == 1:
        return np.ones((1, 1))
    others = distances.copy()
    np.fill_diagonal(others, np.inf)
    kernel = _kernel(others)
    even = (1.0 - np.eye(n)) / (n - 1)
    rows: Array = (1 - _EVEN) * kernel / kernel.sum(1, keepdims=True) + _EVEN * even
    return rows


def _kernel(distances: Array) -> Array:
    """Gaussian kernel in distance, relative to the nearest motion of each row."""
    nearest = distances.min(1, keepdims=True)
    kernel: Array = np.exp(-0.5 * (distances**2 - nearest**2) / KERNEL_WIDTH**2)
    return kernel
