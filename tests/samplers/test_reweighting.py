"""Weights and annealing against densities whose integrals are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2, norm

from imapper_prob.samplers.reweighting import anneal, families_of, resample, reweigh

CHAINS, DRAWS = 4, 250
PROBABILITIES = np.array([0.4, 0.3, 0.2, 0.08, 0.019, 0.001])
"""Of six states."""
FACTOR = np.array([1e-6, 1e-5, 1e-3, 0.2, 0.5, 0.9])
"""What was said: all but impossible where the draws are."""
EXACT = PROBABILITIES * FACTOR / (PROBABILITIES * FACTOR).sum()
NAT = math.log((PROBABILITIES * FACTOR).sum())


def of_normal(rng: np.random.Generator, said: float, error: float) -> tuple[np.ndarray, float]:
    """Log weights of draws of N(0, 1) by N(said; x, error^2), and what their mean should be."""
    draws = rng.standard_normal((CHAINS, DRAWS))
    exact = norm.logpdf(said, 0, math.hypot(1, error))
    return norm.logpdf(said, draws, error), float(exact)


def test_the_mean_weight_is_the_evidence_within_its_error() -> None:
    scores = []
    for seed in range(60):
        log_weights, exact = of_normal(np.random.default_rng(seed), 0.7, 0.8)
        found = reweigh(log_weights)
        assert found.good
        scores.append((found.log_ratio - exact) / found.error)
    # Sums of 60 squares; both ends in one of a thousand.
    assert chi2.ppf(0.0005, 60) < np.square(scores).sum() < chi2.ppf(0.9995, 60) * 1.2
    assert abs(np.mean(scores)) < 3.3 / math.sqrt(60)


def test_a_density_that_is_not_normalised_is_seen() -> None:
    log_weights, exact = of_normal(np.random.default_rng(1), 0.7, 0.8)
    found = reweigh(log_weights + math.log(1.3))
    assert abs(found.log_ratio - exact) > 5 * found.error


def test_chains_that_repeat_themselves_know_less() -> None:
    log_weights, _ = of_normal(np.random.default_rng(2), 0.7, 0.8)
    slow = np.repeat(log_weights[:, ::10], 10, axis=1)
    assert reweigh(slow).error > 2 * reweigh(log_weights).error


def test_few_draws_that_agree_are_not_enough() -> None:
    log_weights, _ = of_normal(np.random.default_rng(3), 6.0, 0.1)
    assert not reweigh(log_weights).good


def test_equal_weights_leave_all_draws() -> None:
    found = reweigh(np.full((2, 10), -3.0))
    assert found.good
    assert (found.log_ratio, found.effective) == (-3.0, pytest.approx(20.0))
    assert found.error == pytest.approx(1 / 22)
    assert not reweigh(np.full((1, 1), -3.0)).good


def test_draws_are_chosen_as_often_as_they_weigh(rng: np.random.Generator) -> None:
    weights = rng.dirichlet(np.ones(30))
    counts = np.bincount(resample(weights, 1000, rng), minlength=30)
    assert (np.abs(counts - 1000 * weights) < 1).all()


def test_a_number_next_to_one_chooses_the_last_draw_that_weighs() -> None:
    class Last(np.random.Generator):
        def random(self) -> float:
            return 1 - 2**-53

    weights = np.append(np.full(1600, 1 / 1600), 0.0)
    chosen = resample(weights, 1600, Last(np.random.PCG64(0)))
    assert chosen[-1] == 1599


def walk(rng: np.random.Generator, state: int, power: float) -> int:
    """Ten steps of Metropolis on a ring of the six states."""
    for _ in range(10):
        new = (state + int(rng.integers(1, 6))) % 6
        ratio = PROBABILITIES[new] / PROBABILITIES[state]
        ratio *= (FACTOR[new] / FACTOR[state]) ** power
        state = new if rng.random() < ratio else state
    return state


def annealed(seed: int, count: int = 200, on_power=None):
    rng = np.random.default_rng(seed)
    draws = rng.choice(6, count, p=PROBABILITIES).tolist()
    families = families_of(CHAINS, count // CHAINS)
    log_factor = np.log(FACTOR)
    return anneal(
        rng, draws, families, log_factor=lambda s: float(log_factor[s]), advance=walk,
        on_power=on_power,
    )  # fmt: skip


def test_annealed_draws_are_the_renormalised_enumeration() -> None:
    powers = [[] for _ in range(40)]
    runs = [annealed(seed, on_power=powers[seed].append) for seed in range(40)]
    counts = np.bincount(np.concatenate([run.states for run in runs]), minlength=6)
    shares = counts / counts.sum()
    by_run = np.array([np.bincount(run.states, minlength=6) / 200 for run in runs])
    error = by_run.std(0, ddof=1) / math.sqrt(40)
    assert (np.abs(shares - EXACT) < 4 * error + 1e-3).all()
    assert all(reached[-1] == 1.0 and len(reached) > 1 for reached in powers)
    # Reweighting knows next to nothing here: hardly a draw agrees with what was said.
    assert EXACT[4:].sum() > 0.35 > PROBABILITIES[4:].sum() + 0.3


def test_annealing_knows_the_evidence_and_its_error() -> None:
    runs = [annealed(seed) for seed in range(60)]
    off = np.array([run.log_ratio - NAT for run in runs])
    errors = np.array([run.error for run in runs])
    assert abs(off.mean()) < 4 * off.std() / math.sqrt(60) + 0.5 * off.var()  # of a logarithm
    # The error is itself known from sixteen families to a fifth or so.
    assert 0.6 < np.sqrt((errors**2).mean()) / off.std() < 1.6
    assert np.abs(off).max() < 6 * errors.mean()


def test_reweighting_and_annealing_agree_where_both_can(rng: np.random.Generator) -> None:
    mild = np.array([0.5, 0.6, 0.3, 0.9, 0.2, 0.4])
    exact = math.log((mild * PROBABILITIES).sum())
    draws = rng.choice(6, (CHAINS, DRAWS), p=PROBABILITIES)
    weighted = reweigh(np.log(mild)[draws])
    found = anneal(
        rng, draws.ravel().tolist(), families_of(CHAINS, DRAWS),
        log_factor=lambda s: math.log(mild[s]), advance=lambda _, state, __: state,
    )  # fmt: skip
    assert weighted.log_ratio == pytest.approx(found.log_ratio)
    assert abs(weighted.log_ratio - exact) < 4 * weighted.error
    assert weighted.error == pytest.approx(found.error, rel=0.6)
