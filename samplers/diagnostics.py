"""Convergence diagnostics of chains that jump between dimensions.

R-hat and effective sample size are defined only for quantities that every draw has: the number of
objects, the log posterior, the occupancy of a cell. The layout of a draw is a categorical
indicator; the error of a layout's probability comes from the transitions between layouts (Heck et
al. 2019).

References
----------
Heck, Overstall, Gronau & Wagenmakers 2019, Stat. Comput. 29, 631 (layout indicators).
Vehtari, Gelman, Simpson, Carpenter & Buerkner 2021, Bayesian Anal. 16, 667 (R-hat).
Grassmann, Taksar & Heyman 1985, Oper. Res. 33, 1107 (stationary distributions).
Chodera 2016, J. Chem. Theory Comput. 12, 1799 (detection of equilibration).
"""

from __future__ import annotations

import warnings
from typing import Any, NamedTuple

import numpy as np
from arviz_stats.base.array import array_stats as _untyped_array_stats
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "LayoutProbabilities",
    "ShortChainWarning",
    "equilibrated",
    "ess",
    "layout_probabilities",
    "mean_error",
    "rhat",
    "stationary_distribution",
    "unanimous_error",
]

Array = NDArray[np.float64]
array_stats: Any = _untyped_array_stats

# R-hat splits each chain in halves, and a variance needs two draws in each.
_MINIMUM_DRAWS = 4
# Layouts beyond the 20 most probable are merged when errors are computed; any of them has less than
# 5 % of the mass.
_SEPARATE_LAYOUTS = 20
# Number of draws of the transition matrix: the relative error of the result is
# 1 / sqrt(2 * 500) = 3 %.
_MATRIX_DRAWS = 500
# Parts of the draws that may be dropped as not yet equilibrated, and the least number of draws of
# which any are: effective draws are too uncertain with fewer.
_DROPPED = (0.1, 0.2, 0.3, 0.4, 0.5)
_DROPPED_OF = 200
# Factor by which the effective draws must grow; by chance they seldom double.
_EQUILIBRATED = 2.0
# Least transition probability, so that the elimination never divides by zero.
_NEVER = 1e-100


class ShortChainWarning(UserWarning):
    """Chains are too short for a diagnostic, which is then NaN."""


class LayoutProbabilities(NamedTuple):
    """Posterior probabilities of layouts, in descending order.

    Parameters
    ----------
    layouts : (K,) int
        Values of the layout indicator.
    probability : (K,) float
        Share of all draws, averaged over chains.
    standard_error : (K,) float
        Monte-Carlo standard error of ``probability``.
    by_chain : (C, K) float
        Share of each chain's draws.
    by_half : (C, 2, K) float
        Share of the draws in each half of each chain.
    n_draws : int
        Draws per chain.
    """

    layouts: NDArray[np.int64]
    probability: Array
    standard_error: Array
    by_chain: Array
    by_half: Array
    n_draws: int

    @property
    def effective_draws(self) -> Array:
        """(K,) number of independent draws with the same error; infinite if all draws agree."""
        variance = self.probability * (1 - self.probability)
        with np.errstate(divide="ignore", invalid="ignore"):
            effective = variance / self.standard_error**2
        return np.where(variance == 0, np.inf, effective)


def layout_probabilities(indicators: ArrayLike, *, rng: np.random.Generator) -> LayoutProbabilities:
    """Estimate layout probabilities and their Monte-Carlo standard errors.

    The error is the largest of three estimates. The first is the standard deviation of the
    stationary distribution when the transition matrix between layouts is drawn from its Dirichlet
    posterior, with a prior of 1/K per cell (Heck et al. 2019). It assumes that the indicator is a
    Markov chain, and is too small if a layout contains scenes that change slowly. The second is the
    Monte-Carlo error of the mean of the indicator, which uses correlations at all lags. The third
    is the standard error between chains; it needs no assumption but is noisy with few chains.

    Parameters
    ----------
    indicators : (C, N) int
        Layout of each draw of each chain, as any integers.
    rng : numpy.random.Generator
        Generator for the draws of the transition matrix.

    Returns
    -------
    LayoutProbabilities

    Warns
    -----
    ShortChainWarning
        Fewer than two draws per chain: standard errors are NaN.
    """
    indicators = np.asarray(indicators)
    if indicators.ndim != 2 or indicators.size == 0:
        raise ValueError(f"indicators must be (chains, draws), not {indicators.shape}")
    n_chains, n_draws = indicators.shape
    layouts, codes = np.unique(indicators, return_inverse=True)
    order = np.argsort(-np.bincount(codes.ravel()), kind="stable")
    codes = np.argsort(order)[codes.reshape(indicators.shape)]
    by_chain = _shares(codes, len(layouts))
    # With an odd number of draws the middle one is in both halves.
    halves = codes[:, : (n_draws + 1) // 2], codes[:, n_draws // 2 :]
    by_half = np.stack([_shares(half, len(layouts)) for half in halves], axis=1)
    probability = by_chain.mean(0)
    if n_draws < 2:
        warnings.warn("one draw a chain says nothing of errors", ShortChainWarning, stacklevel=2)
        error = np.full(len(layouts), np.nan)
    else:
        error = np.maximum(_transition_error(codes, probability, rng), _lagged_error(codes))
        if n_chains > 1:
            error = np.maximum(error, by_chain.std(0, ddof=1) / np.sqrt(n_chains))
    return LayoutProbabilities(layouts[order], probability, error, by_chain, by_half, n_draws)


def _lagged_error(codes: NDArray[np.intp]) -> Array:
    """(K,) Monte-Carlo error of the share of each of the separate layouts; 0 of the others."""
    found = np.zeros(codes.max() + 1)
    if codes.shape[1] >= _MINIMUM_DRAWS:
        for layout in range(min(len(found), _SEPARATE_LAYOUTS)):
            own = (codes == layout).astype(float)
            if np.ptp(own) > 0:
                found[layout] = float(mean_error(own))
    return found


def _shares(codes: NDArray[np.intp], n_layouts: int) -> Array:
    """(C, K) share of each layout in each chain, from (C, N) layout codes."""
    counts = np.stack([np.bincount(chain, minlength=n_layouts) for chain in codes])
    return np.asarray(counts / codes.shape[1])


def _transition_error(
    codes: NDArray[np.intp], probability: Array, rng: np.random.Generator
) -> Array:
    """(K,) standard error from transitions; layouts are coded by descending probability.

    Layouts that were merged divide the error of their union in proportion to sqrt(p (1 - p)).
    """
    lumped = np.minimum(codes, _SEPARATE_LAYOUTS)
    n = int(lumped.max()) + 1
    pairs = lumped[:, :-1] * n + lumped[:, 1:]
    transitions = np.bincount(pairs.ravel(), minlength=n * n).reshape(n, n)
    draws = rng.standard_gamma(transitions + 1 / n, size=(_MATRIX_DRAWS, n, n))
    matrices = np.maximum(draws / draws.sum(-1, keepdims=True), _NEVER)
    error: Array = stationary_distribution(matrices).std(0, ddof=1)
    if len(probability) <= n:
        return error
    rest = probability[n - 1 :]
    union = rest.sum() * (1 - rest.sum())
    scale = np.sqrt(rest * (1 - rest) / union)
    return np.concatenate([error[:-1], error[-1] * scale])


def stationary_distribution(matrices: Array) -> Array:
    """Stationary distributions of positive transition matrices.

    The elimination of Grassmann, Taksar & Heyman has no subtraction, so it stays accurate for
    chains that hardly ever leave a layout.

    Parameters
    ----------
    matrices : (..., K, K) float
        Rows sum to one.

    Returns
    -------
    (..., K) float
    """
    reduced = np.array(matrices)
    n = reduced.shape[-1]
    for k in range(n - 1, 0, -1):
        reduced[..., :k, k] /= reduced[..., k, :k].sum(-1, keepdims=True)
        reduced[..., :k, :k] += reduced[..., :k, k, None] * reduced[..., None, k, :k]
    weights = np.ones(reduced.shape[:-1])
    for k in range(1, n):
        weights[..., k] = (weights[..., :k] * reduced[..., :k, k]).sum(-1)
    weights /= weights.sum(-1, keepdims=True)
    return weights


def rhat(draws: ArrayLike) -> Array:
    """Rank-normalised split R-hat.

    The value is 1 if all draws are equal, and infinite if each chain is constant at its own value.

    Parameters
    ----------
    draws : (C, N, ...) float
        Draws of C chains.

    Returns
    -------
    (...) float

    Warns
    -----
    ShortChainWarning
        Fewer than 4 draws, or only one chain: NaN.
    """
    draws = np.asarray(draws, float)
    if _too_short(draws.shape[0], draws.shape[1]):
        return np.full(draws.shape[2:], np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        values = array_stats.rhat(draws, chain_axis=0, draw_axis=1)
    return _settle_constants(np.asarray(values, float), draws)


def ess(draws: ArrayLike) -> Array:
    """Bulk effective sample size; C N if all draws are equal.

    Parameters
    ----------
    draws : (C, N, ...) float
        Draws of C chains.

    Returns
    -------
    (...) float

    Warns
    -----
    ShortChainWarning
        Fewer than 4 draws: NaN.
    """
    draws = np.asarray(draws, float)
    if _too_short(2, draws.shape[1]):
        return np.full(draws.shape[2:], np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(array_stats.ess(draws, chain_axis=0, draw_axis=1), np.float64)


def equilibrated(log_density: ArrayLike) -> int:
    """Number of first draws of each chain from before the chains were in equilibrium.

    Chains that all find a better mode late have few effective draws of the log density, and many
    more if the draws before are dropped. The number is that with the most effective draws of the
    rest, at most half (Chodera 2016). To keep draws of modes that are rare but correct, it is 0
    unless the effective draws at least double, and the log density rises in all chains: in each by
    at least half of the mean rise.

    Parameters
    ----------
    log_density : (C, N) float
        Of each draw of C chains.

    Returns
    -------
    int
        0 if there are fewer than 200 draws a chain.
    """
    values = np.asarray(log_density, float)
    n = values.shape[1]
    if n < _DROPPED_OF:
        return 0
    options = [round(part * n) for part in _DROPPED]
    effective = [float(ess(values[:, first:])) for first in options]
    first = options[int(np.argmax(effective))]
    rise = values[:, first:].mean(1) - values[:, :first].mean(1)
    together = rise.min() >= 0.5 * rise.mean() > 0
    return first if together and max(effective) >= _EQUILIBRATED * float(ess(values)) else 0


def mean_error(draws: ArrayLike) -> Array:
    """Monte-Carlo standard error of the mean.

    Parameters
    ----------
    draws : (C, N, ...) float
        Draws of C chains.

    Returns
    -------
    (...) float

    Warns
    -----
    ShortChainWarning
        Fewer than 4 draws: NaN.
    """
    draws = np.asarray(draws, float)
    if _too_short(2, draws.shape[1]):
        return np.full(draws.shape[2:], np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        values = array_stats.mcse(draws, method="mean", chain_axis=0, draw_axis=1)
    return np.asarray(values, np.float64)


def unanimous_error(log_density: ArrayLike) -> float:
    """Standard error of a probability on which all draws agree.

    Such draws have no variance to take an error from. After n independent draws that agree, the
    next one differs with probability 1 / (n + 2) under a uniform prior (Laplace's rule of
    succession), which is also the standard deviation of the probability up to terms of order
    1 / n^2. Here n is the effective number of draws of the log density.

    Parameters
    ----------
    log_density : (C, N) float
        Of each draw of C chains.

    Returns
    -------
    float
        NaN with fewer than 4 draws.

    Warns
    -----
    ShortChainWarning
        Fewer than 4 draws.
    """
    return float(1 / (ess(log_density) + 2))


def _too_short(n_chains: int, n_draws: int) -> bool:
    short = n_draws < _MINIMUM_DRAWS or n_chains < 2
    if short:
        warnings.warn(
            f"{n_chains} chains of {n_draws} draws: convergence needs 2 chains of "
            f"{_MINIMUM_DRAWS} draws",
            ShortChainWarning,
            stacklevel=3,
        )
    return short


def _settle_constants(values: Array, chains: Array) -> Array:
    """Set R-hat of constant chains, where it is 0/0: 1 if all are equal, else infinite."""
    lowest, highest = chains.min(1), chains.max(1)
    frozen = (lowest == highest).all(0)
    same = frozen & (lowest == lowest[:1]).all(0)
    return np.where(same, 1.0, np.where(frozen, np.inf, values))
