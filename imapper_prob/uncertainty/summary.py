"""Texts and tables that summarise a posterior."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.table import Table
from rich.text import Text
from scipy.optimize import linear_sum_assignment
from xarray import Dataset

from imapper_prob.layouts import group_of
from imapper_prob.models.scene import Clip, SceneObject, Truth
from imapper_prob.models.text import as_probability, counted, in_markdown, shortened, with_error
from imapper_prob.sampling.ensembles import describe_refinement
from imapper_prob.sampling.sample import Samples
from imapper_prob.uncertainty.checks import Check
from imapper_prob.uncertainty.scenes import WeightedScene

__all__ = [
    "check_table", "describe", "distances_to_truth", "object_rows",
    "object_table", "scene_table",
]  # fmt: skip

Array = NDArray[np.float64]

_LISTED = 4
"""Layouts listed in a table row."""


def scene_table(scenes: Sequence[WeightedScene]) -> Table:
    """A table of scenes with their probabilities and the numbers of their layouts.

    Parameters
    ----------
    scenes : sequence of WeightedScene

    Returns
    -------
    rich.table.Table
    """
    table = Table(title="Scenes", title_justify="left")
    for name in ("", "probability", "objects", "layouts"):
        table.add_column(name, justify="left" if name == "objects" else "right")
    for number, weighted in enumerate(scenes, 1):
        table.add_row(
            str(number),
            with_error(weighted.probability, weighted.error),
            counted(weighted.names),
            shortened(weighted.layouts, most=_LISTED),
        )
    return table


def object_rows(posterior_summary: Dataset) -> list[dict[str, Any]]:
    """Rows of the table of objects over all draws, one mapping per object.

    Parameters
    ----------
    posterior_summary : Dataset
        The result of `Posterior.summary`.

    Returns
    -------
    list of dict
    """
    names = list(posterior_summary.data_vars)
    count = posterior_summary.sizes["object"]
    values = {str(name): posterior_summary[name].values.tolist() for name in names}
    return [{name: column[k] for name, column in values.items()} for k in range(count)]


def object_table(rows: Sequence[Mapping[str, Any]], truth: Truth | None = None) -> Table:
    """A table of objects over all draws: presence, position, and distance from the truth.

    Parameters
    ----------
    rows : sequence of mapping
        Rows of :func:`object_rows`.
    truth : Truth, optional
        If known, distances to it are shown.

    Returns
    -------
    rich.table.Table
    """
    caption = (
        'Over all draws; ± is a standard deviation, of "there" the Monte-Carlo error. After a '
        "name: the probability that it is right, if the object is there."
    )
    table = Table(title="Objects", title_justify="left", caption=caption, caption_justify="left")
    table.add_column()
    for name in ("there", "right x\n[m]", "away y\n[m]", "facing\n[°]"):
        table.add_column(Text(name), justify="right", no_wrap=True)
    errors = None
    if truth is not None:
        table.add_column(Text("to truth\n[m]"), justify="right", no_wrap=True)
        places = np.array([[row["x"], row["y"]] for row in rows]).reshape(-1, 2)
        errors = _distances([str(row["label"]) for row in rows], places, truth.objects)
    for k, row in enumerate(rows):
        name, sure = str(row["label"]), float(row["label_probability"])
        yaw = round(np.degrees(row["yaw"])) % 360
        turned = f"{yaw} ± {np.degrees(row['yaw_sd']):.0f}"
        cells = [
            name if sure == 1 else f"{name} {as_probability(sure)}",
            with_error(row["presence"], row["presence_error"]),
            f"{row['x']:.2f} ± {row['x_sd']:.2f}",
            f"{row['y']:.2f} ± {row['y_sd']:.2f}",
            turned,
        ]
        if errors is not None:
            cells.append("absent" if np.isnan(errors[k]) else f"{errors[k]:.2f}")
        table.add_row(*cells)
    return table


def distances_to_truth(found: Sequence[SceneObject], true: Sequence[SceneObject]) -> Array:
    """Horizontal distances of objects to the true objects they are matched with.

    Parameters
    ----------
    found, true : sequence of SceneObject
        In one world frame.

    Returns
    -------
    (n_found,) float
        Metres; NaN without a match.
    """
    places = np.array([o.centre[:2] for o in found]).reshape(-1, 2)
    return _distances([o.label for o in found], places, true)


def _distances(labels: Sequence[str], places: Array, true: Sequence[SceneObject]) -> Array:
    """Distances (n_found,) for labels and positions (n_found, 2) on the floor, metres."""
    result = np.full(len(labels), np.nan)
    if not labels or not true:
        return result
    gap = places[:, None] - [o.centre[:2] for o in true]
    distance = np.linalg.norm(gap, axis=-1)
    other = np.array([[group_of(label) != group_of(t.label) for t in true] for label in labels])
    rows, columns = linear_sum_assignment(np.where(other, 1e6, distance))
    for row, column in zip(rows, columns, strict=True):
        if not other[row, column]:
            result[row] = distance[row, column]
    return result


def check_table(checks: Iterable[Check]) -> Table:
    """A table of checks with values and limits.

    Parameters
    ----------
    checks : iterable of Check

    Returns
    -------
    rich.table.Table
    """
    table = Table(title="Checks", title_justify="left")
    for name in ("", "found", "limit", "alarmed"):
        table.add_column(name, justify="left" if not name else "right")
    for check in checks:
        found = "–" if math.isnan(check.value) else f"{check.value:.2g}"
        limit = "–" if math.isnan(check.limit) else f"{check.limit:.2g}"
        table.add_row(check.name, found, limit, "YES" if check.alarmed else "no")
    return table


def describe(clip: Clip, samples: Samples, *, verdict: str, alarms: Sequence[str] = ()) -> str:
    """Markdown text at the head of a recording: its content, and how reliable it is.

    Parameters
    ----------
    clip : Clip
    samples : Samples
    verdict : str
        Verdict on convergence.
    alarms : sequence of str
        Alarms, which come first.

    Returns
    -------
    str
    """
    chains, draws = samples.shape
    doubt = f" The focal length is assumed (± {100 * clip.focal_spread:.0f} %)."
    focal = "" if clip.focal_known else doubt
    first = "".join(f"**{sentence}**\n\n" for sentence in alarms)
    return (
        f"{first}**{in_markdown(clip.name)}** - furniture and motion from 2D joints, "
        "as a posterior.\n\n"
        f"{chains} chains, {draws} draws each. {verdict} "
        f"{describe_refinement(samples.walked)}{focal}"
    )
