"""A scenelet alone, moved to where it gains most."""

from __future__ import annotations

import numpy as np
import pytest

from imapper_prob.models.log_posterior import empty_state, log_posterior
from imapper_prob.models.settings import ModelSettings
from imapper_prob.models.view import to_floor
from imapper_prob.sampling.candidates import SingleScenelet
from tests.models import worlds

WHERE = np.array([0.02, np.log(4.0), 0.4, 0.03])


@pytest.mark.parametrize("energy", ["default", "paper"])
def test_a_gain_is_a_difference_of_log_posteriors(energy: str) -> None:
    problem = worlds.problem(20, settings=ModelSettings(energy=energy))
    alone, empty = SingleScenelet(problem), empty_state(problem)
    state = empty.with_item(1, 5, *to_floor(WHERE))
    expected = log_posterior(problem, state) - log_posterior(problem, empty)
    assert alone.gain(1, 5, WHERE) == pytest.approx(expected, abs=1e-5)


def test_mending_gains_and_stays_nearby() -> None:
    alone = SingleScenelet(worlds.problem(20))
    gain = alone.gain(1, 5, WHERE)
    where, better = alone.mended(1, 5, WHERE, gain)
    assert better > gain + 0.1
    assert better == pytest.approx(alone.gain(1, 5, where), abs=1e-5)
    assert (np.abs(where - WHERE) <= [0.016, 0.22, 0.32, 0.1]).all()
