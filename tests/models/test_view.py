"""The map between the floor and the view: inverse, Jacobian, and one map in both its forms."""

from __future__ import annotations

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from imapper_prob.models.view import floor_point, log_area, seen_point, to_floor, to_view

ASIDE, AHEAD = st.floats(-20, 20), st.floats(0.05, 50)


@given(x=ASIDE, y=AHEAD)
def test_there_and_back(x: float, y: float) -> None:
    bearing, log_depth = seen_point(x, y)
    assert floor_point(bearing, log_depth) == pytest.approx((x, y))
    where = to_view([[x, y, 0.4], [2 * x, y, -1.0]], [0.1, 0.2])
    assert where[0] == pytest.approx([bearing, log_depth, 0.4, 0.1])
    placements, sizes = to_floor(where)
    np.testing.assert_allclose(placements, [[x, y, 0.4], [2 * x, y, -1.0]])
    np.testing.assert_array_equal(sizes, [0.1, 0.2])


@given(x=ASIDE, y=AHEAD)
def test_the_area_is_that_of_small_steps(x: float, y: float) -> None:
    bearing, log_depth = seen_point(x, y)
    step = 1e-6
    sides = [
        np.subtract(
            floor_point(bearing + a * step, log_depth + b * step),
            floor_point(bearing - a * step, log_depth - b * step),
        )
        for a, b in ((1, 0), (0, 1))
    ]
    area = abs(np.linalg.det(sides)) / (2 * step) ** 2
    assert np.exp(log_area(log_depth)) == pytest.approx(area, rel=1e-6)


def test_behind_the_camera_nothing_is_seen() -> None:
    with np.errstate(invalid="ignore"):
        assert np.isnan(to_view([1.0, -2.0, 0.0], 0.0)[1])
