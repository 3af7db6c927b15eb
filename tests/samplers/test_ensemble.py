"""Ensembles on a target with known moments, move by move and all together."""

from __future__ import annotations

import emcee
import numpy as np
import pytest
from scipy import stats

from imapper_prob.samplers.ensemble import (
    CrankNicolson,
    DifferentialEvolution,
    Snooker,
    can_walk,
    walk_ensemble,
)

D, Z, NOISE = 4, 20, 0.5
_ROOT = np.random.default_rng(0).normal(size=(D, D)) + np.eye(D)
PRECISION = np.linalg.inv(_ROOT @ _ROOT.T)


def log_density(theta: np.ndarray, latent: np.ndarray, walker: np.ndarray) -> np.ndarray:
    """Correlated normal theta, and a measurement 1 of the sum of theta_0, z_0 and z_1."""
    assert len(walker) == len(theta)
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


def starts(n_walkers: int, n_latent: int = Z, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return 2 * rng.standard_normal((n_walkers, D)), rng.standard_normal((n_walkers, n_latent))


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


@pytest.mark.slow
@pytest.mark.parametrize("wrong", [SnookerWithoutJacobian(5), emcee.moves.DESnookerMove()])
def test_the_same_test_fails_a_wrong_move(wrong):
    # The second is the reason why there is a snooker move of our own.
    assert move_p_value(wrong, n_dimensions=5) < FAIL


def crank_nicolson_variance(move) -> np.ndarray:
    """Variance of 200 latent numbers that only the prior N(0, I) holds: one a replicate."""
    rng = np.random.RandomState(3)
    latent = rng.standard_normal((8, 200))
    coordinates = np.concatenate([np.full((8, 1), 7.0), latent, np.full((8, 1), 3.0)], axis=1)
    squares = []
    for _ in range(1_000):
        coordinates, log_ratio = move.move(coordinates, rng)
        assert not log_ratio.any()
        squares.append(coordinates[:, 1:-1] ** 2)
    assert (coordinates[:, 0] == 7.0).all()
    assert (coordinates[:, -1] == 3.0).all()
    return np.mean(squares, axis=(0, 1))


def test_crank_nicolson_keeps_the_prior():
    assert deviation(crank_nicolson_variance(CrankNicolson(1)), np.ones(())) > PASS


def test_a_random_walk_in_its_place_does_not():
    class Walk(CrankNicolson):
        def move(self, coordinates, random):
            moved = coordinates.copy()
            moved[:, 1:-1] += 0.5 * random.standard_normal(moved[:, 1:-1].shape)
            return moved, np.zeros(len(moved))

    assert deviation(crank_nicolson_variance(Walk(1)), np.ones(())) < FAIL


def test_moments_of_a_known_posterior():
    mean, variance = moments()
    arrived = [
        walk_ensemble(
            log_density, *starts(40, seed=seed), steps=400, rng=np.random.default_rng(seed)
        )
        for seed in range(20)
    ]
    both = np.stack([np.concatenate([one.theta, one.latent], axis=-1) for one in arrived])
    estimates = np.stack([both.mean(1), ((both - mean) ** 2).mean(1)], axis=1)
    assert deviation(estimates, np.stack([mean, variance])) > PASS
    # The same numbers, had the measurement been forgotten.
    prior = np.concatenate([np.diag(_ROOT @ _ROOT.T), np.ones(Z)])
    assert deviation(estimates, np.stack([np.zeros(D + Z), prior])) < FAIL
    one = arrived[3]
    assert one.steps == 400
    np.testing.assert_allclose(
        one.log_density, log_density(one.theta, one.latent, np.arange(len(one.theta)))
    )
    assert set(one.acceptance) == {"differential evolution", "snooker", "latent"}
    assert all(0.1 < rate < 0.9 for rate in one.acceptance.values())


def test_walkers_with_targets_of_their_own_remain_draws_of_them():
    """Half of them are of N(0, 1) and half of N(3, .25): what walks together stays apart."""
    own = np.tile([0, 1], 30)
    middle, spread = np.array([0.0, 3.0])[own], np.array([1.0, 0.5])[own]

    def density(theta, _, walker):
        off = (theta[:, 0] - middle[walker]) / spread[walker]
        return -0.5 * (off**2 + theta[:, 1] ** 2)

    def both_halves(**moved):
        estimates = []
        for seed in range(40):
            rng = np.random.default_rng(seed)
            theta = rng.standard_normal((60, 2))
            theta[:, 0] = middle + spread * theta[:, 0]
            arrived = walk_ensemble(
                moved.get("density", density), theta, np.empty((60, 0)), steps=60, rng=rng
            ).theta[:, 0]
            halves = [arrived[own == h] for h in (0, 1)]
            estimates.append([[half.mean(), half.var(ddof=1)] for half in halves])
        return np.array(estimates)

    truth = np.array([[0.0, 1.0], [3.0, 0.25]])
    assert deviation(both_halves(), truth) > PASS

    def mixed_up(theta, latent, walker):
        return density(theta, latent, (walker + 1) % 60)

    assert deviation(both_halves(density=mixed_up), truth) < FAIL


def test_no_latent_coordinates():
    arrived = walk_ensemble(log_density, *starts(12, 0), steps=20, rng=np.random.default_rng(2))
    assert arrived.theta.shape == (12, D)
    assert arrived.latent.shape == (12, 0)
    assert set(arrived.acceptance) == {"differential evolution", "snooker"}


def test_the_same_generator_gives_the_same_walk_and_starts_are_not_written_to():
    theta, latent = starts(12)
    theta.setflags(write=False)
    latent.setflags(write=False)
    one, two, other = (
        walk_ensemble(log_density, theta, latent, steps=20, rng=np.random.default_rng(seed))
        for seed in (2, 2, 3)
    )
    np.testing.assert_array_equal(one.theta, two.theta)
    np.testing.assert_array_equal(one.latent, two.latent)
    assert not np.array_equal(one.theta, other.theta)


def test_asked_to_stop_it_returns_where_it_is():
    arrived = walk_ensemble(
        log_density, *starts(12), steps=20, rng=np.random.default_rng(2),
        report=lambda part: part < 0.25,
    )  # fmt: skip
    assert arrived.steps == 5


def test_two_walkers_at_one_place_do_no_harm():
    theta, latent = starts(12)
    theta[1], latent[1] = theta[0], latent[0]
    arrived = walk_ensemble(log_density, theta, latent, steps=50, rng=np.random.default_rng(2))
    assert np.isfinite(arrived.theta).all()


def outside(theta: np.ndarray, latent: np.ndarray, walker: np.ndarray) -> np.ndarray:
    return np.where(theta[:, 0] > 0, 0.0, -np.inf)


@pytest.mark.parametrize(
    ("theta", "latent", "message"),
    [
        (np.ones((12, 4)), np.ones((11, 3)), r"not \(12, 4\) and \(11, 3\)"),
        (np.ones((2, 12, 4)), np.ones((2, 12, 3)), r"must be \(W, D\)"),
        (starts(7)[0], np.ones((7, 0)), "4 parameters need at least 8 walkers .* there are 7"),
        (np.arange(12.0)[:, None] * np.ones(4), np.ones((12, 0)), "not all in a subspace"),
        (*starts(12), r"\d walkers start where the log density is not finite"),
    ],
)
def test_starts_that_cannot_work_are_refused(theta, latent, message):
    with pytest.raises(ValueError, match=message):
        walk_ensemble(outside, theta, latent, steps=10, rng=np.random.default_rng(2))


def test_what_can_walk():
    theta = starts(12)[0]
    assert can_walk(theta)
    assert not can_walk(theta[:7])
    theta[:, 2] = theta[:, 0] - theta[:, 1]
    assert not can_walk(theta)


def test_an_interrupt_passes_through_without_a_word(capsys: pytest.CaptureFixture[str]) -> None:
    calls = 0

    def interrupted(theta: np.ndarray, latent: np.ndarray, walker: np.ndarray) -> np.ndarray:
        nonlocal calls
        calls += 1
        if calls == 3:
            raise KeyboardInterrupt
        return log_density(theta, latent, walker)

    with pytest.raises(KeyboardInterrupt):
        walk_ensemble(interrupted, *starts(40), steps=5, rng=np.random.default_rng(1))
    assert capsys.readouterr() == ("", "")
