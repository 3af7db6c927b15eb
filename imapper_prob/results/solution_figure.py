"""Pictures of the staged solution: charness over time, and the candidates at its maxima.

The figures save or show themselves; matplotlib's current figure is left alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from imapper_prob.colours import category_colour
from imapper_prob.models.posterior import empty_state, motion
from imapper_prob.models.scene import SceneObject
from imapper_prob.models.skeleton import PELV
from imapper_prob.results.solved import Solved
from imapper_prob.sampling.layouts import placed_objects
from imapper_prob.staged.combine import state_of
from imapper_prob.staged.shortlist import Fate, MaximumTable, Shortlisted
from imapper_prob.staged.solver import Solution

__all__ = ["candidate_figure", "charness_figure"]

Array = NDArray[np.float64]

_INK: Final = "#2b2f36"
_QUIET: Final = "#7d848f"
_LINES: Final = "#dcdfe4"
_ACCENT: Final = "#e15759"
_COLUMNS: Final = 4
_AROUND: Final = 1.6
"""Metres of floor shown to each side of a candidate: its furniture and a step or two."""


def charness_figure(solved: Solved) -> Figure:
    """Charness over the clip by actor, the maxima that were chosen and those that were not.

    Grey bands are frames whose pose was filled in, red ones detections that the path leaves.
    """
    figure = Figure(figsize=(11, 0.8 + 2.6 * len(solved.actors)), layout="constrained")
    rows = figure.subplots(len(solved.actors), 1, sharex=True, sharey=True, squeeze=False)
    for axes, actor in zip(rows[:, 0], solved.actors, strict=True):
        _charness(axes, actor)
        name = f", {actor.clip.tracks[0].name}" if len(solved.actors) > 1 else ""
        _title(axes, f"{solved.clip.name}{name}: how characteristic the motion is of furniture")
    rows[0, 0].legend(
        frameon=False, fontsize=8, labelcolor=_INK, ncols=4, loc="lower right",
        bbox_to_anchor=(1, 1),
    )  # fmt: skip
    rows[-1, 0].set_xlabel("frame", color=_INK)
    return figure


def _charness(axes: Axes, actor: Solution) -> None:
    ids, curve = actor.clip.frame_ids, actor.curve
    frames = ids[curve.centres]
    for flags, colour in ((actor.frames.filled, _QUIET), (actor.frames.outlier, _ACCENT)):
        for first, last in _runs(flags):
            axes.axvspan(ids[first] - 0.5, ids[last] + 0.5, color=colour, alpha=0.15, lw=0)
    axes.plot(frames, curve.raw, ".", ms=3, color=_QUIET, label="best fits of a window")
    axes.plot(frames, curve.values, color=_INK, lw=1.6, label="smoothed")
    for dropped, inside, label in ((False, _ACCENT, "maximum"), (True, "white", "dropped")):
        peaks = [p for p in curve.peaks if bool(p.dropped) == dropped]
        axes.plot(
            [frames[p.window] for p in peaks], [p.charness for p in peaks],
            "o", ms=7, color=_ACCENT, markerfacecolor=inside, label=label,
        )  # fmt: skip
    axes.set_ylim(bottom=0)
    axes.set_xlim(ids[0] - 0.5, ids[-1] + 0.5)
    axes.set_ylabel("charness", color=_QUIET)
    _tidy(axes)


def candidate_figure(solved: Solved) -> Figure:
    """The best candidates at each maximum in top view, one panel a maximum.

    The person's way through the clip is the thin line, the maximum's part of it thick; grey
    outlines are the true furniture, where it is known.
    """
    panels = [(actor, table) for actor in solved.actors for table in actor.shortlists if table.rows]
    rows = max(1, -(-len(panels) // _COLUMNS))
    figure = Figure(figsize=(3.4 * _COLUMNS, 0.6 + 3.5 * rows), layout="constrained")
    figure.suptitle(f"{solved.clip.name}: candidates at the maxima", color=_INK, fontsize=12)
    grid = figure.subplots(rows, _COLUMNS, squeeze=False).ravel()
    truth = solved.clip.truth.objects if solved.clip.truth is not None else ()
    for axes, (actor, table) in zip(grid, panels, strict=False):
        _candidates(axes, actor, table, truth)
        if len(solved.actors) > 1:
            axes.set_title(f"{actor.clip.tracks[0].name}, {axes.get_title(loc='left')}", loc="left",
                           fontsize=10, color=_INK)  # fmt: skip
    for axes in grid[len(panels) :]:
        axes.set_axis_off()
    return figure


def _candidates(
    axes: Axes, actor: Solution, table: MaximumTable, truth: Sequence[SceneObject]
) -> None:
    kept = [row for row in table.rows if row.fate is Fate.KEPT]
    centre = int(actor.curve.centres[table.window])
    way = motion(actor.problem, empty_state(actor.problem))[:, PELV]
    stretch = way[max(0, centre - 8) : centre + 9]
    for o in truth:
        axes.add_patch(Polygon(o.footprint, fill=False, edgecolor=_QUIET, lw=1.2, ls="--"))
    # The best on top.
    for rank, row in reversed(list(enumerate(kept))):
        for o in _furniture(actor, row):
            red, green, blue = (part / 255 for part in category_colour(o.label))
            axes.add_patch(
                Polygon(
                    o.footprint, facecolor=(red, green, blue, 0.12 if rank else 0.45),
                    edgecolor=(red, green, blue), lw=1.0 if rank else 2.0,
                )
            )  # fmt: skip
            front = o.placement.apply(np.array([[0.0, 0.0, 0.0], [0.0, 0.25, 0.0]]))
            axes.plot(*front[:, :2].T, color=(red, green, blue), lw=1.0 if rank else 2.0)
    axes.plot(*way[:, :2].T, color=_LINES, lw=1)
    axes.plot(*stretch[:, :2].T, color=_INK, lw=2.4, solid_capstyle="round")
    words = [
        f"{', '.join(actor.library[r.candidate.scenelet].labels)} {r.candidate.gain:+.0f} nat"
        for r in kept
    ]
    axes.text(
        0.03, 0.03, "\n".join(words), transform=axes.transAxes, fontsize=8, color=_INK, va="bottom"
    )
    middle = kept[0].candidate.placement if kept else stretch.mean(0)
    axes.set_xlim(middle[0] - _AROUND, middle[0] + _AROUND)
    axes.set_ylim(middle[1] - _AROUND, middle[1] + _AROUND)
    axes.set_aspect("equal")
    _tidy(axes)
    _title(axes, f"frame {actor.clip.frame_ids[centre]}")


def _furniture(actor: Solution, row: Shortlisted) -> list[SceneObject]:
    alone = state_of(actor.problem, [row.candidate])
    return [o for _, o in placed_objects(alone, actor.library)]


def _runs(flags: NDArray[np.bool_]) -> Iterable[tuple[int, int]]:
    """First and last index of every run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    return [(int(a), int(b) - 1) for a, b in edges.reshape(-1, 2)]


def _tidy(axes: Axes) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(_LINES)
    axes.tick_params(colors=_QUIET, labelsize=8)


def _title(axes: Axes, text: str) -> None:
    axes.set_title(text, fontsize=10, color=_INK, loc="left")
