"""The effect of statements on objects, camera and person, before and after."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.table import Table
from scipy.optimize import linear_sum_assignment

from imapper_prob.files import without_nan
from imapper_prob.layouts import group_of
from imapper_prob.models.skeleton import REFERENCE_STATURE
from imapper_prob.results.posterior import Posterior
from imapper_prob.sampling.conditioning import Told
from imapper_prob.uncertainty.clusters import ObjectCluster

__all__ = ["Change", "change_table", "changes", "write_changes"]

_APART = 1.5
"""Distance in metres within which an object before and one after are the same; chosen."""
_LEAST = 0.05
"""Least probability of an object, on either side, that is listed; that of tables of objects."""
_FORMAT = "imapper-prob changes 1"


@dataclass(frozen=True)
class Change:
    """One quantity before and after conditioning on statements.

    Parameters
    ----------
    what : str
        Label of an object, or name of a number.
    unit : str
        Unit of the quantity; empty for an object.
    before : float
        Probability of the object, or mean of the quantity.
    before_error : float
        Standard error of the probability, or standard deviation of the quantity; NaN if there was
        no such object.
    after, after_error : float
        The same after conditioning.
    moved : float
        Distance in metres between the mean positions; NaN if undefined.
    """

    what: str
    unit: str
    before: float
    before_error: float
    after: float
    after_error: float
    moved: float = math.nan


def changes(before: Posterior, after: Posterior) -> tuple[Change, ...]:
    """Compare two posteriors: objects in descending order of probability, then camera and person.

    Parameters
    ----------
    before, after : Posterior
        Posteriors of the same clip.

    Returns
    -------
    tuple of Change
    """
    everything = before.clusters(least=0.0), after.clusters(least=0.0)
    return (*_objects(*everything), *_numbers(before, after))


def _objects(before: Sequence[ObjectCluster], after: Sequence[ObjectCluster]) -> list[Change]:
    """Changes of objects that are likely on either side, matched by kind and position.

    Likely objects are matched with each other first, and the rest of them with unlikely ones.
    """
    first, rare_first = _split(before)
    second, rare_second = _split(after)
    pairs = _paired(first, second)
    gone = [one for one in first if not any(one is own for own, _ in pairs)]
    new = [other for other in second if not any(other is own for _, own in pairs)]
    pairs += _paired(gone, rare_second) + _paired(rare_first, new)
    found = []
    for there in second:
        earlier = next((one for one, other in pairs if other is there), None)
        found.append(_change(there.label, earlier, there))
    for one in gone:
        later = next((other for own, other in pairs if own is one), None)
        found.append(_change(one.label, one, later))
    return found


def _split(
    clusters: Sequence[ObjectCluster],
) -> tuple[list[ObjectCluster], list[ObjectCluster]]:
    """Likely and unlikely objects."""
    likely = [c for c in clusters if c.presence >= _LEAST]
    return likely, [c for c in clusters if c.presence < _LEAST]


def _paired(
    before: Sequence[ObjectCluster], after: Sequence[ObjectCluster]
) -> list[tuple[ObjectCluster, ObjectCluster]]:
    """Pairs of objects of one kind within `_APART`, with the least sum of distances."""
    far = np.array([[_distance(a, b) for b in after] for a in before])
    far = far.reshape(len(before), len(after))
    rows, columns = linear_sum_assignment(np.minimum(far, 2 * _APART))
    return [(before[b], after[a]) for b, a in zip(rows, columns, strict=True) if far[b, a] < _APART]


def _change(label: str, before: ObjectCluster | None, after: ObjectCluster | None) -> Change:
    """The change of an object, which no draw has on a side where it is None."""
    sides = [
        (0.0, math.nan) if own is None else (own.presence, own.presence_error)
        for own in (before, after)
    ]
    moved = math.nan
    if before is not None and after is not None:
        moved = float(math.dist(before.mean, after.mean))
    return Change(label, "", *sides[0], *sides[1], moved)


def _distance(one: ObjectCluster, other: ObjectCluster) -> float:
    if group_of(one.label) != group_of(other.label):
        return math.inf
    return float(math.dist(one.mean, other.mean))


def _numbers(before: Posterior, after: Posterior) -> list[Change]:
    found = []
    for number, (what, unit) in enumerate(
        (("camera pitch", "°"), ("camera height", "m"), ("focal length", "px"), ("stature", "m"))
    ):
        said = []
        for posterior in (before, after):
            values = np.array([state.camera[number] for state in posterior.samples.states])
            if number == 0:
                values = np.degrees(values)
            elif number > 1:
                unit_of = posterior.clip.camera.fx if number == 2 else REFERENCE_STATURE
                values = unit_of * np.exp(values)
            said += [float(values.mean()), float(values.std())]
        found.append(Change(what, unit, *said))
    return found


def change_table(found: Sequence[Change]) -> Table:
    """A table of the changes.

    Parameters
    ----------
    found : sequence of Change

    Returns
    -------
    rich.table.Table
    """
    table = Table(title="What changed", title_justify="left")
    table.add_column("")
    for name in ("before", "after", "moved"):
        table.add_column(name, justify="right")
    for row in found:
        places = 2 if row.unit != "px" else 0
        cells = [
            f"{value:.{places}f} ± {error:.{places}f} {row.unit}".strip()
            if not math.isnan(error)
            else f"{value:.{places}f}"
            for value, error in (
                (row.before, row.before_error),
                (row.after, row.after_error),
            )
        ]
        table.add_row(row.what, *cells, "" if math.isnan(row.moved) else f"{row.moved:.2f} m")
    return table


def write_changes(path: Path, found: Sequence[Change], told: Told | None) -> None:
    """Write the changes and the statements as JSON.

    Parameters
    ----------
    path : Path
    found : sequence of Change
    told : Told, optional
    """
    evidence = None if told is None or told.evidence is None else asdict(told.evidence)
    document = {
        "format": _FORMAT,
        "given": "" if told is None else told.text,
        "evidence": evidence,
        "changes": [asdict(change) for change in found],
    }
    text = json.dumps(without_nan(document), indent=1, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")
