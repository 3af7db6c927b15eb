"""A picture of why a scene is what it is: when it gains, and by what.

On the left the clip from its first frame to its last, all panels on one time axis; on the right
what every scenelet and every object is worth. The figure saves or shows itself; matplotlib's
current figure is left alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from imapper_prob.colours import Colour, action_colour, category_colour
from imapper_prob.results.energy import Explanation, Worth

__all__ = ["energy_figure"]

Array = NDArray[np.float64]

_INK: Final = "#2b2f36"
_QUIET: Final = "#7d848f"
_LINES: Final = "#dcdfe4"
_TERM_COLOURS: Final = {
    "camera": "#bab0ac",
    "layout": "#9c755f",
    "placement": "#edc948",
    "path": "#76b7b2",
    "detections": "#4e79a7",
    "free_pose": "#f28e2b",
    "reprojection": "#4e79a7",
    "occlusion": "#f28e2b",
    "smoothness": "#59a14f",
    "collision": "#b07aa1",
    "motion": "#e15759",
    "ground": "#ff9da7",
    "support": "#5f6b7a",
}
"""Hues of Tableau 10, which stay apart for most colour-blind eyes."""
_SHOWN: Final = 0.5
"""Nats below which a term has no entry in the legend: its bar could not be seen."""


def energy_figure(explanation: Explanation, *, title: str) -> Figure:
    """Draw an explanation.

    Parameters
    ----------
    explanation : Explanation
    title : str
        What the scene is of.
    """
    parts = len(explanation.scenelets) + len(explanation.objects)
    figure = Figure(figsize=(15, max(8.0, 2.5 + 0.42 * parts)), layout="constrained")
    figure.suptitle(f"{title}: why this scene?", color=_INK, fontsize=13)
    grid = figure.add_gridspec(5, 2, width_ratios=(2.1, 1), height_ratios=(0.9, 1.6, 1.6, 1, 1))
    first = figure.add_subplot(grid[0, 0])
    panels = [first, *(figure.add_subplot(grid[row, 0], sharex=first) for row in range(1, 5))]
    _scenelets(panels[0], explanation)
    _gain(panels[1], explanation)
    _sum(panels[2], explanation)
    _costs(panels[3], explanation)
    _probabilities(panels[4], explanation)
    ids = explanation.frame_ids
    first.set_xlim(ids[0] - 0.5, ids[-1] + 0.5)
    for axes in panels:
        _tidy(axes)
        for worth in explanation.scenelets:
            begin, end = _edges(worth.frames[0], ids)
            axes.axvspan(begin, end, color=_rgb(action_colour(worth.action)), alpha=0.07, lw=0)
    for axes in panels[:-1]:
        axes.tick_params(labelbottom=False)
    panels[-1].set_xlabel("frame", color=_INK)
    _worths(figure.add_subplot(grid[:, 1]), explanation)
    return figure


def _scenelets(axes: Axes, explanation: Explanation) -> None:
    """Which scenelet covers which frames, by name and worth."""
    for row, worth in enumerate(explanation.scenelets):
        begin, end = _edges(worth.frames[0], explanation.frame_ids)
        # Neighbours at two heights, so that names of short scenelets do not run together.
        height = -(row % 2)
        colour = _rgb(action_colour(worth.action))
        axes.barh(height, end - begin, left=begin, height=0.42, color=colour, lw=0)
        axes.text(
            (begin + end) / 2, height + 0.27, f"{worth.name} ({worth.total:+.0f})",
            ha="center", va="bottom", fontsize=7.5, color=_INK, clip_on=True,
        )  # fmt: skip
    axes.set(ylim=(-1.4, 0.85), yticks=[])
    _title(axes, "scenelets, and nats lost without each")


def _gain(axes: Axes, explanation: Explanation) -> None:
    """Nats by frame that the scene gains over no scenelet, stacked by term."""
    ids = explanation.frame_ids
    above, below = np.zeros(len(ids)), np.zeros(len(ids))
    for name, nats in explanation.frames.terms.items():
        gained = nats - explanation.bare_frames.terms[name]
        bottom = np.where(gained >= 0, above, below)
        axes.bar(ids, gained, bottom=bottom, width=1.0, color=_TERM_COLOURS[name], lw=0)
        above, below = above + np.maximum(gained, 0), below + np.minimum(gained, 0)
    axes.use_sticky_edges = False  # room above the highest bar
    axes.axhline(0, color=_QUIET, lw=0.8)
    axes.set_ylabel("nat a frame", color=_QUIET)
    _title(axes, "gained over no scenelet")


def _sum(axes: Axes, explanation: Explanation) -> None:
    """The same, summed from the first frame on."""
    gained = explanation.frames.total - explanation.bare_frames.total
    axes.plot(explanation.frame_ids, np.cumsum(gained), color=_INK, lw=1.4)
    axes.axhline(0, color=_QUIET, lw=0.8)
    axes.set_ylabel("nat", color=_QUIET)
    _title(axes, "gained so far: what has to pay for path, placement and layout")


def _costs(axes: Axes, explanation: Explanation) -> None:
    """What the first of the terms, detections, says of each frame, with the scene and without."""
    ids, name = explanation.frame_ids, next(iter(explanation.frames.terms))
    bare, nats = explanation.bare_frames.terms[name], explanation.frames.terms[name]
    axes.plot(ids, bare, color=_QUIET, lw=1, label="no scenelet")
    axes.plot(ids, nats, color=_TERM_COLOURS[name], lw=1.4, label="scene")
    axes.set_ylabel("nat a frame", color=_QUIET)
    _title(axes, f"{name} alone")
    _legend(axes)


def _probabilities(axes: Axes, explanation: Explanation) -> None:
    """How much of the person the scene hides, and where sides look swapped."""
    ids, frames = explanation.frame_ids, explanation.frames
    axes.fill_between(ids, frames.hidden, color="#59a14f", alpha=0.35, lw=0, label="joint hidden")
    axes.plot(ids, frames.swapped, color=_TERM_COLOURS["motion"], lw=1.4, label="sides swapped")
    axes.set(ylim=(0, 1), yticks=[0, 0.5, 1])
    _title(axes, "probability")
    _legend(axes)


def _worths(axes: Axes, explanation: Explanation) -> None:
    """What each part is worth: scenelets on top, objects below, stacked by term."""
    ids = explanation.frame_ids
    names: list[str] = []
    seen: set[str] = set()
    row = 0
    for heading, parts in (
        ("without the scenelet", explanation.scenelets),
        ("without the object alone", explanation.objects),
    ):
        names.append(heading)
        axes.text(0, row, heading, ha="center", va="center", fontsize=9, color=_QUIET)
        for worth in parts:
            row += 1
            seen |= _stack(axes, worth, row)
            spans = ", ".join(f"{ids[a]}-{ids[b]}" for a, b in worth.frames)
            names.append(worth.name if worth.action else f"{worth.name} ({spans})")
        row += 1
    axes.axvline(0, color=_QUIET, lw=0.8)
    axes.set_yticks(range(len(names)), names)
    _tidy(axes)
    axes.tick_params(left=False)
    for label, part in zip(axes.get_yticklabels(), _heads_and_parts(explanation), strict=True):
        label.set_color(_INK if part is None else _rgb(_colour_of(part)))
        label.set_visible(part is not None)
    axes.set_ylim(len(names) - 0.4, -0.7)
    axes.use_sticky_edges = False  # room for the numbers beside the bars
    axes.margins(x=0.16)
    shown = [
        axes.barh(0, 0, color=_TERM_COLOURS[t], label=t.replace("_", " "))
        for t in explanation.terms
        if t in seen or t in explanation.frames.terms
    ]
    axes.legend(
        handles=shown, loc="upper center", bbox_to_anchor=(0.5, -0.05), ncols=4,
        frameon=False, fontsize=8, labelcolor=_INK,
    )  # fmt: skip
    _title(axes, "nats that the scene would lose")


def _stack(axes: Axes, worth: Worth, row: int) -> set[str]:
    """One part's bar; returns the terms that can be seen in it."""
    right = left = 0.0
    for name, value in worth.terms.items():
        start = right if value >= 0 else left
        axes.barh(row, value, left=start, height=0.62, color=_TERM_COLOURS[name], lw=0)
        right, left = right + max(value, 0), left + min(value, 0)
    axes.text(
        right,
        row,
        f" {round(worth.total, 1) + 0.0:+.1f}",
        va="center",
        fontsize=8,
        color=_INK,
        fontweight="bold",
    )
    return {name for name, value in worth.terms.items() if abs(value) >= _SHOWN}


def _heads_and_parts(explanation: Explanation) -> Sequence[Worth | None]:
    """Rows of the panel of worths; None where a heading stands."""
    return [None, *explanation.scenelets, None, *explanation.objects]


def _colour_of(worth: Worth) -> Colour:
    return action_colour(worth.action) if worth.action else category_colour(worth.name)


def _edges(span: tuple[int, int], ids: NDArray[np.int64]) -> tuple[float, float]:
    return float(ids[span[0]]) - 0.5, float(ids[span[1]]) + 0.5


def _tidy(axes: Axes) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(_LINES)
    axes.tick_params(colors=_QUIET, labelsize=8)


def _title(axes: Axes, text: str) -> None:
    axes.set_title(text, fontsize=10, color=_INK, loc="left")


def _legend(axes: Axes) -> None:
    """On the right above the panel, where no curve can run through it."""
    axes.legend(
        frameon=False, fontsize=8, labelcolor=_INK, ncols=2, loc="lower right",
        bbox_to_anchor=(1, 0.96),
    )  # fmt: skip


def _rgb(colour: Colour) -> tuple[float, float, float]:
    red, green, blue = colour
    return red / 255, green / 255, blue / 255
