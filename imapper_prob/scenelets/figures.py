"""Tables and figures of a library: embedding of motions, furniture around people, charness.

The figures are like 4 and 5 of Monszpart et al. (2019). Motions are embedded by Isomap (Tenenbaum,
de Silva and Langford 2000): distances along chains of similar motions, then classical scaling. Of
the ten nearest neighbours of a point .80 have the same action, averaged over sitting, standing,
walking and reaching in the built-in library, with a mean silhouette of .53; principal components of
the weighted descriptors give .77 and .42, diffusion maps of the kernel (width .08 m) .78 and .48,
and the descriptors themselves .90.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD
from rich.table import Table
from scipy.linalg import eigh
from scipy.sparse import csr_array
from scipy.sparse.csgraph import minimum_spanning_tree, shortest_path

from imapper_prob.models.drawing import INK, LINES, QUIET, rgb
from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.models.skeleton import HEAD, LELB, LSHO, LWRI, PELV, RELB, RSHO, RWRI
from imapper_prob.plotting import Colour, action_colour, category_colour
from imapper_prob.scenelets.charness import (
    CELL,
    EDGES,
    categories,
    charness_maps,
    object_histograms,
)

__all__ = [
    "action_table",
    "charness_figure",
    "draw_from_above",
    "embed",
    "embedding_figure",
    "furniture_figure",
    "furniture_table",
    "typical",
]

Array = NDArray[np.float64]
_NEIGHBOURS: Final = 15
"""Number of neighbours in the graph; 10 to 20 give the same embedding."""
_CLOSEST: Final = 1e-9
"""Least distance in metres, because the sparse graph treats 0 as no edge."""


def embed(distances: Array) -> Array:
    """Embed motions in the plane.

    Parameters
    ----------
    distances : (L, L) float
        Between motions, metres; see
        :func:`~imapper_prob.scenelets.charness.motion_distances`.

    Returns
    -------
    (L, 2) float
        Metres along chains of similar motions, centred; the first axis is the longer one.
        Deterministic: the farthest point on each axis is positive.
    """
    n = len(distances)
    if n < 3:
        # One motion, or two at their distance.
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
    """(L, L) lengths of the shortest paths in the neighbour graph, metres."""
    n = len(distances)
    lengths = np.maximum(distances, _CLOSEST)
    np.fill_diagonal(lengths, 0.0)
    # The spanning tree connects the graph of neighbours.
    links = minimum_spanning_tree(csr_array(lengths)).toarray()
    nearest = np.argsort(distances, axis=1, kind="stable")[:, : _NEIGHBOURS + 1]
    rows = np.arange(n)[:, None]
    links[rows, nearest] = lengths[rows, nearest]
    chains: Array = shortest_path(csr_array(np.maximum(links, links.T)), directed=False)
    return chains


# ------------------------------------------------------------------------------------------------
# Tables.


def action_table(library: Library, charness: Array) -> Table:
    """A table of actions: number of scenelets, durations and charness.

    Parameters
    ----------
    library : Library
    charness : (L,) float
        Of :func:`~imapper_prob.scenelets.charness.charness`.

    Returns
    -------
    rich.table.Table
    """
    table = _table("What people do")
    table.add_column("action")
    for name in ("scenelets", "with furniture", "length [s]", "charness", "middle 80 %"):
        table.add_column(name, justify="right")
    seconds = np.array([(s.n_frames - 1) / s.fps for s in library])
    furnished = np.array([bool(s.objects) for s in library])
    actions = np.array([s.action for s in library])
    for action in (*_by_count(actions), None):
        chosen = actions == action if action is not None else np.full(len(library), True)
        if action is None:
            table.add_section()
        low, middle, high = np.quantile(charness[chosen], (0.1, 0.5, 0.9))
        table.add_row(
            action if action is not None else "all",
            str(chosen.sum()),
            str(furnished[chosen].sum()),
            _span(seconds[chosen]),
            f"{middle:.2f}",
            f"{low:.2f} to {high:.2f}",
        )
    return table


def furniture_table(library: Library) -> Table:
    """A table of the number of scenelets by action and furniture category.

    Parameters
    ----------
    library : Library

    Returns
    -------
    rich.table.Table
    """
    actions = _by_count(np.array([s.action for s in library if s.objects], dtype=np.str_))
    table = _table("Scenelets with furniture")
    table.add_column("category")
    for action in (*actions, "all"):
        table.add_column(action, justify="right")
    for label in categories(library):
        at = [s.action for s in library if label in s.labels]
        counts = [at.count(action) for action in actions]
        table.add_row(label, *(str(n) if n else "·" for n in counts), str(len(at)))
    return table


def _table(title: str) -> Table:
    """An empty table that fits a terminal of eighty columns."""
    return Table(
        title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False
    )


def _by_count(words: NDArray[np.str_]) -> list[str]:
    """Distinct words, the most frequent first."""
    names, counts = np.unique(words, return_counts=True)
    return [str(n) for n in names[np.argsort(-counts, kind="stable")]]


def _span(values: Array) -> str:
    low, high = f"{values.min():.1f}", f"{values.max():.1f}"
    return low if low == high else f"{low} to {high}"


# ------------------------------------------------------------------------------------------------
# Figures. Each function returns one; matplotlib's current figure is not changed.

_CHARNESS_COLOURS: Final = "viridis"
_DOT: Final = 11.0
"""Area of a scenelet's dot, square points."""
_EDGE: Final = float(EDGES[-1])
"""Distance in metres from the person to the edge of the grid, and of a view from above."""
_STOPS: Final = 5
"""Number of frames in which a view from above shows the shoulders."""
_ARMS: Final = (RWRI, RELB, RSHO, LSHO, LELB, LWRI)
_VISIBLE: Final = 0.05
"""Overlap below which a category has no column, because its cells would look empty."""


def embedding_figure(library: Library, distances: Array, charness: Array) -> Figure:
    """Plot the embedded motions, coloured by charness on the left and by action on the right.

    Parameters
    ----------
    library : Library
    distances : (L, L) float
        Distances between its motions, metres.
    charness : (L,) float

    Returns
    -------
    matplotlib.figure.Figure
    """
    points = embed(distances)
    actions = np.array([s.action for s in library])
    wide, high = np.maximum(np.ptp(points, axis=0), 1e-9)
    figure = Figure(figsize=(12, 1.0 + float(np.clip(5.0 * high / wide, 2.0, 6.0))))
    figure.set_layout_engine("constrained")
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    _headline(figure, f"{len(library)} motions, alike near alike (library {library.name})")

    order = np.argsort(charness)  # the most characteristic ones on top
    dots = left.scatter(
        *points[order].T, c=charness[order], s=_DOT, lw=0, vmin=0, cmap=_CHARNESS_COLOURS
    )
    bar = figure.colorbar(dots, ax=left, location="left", shrink=0.6)
    bar.set_label("charness", color=INK)
    bar.outline.set_visible(False)  # type: ignore[operator]
    bar.ax.tick_params(colors=QUIET, labelsize=9)
    left.set_title("how much the motion says about furniture", fontsize=11, color=INK)

    for action in _by_count(actions):
        chosen = actions == action
        label = f"{action} ({chosen.sum()})"
        right.scatter(
            *points[chosen].T, s=_DOT, lw=0, color=rgb(action_colour(action)), label=label
        )
    right.legend(
        loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, labelcolor=INK, markerscale=2
    )
    right.set_title("what is done", fontsize=11, color=INK)
    for axes in (left, right):
        axes.set(aspect="equal", xticks=[], yticks=[])
        axes.spines[:].set_color(LINES)
    return figure


def furniture_figure(
    library: Library, distances: Array, chosen: Sequence[str] | None = None
) -> Figure:
    """Plot scenelets from above, with the mean furniture of similar motions.

    Parameters
    ----------
    library : Library
    distances : (L, L) float
        Distances between its motions, metres.
    chosen : sequence of str, optional
        Names of scenelets, one row each; by default those of :func:`typical`.

    Returns
    -------
    matplotlib.figure.Figure
    """
    position = {s.name: i for i, s in enumerate(library)}
    rows = [position[name] for name in (chosen or typical(library, distances))]
    labels = categories(library)
    own = object_histograms(library.scenelets, labels)
    weights = np.array([s.weight for s in library])
    around = charness_maps(distances[rows], own, weights)
    seen = np.maximum(own[rows], around).max((0, 2, 3)) >= _VISIBLE
    n_columns = 1 + int(seen.sum())
    figure = Figure(figsize=(1.45 * n_columns + 1.0, 1.6 * len(rows) + 0.9), layout="constrained")
    grid = figure.subplots(len(rows), n_columns, squeeze=False)
    _headline(figure, "What stands around people who move like this")
    figure.supxlabel(
        f"cells of {CELL:g} m around the person, who faces up; "
        "colour: overlap with furniture, mean of similar motions; squares: in this scenelet",
        color=QUIET, fontsize=9,
    )  # fmt: skip
    for axes, row in zip(grid, rows, strict=True):
        draw_from_above(axes[0], library[row])
        axes[0].set_ylabel(library[row].name, fontsize=9, color=INK)
    for column, category in zip(grid[:, 1:].T, np.flatnonzero(seen), strict=True):
        label = labels[category]
        column[0].set_title(label, fontsize=10, color=INK)
        for k, (axes, row) in enumerate(zip(column, rows, strict=True)):
            _draw_cells(axes, own[row, category], around[k, category], category_colour(label))
    grid[0, 0].set_title("from above", fontsize=10, color=INK)
    return figure


def charness_figure(library: Library, charness: Array) -> Figure:
    """Plot the charness of every scenelet by action, the most characteristic action on top.

    Parameters
    ----------
    library : Library
    charness : (L,) float

    Returns
    -------
    matplotlib.figure.Figure
    """
    actions = np.array([s.action for s in library])
    rows = sorted(set(actions.tolist()), key=lambda a: float(np.median(charness[actions == a])))
    figure = Figure(figsize=(8, 1.1 + 0.6 * len(rows)), layout="constrained")
    axes = figure.subplots()
    _headline(figure, f"How much a motion says about furniture (library {library.name})")
    for height, action in enumerate(rows):
        values = np.sort(charness[actions == action])
        colour = rgb(action_colour(action))
        if np.ptp(values) > 0:
            shape = axes.violinplot(
                values, [height], orientation="horizontal", widths=0.85, showextrema=False
            )
            for body in shape["bodies"]:  # type: ignore[attr-defined]
                body.set(facecolor=colour, alpha=0.25)
        # Values at different heights, spread deterministically by the golden ratio.
        spread = (np.arange(len(values)) * 0.618034) % 1.0 - 0.5
        axes.scatter(values, height + 0.45 * spread, s=7, lw=0, color=colour)
        axes.plot([np.median(values)] * 2, [height - 0.3, height + 0.3], color=INK, lw=2)
    axes.set_yticks(range(len(rows)), [f"{a} ({(actions == a).sum()})" for a in rows])
    axes.set_xlim(0, 1)
    axes.set_xlabel("charness (bar: median)", color=INK)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.spines["bottom"].set_color(LINES)
    axes.tick_params(colors=QUIET, labelcolor=INK, left=False)
    return figure


def typical(library: Library, distances: Array) -> list[str]:
    """Name of the most central scenelet of each action.

    Parameters
    ----------
    library : Library
    distances : (L, L) float
        Distances between its motions, metres.

    Returns
    -------
    list of str
    """
    actions = np.array([s.action for s in library])
    names = []
    for action in _by_count(actions):
        members = np.flatnonzero(actions == action)
        middle = members[distances[np.ix_(members, members)].sum(1).argmin()]
        names.append(library[int(middle)].name)
    return names


def draw_from_above(axes: Axes, scenelet: Scenelet) -> None:
    """Draw a scenelet from above: furniture, the path of the pelvis, and the person.

    Arms and head are drawn for the middle frame, in which the person faces up; for other frames
    only the shoulders, in grey.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    scenelet : Scenelet
    """
    for o in scenelet.objects:
        colour = rgb(category_colour(o.label))
        for part in sorted(o.cuboids, key=lambda c: float(c.centre[2] + c.size[2] / 2)):
            corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]) * part.size / 2
            outline = o.placement.apply(part.centre + corners)[:, :2]
            axes.add_patch(Polygon(outline, fc=(*colour, 0.25), ec=colour, lw=0.6))
    joints = scenelet.joints
    for t in np.linspace(0, scenelet.n_frames - 1, _STOPS).round().astype(int):
        axes.plot(*joints[t][[LSHO, RSHO], :2].T, color=QUIET, lw=1.2, alpha=0.7)
    axes.plot(*joints[:, PELV, :2].T, color=QUIET, lw=1)
    middle = joints[scenelet.n_frames // 2]
    axes.plot(*middle[list(_ARMS), :2].T, color=INK, lw=1.6, solid_joinstyle="round")
    axes.scatter(middle[HEAD, 0], middle[HEAD, 1], s=18, color=INK, zorder=3)
    axes.set(xlim=(-_EDGE, _EDGE), ylim=(-_EDGE, _EDGE), aspect="equal", xticks=[], yticks=[])
    axes.spines[:].set_color(LINES)


def _draw_cells(axes: Axes, own: Array, around: Array, colour: Colour) -> None:
    """Draw the grid of a category: colours for similar motions, squares for one scenelet."""
    hue = np.array(rgb(colour))
    shades = LinearSegmentedColormap.from_list("overlap", np.stack([np.ones(3), hue, 0.6 * hue]))
    axes.pcolormesh(EDGES, EDGES, around, cmap=shades, vmin=0, vmax=1, ec=LINES, lw=0.5)
    x, y = np.meshgrid((EDGES[1:] + EDGES[:-1]) / 2, (EDGES[1:] + EDGES[:-1]) / 2)
    axes.scatter(x, y, s=30 * own, marker="s", color=INK, lw=0)
    axes.scatter(0, 0, s=9, marker="^", fc="white", ec=QUIET, lw=0.6)
    axes.set(aspect="equal", xticks=[], yticks=[])
    axes.spines[:].set_visible(False)


def _headline(figure: Figure, text: str) -> None:
    figure.suptitle(text, color=INK, fontsize=12)
