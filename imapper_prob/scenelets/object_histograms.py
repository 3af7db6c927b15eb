"""Where the furniture of a scenelet is, seen from the person: a grid of cells a category.

Monszpart et al. (2019, section 4): a grid of five by five cells that faces where the person
faces; a cell holds the largest overlap of an object of its category with it, as part of the
smaller of the two areas. The paper does not give the size of a cell; half a metre lets the
grid cover what is within reach of the person in the middle one.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from imapper_prob.models.scenelet import Scenelet

__all__ = ["CELL", "EDGES", "categories", "object_histograms"]

Array = NDArray[np.float64]

CELL: Final = 0.5
"""Side of a cell in metres."""

EDGES: Final = CELL * (np.arange(6) - 2.5)
"""(6,) edges of the cells in metres: of columns along x, of rows along y, local frame."""


def categories(scenelets: Iterable[Scenelet]) -> tuple[str, ...]:
    """All labels of objects there are, sorted."""
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
