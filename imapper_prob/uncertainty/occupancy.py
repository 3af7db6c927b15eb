"""Occupancy: the probability by category that furniture covers a cell of the floor.

Objects have no identity across draws, but positions on the floor do. Every draw tells whether a
position is covered, and the share of draws is a probability.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.drawing import axes_for, picture_of
from imapper_prob.models.scene import SceneObject
from imapper_prob.models.text import brief

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Occupancy", "occupancy"]

Array = NDArray[np.float64]

_REACH: Final = 500
"""Largest distance in cells from the middle of the grid: 50 m at the usual cell size. Furniture
farther away is left out, because the grid would need too much memory."""


@dataclass(frozen=True)
class Occupancy:
    """Probability that positions on the floor are covered.

    Parameters
    ----------
    x : (X,) float
        Centres of the cells, metres.
    y : (Y,) float
        Centres of the cells, metres.
    cell : float
        Side of a cell, metres.
    categories : tuple of C str
        In alphabetical order.
    by_category : (C, Y, X) float
        Probability that an object of the category covers the centre of the cell.
    anything : (Y, X) float
        Probability that any object does. Not the sum, because a chair may stand under a table.
    """

    x: Array
    y: Array
    cell: float
    categories: tuple[str, ...]
    by_category: Array
    anything: Array

    __repr__ = brief

    def at(self, x: float, y: float) -> dict[str, float]:
        """Probability of each category at a position in metres, in descending order.

        The values are those of the nearest cell centre; 0 outside the grid.

        Parameters
        ----------
        x, y : float
            Metres.

        Returns
        -------
        dict of str to float
        """
        gap_x, gap_y = np.abs(self.x - x), np.abs(self.y - y)
        if not gap_x.size or max(gap_x.min(), gap_y.min()) > self.cell:
            return dict.fromkeys(self.categories, 0.0)
        found = self.by_category[:, gap_y.argmin(), gap_x.argmin()]
        order = np.argsort(-found, kind="stable")
        return {self.categories[k]: float(found[k]) for k in order}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the map from above; the saturation of a cell is the probability that it is covered.

        The hue is that of the most probable category; the legend has the largest probability of
        each category.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            If not given, the axes of a new figure.

        Returns
        -------
        matplotlib.axes.Axes

        Examples
        --------
        >>> axes = posterior.occupancy().plot()
        >>> [text.get_text() for text in axes.get_legend().get_texts()]
        [...'couch, highest p: ...]
        """
        from imapper_prob.uncertainty.drawing import draw_occupancy

        axes = axes_for(ax, size=(5.6, 4.6))
        draw_occupancy(axes, self)
        return axes

    def _repr_html_(self) -> str:
        """The map from above and a text, for notebooks."""
        return f"<p>{escape(repr(self))}</p>{picture_of(self.plot, size=(5.6, 4.6))}"


def occupancy(draws: Sequence[Sequence[SceneObject]], *, cell: float = 0.1) -> Occupancy:
    """Compute the occupancy of a grid over draws.

    Parameters
    ----------
    draws : sequence of N sequences of SceneObject
        Furniture of each draw in the world frame; at least one draw.
    cell : float
        Side of a cell, metres. Cell centres are whole multiples of it. The grid contains every
        footprint, except those farther than 500 cells from the middle.

    Returns
    -------
    Occupancy
    """
    if not draws or cell <= 0:
        raise ValueError("occupancy needs a draw and cells of a positive size")
    categories = tuple(sorted({o.label for objects in draws for o in objects}))
    footprints = [o.footprint for objects in draws for o in objects]
    if not footprints:
        nothing = np.zeros((0, 0))
        return Occupancy(np.zeros(0), np.zeros(0), cell, (), np.zeros((0, 0, 0)), nothing)
    corners = np.concatenate(footprints)
    middle = np.median(corners, axis=0)
    low = np.maximum(corners.min(0), middle - _REACH * cell)
    high = np.minimum(corners.max(0), middle + _REACH * cell)
    first = np.floor(low / cell).astype(int)
    last = np.ceil(high / cell).astype(int)
    x, y = (cell * np.arange(a, b + 1) for a, b in zip(first, last, strict=True))
    counts = np.zeros((len(categories), len(y), len(x)))
    total = np.zeros((len(y), len(x)))
    for objects in draws:
        covered = np.zeros(counts.shape, bool)
        for o in objects:
            _cover(covered[categories.index(o.label)], o, x, y)
        counts += covered
        total += covered.any(0)
    n = len(draws)
    return Occupancy(x, y, cell, categories, counts / n, total / n)


def _cover(cells: NDArray[np.bool_], o: SceneObject, x: Array, y: Array) -> None:
    """Mark the cells (Y, X) whose centres lie in the footprint of an object."""
    footprint = o.footprint
    low, high = footprint.min(0), footprint.max(0)
    columns = slice(*np.searchsorted(x, (low[0], high[0] + 1e-9)))
    rows = slice(*np.searchsorted(y, (low[1], high[1] + 1e-9)))
    origin, along, across = footprint[0], footprint[1] - footprint[0], footprint[3] - footprint[0]
    dx, dy = x[columns] - origin[0], (y[rows] - origin[1])[:, None]
    inside = np.ones((dy.shape[0], dx.shape[0]), bool)
    for side in (along, across):
        share = (dx * side[0] + dy * side[1]) / (side @ side)
        inside &= (share >= 0) & (share <= 1)
    cells[rows, columns] |= inside
