"""Texts of others, and numbers with their errors, as they are shown."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import pytest

from imapper_prob.evaluate.tables import markdown_table
from imapper_prob.models.text import as_probability, in_markdown, with_error
from imapper_prob.recording.blueprint import caption, certainty_text
from imapper_prob.uncertainty.summary import describe
from tests.runs import posterior

HOSTILE = "a|b*c* <b>`d`\n[e](f)\x1b"
SHOWN = "a\\|b\\*c\\* \\<b>\\`d\\` \\[e](f)\ufffd"


@pytest.mark.parametrize(
    ("value", "error", "shown"),
    [
        (0.25, 0.034, "0.25 ± 0.03"),
        (0.9981, 0.0009, "0.998 ± 0.001"),
        (0.0406, 0.0048, "0.041 ± 0.005"),
        (0.871, 0.0051, "0.87 ± 0.01"),
        (1.0, 0.0006, "1.000 ± 0.001"),
        (1.0, 0.00031, "1.0000 ± 0.0003"),
        (0.25, 1e-15, "0.25"),
        (0.25, 0.0, "0.25"),
        (0.25, math.nan, "0.25 ± unknown"),
    ],
)
def test_an_error_is_never_shown_as_zero(value: float, error: float, shown: str) -> None:
    assert with_error(value, error) == shown


@pytest.mark.parametrize(
    ("value", "shown"),
    [(0.25, "0.25"), (0.994, "0.99"), (0.9981, "> 0.99"), (1.0, "> 0.99"), (0.004, "< 0.01")],
)
def test_a_probability_without_an_error_never_looks_certain(value: float, shown: str) -> None:
    assert as_probability(value) == shown


def test_names_of_others_are_no_markdown() -> None:
    assert in_markdown(HOSTILE) == SHOWN
    assert in_markdown("couch_2, 0.25 ± 0.03") == "couch_2, 0.25 ± 0.03"


def test_names_of_others_stay_in_their_cell() -> None:
    head, rule, row = markdown_table([("", "error"), (HOSTILE, "1")]).split("\n")
    assert row == f"| {SHOWN} | 1 |"
    assert cells(head) == cells(rule) == cells(row) == 3


def test_labels_of_others_stay_in_the_cells_of_a_recording() -> None:
    run = posterior()
    cluster = run.certainty.clusters[0]
    hostile = replace(cluster, labels={HOSTILE: 1.0})
    hidden = run.certainty.hidden
    hidden = replace(hidden, clusters=(hostile, *hidden.clusters[1:]))
    certainty = replace(run.certainty, hidden=hidden)
    rows = certainty_text(certainty).split("\n")[:3]
    assert SHOWN in rows[2]
    assert len({cells(row) for row in rows}) == 1
    scene = replace(run[0], difference=HOSTILE)
    assert f"| {SHOWN} |" in caption("", [scene])
    clip = replace(run.clip, name=HOSTILE)
    assert describe(clip, run.samples, verdict="").startswith(f"**{SHOWN}**")


def cells(row: str) -> int:
    """Bars that end a cell."""
    return len(re.findall(r"(?<!\\)\|", row))
