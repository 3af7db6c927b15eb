"""Polynomials of one to three coefficients: evidences are known in closed form."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import stats

from imapper_prob.samplers.reversible_jump import Mixture, Proposal
from imapper_prob.samplers.tempering import POSTERIOR, LogDensityParts, Rung

K_MAX, NOISE, PRIOR = 3, 0.5, 1.5
X = np.linspace(-1, 1, 12)
Y = 0.4 + 0.5 * X + 0.3 * X**2 + NOISE * np.random.default_rng(3).standard_normal(len(X))
DESIGN = X[:, None] ** np.arange(K_MAX)

ROOT_TWO_PI = math.sqrt(2 * math.pi)

# A birth also pulls the coefficients it finds towards zero: a Jacobian that depends on k.
PULL, BORN_SCALE = 0.8, 0.7


def log_evidences(beta: float = 1.0) -> np.ndarray:
    """(K_MAX,) log p(y | k), the likelihood to the power beta; else up to a constant."""
    return np.array(
        [
            stats.multivariate_normal(
                cov=NOISE**2 / beta * np.eye(len(X)) + PRIOR**2 * DESIGN[:, :k] @ DESIGN[:, :k].T
            ).logpdf(Y)
            for k in range(1, K_MAX + 1)
        ]
    )


def exact(rung: Rung = POSTERIOR) -> np.ndarray:
    """P(k | y) on a rung, all k equally probable a priori."""
    log_weights = log_evidences(rung.beta) + sum(rung.tilts) * np.arange(1, K_MAX + 1)
    weights = np.exp(log_weights - log_weights.max())
    return weights / weights.sum()


def target(theta: np.ndarray, y: np.ndarray = Y) -> LogDensityParts:
    """Density of theta given its length, and of y given theta, both normalised."""
    residual = (y - DESIGN[:, : len(theta)] @ theta) / NOISE
    prior = -0.5 * theta @ theta / PRIOR**2 - len(theta) * math.log(PRIOR * ROOT_TWO_PI)
    likelihood = -0.5 * residual @ residual - len(X) * math.log(NOISE * ROOT_TWO_PI)
    return LogDensityParts(float(prior), float(likelihood), (float(len(theta)),))


def log_density(theta: np.ndarray, y: np.ndarray = Y) -> float:
    return target(theta, y).at(POSTERIOR)


def draw_prior(rng: np.random.Generator) -> np.ndarray:
    return PRIOR * rng.standard_normal(rng.integers(1, K_MAX + 1))


def draw_data(rng: np.random.Generator, theta: np.ndarray) -> np.ndarray:
    return DESIGN[:, : len(theta)] @ theta + NOISE * rng.standard_normal(len(X))


def log_normal(u: float) -> float:
    return -0.5 * u * u - math.log(ROOT_TWO_PI)


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

    def log_proposal_density(self, old, new):
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

    def log_proposal_density(self, old, new):
        return 0.0


@dataclass(frozen=True)
class Walk:
    name = "walk"
    reverse = "walk"

    def propose(self, rng, theta):
        return Proposal(theta + 0.3 * rng.standard_normal(len(theta)), 0.0)

    def log_proposal_density(self, old, new):
        return float(-0.5 * np.sum(((new - old) / 0.3) ** 2))


def mixture(*, jacobian: bool = True) -> Mixture:
    return Mixture((Birth(jacobian), Death(jacobian), Walk()), (0.2, 0.3, 0.5))
