"""Importance reweighting of draws to a density with one more factor, and annealing for hard cases.

Draws x_n of p(x) become draws of p(x) L(x) with weights L(x_n). The mean weight estimates the ratio
of the two normalising constants. If few draws have most of the weight, draws are annealed instead:
the powers b of p L^b rise from 0 to 1 in small steps; at each step draws are resampled by weight
and then moved by a kernel that leaves p L^b invariant (annealed importance sampling with
resampling). The product of the mean weights of all steps estimates the ratio.

Weights are not smoothed by a Pareto tail. Weights of a normalised statement are bounded, and the
repeated draws of a chain would bias the fitted shape of the tail.

References
----------
Del Moral, Doucet & Jasra 2006, J. R. Stat. Soc. B 68, 411 (sequential Monte Carlo samplers).
Lee & Whiteley 2018, Biometrika 105, 609 (variance of the ratio from families of draws).
Neal 2001, Stat. Comput. 11, 125 (annealed importance sampling).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.samplers.diagnostics import ShortChainWarning, mean_error

__all__ = ["Reweighted", "anneal", "families_of", "resample", "reweigh"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
S = TypeVar("S")

# Least effective number of draws, the share of all draws that is enough if they are few, and the
# largest error of the log ratio, nats. The error is limited too, because the draws with weight may
# all come from one stretch in which a chain hardly moved. Chosen values.
_ENOUGH, _SHARE, _ERROR = 100.0, 0.25, 0.3
# Effective share of the draws after each step of annealing; the usual choice.
_KEPT = 0.5
# Parts of each chain that are treated as independent in the error of annealed draws.
_PARTS = 4


@dataclass(frozen=True)
class Reweighted:
    """Weighted draws.

    Parameters
    ----------
    weights : (C, N) float
        Their sum is 1.
    log_ratio : float
        Log ratio of the normalising constants, nats.
    error : float
        Standard error of ``log_ratio``, nats; NaN if chains are too short.
    effective : float
        Effective sample size by Kish: 1 / sum of squared weights.
    """

    weights: Array
    log_ratio: float
    error: float
    effective: float

    @property
    def good(self) -> bool:
        """Whether the effective sample size and the error are good enough for use."""
        enough = self.effective >= min(_ENOUGH, _SHARE * self.weights.size)
        return enough and self.error <= _ERROR


def reweigh(log_weights: ArrayLike) -> Reweighted:
    """Compute normalised weights of draws from the log of the factor.

    Parameters
    ----------
    log_weights : (C, N) float
        Log factor of each draw of each chain, nats; finite.

    Returns
    -------
    Reweighted
        Its error accounts for the autocorrelation within chains; if all draws have the same
        weight, it is that of as many independent draws which agree.
    """
    log_weights = np.asarray(log_weights, float)
    top = log_weights.max()
    plain = np.exp(log_weights - top)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ShortChainWarning)
        error = float(mean_error(plain) / plain.mean())
    if np.ptp(plain) == 0:  # no variance to take an error from, see `unanimous_error`
        error = 1 / (plain.size + 2)
    weights = plain / plain.sum()
    return Reweighted(
        weights=weights,
        log_ratio=float(top + math.log(plain.mean())),
        error=error,
        effective=float(1 / (weights**2).sum()),
    )


def resample(weights: ArrayLike, count: int, rng: np.random.Generator) -> Ints:
    """Resample systematically; the indices come in ascending order.

    Parameters
    ----------
    weights : (N,) float
        Their sum is 1.
    count : int
    rng : numpy.random.Generator

    Returns
    -------
    (count,) int
        Index n occurs ``count * weights[n]`` times, rounded up or down.
    """
    ends = np.cumsum(np.asarray(weights, float))
    at = (np.arange(count) + rng.random()) / count * ends[-1]
    last = np.searchsorted(ends, ends[-1])  # rounding may put the last point at the end
    chosen: Ints = np.minimum(np.searchsorted(ends, at, side="right"), last).astype(np.int64)
    return chosen


@dataclass(frozen=True)
class Annealed(Generic[S]):
    """Draws of the density with the factor, after annealing.

    Parameters
    ----------
    states : tuple of S
    log_ratio : float
        Log ratio of the normalising constants, nats.
    error : float
        Standard error of ``log_ratio``, nats.
    """

    states: tuple[S, ...]
    log_ratio: float
    error: float


def families_of(n_chains: int, n_draws: int) -> Ints:
    """Family index of each draw: parts of chains, which are treated as independent.

    Parameters
    ----------
    n_chains, n_draws : int

    Returns
    -------
    (n_chains * n_draws,) int
    """
    part = np.arange(n_draws) * min(_PARTS, n_draws) // n_draws
    return (np.arange(n_chains)[:, None] * _PARTS + part).ravel().astype(np.int64)


def anneal(
    rng: np.random.Generator,
    states: Sequence[S],
    families: ArrayLike,
    *,
    log_factor: Callable[[S], float],
    advance: Callable[[np.random.Generator, S, float], S],
    on_power: Callable[[float], None] | None = None,
) -> Annealed[S]:
    """Anneal draws of a density to the same density times a factor (annealed SMC).

    Parameters
    ----------
    rng : numpy.random.Generator
    states : sequence of P S
        Draws of the density without the factor; P of them.
    families : (P,) int
        Family of each draw. Draws of one family, such as a part of a chain, may be dependent.
    log_factor : callable
        Log of the factor, nats; finite.
    advance : callable
        ``advance(rng, state, power)`` moves a state by a kernel that leaves the density times that
        power of the factor invariant.
    on_power : callable, optional
        Called with each power when it is reached.

    Returns
    -------
    Annealed
    """
    states, count = list(states), len(states)
    _, family = np.unique(np.asarray(families), return_inverse=True)
    number, factor = int(family.max()) + 1, np.array([log_factor(s) for s in states])
    power, total, steps = 0.0, 0.0, 0
    shares = np.full(number, 1 / number)
    while power < 1.0:
        by = _next_step(factor, 1.0 - power)
        log_weights = by * factor
        top = log_weights.max()
        weights = np.exp(log_weights - top)
        total += float(top + math.log(weights.mean()))
        weights /= weights.sum()
        power = 1.0 if power + by > 1.0 - 1e-12 else power + by
        steps += 1
        shares = np.bincount(family, weights, number)
        # Multinomial resampling, because the variance estimate from families assumes it.
        chosen = rng.choice(count, count, p=weights)
        states, family = [advance(rng, states[n], power) for n in chosen], family[chosen]
        factor = np.array([log_factor(s) for s in states])
        if on_power is not None:
            on_power(power)
    return Annealed(tuple(states), total, _family_error(shares, count, steps))


def _next_step(log_factor: Array, most: float) -> float:
    """Largest increase of the power, up to ``most``, that keeps the effective share above
    `_KEPT`."""

    def left(by: float) -> float:
        weights = np.exp(by * (log_factor - log_factor.max()))
        return float(weights.sum() ** 2 / (weights**2).sum() / len(weights))

    if left(most) >= _KEPT:
        return most
    low, high = 0.0, most
    while high - low > 1e-3 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if left(middle) >= _KEPT else (low, middle)
    return high


def _family_error(shares: Array, count: int, steps: int) -> float:
    """Standard error of the log of the product of mean weights, nats.

    Equation 8 of Lee & Whiteley 2018 estimates the variance of the product Z over the mean of its
    square, v / (1 + v) for the relative variance v; of a log-normal product, v is that of exp(N(0,
    error^2)). ``shares`` are the last weights summed by family, of ``count`` draws resampled
    ``steps`` - 1 times. NaN if all draws are of one family: then nothing is known of the error.
    """
    number = len(shares)
    if number < 2:
        return math.nan
    apart = (1 - (shares**2).sum()) * number / (number - 1) * (count / (count - 1)) ** (steps - 1)
    return math.sqrt(max(0.0, -math.log(apart))) if apart > 0 else math.nan
