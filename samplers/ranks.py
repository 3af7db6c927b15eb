"""Are ranks uniform? What simulation-based calibration looks at.

Draw parameters from the prior, data given them, and L draws from the posterior of these data:
then the rank of the true value among the draws is uniform on 0 ... L, whatever is asked of the
parameters and the data (Cook, Gelman & Rubin 2006; Talts et al. 2018, arXiv:1804.06788).
Whether N ranks are uniform is seen best in their cumulative distribution, beside the band in
which all of it lies with a stated probability if they are (Säilynoja, Bürkner & Vehtari 2022,
Stat. Comput. 32, 32).
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import binom

__all__ = ["Band", "ecdf_band", "ecdf_of_ranks", "rank_among", "uniformity"]

Array = NDArray[np.float64]

_SIMULATED = 4000
"""Sets of uniform ranks by which a band is made: a probability of 1 % is then known to .16 %."""


class Band(NamedTuple):
    """Where the cumulative shares of uniform ranks lie, all of them at once.

    Parameters
    ----------
    at : (K,) float
        Share of the possible ranks, ascending to 1.
    low, high : (K,) float
        Share of the ranks up to there.
    """

    at: Array
    low: Array
    high: Array


def rank_among(rng: np.random.Generator, value: float, draws: ArrayLike) -> int:
    """How many of the L draws a value exceeds; equal ones are put in order by chance."""
    draws = np.asarray(draws, float)
    equal = int((draws == value).sum())
    return int((draws < value).sum()) + int(rng.integers(equal + 1))


def ecdf_of_ranks(ranks: ArrayLike, *, n_draws: int) -> Array:
    """(L + 1,) share of the ranks that are 0, at most 1, ... at most L."""
    counts = np.bincount(np.asarray(ranks, np.int64), minlength=n_draws + 1)
    shares: Array = counts.cumsum() / counts.sum()
    return shares


def ecdf_band(n_ranks: int, *, n_draws: int, probability: float = 0.95) -> Band:
    """The band that holds all cumulative shares of uniform ranks with a probability."""
    at = np.arange(1, n_draws + 2) / (n_draws + 1)
    level = float(np.quantile(_surprises(n_ranks, n_draws), 1 - probability))
    low = binom.ppf(level / 2, n_ranks, at) / n_ranks
    high = binom.isf(level / 2, n_ranks, at) / n_ranks
    return Band(at, low, high)


def uniformity(ranks: ArrayLike, *, n_draws: int) -> float:
    """P-value of the hypothesis that ranks are uniform: 1 minus the narrowest band's probability.

    At least one over the number of simulated sets of ranks.
    """
    ranks = np.asarray(ranks, np.int64)
    simulated = _surprises(len(ranks), n_draws)
    found = _surprise(ecdf_of_ranks(ranks, n_draws=n_draws)[None], len(ranks))[0]
    return float((1 + (simulated <= found * (1 + 1e-9)).sum()) / (1 + len(simulated)))


def _surprise(shares: Array, n_ranks: int) -> Array:
    """(S,) the smallest two-sided pointwise probability along each row of cumulative shares."""
    at = np.arange(1, shares.shape[1] + 1) / shares.shape[1]
    counts = np.round(shares * n_ranks)
    # The last share is always 1.
    below = binom.cdf(counts, n_ranks, at)[:, :-1]
    above = binom.sf(counts - 1, n_ranks, at)[:, :-1]
    smallest: Array = np.minimum(1.0, 2 * np.minimum(below, above)).min(1)
    return smallest


@lru_cache(maxsize=16)
def _surprises(n_ranks: int, n_draws: int) -> Array:
    """(S,) ascending: of simulated sets of uniform ranks, always the same ones."""
    rng = np.random.default_rng(0)
    uniform = np.full(n_draws + 1, 1 / (n_draws + 1))
    counts = rng.multinomial(n_ranks, uniform, size=_SIMULATED)
    surprises = np.sort(_surprise(counts.cumsum(1) / n_ranks, n_ranks))
    surprises.setflags(write=False)
    return surprises
