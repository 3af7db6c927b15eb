"""Where rungs stand, and how journeys are counted."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imapper_prob.samplers.ladder import SwapTable, power_ladder, respaced


def test_a_first_ladder_is_dense_near_the_prior():
    betas = power_ladder(6)
    assert (betas[0], betas[-1]) == (0, 1)
    assert (np.diff(betas, 2) > 0).all()


@pytest.mark.parametrize("n_rungs", [0, 1])
def test_ladders_that_are_none_are_refused(n_rungs):
    with pytest.raises(ValueError, match=r"ladder of \d rungs"):
        power_ladder(n_rungs)


@given(
    acceptance=st.lists(st.floats(0, 1), min_size=1, max_size=9),
    gain=st.floats(1e-3, 1),
)
def test_a_respaced_ladder_is_a_ladder_with_the_same_ends(acceptance, gain):
    betas = power_ladder(len(acceptance) + 1)
    moved = respaced(betas, acceptance, gain=gain)
    assert (moved[0], moved[-1]) == (betas[0], betas[-1])
    assert (np.diff(moved) > 0).all()


def test_gaps_that_are_crossed_too_easily_widen():
    betas = power_ladder(4)
    moved = respaced(betas, (0.9, 0.2, 0.2), gain=0.5)
    assert moved[1] > betas[1]
    np.testing.assert_allclose(respaced(betas, (0.4, 0.4, 0.4), gain=0.5), betas)
    assert respaced((0.0, 1.0), (0.3,), gain=0.5) == (0.0, 1.0)


def test_round_trips_are_counted_from_end_to_end_and_back():
    table = SwapTable.empty((0.0, 0.5, 1.0))
    places = [(0, 1, 2), (1, 0, 2), (1, 2, 0), (1, 0, 2), (0, 1, 2), (0, 1, 2), (2, 0, 1)]
    for replicas in places:
        table = table.recorded((0.5, 0.25), replicas)
    # Replica 0 goes from the hottest rung to the coldest and back: one trip. Replica 1 goes
    # up once, and so does replica 2 the other way: half a trip each, which count for nothing.
    assert tuple(table.crossings) == (2, 1, 1)
    summary = table.summary()
    assert summary.round_trips == 1
    assert summary.rounds == 7
    assert summary.swap_rates == (0.5, 0.25)
    assert summary.barrier == pytest.approx(1.25)


def test_a_table_can_be_kept_as_json():
    table = SwapTable.empty((0.0, 1.0)).recorded((0.5,), (0, 1)).recorded((0.25,), (1, 0))
    again = SwapTable(**json.loads(json.dumps(dataclasses.asdict(table))))
    assert again.summary() == table.summary()
    both = (each.recorded((0.5,), (0, 1)).summary() for each in (again, table))
    assert next(both) == next(both)


def test_rates_are_unknown_before_the_first_round():
    assert np.isnan(SwapTable.empty((0.0, 1.0)).summary().swap_rates).all()


def test_one_rung_has_no_journeys():
    table = SwapTable.empty((1.0,)).recorded((), (0,)).recorded((), (0,))
    assert table.summary().round_trips == 0
