"""Tables for a console."""

from __future__ import annotations

from io import StringIO

from rich.console import Console
from rich.table import Table

from imapper_prob.evaluate.tables import screen_table


def printed(table: Table) -> list[str]:
    file = StringIO()
    Console(width=80, file=file).print(table)
    return [line.rstrip() for line in file.getvalue().splitlines() if line.strip()]


def test_what_all_rows_share_is_in_the_title() -> None:
    heads = ("", "clips", "cm")
    one = ("one", "Scene04", "3")
    alike = screen_table([heads, one, ("two", "Scene04", "4")], title="T")
    assert alike.title == "T, Scene04"
    assert [column.header for column in alike.columns] == ["", "cm"]
    apart = screen_table([heads, one, ("two", "Scene10", "4")], title="T")
    assert apart.title == "T"
    assert [column.header for column in apart.columns] == ["", "clips", "cm"]


def test_many_columns_become_rows_and_no_word_is_lost() -> None:
    measures = tuple(f"measure-{k}" for k in range(12))
    rows = [("", *measures), ("method", *(f"value-{k}" for k in range(12)))]
    text = printed(screen_table(rows, title="T"))
    for k, measure in enumerate(measures):
        (line,) = (line.split() for line in text if line.split()[0] == measure)
        assert line == [measure, f"value-{k}"]
