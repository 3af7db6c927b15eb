"""Pictures of results over the truth, and of whether uncertainties hold.

Figures save or show themselves; matplotlib's current figure is left alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import binom
from shapely import get_coordinates

from imapper_prob.colours import category_colour
from imapper_prob.evaluate.outline import Outline
from imapper_prob.evaluate.posterior_score import PosteriorScore
from imapper_prob.evaluate.prediction import Prediction
from imapper_prob.evaluate.truth import TruthInView
from imapper_prob.models.skeleton import PELV

__all__ = ["coverage_figure", "top_view_figure"]

Array = NDArray[np.float64]

_INK: Final = "#2b2f36"
_QUIET: Final = "#9aa0aa"
_PELVIS: Final = "#f28e2b"
_JOINTS: Final = "#4e79a7"
_HIDDEN: Final = "#76b7b2"
_OBJECTS: Final = "#e15759"
_ARROW: Final = 0.35
"""Metres from the centre of a seat to the tip of the arrow that shows its front."""
_PANEL: Final = 3.2
"""Inches."""


def top_view_figure(truth: TruthInView, predictions: Sequence[Prediction]) -> Figure:
    """Each prediction over the truth, seen from above with the camera at the bottom.

    True furniture is grey, darker where somebody uses it; the true walk is a grey line.
    """
    columns = min(len(predictions), 4)
    rows = -(-len(predictions) // columns)
    figure = Figure((_PANEL * columns, _PANEL * rows + 0.3), layout="constrained")
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for axes, prediction in zip(panels.flat, predictions, strict=False):
        for k, item in enumerate(truth.objects):
            shade = 0.28 if k in truth.used else 0.1
            axes.fill(*_edge(item), color=_INK, alpha=shade, linewidth=0)
        axes.plot(*_walk(truth.joints), color=_QUIET, linewidth=1.2)
        axes.plot(*_walk(prediction.joints), color=_INK, linewidth=0.9)
        for item in prediction.objects:
            _draw(axes, item)
        axes.set_title(prediction.name, fontsize=8, color=_INK)
        axes.set_aspect("equal")
        axes.tick_params(labelsize=6)
    for axes in panels.flat[len(predictions) :]:
        axes.set_visible(False)
    figure.suptitle(f"{truth.name}: metres to the right of the camera and ahead", fontsize=9)
    return figure


def coverage_figure(scores: Sequence[PosteriorScore]) -> Figure:
    """Stated probability of regions against the share of truths in them; ranks of distance.

    The band is where 90 % of such shares lie for as many independent objects, if stated
    probabilities are right. On the right, bars of even height are right: high ones on the left
    say that draws are too far away, on the right too near.
    """
    figure = Figure((8.4, 4.0), layout="constrained")
    axes, bars = figure.subplots(1, 2)
    stated = np.linspace(0, 1, 101)
    objects = np.concatenate([s.object_ranks for s in scores])
    if len(objects):
        low, high = (binom.ppf(q, len(objects), stated) / len(objects) for q in (0.05, 0.95))
        axes.fill_between(stated, low, high, color=_OBJECTS, alpha=0.15, linewidth=0)
    axes.plot(stated, stated, color=_QUIET, linewidth=0.8)
    for name, ranks, colour in (
        ("objects", objects, _OBJECTS),
        ("pelvis", np.concatenate([s.pelvis_ranks for s in scores]), _PELVIS),
        ("joints", np.concatenate([s.joint_ranks for s in scores]), _JOINTS),
        ("hidden joints", np.concatenate([s.hidden_ranks for s in scores]), _HIDDEN),
    ):
        if len(ranks):
            share = (ranks[:, None] < stated).mean(0)
            axes.plot(stated, share, color=colour, label=f"{name} ({len(ranks)})")
    axes.set_xlabel("stated probability of a region", fontsize=8)
    axes.set_ylabel("share of the truths in it", fontsize=8)
    axes.legend(fontsize=7, frameon=False, loc="upper left")
    axes.set_aspect("equal")
    distances = np.concatenate([s.distance_ranks for s in scores])
    bars.hist(distances, bins=20, range=(0, 1), color=_PELVIS)
    bars.axhline(len(distances) / 20, color=_QUIET, linewidth=0.8)
    bars.set_xlabel("share of the draws nearer to the camera than the true pelvis", fontsize=8)
    bars.set_ylabel("frames", fontsize=8)
    for each in (axes, bars):
        each.tick_params(labelsize=7)
    return figure


def _draw(axes: Axes, item: Outline) -> None:
    colour = tuple(c / 255 for c in category_colour(item.label))
    x, y = item.centre
    axes.fill(*_edge(item), facecolor=(*colour, 0.25), edgecolor=colour, linewidth=1.2)
    if item.has_front:
        tip = _ARROW * np.array([-np.sin(item.yaw), np.cos(item.yaw)])
        axes.annotate(
            "", (x + tip[0], y + tip[1]), (x, y),
            arrowprops={"arrowstyle": "->", "color": colour, "shrinkA": 0, "shrinkB": 0},
        )  # fmt: skip
    axes.text(x, y, item.label, fontsize=5.5, ha="center", va="center", color=_INK)


def _edge(item: Outline) -> tuple[Array, Array]:
    x, y = get_coordinates(item.hull).T
    return x, y


def _walk(joints: Array) -> tuple[Array, Array]:
    """The pelvis in top view, without the frames that nobody knows."""
    pelvis = joints[:, PELV, :2]
    x, y = pelvis[np.isfinite(pelvis).all(1)].T
    return x, y
