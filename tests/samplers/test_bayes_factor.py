"""Jumps between polynomials of one to three coefficients find their known Bayes factors."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest
from scipy import stats

from imapper_prob.samplers.diagnostics import layout_probabilities
from imapper_prob.samplers.reversible_jump import Mixture, sample
from tests.samplers.polynomials import exact, log_density, mixture
from tests.samplers.rounds import RoundTripError, check_rounds


def deviation(moves: Mixture) -> float:
    """Largest distance of P(k | y) from the truth in standard errors."""
    seeds = np.random.SeedSequence(8).spawn(6)
    sizes = [
        [
            len(at.state)
            for at, _ in islice(
                sample(
                    np.random.default_rng(seed),
                    np.zeros(1),
                    log_density_fn=log_density,
                    mixture=moves,
                ),
                8_000,
            )
        ]
        for seed in seeds
    ]
    found = layout_probabilities(sizes, rng=np.random.default_rng(0))
    truth = exact()[found.layouts - 1]
    return float(np.max(np.abs(found.probability - truth) / found.standard_error))


def test_finds_the_posterior_of_the_dimension():
    # The error comes from six chains: t with five degrees of freedom, three comparisons.
    assert deviation(mixture()) < stats.t(5).isf(1e-3 / 6)


def test_the_same_test_fails_without_the_jacobian():
    assert deviation(mixture(jacobian=False)) > 10


def test_every_ratio_is_that_of_both_directions(rng):
    table = check_rounds(rng, np.zeros(1), log_density, mixture(), n=500)
    assert all(rate > 0.02 for rate in table.rates().values())


def test_check_finds_the_missing_jacobian(rng):
    with pytest.raises(RoundTripError):
        check_rounds(rng, np.zeros(1), log_density, mixture(jacobian=False), n=50)
