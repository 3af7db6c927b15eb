"""Occupancy, counted by hand and by a polygon library."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import Point, Polygon

from imapper_prob.uncertainty.occupancy import occupancy
from tests.uncertainty.pieces import piece


def test_shares_of_draws_counted_by_hand() -> None:
    chair, table = piece("chair", 0.0, 3.0), piece("table", 2.0, 4.0)
    near = piece("chair", 0.0, 3.1)
    found = occupancy([[chair], [chair, table], [near, chair], []])
    assert found.categories == ("chair", "table")
    assert found.at(0.0, 3.0) == {"chair": 0.75, "table": 0.0}
    assert found.at(2.0, 4.0) == {"table": 0.25, "chair": 0.0}
    # Two chairs of one draw on one place count once.
    assert found.at(0.0, 2.75)["chair"] == 0.75
    assert found.at(0.0, 3.35)["chair"] == 0.25
    assert found.at(50.0, 3.0) == {"chair": 0.0, "table": 0.0}


def test_a_chair_under_a_table_is_no_sum() -> None:
    found = occupancy([[piece("chair", 0, 3), piece("table", 0, 3)], [piece("table", 0, 3)]])
    assert found.at(0, 3) == {"table": 1.0, "chair": 0.5}
    row, column = np.abs(found.y - 3).argmin(), np.abs(found.x).argmin()
    assert found.anything[row, column] == 1.0
    assert found.anything.max() <= 1


@given(
    x=st.floats(-3, 3), y=st.floats(1, 6), yaw=st.floats(-4, 4), width=st.floats(0.2, 2.5)
)  # fmt: skip
def test_cells_are_those_whose_centres_are_inside(
    x: float, y: float, yaw: float, width: float
) -> None:
    o = piece("couch", x, y, yaw, width=width)
    found = occupancy([[o]], cell=0.15)
    outline = Polygon(o.footprint)
    for row, b in enumerate(found.y):
        for column, a in enumerate(found.x):
            # On the edge rounding decides.
            if outline.exterior.distance(Point(a, b)) > 1e-9:
                assert found.anything[row, column] == float(outline.contains(Point(a, b)))


def test_the_area_is_that_of_the_footprint() -> None:
    found = occupancy([[piece("bed", 0.3, 4.0, 0.7, width=2.0, depth=1.5)]], cell=0.02)
    # The edge, 7 m long, is known to half a cell.
    assert found.anything.sum() * 0.02**2 == pytest.approx(3.0, abs=7 * 0.01)


def test_what_stands_far_away_makes_no_larger_map() -> None:
    """A draw of a spoiled run has furniture kilometres away."""
    near, far = piece("chair", 0.0, 3.0), piece("chair", 4e4, 3e4)
    found = occupancy([[near], [near], [near, far]])
    assert max(found.anything.shape) <= 1001
    assert found.at(0.0, 3.0) == {"chair": 1.0}
    assert found.at(4e4, 3e4) == {"chair": 0.0}


def test_an_empty_room_and_no_room() -> None:
    found = occupancy([[], []])
    assert found.anything.size == 0
    assert found.at(0, 0) == {}
    with pytest.raises(ValueError, match="needs a draw"):
        occupancy([])
