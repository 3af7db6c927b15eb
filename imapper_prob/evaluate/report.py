"""The benchmark as a Markdown page: all tables, with the command that made them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from imapper_prob.evaluate.probability import LIKELY
from imapper_prob.evaluate.published import (
    OnClip,
    published_object_rows,
    published_pose_rows,
)
from imapper_prob.evaluate.score import SUBSETS, Summary
from imapper_prob.evaluate.suite import Evaluation, posterior_coverage
from imapper_prob.evaluate.tables import (
    Rows,
    coverage_rows,
    difference_rows,
    markdown_table,
    number,
    object_rows,
    pair_rows,
    pose_rows,
    posterior_rows,
)
from imapper_prob.files import written_whole

__all__ = ["Exploration", "benchmark_page", "exploration_figure", "write_page"]

AUTHORS = "authors' output"


@dataclass(frozen=True)
class Exploration:
    """Scores after the first part of each clip.

    Parameters
    ----------
    part : float
        Fraction of each clip's frames.
    summaries : list of Summary
        One for each method.
    spread : float
        Half the expected distance between the furniture of two draws, cm, mean over clips; NaN
        without draws.
    """

    part: float
    summaries: list[Summary]
    spread: float


def _exploration_rows(found: Sequence[Exploration]) -> Rows:
    """Errors and uncertainty by the fraction of the clip that was observed."""
    rows: Rows = [
        ("", "seen", "error (sd), cm", "with misses, cm", "found within 1 m", "spurious",
         "between draws, cm", "joints, all frames: world cm / local cm / pixels"),
    ]  # fmt: skip
    for exploration in found:
        for s in exploration.summaries:
            values = zip(s.pose[SUBSETS[0]], (1, 1, 0), strict=True)
            rows.append(
                (
                    s.name,
                    f"{exploration.part:.0%}",
                    f"{number(s.error)} ({number(s.spread)})",
                    number(s.loss),
                    f"{s.found} of {s.true}",
                    str(s.spurious),
                    number(exploration.spread if s.name == LIKELY else float("nan")),
                    " / ".join(number(v, d) for v, d in values),
                )
            )
    return rows


def exploration_figure(explored: Sequence[Exploration]) -> Figure:
    """Plot the scores and the spread of draws against the fraction of the clips observed.

    Parameters
    ----------
    explored : sequence of Exploration
        In order of ``part``.

    Returns
    -------
    matplotlib.figure.Figure
    """
    seen = [100 * exploration.part for exploration in explored]
    names = dict.fromkeys(s.name for exploration in explored for s in exploration.summaries)
    figure = Figure(figsize=(11.5, 3.4), layout="constrained")
    found, furniture, joints = figure.subplots(1, 3)
    for name in names:
        rows = [next(s for s in e.summaries if s.name == name) for e in explored]
        for axes, values in (
            (found, [s.found / s.true if s.true else float("nan") for s in rows]),
            (furniture, [s.loss for s in rows]),
            (joints, [s.pose[SUBSETS[0]][0] for s in rows]),
        ):
            axes.plot(seen, values, marker="o", markersize=4, label=name)
    spread = [exploration.spread for exploration in explored]
    if np.isfinite(spread).any():
        furniture.plot(seen, spread, "k--", marker="o", markersize=4, label="between draws")
    found.set(ylabel="found within 1 m, share of objects")
    furniture.set(ylabel="furniture, misses as a metre [cm]")
    joints.set(ylabel="joints in the world [cm]")
    for axes in (found, furniture, joints):
        axes.set(xlabel="seen of each clip [%]", xticks=seen)
        axes.margins(y=0.08)
        axes.set_ylim(bottom=0)
    furniture.legend(fontsize=7, frameon=False)
    return figure


def benchmark_page(
    evaluation: Evaluation,
    *,
    ours: Sequence[str],
    theirs: Sequence[str],
    made_by: Mapping[str, str],
    clips: Mapping[str, OnClip],
    explored: Sequence[Exploration] = (),
    pictures: Sequence[str] = (),
) -> str:
    """The benchmark page in Markdown.

    Parameters
    ----------
    evaluation : Evaluation
    ours, theirs : sequence of str
        Names of methods; differences are taken between the two groups.
    made_by : mapping
        Program and command.
    clips : mapping of str to OnClip
        By the name of the clip, for the paper's tables.
    explored : sequence of Exploration
        Scores on shorter parts of the clips.
    pictures : sequence of str
        Paths of figures, relative to the page.

    Returns
    -------
    str
    """
    first = [s for name in ours for s in evaluation.scores[name]]
    sections = [
        "# Benchmark\n",
        f"{made_by['program']}. Made by\n\n"
        f"    {made_by['command']}\n\n"
        "The definitions are in [metrics](metrics.md). The truth is read only here. Each scene is "
        "solved and sampled with constants that were estimated without it "
        "([calibration](calibration.md)).\n",
        "## Furniture\n",
        markdown_table(object_rows(evaluation.summaries)),
        "\nScene by scene:\n",
        markdown_table(object_rows(evaluation.one_by_one)),
        "\n## Joints\n",
        "World cm / local cm / pixels; the mean over clips.\n",
        markdown_table(pose_rows(evaluation.summaries)),
        "\nScene by scene:\n",
        markdown_table(pose_rows(evaluation.one_by_one)),
    ]
    differences = evaluation.differences(ours, theirs)
    if differences:
        sections += [
            "\n## Paired differences\n",
            "Differences object by object, a miss counting as a metre; negative is nearer.\n",
            markdown_table(difference_rows(differences)),
        ]
    if evaluation.posteriors:
        sections += [
            "\n## Coverage\n",
            markdown_table(posterior_rows(evaluation.posteriors)),
            "\nPooled over clips:\n",
            markdown_table(coverage_rows(posterior_coverage(evaluation.posteriors))),
        ]
    if explored:
        sections += ["\n## The longer the clip\n", markdown_table(_exploration_rows(explored))]
    sections += [
        "\n## The paper's tables\n",
        "Every printed figure; behind a slash, and in columns of their own, what this program says "
        "of the clips at hand. Objects (table 1), mean (standard deviation). The paper's distance "
        "of centroids can be read in top view or in space; no scene of it is reproduced by the "
        "authors' public files either way, so the printed column is not to be compared with the "
        "others. Mask-RCNN and MonoDepth are filled in from files (`--detections`, `--depths`).\n",
        markdown_table(published_object_rows(clips, ours, AUTHORS)),
        "\nPoses (table 2), world cm / local cm / pixels, frames with three hidden joints or more. "
        "The lifter's file is the input that the authors published, put into the world by them "
        "frame by frame.\n",
        markdown_table(published_pose_rows(clips, ours, AUTHORS)),
    ]
    sections += ["\n## Objects one by one\n", markdown_table(pair_rows(first))]
    sections += [f"\n![{Path(name).stem}]({name})" for name in pictures]
    return "\n".join(sections) + "\n"


def write_page(path: Path, text: str) -> None:
    """Write a page atomically.

    Parameters
    ----------
    path : Path
    text : str
    """
    with written_whole(path) as beside:
        beside.write_text(text, encoding="utf-8")
