"""Evidences, the second way: from a ladder of temperatures, or from draws of a posterior.

The visits of a jump chain say how probable layouts are relative to each other. Where few
layouts are in question, each one's evidence can be computed alone, by a method that jumps
nowhere, and the ratios compared.

References
----------
Xie, Lewis, Fan, Kuo & Chen 2011, Syst. Biol. 60, 150 (stepping-stone sampling).
Meng & Wong 1996, Stat. Sinica 6, 831 (bridge sampling).
Overstall & Forster 2010, Comput. Stat. Data Anal. 54, 3269 (fit and use different draws).
Frühwirth-Schnatter 2004, Econom. J. 7, 143 (error for correlated draws).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq
from scipy.special import expit, logsumexp

from imapper_prob.samplers.diagnostics import mean_error

__all__ = ["Evidence", "bridge_sampling", "stepping_stone"]

Array = NDArray[np.float64]

# Nats beyond which one of the two sums of a bridge is nothing beside the other: e^-50 is
# smaller than one over any number of draws.
_BEYOND = 50.0


class Evidence(NamedTuple):
    """The logarithm of an evidence.

    Parameters
    ----------
    log_evidence : float
    standard_error : float
        Monte-Carlo standard error of ``log_evidence``, to first order: trust it below one.
    """

    log_evidence: float
    standard_error: float


def stepping_stone(log_likelihoods: ArrayLike, betas: ArrayLike) -> Evidence:
    """Evidence from the likelihoods that a frozen ladder visited.

    ``log Z = sum_k log mean_k exp((beta_k+1 - beta_k) log L)``, the mean over rung k.

    Parameters
    ----------
    log_likelihoods : (C, n, K) float
        Of C ladders, n rounds and K rungs, such as `tempering.Position.log_likelihoods`;
        -inf where the likelihood is zero. The coldest rung is not used.
    betas : (K,) float
        Ascending, the same for all ladders.

    Returns
    -------
    Evidence
        Integral of prior times likelihood if the ladder goes from 0 to 1, the prior and the
        likelihood normalised; otherwise the ratio of the normalisers of its ends. The error
        takes account of swaps, which correlate the rungs.

    Raises
    ------
    ValueError
        Arrays that do not fit together, or a rung that has not met a likelihood above zero.

    Warns
    -----
    ShortChainWarning
        Fewer than 4 rounds: the standard error is NaN.
    """
    values, betas = np.asarray(log_likelihoods, float), np.asarray(betas, float)
    if values.ndim != 3 or betas.shape != values.shape[-1:] or 0 in values.shape:
        raise ValueError(
            f"likelihoods must be (ladders, rounds, rungs), not {values.shape} for "
            f"{betas.size} inverse temperatures"
        )
    steps = np.diff(betas) * values[..., :-1]
    top = steps.max((0, 1))
    if not np.isfinite(top).all():
        rung = int(np.flatnonzero(~np.isfinite(top))[0])
        raise ValueError(f"rung {rung} of the ladder has not met a finite likelihood above zero")
    weights = np.exp(steps - top)
    means = weights.mean((0, 1))
    # To first order the error of log Z is that of the mean of this one series, which holds
    # whatever correlates the rungs.
    series = (weights / means).sum(-1)
    return Evidence(float((top + np.log(means)).sum()), float(mean_error(series)))


def bridge_sampling(
    draws: ArrayLike, log_density_fn: Callable[[Array], Array], *, rng: np.random.Generator
) -> Evidence:
    """Evidence of a posterior of fixed dimension, from draws and a normal proposal.

    The proposal has the mean and covariance of the first half of each chain; the second half
    enters the estimate with as many draws of the proposal (Meng & Wong 1996).

    Parameters
    ----------
    draws : (C, N, D) float
        Draws of the posterior in coordinates without bounds, on which it is roughly normal.
    log_density_fn : callable
        ``(n, D) -> (n,)``, log prior + log likelihood, normalised; -inf where it is zero.
    rng : numpy.random.Generator
        For draws of the proposal.

    Raises
    ------
    ValueError
        Not (C, N, D), fewer than 2 (D + 1) draws to fit, draws in a subspace, or draws where
        the density is not finite, or zero at all draws of the proposal.
    """
    draws = np.asarray(draws, float)
    if draws.ndim != 3:
        raise ValueError(f"draws must be (chains, draws, dimensions), not {draws.shape}")
    n_dimensions, half = draws.shape[2], draws.shape[1] // 2
    fitted = draws[:, :half].reshape(-1, n_dimensions)
    if len(fitted) < 2 * (n_dimensions + 1):
        raise ValueError(f"{len(fitted)} draws cannot fit a proposal in {n_dimensions} dimensions")
    used = draws[:, half:]
    mean = fitted.mean(0)
    try:
        root = np.linalg.cholesky(np.atleast_2d(np.cov(fitted, rowvar=False)))
    except np.linalg.LinAlgError as error:
        raise ValueError("the draws lie in a subspace: a coordinate says nothing new") from error

    def log_proposal(x: Array) -> Array:
        z = np.linalg.solve(root, (x - mean).T)
        constant = 0.5 * n_dimensions * math.log(2 * math.pi) + np.log(np.diag(root)).sum()
        density: Array = -0.5 * (z**2).sum(0) - constant
        return density

    posterior = used.reshape(-1, n_dimensions)
    proposed = mean + rng.standard_normal(posterior.shape) @ root.T
    # Log ratios of target to proposal, where the posterior and where the proposal was drawn.
    at_posterior = log_density_fn(posterior) - log_proposal(posterior)
    at_proposal = log_density_fn(proposed) - log_proposal(proposed)
    if not np.isfinite(at_posterior).all():
        raise ValueError("the density is not finite at a draw that is said to be of it")
    if not np.isfinite(at_proposal).any():
        raise ValueError("no draw of the normal proposal has a finite density")
    log_evidence = _bridged(at_posterior, at_proposal)
    series = expit(log_evidence - at_posterior)
    others = expit(at_proposal - log_evidence)
    variance = (mean_error(series.reshape(used.shape[:2])) / series.mean()) ** 2
    variance += others.var(ddof=1) / len(others) / others.mean() ** 2
    return Evidence(log_evidence, float(np.sqrt(variance)))


def _bridged(at_posterior: Array, at_proposal: Array) -> float:
    """log Z at which the estimate of Meng & Wong reproduces itself, from log ratios p / g.

    As many draws of the posterior as of the proposal make it the only root of
    ``mean_g(p / (p + Z g)) = mean_p(Z g / (p + Z g))``, whose left side falls with Z.
    """

    def difference(log_evidence: float) -> float:
        left = logsumexp(-np.logaddexp(0, log_evidence - at_proposal))
        right = logsumexp(-np.logaddexp(0, at_posterior - log_evidence))
        return float(left - right)

    ratios = np.concatenate([at_posterior, at_proposal[np.isfinite(at_proposal)]])
    return float(brentq(difference, ratios.min() - _BEYOND, ratios.max() + _BEYOND))
