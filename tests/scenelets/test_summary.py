"""The tables of a library."""

from __future__ import annotations

import numpy as np
from rich.table import Table

from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.scenelets.figures import action_table, furniture_table
from tests.scenelets.motions import box, standing


def small_library() -> Library:
    chair, table = box("chair"), box("table", y=1.0)
    return Library(
        "small",
        (
            Scenelet("sit-0", "sit", standing(11), (chair, table)),
            Scenelet("sit-1", "sit", standing(21), (chair, chair)),
            Scenelet("walk-0", "walk", standing(11), ()),
        ),
    )


def words(table: Table) -> list[list[str]]:
    """Header and rows."""
    columns = [[str(c.header), *map(str, c.cells)] for c in table.columns]
    return [list(row) for row in zip(*columns, strict=True)]


def test_actions_are_counted_and_measured() -> None:
    rows = words(action_table(small_library(), np.array([0.4, 0.6, 0.0])))
    assert rows[1:] == [
        ["sit", "2", "2", "1.0 to 2.0", "0.50", "0.42 to 0.58"],
        ["walk", "1", "0", "1.0", "0.00", "0.00 to 0.00"],
        ["all", "3", "2", "1.0 to 2.0", "0.40", "0.08 to 0.56"],
    ]


def test_furniture_counts_once_a_scenelet() -> None:
    rows = words(furniture_table(small_library()))
    assert rows == [["category", "sit", "all"], ["chair", "2", "2"], ["table", "1", "1"]]


def test_a_library_without_furniture_has_an_empty_table() -> None:
    bare = Library("bare", (small_library()[2],))
    assert words(furniture_table(bare)) == [["category", "all"]]
