"""A library in tables."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD
from rich.table import Table

from imapper_prob.models.scenelet import Library
from imapper_prob.scenelets.object_histograms import categories

__all__ = ["action_table", "furniture_table"]

Array = NDArray[np.float64]


def action_table(library: Library, charness: Array) -> Table:
    """What people do: how many scenelets, how long they are, how characteristic.

    Parameters
    ----------
    library : Library
    charness : (L,) float
        Of :func:`~imapper_prob.scenelets.charness.charness`.
    """
    table = _table("What people do")
    table.add_column("action")
    for name in ("scenelets", "with furniture", "length [s]", "charness", "middle 80 %"):
        table.add_column(name, justify="right")
    seconds = np.array([(s.n_frames - 1) / s.fps for s in library])
    furnished = np.array([bool(s.objects) for s in library])
    actions = np.array([s.action for s in library])
    for action in (*_by_count(actions), None):
        chosen = actions == action if action is not None else np.full(len(library), True)
        if action is None:
            table.add_section()
        low, middle, high = np.quantile(charness[chosen], (0.1, 0.5, 0.9))
        table.add_row(
            action if action is not None else "all",
            str(chosen.sum()),
            str(furnished[chosen].sum()),
            _span(seconds[chosen]),
            f"{middle:.2f}",
            f"{low:.2f} to {high:.2f}",
        )
    return table


def furniture_table(library: Library) -> Table:
    """In how many scenelets of each action each category of furniture stands."""
    actions = _by_count(np.array([s.action for s in library if s.objects], dtype=np.str_))
    table = _table("Scenelets with furniture")
    table.add_column("category")
    for action in (*actions, "all"):
        table.add_column(action, justify="right")
    for label in categories(library):
        at = [s.action for s in library if label in s.labels]
        counts = [at.count(action) for action in actions]
        table.add_row(label, *(str(n) if n else "·" for n in counts), str(len(at)))
    return table


def _table(title: str) -> Table:
    """Narrow enough for a terminal of eighty columns."""
    return Table(
        title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False
    )


def _by_count(words: NDArray[np.str_]) -> list[str]:
    """Distinct words, the most frequent first."""
    names, counts = np.unique(words, return_counts=True)
    return [str(n) for n in names[np.argsort(-counts, kind="stable")]]


def _span(values: Array) -> str:
    low, high = f"{values.min():.1f}", f"{values.max():.1f}"
    return low if low == high else f"{low} to {high}"
