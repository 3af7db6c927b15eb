"""The answer of a run in sentences and tables."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray
from rich.table import Table
from scipy.optimize import linear_sum_assignment

from imapper_prob.layouts import group_of
from imapper_prob.models.scene import Clip, SceneObject, Truth
from imapper_prob.sampling.placements import describe_agreement
from imapper_prob.sampling.sample import Samples
from imapper_prob.uncertainty.checks import Check
from imapper_prob.uncertainty.scenes import WeightedScene

__all__ = [
    "check_table", "describe", "distances_to_truth", "furniture", "object_table", "scene_table",
]  # fmt: skip

Array = NDArray[np.float64]

_LISTED = 4
"""Layouts named in a row of a table."""


def scene_table(scenes: Sequence[WeightedScene]) -> Table:
    """Scenes with their probabilities, and the numbers of the layouts in them.

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
            f"{weighted.probability:.2f} ± {weighted.error:.2f}",
            furniture(weighted),
            _shortened(weighted.layouts),
        )
    return table


def furniture(weighted: WeightedScene) -> str:
    """The objects of a scene, counted.

    Parameters
    ----------
    weighted : WeightedScene

    Returns
    -------
    str
    """
    labels = [o.label for o in weighted.scene.objects]
    counted = [f"{labels.count(n)} {n}" for n in dict.fromkeys(labels)]
    return ", ".join(counted) or "none"


def _shortened(layouts: Sequence[int]) -> str:
    """The first layouts of a scene, and how many more there are."""
    listed = ", ".join(map(str, layouts[:_LISTED]))
    more = len(layouts) - _LISTED
    return f"{listed} and {more} more" if more > 0 else listed


def object_table(weighted: WeightedScene, truth: Truth | None = None) -> Table:
    """Objects of one scene: where they stand, how sure that is, how far from the truth.

    Parameters
    ----------
    weighted : WeightedScene
    truth : Truth, optional

    Returns
    -------
    rich.table.Table
    """
    table = Table(title="Objects of scene 1", title_justify="left")
    for name in ("", "x [m]", "y [m]", "± [cm]", "facing [°]"):
        table.add_column(name, justify="left" if not name else "right")
    errors = None
    if truth is not None:
        table.add_column("from truth [cm]", justify="right")
        errors = distances_to_truth(weighted.scene.objects, truth.objects)
    for k, o in enumerate(weighted.scene.objects):
        spread = 100 * np.sqrt(np.trace(weighted.covariances[k]) / 2)
        row = [
            o.label,
            f"{o.centre[0]:.2f}",
            f"{o.centre[1]:.2f}",
            f"{spread:.0f}",
            f"{np.degrees(o.placement.yaw) % 360:.0f}",
        ]
        if errors is not None:
            row.append("not there" if np.isnan(errors[k]) else f"{100 * errors[k]:.0f}")
        table.add_row(*row)
    return table


def distances_to_truth(found: Sequence[SceneObject], true: Sequence[SceneObject]) -> Array:
    """Distances in top view to the true objects that objects are paired with.

    Parameters
    ----------
    found, true : sequence of SceneObject
        In one world.

    Returns
    -------
    (n_found,) float
        Metres; NaN without a partner.
    """
    result = np.full(len(found), np.nan)
    if not found or not true:
        return result
    gap = np.array([o.centre[:2] for o in found])[:, None] - [o.centre[:2] for o in true]
    distance = np.linalg.norm(gap, axis=-1)
    other = np.array([[group_of(f.label) != group_of(t.label) for t in true] for f in found])
    rows, columns = linear_sum_assignment(np.where(other, 1e6, distance))
    for row, column in zip(rows, columns, strict=True):
        if not other[row, column]:
            result[row] = distance[row, column]
    return result


def check_table(checks: Iterable[Check]) -> Table:
    """What was checked of the result, what was found, and from where on it is alarming.

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
    """Markdown that heads the recording: what it is of, and how far to trust it.

    Parameters
    ----------
    clip : Clip
    samples : Samples
    verdict : str
        On the chains.
    alarms : sequence of str
        Said first.

    Returns
    -------
    str
    """
    chains, draws = samples.shape
    doubt = f" The focal length is assumed (± {100 * clip.focal_spread:.0f} %)."
    focal = "" if clip.focal_known else doubt
    first = "".join(f"**{sentence}**\n\n" for sentence in alarms)
    return (
        f"{first}**{clip.name}** - furniture and motion from 2D joints, as a posterior.\n\n"
        f"{chains} chains, {draws} draws each. {verdict} "
        f"{describe_agreement(samples.agreements)}{focal}"
    )
