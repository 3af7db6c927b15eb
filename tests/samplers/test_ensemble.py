"""Ensembles on a target with known moments, move by move and all together."""

from __future__ import annotations

import emcee
import numpy as np
import pytest
from scipy import stats

from imapper_prob.samplers.ensemble import (
    CrankNicolson,
    DifferentialEvolution,
    EnsembleSettings,
    Snooker,
    run_ensembles,
)

D, Z, NOISE = 4, 20, 0.5
_ROOT = np.random.default_rng(0).normal(size=(D, D)) + np.eye(D)
PRECISION = np.linalg.inv(_ROOT @ _ROOT.T)


def log_density(theta: np.ndarray, latent: np.ndarray) -> np.ndarray:
    """Correlated normal theta, and a measurement 1 of the sum of theta_0, z_0 and z_1."""
    prior = -0.5 * np.einsum("wi,ij,wj->w", theta, PRECISION, theta)
    if latent.shape[1] == 0:
        return prior
    residual = (theta[:, 0] + latent[:, :2].sum(1) - 1) / NOISE
    return prior - 0.5 * residual**2


def moments() -> tuple[np.ndarray, np.ndarray]:
    """Posterior mean and variance of (theta, z)."""
    row = np.zeros(D + Z)
    row[[0, D, D + 1]] = 1
    precision = np.eye(D + Z)
    precision[:D, :D] = PRECISION
    covariance = np.linalg.inv(precision + np.outer(row, row) / NOISE**2)
    return covariance @ row / NOISE**2, np.diag(covariance)


def starts(n_ensembles: int, n_walkers: int, n_latent: int = Z) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    return (
        2 * rng.standard_normal((n_ensembles, n_walkers, D)),
        rng.standard_normal((n_ensembles, n_walkers, n_latent)),
    )


def deviation(replicates: np.ndarray, truth: np.ndarray) -> float:
    """How far independent estimates (R, ...) of ``truth`` lie off, as a chance (Bonferroni)."""
    n = len(replicates)
    t = (replicates.mean(0) - truth) / (replicates.std(0, ddof=1) / np.sqrt(n))
    return float(np.min(2 * stats.t(n - 1).sf(np.abs(t))) * t.size)


def move_p_value(move, *, n_dimensions: int, n_replicates: int = 8) -> float:
    """Mean and variance of a standard normal target under one move, started in it."""
    estimates = []
    for seed in range(n_replicates):
        rng = np.random.default_rng(seed)
        sampler = emcee.EnsembleSampler(
            24, n_dimensions, lambda x: -0.5 * (x**2).sum(1), moves=move, vectorize=True
        )
        sampler.random_state = np.random.MT19937(seed).state
        sampler.run_mcmc(rng.standard_normal((24, n_dimensions)), 400)
        draws = sampler.get_chain(flat=True)
        estimates.append([draws.mean(), (draws**2).mean()])
    return deviation(np.array(estimates), np.array([0.0, 1.0]))


class SnookerWithoutJacobian(Snooker):
    def move(self, theta, others, random):
        moved, log_ratio = super().move(theta, others, random)
        return moved, np.zeros_like(log_ratio)


# One chance in a thousand for a right move; wrong ones are far below.
PASS, FAIL = 1e-3, 1e-6


@pytest.mark.parametrize("n_dimensions", [1, 5])
@pytest.mark.parametrize("kind", ["differential evolution", "snooker"])
def test_moves_leave_a_normal_target_alone(kind, n_dimensions):
    move = (
        Snooker(n_dimensions)
        if kind == "snooker"
        else DifferentialEvolution(n_dimensions, jump_between_modes=0.1)
    )
    assert move_p_value(move, n_dimensions=n_dimensions) > PASS
    assert 0.1 < move.rate < 0.7


@pytest.mark.parametrize("wrong", [SnookerWithoutJacobian(5), emcee.moves.DESnookerMove()])
def test_the_same_test_fails_a_wrong_move(wrong):
    # The second is the reason why there is a snooker move of our own.
    assert move_p_value(wrong, n_dimensions=5) < FAIL


def crank_nicolson_variance(move) -> np.ndarray:
    """Variance of 200 latent numbers that only the prior N(0, I) holds: one a replicate."""
    rng = np.random.RandomState(3)
    coordinates = np.concatenate([np.full((8, 1), 7.0), rng.standard_normal((8, 200))], axis=1)
    squares = []
    for _ in range(1_000):
        coordinates, log_ratio = move.move(coordinates, rng)
        assert not log_ratio.any()
        squares.append(coordinates[:, 1:] ** 2)
    assert (coordinates[:, 0] == 7.0).all()
    return np.mean(squares, axis=(0, 1))


def test_crank_nicolson_keeps_the_prior():
    assert deviation(crank_nicolson_variance(CrankNicolson(1, step=0.5)), np.ones(())) > PASS


def test_a_random_walk_in_its_place_does_not():
    class Walk(CrankNicolson):
        def move(self, coordinates, random):
            moved = coordinates.copy()
            moved[:, 1:] += 0.5 * random.standard_normal(moved[:, 1:].shape)
            return moved, np.zeros(len(moved))

    assert deviation(crank_nicolson_variance(Walk(1, step=0.5)), np.ones(())) < FAIL


def test_moments_of_a_known_posterior():
    mean, variance = moments()
    draws = run_ensembles(
        log_density,
        *starts(10, 16),
        seed=2,
        settings=EnsembleSettings(burn_in=300, n_draws=400, thin_by=2),
    )
    both = np.concatenate([draws.theta, draws.latent], axis=-1)
    estimates = np.stack([both.mean((1, 2)), ((both - mean) ** 2).mean((1, 2))], axis=1)
    assert deviation(estimates, np.stack([mean, variance])) > PASS
    # The same numbers, had the measurement been forgotten.
    prior = np.concatenate([np.diag(_ROOT @ _ROOT.T), np.ones(Z)])
    assert deviation(estimates, np.stack([np.zeros(D + Z), prior])) < FAIL
    np.testing.assert_allclose(
        draws.log_density[3, 17], log_density(draws.theta[3, 17], draws.latent[3, 17])
    )
    assert set(draws.acceptance) == {"differential evolution", "snooker", "latent"}
    for rates in draws.acceptance.values():
        assert rates.shape == (10,)
        assert ((rates > 0.1) & (rates < 0.9)).all()


SHORT = EnsembleSettings(burn_in=20, n_draws=15)


def test_no_latent_coordinates():
    draws = run_ensembles(log_density, *starts(2, 12, 0), seed=2, settings=SHORT)
    assert draws.theta.shape == (2, 15, 12, D)
    assert draws.latent.shape == (2, 15, 12, 0)
    assert set(draws.acceptance) == {"differential evolution", "snooker"}


def test_the_same_seed_gives_the_same_draws_in_any_number_of_processes():
    one = run_ensembles(log_density, *starts(2, 12), seed=2, settings=SHORT)
    two = run_ensembles(log_density, *starts(2, 12), seed=2, settings=SHORT, workers=2)
    other = run_ensembles(log_density, *starts(2, 12), seed=3, settings=SHORT)
    np.testing.assert_array_equal(one.theta, two.theta)
    np.testing.assert_array_equal(one.latent, two.latent)
    assert not np.array_equal(one.theta, other.theta)
    assert not np.array_equal(one.theta[0], one.theta[1])


def test_starts_are_not_written_to():
    theta, latent = starts(2, 12)
    theta.setflags(write=False)
    latent.setflags(write=False)
    run_ensembles(log_density, theta, latent, seed=2, settings=SHORT)


def test_an_interrupted_run_returns_what_all_ensembles_have():
    draws = run_ensembles(
        log_density,
        *starts(2, 12),
        seed=2,
        settings=SHORT,
        on_progress=lambda chain, progress: progress[0] < SHORT.burn_in + 5,
    )
    # The first ensemble asks both to stop at its fifth draw; the second has one by then.
    assert draws.theta.shape == (2, 1, 12, D)


def test_the_latent_step_adapts_in_burn_in_only():
    move = CrankNicolson(1, step=0.5)
    for _ in range(50):
        move.tune(None, np.array([False, False]))
    assert move.step < 0.3
    for _ in range(300):
        move.tune(None, np.array([True, True]))
    assert move.step == 1.0


def outside(theta: np.ndarray, latent: np.ndarray) -> np.ndarray:
    return np.where(theta[:, 0] > 0, 0.0, -np.inf)


@pytest.mark.parametrize(
    ("theta", "latent", "message"),
    [
        (np.ones((2, 12, 4)), np.ones((2, 11, 3)), r"not \(2, 12, 4\) and \(2, 11, 3\)"),
        (np.ones((12, 4)), np.ones((12, 3)), r"must be \(E, W, D\)"),
        (starts(1, 9)[0][:, :7], np.ones((1, 7, 0)), "4 parameters need at least 8 walkers"),
        (np.ones((1, 12, 4)), np.ones((1, 12, 0)), "two walkers start at the same place"),
        (
            np.arange(12.0)[None, :, None] * np.ones(4),
            np.ones((1, 12, 0)),
            "ensemble 0: the walkers start in a subspace",
        ),
        (*starts(1, 12), r"\d walkers start where the log density is not finite"),
    ],
)
def test_starts_that_cannot_work_are_refused(theta, latent, message):
    with pytest.raises(ValueError, match=message):
        run_ensembles(outside, theta, latent, seed=2, settings=SHORT)
