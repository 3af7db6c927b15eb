"""Evidences against those in closed form, and errors against how far off they are."""

from __future__ import annotations

import math
from functools import partial
from itertools import islice

import numpy as np
import pytest
from scipy import stats

from imapper_prob.samplers.diagnostics import ShortChainWarning
from imapper_prob.samplers.evidence import bridge_sampling, stepping_stone
from imapper_prob.samplers.kernel import Mixture, step
from imapper_prob.samplers.ladder import power_ladder
from imapper_prob.samplers.tempering import start, temper
from tests.samplers import islands, polynomials
from tests.samplers.markov import autoregressive

# Standard errors that a right estimate may lie off: once in 15,000 runs.
FAR = 4


def ladder_likelihoods(target, mixture, first, *, seed: int, rounds: int, n_rungs: int = 6):
    """(1, rounds, K) log-likelihoods of an adapted ladder, and where its rungs stand."""
    betas = power_ladder(n_rungs)
    rngs = np.random.default_rng(seed).spawn(n_rungs + 1)
    options = {"target": target, "kernel": partial(step, mixture=mixture), "steps_per_swap": 4}
    at = start([first] * n_rungs, target=target, betas=betas)
    *_, last = islice(temper(rngs, at, adapt=True, **options), 300)
    items = islice(temper(rngs, last.position, **options), rounds)
    return np.array([[item.position.log_likelihoods for item in items]]), last.position.betas


def test_stepping_stones_of_each_model_give_the_known_bayes_factors():
    walk = Mixture((polynomials.Walk(),), (1.0,))
    for k, truth in enumerate(polynomials.log_evidences(), 1):
        values, betas = ladder_likelihoods(
            polynomials.target, walk, np.zeros(k), seed=k, rounds=1_000
        )
        found = stepping_stone(values, betas)
        assert found.standard_error < 0.25
        assert abs(found.log_evidence - truth) < FAR * found.standard_error


def test_stepping_stones_over_all_models_at_once():
    # The ladder of a jump chain: the evidence of the mixture, each model having one third.
    values, betas = ladder_likelihoods(
        polynomials.target, polynomials.mixture(), np.zeros(1), seed=4, rounds=1_500
    )
    truth = np.log(np.exp(polynomials.log_evidences()).mean())
    found = stepping_stone(values, betas)
    assert abs(found.log_evidence - truth) < FAR * found.standard_error


def test_stepping_stones_across_islands():
    values, betas = ladder_likelihoods(
        islands.target, islands.MIXTURE, islands.START, seed=5, rounds=2_000
    )
    found = stepping_stone(values, betas)
    assert abs(found.log_evidence - np.log(islands.masses().sum())) < FAR * found.standard_error


def independent_ladder(rng, betas, n: int, *, sharpness: float = 100.0) -> np.ndarray:
    """Log-likelihoods -sharpness x^2 / 2 under a standard normal prior, drawn exactly."""
    precision = 1 + sharpness * np.array(betas)
    return -0.5 * sharpness * rng.standard_normal((1, n, len(betas))) ** 2 / precision


def test_the_error_of_stepping_stones_is_how_far_they_are_off(rng):
    betas = power_ladder(6)
    truth = -0.5 * math.log(101)
    found = [stepping_stone(independent_ladder(rng, betas, 300), betas) for _ in range(300)]
    z = np.array([(item.log_evidence - truth) / item.standard_error for item in found])
    # The standard deviation of 300 standard normal numbers is known to 1 / sqrt(600).
    assert z.std() == pytest.approx(1, abs=FAR / math.sqrt(600))
    assert abs(z.mean()) < FAR / math.sqrt(300)


def test_the_error_knows_of_correlated_rungs(rng):
    # All rungs see the same noise: errors add up instead of averaging out.
    betas = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
    shared = [
        stepping_stone(np.repeat(rng.standard_normal((1, 500, 1)), 5, axis=2), betas)
        for _ in range(200)
    ]
    spread = np.std([item.log_evidence for item in shared])
    mean = np.mean([item.standard_error for item in shared])
    assert mean == pytest.approx(spread, rel=FAR / math.sqrt(400))


def test_part_of_a_ladder_gives_the_ratio_of_its_ends(rng):
    betas = np.array([0.2, 0.4, 0.7, 1.0])
    found = stepping_stone(independent_ladder(rng, betas, 4_000), betas)
    truth = -0.5 * math.log(101 / 21)
    assert abs(found.log_evidence - truth) < FAR * found.standard_error


def test_a_likelihood_of_zero_counts_as_zero(rng):
    # Half of the prior is forbidden: the evidence is one half, exactly known from shares.
    values = np.where(rng.random((1, 2_000, 2)) < 0.5, 0.0, -np.inf)
    found = stepping_stone(values, [0.0, 1.0])
    assert found.log_evidence == pytest.approx(math.log((values[..., 0] == 0).mean()))
    assert found.standard_error == pytest.approx(1 / math.sqrt(2_000), rel=0.2)


def test_ladders_that_say_nothing_are_refused():
    with pytest.raises(ValueError, match=r"\(ladders, rounds, rungs\), not \(5, 3\)"):
        stepping_stone(np.zeros((5, 3)), [0.0, 0.5, 1.0])
    with pytest.raises(ValueError, match="for 2 inverse temperatures"):
        stepping_stone(np.zeros((1, 5, 3)), [0.0, 1.0])
    with pytest.raises(ValueError, match="rung 0 of the ladder has not met"):
        stepping_stone(np.full((1, 5, 2), -np.inf), [0.0, 1.0])
    with pytest.warns(ShortChainWarning):
        assert math.isnan(stepping_stone(np.zeros((1, 3, 2)), [0.0, 1.0]).standard_error)


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


def test_a_bridge_leads_to_the_same_evidence_as_stepping_stones():
    walk = Mixture((polynomials.Walk(),), (1.0,))
    values, betas = ladder_likelihoods(polynomials.target, walk, np.zeros(2), seed=9, rounds=1_000)
    stones = stepping_stone(values, betas)
    chain = islice(
        temper(
            np.random.default_rng(9).spawn(2),
            start([np.zeros(2)], target=polynomials.target, betas=[1.0]),
            target=polynomials.target,
            kernel=partial(step, mixture=walk),
            steps_per_swap=5,
        ),
        1_000,
    )
    draws = np.array([[item.position.chains[0].state for item in chain]])
    bridge = bridge_sampling(draws, log_posterior_of(2), rng=np.random.default_rng(9))
    error = math.hypot(stones.standard_error, bridge.standard_error)
    assert abs(stones.log_evidence - bridge.log_evidence) < FAR * error


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
