"""Boxes that are made larger are those that would have been made anew."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Cuboid, Placement
from tests.models.worlds import couch


@given(st.floats(0.1, 10.0))
def test_a_larger_box_is_as_if_made_so(factor: float) -> None:
    box = Cuboid("seat", np.array([0.1, -0.2, 0.3]), np.array([1.6, 0.8, 0.4]))
    made, anew = box.scaled(factor), Cuboid("seat", factor * box.centre, factor * box.size)
    assert made.part == anew.part
    np.testing.assert_array_equal(made.centre, anew.centre)
    np.testing.assert_array_equal(made.size, anew.size)
    assert not made.centre.flags.writeable
    assert not made.size.flags.writeable


@pytest.mark.parametrize("factor", [0.0, -1.0, np.nan, np.inf])
def test_no_box_is_nothing_or_endless(factor: float) -> None:
    with pytest.raises(InputError, match="cannot be"):
        couch().scaled(factor)


@pytest.mark.parametrize("place", [(np.nan, 0.0, 0.0), (0.0, np.inf, 0.0), (0.0, 0.0, -np.inf)])
def test_no_place_is_nowhere(place: tuple[float, float, float]) -> None:
    with pytest.raises(InputError, match="must be finite"):
        Placement(*place)
