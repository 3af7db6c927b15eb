"""Evidences by bridge sampling against those in closed form, and errors against what is off."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from lab.eryn.evidence import bridge_sampling
from tests.samplers import polynomials
from tests.samplers.markov import autoregressive

# Standard errors that a right estimate may lie off: once in 15,000 runs.
FAR = 4


def log_posterior_of(k: int):
    return lambda thetas: np.array([polynomials.log_density(theta) for theta in thetas])


@pytest.mark.parametrize("k", [1, 2, 3])
def test_a_bridge_finds_the_evidence_of_a_polynomial(k):
    rng = np.random.default_rng(k)
    precision = polynomials.DESIGN[:, :k].T @ polynomials.DESIGN[:, :k] / polynomials.NOISE**2
    covariance = np.linalg.inv(precision + np.eye(k) / polynomials.PRIOR**2)
    mean = covariance @ polynomials.DESIGN[:, :k].T @ polynomials.Y / polynomials.NOISE**2
    chains = autoregressive(rng, (4 * k, 600), correlation=0.7).reshape(4, k, 600)
    draws = mean + np.moveaxis(chains, 1, 2) @ np.linalg.cholesky(covariance).T
    found = bridge_sampling(draws, log_posterior_of(k), rng=rng)
    truth = polynomials.log_evidences()[k - 1]
    assert found.standard_error < 0.03
    assert abs(found.log_evidence - truth) < FAR * found.standard_error


def test_the_error_of_a_bridge_is_how_far_it_is_off():
    # A skewed target, so that the proposal does not fit, and correlated draws.
    gumbel = stats.gumbel_r()
    z = []
    for seed in range(150):
        rng = np.random.default_rng(seed)
        normal = autoregressive(rng, (2, 400), correlation=0.6)
        draws = gumbel.ppf(stats.norm.cdf(normal))[..., None]
        found = bridge_sampling(draws, lambda x: 7 + gumbel.logpdf(x[:, 0]), rng=rng)
        z.append((found.log_evidence - 7) / found.standard_error)
    # The error is of first order, and its chain's correlation is estimated from 200 draws.
    assert np.std(z) == pytest.approx(1, abs=FAR / math.sqrt(300) + 0.1)
    assert abs(np.mean(z)) < 0.5


def test_a_bridge_to_a_bounded_target(rng):
    # -inf where the proposal leaves the support; the evidence of exp(-x) on x > 0 is one.
    draws = rng.exponential(size=(2, 4_000, 1))
    found = bridge_sampling(draws, lambda x: np.where(x[:, 0] > 0, -x[:, 0], -np.inf), rng=rng)
    assert abs(found.log_evidence) < FAR * found.standard_error


def flat(x: np.ndarray) -> np.ndarray:
    return np.zeros(len(x))


def test_bridges_that_cannot_stand_are_refused(rng):
    with pytest.raises(ValueError, match=r"\(chains, draws, dimensions\), not \(5, 3\)"):
        bridge_sampling(np.zeros((5, 3)), flat, rng=rng)
    with pytest.raises(ValueError, match="4 draws cannot fit a proposal in 3 dimensions"):
        bridge_sampling(rng.standard_normal((2, 4, 3)), flat, rng=rng)
    with pytest.raises(ValueError, match="lie in a subspace"):
        bridge_sampling(np.ones((2, 50, 1)), flat, rng=rng)
    with pytest.raises(ValueError, match="not finite at a draw"):
        bridge_sampling(
            rng.standard_normal((2, 50, 1)), lambda x: np.full(len(x), -np.inf), rng=rng
        )
    # On whole numbers alone: a normal proposal never meets them.
    with pytest.raises(ValueError, match="no draw of the normal proposal"):
        bridge_sampling(
            rng.integers(9, size=(2, 50, 1)).astype(float),
            lambda x: np.where(x[:, 0] % 1 == 0, 0.0, -np.inf),
            rng=rng,
        )
