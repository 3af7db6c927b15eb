"""Visit frequencies against the exact answer, and wrong moves that must fail the same test."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.samplers.intervals import (
    K_MAX,
    STATES,
    EagerDeath,
    ForgetfulMixture,
    WrongStateBirth,
    log_density,
    mixture,
    p_value,
    visits,
)
from tests.samplers.rounds import RoundTripError, check_rounds

# A right sampler falls below by chance once in a thousand seeds; wrong ones are far below.
PASS, FAIL = 1e-3, 1e-5


def test_visits_every_layout_as_often_as_it_should():
    states = visits(mixture(), seed=1)
    assert p_value(states) > PASS
    sizes = {len(STATES[index]) for index in np.unique(states)}
    assert sizes == set(range(K_MAX + 1))  # nothing and everything are among them


@pytest.mark.parametrize(
    "wrong",
    [
        pytest.param(mixture(birth=WrongStateBirth()), id="reverse from the wrong state"),
        pytest.param(mixture(death=EagerDeath()), id="edge factor dropped"),
        pytest.param(mixture(kind=ForgetfulMixture), id="choice probability dropped"),
    ],
)
@pytest.mark.slow
def test_the_same_test_fails_a_wrong_sampler(wrong):
    assert p_value(visits(wrong, seed=1)) < FAIL


@given(state=st.sampled_from(STATES), seed=st.integers(0, 2**32 - 1))
def test_every_ratio_is_that_of_both_directions(state, seed):
    check_rounds(np.random.default_rng(seed), state, log_density, mixture(), n=8)


def test_check_finds_the_wrong_ratio(rng):
    with pytest.raises(RoundTripError, match=r"'birth'.*'death'"):
        check_rounds(rng, frozenset(), log_density, mixture(birth=WrongStateBirth()), n=50)
