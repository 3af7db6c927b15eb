"""How far to trust chains that jump between dimensions.

R-hat and effective draws exist only for what every draw has: the number of objects, the
log posterior, occupancy of a cell. Which layout a draw has is an indicator without order;
the error of its probability comes from the transitions between layouts (Heck et al. 2019).

References
----------
Heck, Overstall, Gronau & Wagenmakers 2019, Stat. Comput. 29, 631 (layout indicators).
Vehtari, Gelman, Simpson, Carpenter & Buerkner 2021, Bayesian Anal. 16, 667 (R-hat).
Grassmann, Taksar & Heyman 1985, Oper. Res. 33, 1107 (stationary distributions).
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
    "ess",
    "layout_probabilities",
    "mean_error",
    "rhat",
    "stationary_distribution",
]

Array = NDArray[np.float64]
array_stats: Any = _untyped_array_stats

# R-hat splits chains in halves, of which a variance needs two draws.
_MINIMUM_DRAWS = 4
# Rarer layouts are taken as one when errors are computed; a twenty-first layout has less
# than 5 % of the mass.
_SEPARATE_LAYOUTS = 20
# Draws of the transition matrix: the error is then known to 3 %, 1 / sqrt(2 * 500).
_MATRIX_DRAWS = 500
# A transition that "never" happens still has a probability one can divide by.
_NEVER = 1e-100


class ShortChainWarning(UserWarning):
    """Chains are too short for what was asked; the answer is NaN."""


class LayoutProbabilities(NamedTuple):
    """How probable each layout is, the most probable first.

    Parameters
    ----------
    layouts : (K,) int
        The indicators' values.
    probability : (K,) float
        Share of all draws.
    standard_error : (K,) float
        Monte-Carlo standard error of ``probability``.
    by_chain : (C, K) float
        Share of each chain's draws.
    by_half : (C, 2, K) float
        The same of the two halves of each chain.
    n_draws : int
        Draws of a chain.
    """

    layouts: NDArray[np.int64]
    probability: Array
    standard_error: Array
    by_chain: Array
    by_half: Array
    n_draws: int

    @property
    def effective_draws(self) -> Array:
        """(K,) independent draws with the same error; infinite where there is no error."""
        variance = self.probability * (1 - self.probability)
        with np.errstate(divide="ignore", invalid="ignore"):
            effective = variance / self.standard_error**2
        return np.where(self.standard_error == 0, np.inf, effective)


def layout_probabilities(indicators: ArrayLike, *, rng: np.random.Generator) -> LayoutProbabilities:
    """Probabilities of layouts with their Monte-Carlo errors.

    The error is the larger of two. One is the spread of the stationary distribution when
    the matrix of transitions between layouts is drawn from its Dirichlet posterior, prior
    1/K a cell (Heck et al. 2019); it takes the indicator for a Markov chain, which it is
    only nearly. The other is the standard error between chains, which needs no such
    assumption but is itself uncertain with few chains.

    Parameters
    ----------
    indicators : (C, N) int
        Layout of each draw of each chain, any integers.
    rng : numpy.random.Generator
        For draws of the transition matrix.

    Returns
    -------
    LayoutProbabilities

    Warns
    -----
    ShortChainWarning
        Fewer than two draws a chain: standard errors are NaN.
    """
    indicators = np.asarray(indicators)
    if indicators.ndim != 2 or indicators.size == 0:
        raise ValueError(f"indicators must be (chains, draws), not {indicators.shape}")
    n_chains, n_draws = indicators.shape
    layouts, codes = np.unique(indicators, return_inverse=True)
    order = np.argsort(-np.bincount(codes.ravel()), kind="stable")
    codes = np.argsort(order)[codes.reshape(indicators.shape)]
    by_chain = _shares(codes, len(layouts))
    # The only draw of a chain is in both its halves.
    halves = codes[:, : (n_draws + 1) // 2], codes[:, n_draws // 2 :]
    by_half = np.stack([_shares(half, len(layouts)) for half in halves], axis=1)
    probability = by_chain.mean(0)
    if n_draws < 2:
        warnings.warn("one draw a chain says nothing of errors", ShortChainWarning, stacklevel=2)
        error = np.full(len(layouts), np.nan)
    else:
        error = _transition_error(codes, probability, rng)
        if n_chains > 1:
            error = np.maximum(error, by_chain.std(0, ddof=1) / np.sqrt(n_chains))
    return LayoutProbabilities(layouts[order], probability, error, by_chain, by_half, n_draws)


def _shares(codes: NDArray[np.intp], n_layouts: int) -> Array:
    """(C, N) codes to (C, K) shares."""
    counts = np.stack([np.bincount(chain, minlength=n_layouts) for chain in codes])
    return np.asarray(counts / codes.shape[1])


def _transition_error(
    codes: NDArray[np.intp], probability: Array, rng: np.random.Generator
) -> Array:
    """(K,) standard error from transitions; layouts are coded by falling probability.

    The rare layouts share the error of their union as so many parts of it would,
    in proportion to sqrt(p (1 - p)).
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

    The elimination of Grassmann, Taksar & Heyman subtracts nothing, so that chains that
    hardly ever leave a layout lose no digits.

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

    1 where all draws are the same, infinite where each half chain has its own constant.

    Parameters
    ----------
    draws : (C, N, ...) float
        Of C chains.

    Returns
    -------
    (...) float

    Warns
    -----
    ShortChainWarning
        Fewer than 4 draws or one chain only: NaN.
    """
    draws = np.asarray(draws, float)
    if _too_short(draws.shape[0], draws.shape[1]):
        return np.full(draws.shape[2:], np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        values = array_stats.rhat(draws, chain_axis=0, draw_axis=1)
    return _settle_constants(np.asarray(values, float), draws)


def ess(draws: ArrayLike) -> Array:
    """Effective draws in the bulk; C N where all draws are the same.

    Parameters
    ----------
    draws : (C, N, ...) float
        Of C chains.

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


def mean_error(draws: ArrayLike) -> Array:
    """Monte-Carlo standard error of the mean.

    Parameters
    ----------
    draws : (C, N, ...) float
        Of C chains.

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
    """R-hat divides by the variance within chains, which may be zero."""
    lowest, highest = chains.min(1), chains.max(1)
    frozen = (lowest == highest).all(0)
    same = frozen & (lowest == lowest[:1]).all(0)
    return np.where(same, 1.0, np.where(frozen, np.inf, values))
