"""From draws of one density to another that is a factor away: weights, and a bridge of densities.

Draws x_n of p(x) become draws of p(x) L(x) by weights L(x_n), and the mean weight is the ratio of
both densities' integrals. Where few draws have most of the weight they are led there in small steps
instead: p L^b for powers b that rise from 0 to 1, at each of which draws are chosen by weight and
then moved by a kernel that leaves p L^b as it is (annealed importance sampling with resampling).
The product of the mean weights of all steps is the ratio.

Weights are not smoothed by a Pareto tail: those of a normalised statement are bounded, and draws
of a chain repeat themselves, which the fit of a tail takes for its shape.

References
----------
Del Moral, Doucet & Jasra 2006, J. R. Stat. Soc. B 68, 411 (sequential Monte Carlo samplers).
Lee & Whiteley 2018, Biometrika 105, 609 (the variance of the ratio from its families).
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

__all__ = ["Reweighted", "bridge", "families_of", "resample", "reweigh"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
S = TypeVar("S")

# Draws that have to be left, or this share of them if there are few, and the largest error of the
# log ratio, nats: draws of chains may all be of one stretch in which they hardly moved. Chosen.
_ENOUGH, _SHARE, _ERROR = 100.0, 0.25, 0.3
# Share of the draws that is left, effectively, by each step of a bridge; the usual choice.
_KEPT = 0.5
# Parts of each chain that count as independent of one another in the error of a bridge.
_PARTS = 4


@dataclass(frozen=True)
class Reweighted:
    """Draws with weights.

    Parameters
    ----------
    weights : (C, N) float
        Their sum is 1.
    log_ratio : float
        Log of the ratio of the integrals, nats.
    error : float
        Its standard error; NaN where chains are too short.
    effective : float
        Draws of equal weight that would be as good, by Kish: 1 / sum of squared weights.
    """

    weights: Array
    log_ratio: float
    error: float
    effective: float

    @property
    def good(self) -> bool:
        """Whether enough draws are left."""
        enough = self.effective >= min(_ENOUGH, _SHARE * self.weights.size)
        return enough and self.error <= _ERROR


def reweigh(log_weights: ArrayLike) -> Reweighted:
    """Weights of draws from the log of the factor.

    Parameters
    ----------
    log_weights : (C, N) float
        Of each draw of each chain, nats; finite.

    Returns
    -------
    Reweighted
        Its error is by chains and their correlation.
    """
    log_weights = np.asarray(log_weights, float)
    top = log_weights.max()
    plain = np.exp(log_weights - top)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ShortChainWarning)
        error = float(mean_error(plain) / plain.mean()) if np.ptp(plain) > 0 else 0.0
    weights = plain / plain.sum()
    return Reweighted(
        weights=weights,
        log_ratio=float(top + math.log(plain.mean())),
        error=error,
        effective=float(1 / (weights**2).sum()),
    )


def resample(weights: ArrayLike, count: int, rng: np.random.Generator) -> Ints:
    """Draws chosen by weight, as evenly as can be, in their order.

    Parameters
    ----------
    weights : (N,) float
        Their sum is 1.
    count : int
    rng : numpy.random.Generator

    Returns
    -------
    (count,) int
        Each draw n occurs ``count * weights[n]`` times, rounded up or down.
    """
    ends = np.cumsum(np.asarray(weights, float))
    at = (np.arange(count) + rng.random()) / count * ends[-1]
    chosen: Ints = np.searchsorted(ends, at, side="right").astype(np.int64)
    return chosen


@dataclass(frozen=True)
class Bridged(Generic[S]):
    """Draws of the density with the factor, led there.

    Parameters
    ----------
    states : tuple of S
    log_ratio : float
        Log of the ratio of the integrals, nats.
    error : float
        Its standard error.
    powers : tuple of float
        Of the factor, after each step; the last is 1.
    """

    states: tuple[S, ...]
    log_ratio: float
    error: float
    powers: tuple[float, ...]


def families_of(n_chains: int, n_draws: int) -> Ints:
    """Families of draws that are told chain by chain: parts of chains, independent or nearly.

    Parameters
    ----------
    n_chains, n_draws : int

    Returns
    -------
    (n_chains * n_draws,) int
    """
    part = np.arange(n_draws) * min(_PARTS, n_draws) // n_draws
    return (np.arange(n_chains)[:, None] * _PARTS + part).ravel().astype(np.int64)


def bridge(
    rng: np.random.Generator,
    states: Sequence[S],
    families: ArrayLike,
    *,
    log_factor: Callable[[S], float],
    advance: Callable[[np.random.Generator, S, float], S],
    on_power: Callable[[float], None] | None = None,
) -> Bridged[S]:
    """Lead draws from a density to the same with a factor.

    Parameters
    ----------
    rng : numpy.random.Generator
    states : sequence of P S
        Draws of the density without the factor.
    families : (P,) int
        Those of one family may depend on one another: parts of chains.
    log_factor : callable
        Log of the factor, nats; finite.
    advance : callable
        ``advance(rng, state, power)`` moves a state and leaves the density with that power of the
        factor as it is.
    on_power : callable, optional
        Called with each power that is reached.

    Returns
    -------
    Bridged
    """
    states, count = list(states), len(states)
    _, family = np.unique(np.asarray(families), return_inverse=True)
    number, factor = int(family.max()) + 1, np.array([log_factor(s) for s in states])
    power, total, powers = 0.0, 0.0, list[float]()
    shares = np.full(number, 1 / number)
    while power < 1.0:
        by = _next_step(factor, 1.0 - power)
        log_weights = by * factor
        top = log_weights.max()
        weights = np.exp(log_weights - top)
        total += float(top + math.log(weights.mean()))
        weights /= weights.sum()
        power = 1.0 if power + by > 1.0 - 1e-12 else power + by
        powers.append(power)
        shares = np.bincount(family, weights, number)
        # Independent choices: their variance is the one that the families tell.
        chosen = rng.choice(count, count, p=weights)
        states, family = [advance(rng, states[n], power) for n in chosen], family[chosen]
        factor = np.array([log_factor(s) for s in states])
        if on_power is not None:
            on_power(power)
    return Bridged(tuple(states), total, _family_error(shares, count, len(powers)), tuple(powers))


def _next_step(log_factor: Array, most: float) -> float:
    """How much the power may rise so that enough draws are left."""

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
    """Relative standard error of a product of mean weights (Lee & Whiteley 2018, equation 8).

    ``shares`` of the last weights are by family, of ``count`` draws, chosen ``steps`` - 1 times.
    """
    number = len(shares)
    if number < 2:
        return math.nan
    apart = (1 - (shares**2).sum()) * number / (number - 1) * (count / (count - 1)) ** (steps - 1)
    return math.sqrt(max(0.0, 1 - apart))
