"""Charness: how much a motion says about the furniture around it.

Monszpart et al. (2019, section 4). Motions have descriptors that do not depend on place, heading
and speed. Furniture has histograms over cells around the person. A motion is characteristic where
similar motions have similar histograms: sitting implies a seat below, walking implies nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

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
"""Moments along a motion (Monszpart et al. 2019)."""
SAMPLE_SPREAD: Final = 2.33
"""Standard deviation, in samples, of the weight that falls off from the middle one (ibid.)."""
FROM_VERTICAL: Final = (RANK, LANK, RKNE, LKNE, RSHO, LSHO, RWRI, LWRI)
"""Joints whose distance from the vertical through the pelvis counts."""
FROM_LINES: Final = (
    (RANK, RHIP, LHIP),
    (LANK, RHIP, LHIP),
    (RWRI, RHIP, LHIP),
    (LWRI, RHIP, LHIP),
    (RELB, RSHO, RWRI),
    (LELB, LSHO, LWRI),
)
"""A joint, and the two joints its line goes through."""
N_FEATURES: Final = len(FROM_VERTICAL) + len(FROM_LINES)


def joint_line_distances(joints: Array) -> Array:
    """Distances of joints from lines.

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
    """Descriptors of motions, all at once; linear in the number of frames.

    Parameters
    ----------
    motions : sequence of L arrays (n, 16, 3)
        Joints in metres, z up; at least two frames each.

    Returns
    -------
    (L, 15, 14) float
        Metres. The fifteen moments are evenly spaced along the trajectory in the space of
        the fourteen features and the pelvis, so that a slow motion is described as a fast
        one; where nothing moves, evenly in time.
    """
    lengths = np.array([len(m) for m in motions])
    joints = np.concatenate([np.asarray(m, float) for m in motions])
    features = joint_line_distances(joints)
    trajectory = np.concatenate([features, joints[:, PELV]], axis=1)
    steps = np.linalg.norm(np.diff(trajectory, axis=0, prepend=trajectory[:1]), axis=1)
    first = np.concatenate([[0], np.cumsum(lengths)[:-1]])
    # The smallest of steps keeps the way increasing where nothing moves.
    steps = np.maximum(steps, 1e-9)
    steps[first] = 0.0
    walked = np.cumsum(steps)
    own = np.repeat(np.arange(len(lengths)), lengths)
    walked -= walked[first][own]
    way = walked / walked[first + lengths - 1][own]
    # One interpolation for all: motion l lives on [2 l, 2 l + 1].
    at = 2.0 * np.arange(len(lengths))[:, None] + np.linspace(0.0, 1.0, N_SAMPLES)
    columns = [np.interp(at, way + 2.0 * own, column) for column in features.T]
    return np.stack(columns, axis=-1)


def descriptor_distances(one: Array, other: Array | None = None) -> Array:
    """Distances between motions: root mean square over features and weighted samples.

    Parameters
    ----------
    one : (L, 15, 14) float
        Of :func:`motion_descriptors`.
    other : (M, 15, 14) float, optional
        ``one`` itself if not given.

    Returns
    -------
    (L, M) float
        Metres.
    """
    a = _weighted(one)
    b = a if other is None else _weighted(other)
    squared = (a**2).sum(1)[:, None] + (b**2).sum(1) - 2.0 * a @ b.T
    if other is None:
        np.fill_diagonal(squared, 0.0)
    distances: Array = np.sqrt(np.maximum(squared, 0.0))
    return distances


def _weighted(descriptors: Array) -> Array:
    """(L, 210) such that plain Euclidean distances are the weighted ones."""
    offset = (np.arange(N_SAMPLES) - N_SAMPLES // 2) / SAMPLE_SPREAD
    weight = np.exp(-0.5 * offset**2)
    weight /= weight.sum() * N_FEATURES
    flat: Array = (descriptors * np.sqrt(weight)[:, None]).reshape(len(descriptors), -1)
    return flat


# ------------------------------------------------------------------------------------------------
# Histograms of furniture: a grid of five by five cells that faces where the person faces.
#
# A cell holds the largest overlap of an object of its category with it, as part of the smaller of
# the two areas. The paper does not give the size of a cell; half a metre lets the grid cover what
# is within reach of the person in the middle one.

CELL: Final = 0.5
"""Side of a cell in metres."""
EDGES: Final = CELL * (np.arange(6) - 2.5)
"""(6,) edges of the cells in metres: of columns along x, of rows along y, local frame."""


def categories(scenelets: Iterable[Scenelet]) -> tuple[str, ...]:
    """All labels of objects there are, sorted.

    Parameters
    ----------
    scenelets : iterable of Scenelet

    Returns
    -------
    tuple of str
    """
    return tuple(sorted({label for s in scenelets for label in s.labels}))


def object_histograms(scenelets: Sequence[Scenelet], labels: Sequence[str]) -> Array:
    """Overlap of furniture with the cells around the person.

    Parameters
    ----------
    scenelets : sequence of L Scenelet
    labels : sequence of C str
        Categories; objects of others are left out.

    Returns
    -------
    (L, C, 5, 5) float
        In [0, 1]; rows from behind the person to the front, columns from left to right.
        The area is exact, that of the bounding rectangle of each object.
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
"""Standard deviation in metres of the kernel over distances of descriptors: twice the median
distance of a built-in scenelet from the next. The optimum is flat: between .035 and .06 the
charness of i3DB's sitting and reaching windows exceeds that of walking ones in 95 or 96 of 100
pairs. (The paper has 13, in units that it does not name.)"""


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


def charness_maps(
    distances: Array, histograms: Array, weights: ArrayLike, *, width: float = KERNEL_WIDTH
) -> Array:
    """What stands where around people who move like this.

    Parameters
    ----------
    distances : (M, L) float
        From M motions to the L of a library, metres.
    histograms : (L, C, 5, 5) float
        Of :func:`~imapper_prob.scenelets.charness.object_histograms`.
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


def similarity(distances: Array) -> Array:
    """(L, L) rows of probabilities of trying another scenelet in place of one.

    By the motion kernel, one part in ten spread evenly so that every exchange is possible.

    Parameters
    ----------
    distances : (L, L) float
        Between its motions, metres.

    Returns
    -------
    (L, L) float
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
