"""Scores as tables and figures, with the commit that made them."""

from __future__ import annotations

import math
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD
from rich.table import Table
from scipy.stats import binom
from shapely import get_coordinates

from imapper_prob.evaluate.prediction import Prediction
from imapper_prob.evaluate.probability import PosteriorScore
from imapper_prob.evaluate.regions import Coverage
from imapper_prob.evaluate.score import SUBSETS, Difference, Score, Summary
from imapper_prob.evaluate.truth import Outline, TruthInView
from imapper_prob.files import without_nan
from imapper_prob.models.drawing import INK, rgb
from imapper_prob.models.skeleton import PELV
from imapper_prob.models.text import in_markdown
from imapper_prob.plotting import category_colour

__all__ = [
    "as_json",
    "commit",
    "coverage_figure",
    "coverage_rows",
    "difference_rows",
    "made_by",
    "markdown_table",
    "number",
    "object_rows",
    "pair_rows",
    "pose_rows",
    "posterior_rows",
    "screen_table",
    "top_view_figure",
]


def made_by(command: str) -> dict[str, str]:
    """Program, commit and command that made a result.

    Parameters
    ----------
    command : str

    Returns
    -------
    dict of str to str
    """
    return {
        "program": f"imapper-prob {version('imapper-prob')}",
        "commit": commit(),
        "command": command,
    }


def commit() -> str:
    """Commit of the source folder, followed by + if files differ from it, or ``unknown``.

    Returns
    -------
    str
    """
    here = Path(__file__).parent
    try:
        head = _git(here, "rev-parse", "--short=10", "HEAD")
        changed = _git(here, "status", "--porcelain", "--untracked-files=no")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return head + ("+" if changed else "")


def _git(folder: Path, *arguments: str) -> str:
    done = subprocess.run(
        ["git", "-C", str(folder), *arguments], capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


# ------------------------------------------------------------------------------------------------
# Rows, for the screen, Markdown and JSON.

OBJECT_COLUMNS = (
    "", "clips", "error (sd), cm", "seats, cm", "with misses, cm", "found within 1 m", "by chance",
    "spurious", "yaw, °", "seats' yaw, °", "IoU",
)  # fmt: skip
PAIR_COLUMNS = ("", "clip", "true", "taken for it", "distance, cm", "yaw, °")
POSE_COLUMNS = ("", "clips", *SUBSETS, "joints not predicted")
DIFFERENCE_COLUMNS = ("", "less", "cm", "90 % of bootstraps", "objects")
POSTERIOR_COLUMNS = (
    "run", "clip", "draws", "furniture: first / best of 5, cm", "expected / energy score, cm",
    "joints: expected / energy score, cm", "found within 1 m, mean of draws", "claimed, > 50 %",
    "counts: Brier / nats",
    "presence: Brier / nats", "labels: right / expected / nats",
)  # fmt: skip
COVERAGE_COLUMNS = ("truths", "region", "share in it", "expected in 90 % of cases", "count")
Rows = list[tuple[str, ...]]


def number(value: float, digits: int = 0) -> str:
    """A number as text, or a dash for NaN.

    Parameters
    ----------
    value : float
    digits : int
        Digits after the decimal point.

    Returns
    -------
    str
    """
    return "–" if math.isnan(value) else f"{value:.{digits}f}"


def object_rows(summaries: Sequence[Summary]) -> Rows:
    """One row a method, with :data:`OBJECT_COLUMNS` as the first row.

    Parameters
    ----------
    summaries : sequence of Summary

    Returns
    -------
    list of tuple of str
    """
    rows: Rows = [OBJECT_COLUMNS]
    for s in summaries:
        rows.append(
            (
                s.name,
                _clips(s),
                f"{number(s.error)} ({number(s.spread)})" if s.paired else "nothing to compare",
                number(s.seat_error),
                number(s.loss),
                f"{s.found} of {s.true}",
                number(s.chance * s.true, 1),
                str(s.spurious),
                number(s.yaw),
                number(s.seat_yaw),
                number(s.overlap, 2),
            )
        )
    return rows


def pose_rows(summaries: Sequence[Summary]) -> Rows:
    """Pose errors, world cm / local cm / pixels, one row a method.

    Parameters
    ----------
    summaries : sequence of Summary

    Returns
    -------
    list of tuple of str
    """
    rows: Rows = [POSE_COLUMNS]
    for s in summaries:
        cells = (
            " / ".join(number(v, d) for v, d in zip(s.pose[name], (1, 1, 0), strict=True))
            for name in SUBSETS
        )
        rows.append((s.name, _clips(s), *cells, str(s.left_out)))
    return rows


def pair_rows(scores: Sequence[Score]) -> Rows:
    """One row for every true object that has a partner.

    Parameters
    ----------
    scores : sequence of Score

    Returns
    -------
    list of tuple of str
    """
    rows: Rows = [PAIR_COLUMNS]
    for s in scores:
        for pair in s.objects.pairs:
            cells = (number(100 * pair.distance), number(pair.yaw))
            rows.append((s.name, s.clip, pair.truth.label, pair.found.label, *cells))
    return rows


def difference_rows(differences: Sequence[Difference]) -> Rows:
    """One row for each difference between two methods.

    Parameters
    ----------
    differences : sequence of Difference

    Returns
    -------
    list of tuple of str
    """
    rows: Rows = [DIFFERENCE_COLUMNS]
    for d in differences:
        interval = f"{d.low:+.0f} to {d.high:+.0f}" if d.objects else "–"
        mean = f"{d.mean:+.0f}" if d.objects else "–"
        rows.append((d.name, d.other, mean, interval, str(d.objects)))
    return rows


def posterior_rows(posteriors: Sequence[PosteriorScore]) -> Rows:
    """Errors of the draws and scores of their probabilities, one row a run.

    Parameters
    ----------
    posteriors : sequence of PosteriorScore

    Returns
    -------
    list of tuple of str
    """
    rows: Rows = [POSTERIOR_COLUMNS]
    for p in posteriors:
        rows.append(
            (
                p.name,
                p.clip,
                str(p.draws),
                f"{number(p.first)} / {number(p.best)}",
                f"{number(p.expected)} / {number(p.energy)}",
                f"{number(p.joint_expected)} / {number(p.joint_energy)}",
                "–" if math.isnan(p.found) else f"{p.found:.0%}",
                f"{p.claimed} of {p.true}",
                f"{number(p.counts[0], 2)} / {number(p.counts[1], 1)}",
                f"{number(p.presence[0], 2)} / {number(p.presence[1], 2)}",
                f"{p.labels.right} of {p.labels.count} / {number(p.labels.expected, 1)} / "
                f"{number(p.labels.logarithmic, 2)}",
            )
        )
    return rows


def coverage_rows(found: Mapping[str, Sequence[Coverage]]) -> Rows:
    """Observed coverage of regions, one row for each kind of truth and region.

    Parameters
    ----------
    found : mapping of str to sequence of Coverage

    Returns
    -------
    list of tuple of str
    """
    rows: Rows = [COVERAGE_COLUMNS]
    for name, regions in found.items():
        for c in regions:
            share = f"{c.share:.2f}" if c.count else "–"
            interval = f"{c.low:.2f} to {c.high:.2f}" if c.count else "–"
            rows.append((name, f"{c.region:.0%}", share, interval, str(c.count)))
    return rows


def _clips(summary: Summary) -> str:
    return summary.clips[0] if len(summary.clips) == 1 else f"{len(summary.clips)} clips"


def screen_table(rows: Rows, *, title: str) -> Table:
    """A table for a console, which may have 80 columns.

    Parameters
    ----------
    rows : list of tuple of str
        If all rows are of the same clips, these are in the title instead of a column. Rows become
        columns if there are fewer of them.
    title : str

    Returns
    -------
    rich.table.Table
    """
    if "clips" in rows[0]:
        at = rows[0].index("clips")
        if len(clips := {row[at] for row in rows[1:]}) == 1:
            title = f"{title}, {clips.pop()}"
            rows = [row[:at] + row[at + 1 :] for row in rows]
    if len(rows) < len(rows[0]):
        rows = list(zip(*rows, strict=True))
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=0)
    for k, name in enumerate(rows[0]):
        table.add_column(name, justify="right" if k else "left", overflow="fold")
    for row in rows[1:]:
        table.add_row(*row)
    return table


def markdown_table(rows: Rows) -> str:
    """A Markdown table.

    Parameters
    ----------
    rows : list of tuple of str
        Cells, which are shown as they are.

    Returns
    -------
    str
    """
    lines = ["| " + " | ".join(map(in_markdown, cells)) + " |" for cells in rows]
    rule = "|" + "|".join("---" if k < 2 else "---:" for k in range(len(rows[0]))) + "|"
    return "\n".join([lines[0], rule, *lines[1:]])


def as_json(scores: Sequence[Score], summary: Summary) -> dict[str, Any]:
    """A method's summary and its objects one by one, for JSON; undefined numbers are null.

    Parameters
    ----------
    scores : sequence of Score
    summary : Summary

    Returns
    -------
    dict
    """
    document = asdict(summary)
    document["pose"] = {
        name: dict(zip(("world_cm", "local_cm", "pixels"), values, strict=True))
        for name, values in summary.pose.items()
    }
    document["objects"] = [
        {
            "clip": s.clip,
            "true": pair.truth.label,
            "found": pair.found.label,
            "distance_m": pair.distance,
            "yaw_degrees": pair.yaw,
        }
        for s in scores
        for pair in s.objects.pairs
    ]
    cleaned: dict[str, Any] = without_nan(document)
    return cleaned


# ------------------------------------------------------------------------------------------------
# Figures. Functions return a figure and leave matplotlib's current figure alone.

Array = NDArray[np.float64]
_QUIET: Final = "#9aa0aa"
_PELVIS: Final = "#f28e2b"
_JOINTS: Final = "#4e79a7"
_HIDDEN: Final = "#76b7b2"
_OBJECTS: Final = "#e15759"
_ARROW: Final = 0.35
"""Length in metres of the arrow that shows the front of a seat."""
_PANEL: Final = 3.2
"""Side of a panel in inches."""


def top_view_figure(truth: TruthInView, predictions: Sequence[Prediction]) -> Figure:
    """Draw each prediction over the truth, from above with the camera at the bottom.

    True furniture is grey, darker if it is used; the true path is a grey line.

    Parameters
    ----------
    truth : TruthInView
    predictions : sequence of Prediction

    Returns
    -------
    matplotlib.figure.Figure
    """
    columns = min(len(predictions), 4)
    rows = -(-len(predictions) // columns)
    figure = Figure((_PANEL * columns, _PANEL * rows + 0.3), layout="constrained")
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for axes, prediction in zip(panels.flat, predictions, strict=False):
        for k, item in enumerate(truth.objects):
            shade = 0.28 if k in truth.used else 0.1
            axes.fill(*_edge(item), color=INK, alpha=shade, linewidth=0)
        for joints, colour, width in (
            (truth.joints, _QUIET, 1.2),
            (prediction.joints, INK, 0.9),
        ):
            for first in range(0, len(joints), len(truth.frame_ids)):
                own = joints[first : first + len(truth.frame_ids)]
                axes.plot(*_walk(own), color=colour, linewidth=width)
        for item in prediction.objects:
            _draw(axes, item)
        axes.set_title(prediction.name, fontsize=8, color=INK)
        axes.set_aspect("equal")
        axes.tick_params(labelsize=6)
    for axes in panels.flat[len(predictions) :]:
        axes.set_visible(False)
    figure.suptitle(f"{truth.name}: metres to the right of the camera and ahead", fontsize=9)
    return figure


def coverage_figure(scores: Sequence[PosteriorScore]) -> Figure:
    """Plot observed against stated coverage of regions, and a histogram of ranks of distance.

    The band contains 90 % of the observed fractions for as many independent objects if the stated
    probabilities are correct. In the histogram on the right, bars of equal height are correct; high
    bars on its left mean that draws are too far away, on its right too near.

    Parameters
    ----------
    scores : sequence of PosteriorScore

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure = Figure((8.4, 4.0), layout="constrained")
    axes, bars = figure.subplots(1, 2)
    stated = np.linspace(0, 1, 101)
    objects = np.concatenate([s.object_ranks for s in scores])
    if len(objects):
        low, high = (binom.ppf(q, len(objects), stated) / len(objects) for q in (0.05, 0.95))
        axes.fill_between(stated, low, high, color=_OBJECTS, alpha=0.15, linewidth=0)
    axes.plot(stated, stated, color=_QUIET, linewidth=0.8)
    for name, ranks, colour, style in (
        ("objects", objects, _OBJECTS, "-"),
        ("pelvis", np.concatenate([s.pelvis_ranks for s in scores]), _PELVIS, "-"),
        ("joints", np.concatenate([s.joint_ranks for s in scores]), _JOINTS, "-"),
        ("joints, given the size", np.concatenate([s.sized_ranks for s in scores]), _JOINTS, ":"),
        ("hidden joints", np.concatenate([s.hidden_ranks for s in scores]), _HIDDEN, "-"),
    ):
        if len(ranks):
            share = (ranks[:, None] < stated).mean(0)
            axes.plot(stated, share, style, color=colour, label=f"{name} ({len(ranks)})")
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
    colour = rgb(category_colour(item.label))
    x, y = item.centre
    axes.fill(*_edge(item), facecolor=(*colour, 0.25), edgecolor=colour, linewidth=1.2)
    if item.has_front:
        tip = _ARROW * np.array([-np.sin(item.yaw), np.cos(item.yaw)])
        axes.annotate(
            "", (x + tip[0], y + tip[1]), (x, y),
            arrowprops={"arrowstyle": "->", "color": colour, "shrinkA": 0, "shrinkB": 0},
        )  # fmt: skip
    axes.text(x, y, item.label, fontsize=5.5, ha="center", va="center", color=INK)


def _edge(item: Outline) -> tuple[Array, Array]:
    x, y = get_coordinates(item.hull).T
    return x, y


def _walk(joints: Array) -> tuple[Array, Array]:
    """The pelvis in top view, without frames where it is unknown."""
    pelvis = joints[:, PELV, :2]
    x, y = pelvis[np.isfinite(pelvis).all(1)].T
    return x, y
