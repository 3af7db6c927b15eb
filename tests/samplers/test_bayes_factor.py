"""Polynomials of one to three coefficients: evidences are known in closed form."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import islice

import numpy as np
import pytest
from scipy import stats

from imapper_prob.samplers.diagnostics import layout_probabilities
from imapper_prob.samplers.kernel import Mixture, Proposal, RoundTripError
from imapper_prob.samplers.reversible_jump import sample
from tests.samplers.rounds import check_rounds

K_MAX, NOISE, PRIOR = 3, 0.5, 1.5
X = np.linspace(-1, 1, 12)
Y = 0.4 + 0.5 * X + 0.3 * X**2 + NOISE * np.random.default_rng(3).standard_normal(len(X))
DESIGN = X[:, None] ** np.arange(K_MAX)

# A birth also pulls the coefficients it finds towards zero: a Jacobian that depends on k.
PULL, BORN_SCALE = 0.8, 0.7


def exact() -> np.ndarray:
    """P(k | y), all k equally probable a priori."""
    evidence = [
        stats.multivariate_normal(
            cov=NOISE**2 * np.eye(len(X)) + PRIOR**2 * DESIGN[:, :k] @ DESIGN[:, :k].T
        ).logpdf(Y)
        for k in range(1, K_MAX + 1)
    ]
    weights = np.exp(np.array(evidence) - max(evidence))
    return weights / weights.sum()


def log_density(theta: np.ndarray) -> float:
    residual = (Y - DESIGN[:, : len(theta)] @ theta) / NOISE
    prior = -0.5 * theta @ theta / PRIOR**2 - len(theta) * math.log(PRIOR * math.sqrt(2 * math.pi))
    return float(prior - 0.5 * residual @ residual)


def log_normal(u: float) -> float:
    return -0.5 * u * u - 0.5 * math.log(2 * math.pi)


@dataclass(frozen=True)
class Birth:
    jacobian: bool = True
    name = "birth"
    reverse = "death"

    def propose(self, rng, theta):
        if len(theta) == K_MAX:
            return None
        u = rng.standard_normal()
        log_jacobian = len(theta) * math.log(PULL) + math.log(BORN_SCALE)
        return Proposal(
            np.append(PULL * theta, BORN_SCALE * u), self.jacobian * log_jacobian - log_normal(u)
        )

    def explain(self, old, new):
        if not np.allclose(new[:-1], PULL * old):
            return -math.inf
        stretch = len(old) * math.log(PULL) + math.log(BORN_SCALE)
        return log_normal(new[-1] / BORN_SCALE) - stretch


@dataclass(frozen=True)
class Death:
    jacobian: bool = True
    name = "death"
    reverse = "birth"

    def propose(self, rng, theta):
        if len(theta) == 1:
            return None
        log_jacobian = (len(theta) - 1) * math.log(PULL) + math.log(BORN_SCALE)
        return Proposal(
            theta[:-1] / PULL, log_normal(theta[-1] / BORN_SCALE) - self.jacobian * log_jacobian
        )

    def explain(self, old, new):
        return 0.0


@dataclass(frozen=True)
class Walk:
    name = "walk"
    reverse = "walk"

    def propose(self, rng, theta):
        return Proposal(theta + 0.3 * rng.standard_normal(len(theta)), 0.0)


def mixture(*, jacobian: bool = True) -> Mixture:
    return Mixture((Birth(jacobian), Death(jacobian), Walk()), (0.2, 0.3, 0.5))


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


def test_every_proposal_can_be_explained_both_ways(rng):
    table = check_rounds(rng, np.zeros(1), log_density, mixture(), n=500)
    assert all(rate > 0.02 for rate in table.rates().values())


def test_check_misses_the_jacobian(rng):
    with pytest.raises(RoundTripError):
        check_rounds(rng, np.zeros(1), log_density, mixture(jacobian=False), n=50)
