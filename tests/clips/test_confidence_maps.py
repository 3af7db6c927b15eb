"""Maps of confidence: monotone, within [0, 1], and nothing stays nothing."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imapper_prob.clips.assemble import CONFIDENCE_MAPS, confidence_map
from imapper_prob.models.errors import InputError

NAMES = sorted([*CONFIDENCE_MAPS, "cpm"])


@pytest.mark.parametrize("name", NAMES)
@given(st.lists(st.floats(-1, 3), min_size=2, max_size=20))
def test_maps_ascend_within_bounds(name: str, scores: list[float]) -> None:
    mapped = confidence_map(name)(np.sort(scores))
    assert ((mapped >= 0) & (mapped <= 1)).all()
    assert (np.diff(mapped) >= 0).all()
    assert (mapped[np.sort(scores) <= 0] == 0).all()


@pytest.mark.parametrize("name", NAMES)
def test_what_is_no_number_is_no_detection(name: str) -> None:
    mapped = confidence_map(name)([np.nan, -np.inf, np.inf])
    assert (mapped[:2] == 0).all()
    assert 0 < mapped[2] <= 1


def test_heat_as_the_benchmark_has_it() -> None:
    assert confidence_map("cpm")(0.0019) == pytest.approx(0.5)


def test_a_map_of_ones_own() -> None:
    mapped = confidence_map("0:0, .5:.9,1:1")([0.25, 0.5, 2.0])
    np.testing.assert_allclose(mapped, [0.45, 0.9, 1.0])


@pytest.mark.parametrize("text", ["cqm", "0:0", "0:0,1:2", "1:0,0:1", "0:1,1:0", "0:0,,1:1", ""])
def test_faulty_maps(text: str) -> None:
    with pytest.raises(InputError, match="confidence map"):
        confidence_map(text)
