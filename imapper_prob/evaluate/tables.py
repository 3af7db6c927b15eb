"""Scores as rows: on the screen, in Markdown and in JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.table import Table

from imapper_prob.evaluate.paired import Difference
from imapper_prob.evaluate.pose import SUBSETS
from imapper_prob.evaluate.posterior_score import PosteriorScore
from imapper_prob.evaluate.score import Score, Summary
from imapper_prob.evaluate.spread import Coverage

__all__ = [
    "as_json", "coverage_rows", "difference_rows", "markdown_table", "number", "object_rows",
    "pair_rows", "pose_rows", "posterior_rows", "screen_table", "without_nan",
]  # fmt: skip

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
    "presence: Brier / nats",
)  # fmt: skip
COVERAGE_COLUMNS = ("truths", "region", "share in it", "90 % if independent", "count")

Rows = list[tuple[str, ...]]


def number(value: float, digits: int = 0) -> str:
    """A number, or a dash where there is none."""
    return "–" if math.isnan(value) else f"{value:.{digits}f}"


def object_rows(summaries: Sequence[Summary]) -> Rows:
    """A row a method, :data:`OBJECT_COLUMNS` first."""
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
    """World cm / local cm / pixels, a row a method."""
    rows: Rows = [POSE_COLUMNS]
    for s in summaries:
        cells = (
            " / ".join(number(v, d) for v, d in zip(s.pose[name], (1, 1, 0), strict=True))
            for name in SUBSETS
        )
        rows.append((s.name, _clips(s), *cells, str(s.left_out)))
    return rows


def pair_rows(scores: Sequence[Score]) -> Rows:
    """Every true object that has a partner, with it."""
    rows: Rows = [PAIR_COLUMNS]
    for s in scores:
        for pair in s.objects.pairs:
            cells = (number(100 * pair.distance), number(pair.yaw))
            rows.append((s.name, s.clip, pair.truth.label, pair.found.label, *cells))
    return rows


def difference_rows(differences: Sequence[Difference]) -> Rows:
    """Object by object, misses counting as a metre."""
    rows: Rows = [DIFFERENCE_COLUMNS]
    for d in differences:
        interval = f"{d.low:+.0f} to {d.high:+.0f}" if d.objects else "–"
        mean = f"{d.mean:+.0f}" if d.objects else "–"
        rows.append((d.name, d.other, mean, interval, str(d.objects)))
    return rows


def posterior_rows(posteriors: Sequence[PosteriorScore]) -> Rows:
    """How far draws are from the truth, and how honest their probabilities."""
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
                f"{p.found:.0%}",
                f"{p.claimed} of {p.true}",
                f"{number(p.counts[0], 2)} / {number(p.counts[1], 1)}",
                f"{number(p.presence[0], 2)} / {number(p.presence[1], 2)}",
            )
        )
    return rows


def coverage_rows(found: Mapping[str, Sequence[Coverage]]) -> Rows:
    """How often regions hold the truth."""
    rows: Rows = [COVERAGE_COLUMNS]
    for name, regions in found.items():
        for c in regions:
            share = f"{c.share:.2f}" if c.count else "–"
            interval = f"{c.low:.2f} to {c.high:.2f}"
            rows.append((name, f"{c.region:.0%}", share, interval, str(c.count)))
    return rows


def _clips(summary: Summary) -> str:
    return summary.clips[0] if len(summary.clips) == 1 else f"{len(summary.clips)} clips"


def screen_table(rows: Rows, *, title: str) -> Table:
    """For a console."""
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD)
    for k, name in enumerate(rows[0]):
        table.add_column(name, justify="left" if k < 2 else "right")
    for row in rows[1:]:
        table.add_row(*row)
    return table


def markdown_table(rows: Rows) -> str:
    """For a page."""
    lines = ["| " + " | ".join(cells) + " |" for cells in rows]
    rule = "|" + "|".join("---" if k < 2 else "---:" for k in range(len(rows[0]))) + "|"
    return "\n".join([lines[0], rule, *lines[1:]])


def as_json(scores: Sequence[Score], summary: Summary) -> dict[str, Any]:
    """A method's summary, and its objects one by one; numbers that do not exist are null."""
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


def without_nan(value: Any) -> Any:
    """The same with ``None`` for numbers that JSON does not have."""
    if isinstance(value, dict):
        return {key: without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [without_nan(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
