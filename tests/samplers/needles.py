"""Needles on a floor: a place and a yaw each, up to four, with everything known.

The prior has a truncated Poisson number of needles, uniform places on (0, 1) and uniform
yaws. The likelihood favours yaws about zero (von Mises) and leaves places alone, so that
numbers, places and yaws of the posterior have closed forms; without it the prior comes back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import i0

from imapper_prob.samplers.reversible_jump import Mixture, Proposal
from imapper_prob.samplers.tempering import LogDensityParts

K_MAX, MEAN, KAPPA = 4, 1.8, 1.5
LOG_TURN = math.log(2 * math.pi)
EMPTY = np.empty((0, 2))


def numbers(kappa: float) -> np.ndarray:
    """(K_MAX + 1,) probability of each number of needles: the yaws integrate to I0(kappa)."""
    weights = np.array([(MEAN * i0(kappa)) ** k / math.factorial(k) for k in range(K_MAX + 1)])
    return weights / weights.sum()


def target(needles: np.ndarray, kappa: float = KAPPA) -> LogDensityParts:
    """Density of a list of needles in some order, and of its yaws relative to the prior."""
    if len(needles) > K_MAX or not ((needles[:, 0] > 0) & (needles[:, 0] < 1)).all():
        return LogDensityParts(-math.inf, 0.0)
    prior = len(needles) * (math.log(MEAN) - LOG_TURN) - math.lgamma(len(needles) + 1)
    return LogDensityParts(prior, kappa * float(np.cos(needles[:, 1]).sum()))


def draw(rng: np.random.Generator, kappa: float) -> np.ndarray:
    """An independent draw."""
    k = rng.choice(K_MAX + 1, p=numbers(kappa))
    return np.stack([rng.random(k), rng.vonmises(0, kappa, k)], axis=1)


@dataclass(frozen=True)
class Birth:
    """A needle more: a place drawn from Beta(2, 1) and a yaw from all round."""

    log_turn: float = LOG_TURN
    name = "birth"
    reverse = "death"

    def propose(self, rng, needles):
        if len(needles) == K_MAX:
            return None
        place, yaw = math.sqrt(rng.random()), rng.uniform(-math.pi, math.pi)
        at = int(rng.integers(len(needles) + 1))
        new = np.insert(needles, at, (place, yaw), axis=0)
        # Any of the k + 1 dies with the same probability as one of k + 1 gaps is chosen.
        return Proposal(new, self.log_turn - math.log(2 * place))

    def log_proposal_density(self, old, new):
        at = next((i for i in range(len(new)) if np.array_equal(np.delete(new, i, 0), old)), None)
        if at is None:
            return -math.inf
        return math.log(2 * new[at, 0]) - LOG_TURN - math.log(len(new))


@dataclass(frozen=True)
class Death:
    """A needle less, any of them."""

    log_turn: float = LOG_TURN
    name = "death"
    reverse = "birth"

    def propose(self, rng, needles):
        if not len(needles):
            return None
        at = int(rng.integers(len(needles)))
        ratio = math.log(2 * needles[at, 0]) - self.log_turn
        return Proposal(np.delete(needles, at, axis=0), ratio)

    def log_proposal_density(self, old, new):
        return -math.log(len(old))


@dataclass(frozen=True)
class Turn:
    """All needles by the same angle."""

    name = "turn"
    reverse = "turn"

    def propose(self, rng, needles):
        turned = needles.copy()
        turned[:, 1] += 0.8 * rng.standard_normal()
        turned[:, 1] = np.remainder(turned[:, 1] + math.pi, 2 * math.pi) - math.pi
        return Proposal(turned, 0.0)

    def log_proposal_density(self, old, new):
        # Wrapped, all yaws by the same angle: a normal density up to a common factor.
        if not len(old):
            return 0.0
        angles = np.arange(-3, 4) * 2 * math.pi + new[0, 1] - old[0, 1]
        return float(np.logaddexp.reduce(-0.5 * (angles / 0.8) ** 2))


@dataclass(frozen=True)
class Squeeze:
    """All places to a power, about 1: the Jacobian is known by heart and easily dropped."""

    jacobian: bool = True
    name = "squeeze"
    reverse = "squeeze"

    def propose(self, rng, needles):
        log_power = 0.3 * rng.standard_normal()
        power = math.exp(log_power)
        squeezed = needles.copy()
        squeezed[:, 0] **= power
        ratio = len(needles) * log_power + (power - 1) * float(np.log(needles[:, 0]).sum())
        return Proposal(squeezed, self.jacobian * ratio)

    def log_proposal_density(self, old, new):
        # Densities of the same underlying normal number; d new / d old makes the difference.
        if not len(old):
            return 0.0
        log_power = math.log(math.log(new[0, 0]) / math.log(old[0, 0]))
        stretch = len(old) * log_power + float(np.log(new[:, 0] / old[:, 0]).sum())
        return -0.5 * (log_power / 0.3) ** 2 - 0.5 * stretch


def mixture(*, log_turn: float = LOG_TURN, jacobian: bool = True) -> Mixture:
    return Mixture(
        (Birth(log_turn), Death(log_turn), Turn(), Squeeze(jacobian)), (0.35, 0.25, 0.2, 0.2)
    )
