"""Draw occupancy maps and regions of objects on matplotlib axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.patches import Ellipse

from imapper_prob.models.drawing import INK, name_axes_of_floor, rgb, show_legend, write_name
from imapper_prob.models.text import as_probability, with_error
from imapper_prob.plotting import category_colour
from imapper_prob.uncertainty.clusters import LEAST_NAMED, ObjectCluster, names_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from imapper_prob.uncertainty.occupancy import Occupancy

__all__ = ["draw_clusters", "draw_occupancy"]

_REGIONS: Final = ((0.5, "-"), (0.9, "--"))
"""Shares of draws inside the ellipses, and their line styles."""
_TOLD: Final = 0.05
"""Least probability of a label in the legend."""


def draw_occupancy(axes: Axes, occupancy: Occupancy) -> None:
    """Draw an occupancy map from above, with a legend of categories.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    occupancy : Occupancy
    """
    if occupancy.categories:
        hue = np.array([rgb(category_colour(c)) for c in occupancy.categories])
        kind = occupancy.by_category.argmax(0)
        picture = 1 - occupancy.anything[..., None] * (1 - hue[kind])
        half = occupancy.cell / 2
        x, y = occupancy.x, occupancy.y
        edges = (x[0] - half, x[-1] + half, y[0] - half, y[-1] + half)
        axes.imshow(picture, origin="lower", extent=edges, interpolation="nearest")
    for category, colour, share in zip(
        occupancy.categories, map(category_colour, occupancy.categories),
        occupancy.by_category.max((1, 2), initial=0), strict=True,
    ):  # fmt: skip
        label = f"{category}, highest p: {as_probability(share)}"
        axes.scatter([], [], marker="s", color=rgb(colour), label=label)
    name_axes_of_floor(axes)
    show_legend(axes, below=True)


def draw_clusters(axes: Axes, clusters: Sequence[ObjectCluster]) -> None:
    """Draw the positions of objects, and the ellipses that hold 50 and 90 % of them.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    clusters : sequence of ObjectCluster
    """
    for cluster, name in zip(clusters, names_of(clusters), strict=True):
        _draw_regions(axes, cluster, name)
    for share, style in _REGIONS if clusters else ():
        label = f"{100 * share:.0f} % of the draws"
        axes.plot([], [], color=INK, ls=style, lw=1.4, label=label)
    axes.autoscale_view()
    name_axes_of_floor(axes)
    show_legend(axes, below=True)


def _draw_regions(axes: Axes, cluster: ObjectCluster, name: str) -> None:
    colour = rgb(category_colour(cluster.label))
    faint = float(np.clip(cluster.presence, 0.2, 1.0))
    told = f"{name}, p = {with_error(cluster.presence, cluster.presence_error)}"
    shares = [
        f"{label} {as_probability(share)}"
        for label, share in cluster.labels.items()
        if share >= _TOLD
    ]
    if len(shares) > 1:
        told = f"{told}\n({', '.join(shares[:2])})"
    x, y = cluster.positions.T
    axes.scatter(x, y, s=3, color=colour, alpha=0.25 * faint, lw=0)
    for share, style in _REGIONS:
        region = cluster.region(share)
        middle = (float(region.centre[0]), float(region.centre[1]))
        width, height = (2 * region.half_axes).tolist()
        turn = float(np.degrees(region.angle))
        axes.add_patch(
            Ellipse(
                middle, width, height, angle=turn, fill=False, ec=colour, ls=style, lw=1.4,
                alpha=faint, label=told if style == "-" else None,
            )
        )  # fmt: skip
    if cluster.presence >= LEAST_NAMED:
        write_name(axes, cluster.mean, name)
