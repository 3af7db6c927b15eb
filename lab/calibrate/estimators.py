"""Estimators of the model's constants, from arrays to numbers.

They do not depend on scenes or files, so that each can be tested on numbers from a known
distribution.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor, cho_solve, toeplitz
from scipy.optimize import minimize, minimize_scalar
from scipy.special import expit, gammaln

from imapper_prob.models.detector import student_t_loss
from imapper_prob.models.path_prior import remembered

__all__ = [
    "autocorrelation",
    "balanced_logistic_fit",
    "between_groups",
    "change_within",
    "confusion_mean",
    "correlation_length",
    "jackknife_error",
    "predictive_spread",
    "root_mean_square",
    "shares",
    "sight_width_fit",
    "smoothing_time",
    "student_t_fit",
    "student_t_score",
    "wrapped_cauchy_fit",
]

Array = NDArray[np.float64]

_PSEUDO_COUNT = 0.5
"""Pseudo-count of each bin, so that empty bins are not impossible (Jeffreys' prior)."""
_DOF = (0.5, 50.0)
"""Range of degrees of freedom: heavier tails have no scale, lighter ones are nearly normal."""
_LOG_SCALES = (-7.0, 2.0)
"""Range of log scales of angles: from a twentieth of a degree to nearly uniform."""
_LOG_WIDTHS = (-7.0, 1.0)
"""Range of log widths: from a millimetre to metres."""
_GRID = 1000
"""Points of a grid over probabilities."""
_FEWEST = 20
"""Least number of observations for a Student-t fit."""


def shares(values: ArrayLike, edges: ArrayLike) -> Array:
    """(B,) probability of each bin between ``edges`` (B + 1,), with half a pseudo-count in each."""
    counts = np.histogram(np.asarray(values, float), np.asarray(edges, float))[0] + _PSEUDO_COUNT
    result: Array = counts / counts.sum()
    return result


def sight_width_fit(clearance: ArrayLike, hidden: ArrayLike, *, visibility_error: float) -> float:
    """Maximum-likelihood width in metres of the step from hidden to visible.

    Parameters
    ----------
    clearance : (n,) float
        Clearance of lines of sight, metres; negative if something is in the way.
    hidden : (n,) bool
    visibility_error : float
        Probability of the opposite state at either end of the step.
    """
    clearance, hidden = np.asarray(clearance, float), np.asarray(hidden, bool)

    def cost(log_width: float) -> float:
        seen = visibility_error + (1 - 2 * visibility_error) * expit(clearance * np.exp(-log_width))
        return float(-np.log(np.where(hidden, 1 - seen, seen)).mean())

    return float(np.exp(minimize_scalar(cost, bounds=_LOG_WIDTHS, method="bounded").x))


def confusion_mean(agreement: ArrayLike) -> float:
    """Posterior mean of the probability that a label says nothing; uniform before.

    A label that says nothing has those of a population: it is the true one with that one's share.
    Its probability is linear in the confusion, so the mean predicts like the whole posterior.

    Parameters
    ----------
    agreement : (n, 2) float
        For each object the fraction of labels that agree with the true one, all of which count
        once; and the share of the true one in the population.

    Returns
    -------
    float
    """
    agree, share = np.asarray(agreement, float).reshape(-1, 2).T[:, :, None]
    confusion = (np.arange(_GRID) + 0.5) / _GRID
    logs = agree * np.log(1 - confusion + confusion * share)
    logs += (1 - agree) * np.log(confusion * (1 - share))
    weights = np.exp(logs.sum(0) - logs.sum(0).max())
    return float(weights @ confusion / weights.sum())


def student_t_fit(errors: ArrayLike) -> tuple[float, float]:
    """Maximum-likelihood scale and degrees of freedom of isotropic zero-mean errors (n, d).

    Raises
    ------
    ValueError
        There are fewer than twenty errors.
    """
    errors = np.asarray(errors, float)
    n, d = errors.shape
    if n < _FEWEST:
        raise ValueError(f"{n} errors are too few for a Student-t")
    squared = (errors**2).sum(-1)

    def cost(theta: Array) -> float:
        scale, dof = np.exp(theta)
        inside = gammaln((dof + d) / 2) - gammaln(dof / 2) - d / 2 * np.log(dof * np.pi)
        tails = student_t_loss(squared, scale, dof, dimensions=d).mean()
        return float(d * np.log(scale) + tails - inside)

    typical = np.sqrt(np.median(squared) / d)
    bounds = [(np.log(typical) - 5, np.log(typical) + 5), tuple(np.log(_DOF))]
    found = minimize(cost, [np.log(typical), np.log(4.0)], method="L-BFGS-B", bounds=bounds)
    scale, dof = np.exp(found.x)
    return float(scale), float(dof)


def wrapped_cauchy_fit(angles: ArrayLike) -> float:
    """Maximum-likelihood scale in radians of angles (n,) that are wrapped Cauchy about zero."""
    cosine = np.cos(np.asarray(angles, float))

    def cost(log_scale: float) -> float:
        near = np.exp(-np.exp(log_scale))
        apart = np.log1p(near**2 - 2 * near * cosine).mean()
        return float(apart - np.log1p(-(near**2)))

    return float(np.exp(minimize_scalar(cost, bounds=_LOG_SCALES, method="bounded").x))


def student_t_score(errors: ArrayLike, scale: ArrayLike, dof: ArrayLike) -> Array:
    """Score of errors (..., d) under a Student-t, in which outliers hardly count.

    It is the derivative of the log-density by the centre, up to a constant factor of each class
    that gives small errors in units of their scale.
    """
    errors = np.asarray(errors, float)
    scale, dof = (np.asarray(a, float)[..., None] for a in (scale, dof))
    unit = errors / scale
    result: Array = unit / (1 + (unit**2).sum(-1, keepdims=True) / dof)
    return result


def correlation_length(series: Sequence[ArrayLike]) -> float:
    """Integrated autocorrelation of several series: how many neighbours share one error.

    Parameters
    ----------
    series : sequence of (T, K) float
        K signals a series, NaN where missing. Their means are subtracted. The autocovariances of
        all are pooled and summed up to the first that is not positive, after which only noise
        remains (Geyer 1992).

    Returns
    -------
    float
        1 + 2 sum of the autocorrelations, in steps of a series; 1 for white noise.
    """
    centred = []
    for signals in series:
        signals = np.asarray(signals, float)
        known = np.isfinite(signals)
        mean = np.where(known, signals, 0.0).sum(0) / np.maximum(known.sum(0), 1)
        centred.append((np.where(known, signals - mean, 0.0), known))

    def covariance(lag: int) -> float:
        total, pairs = 0.0, 0
        for values, known in centred:
            n = len(values) - lag
            if n > 0:
                total += float((values[:n] * values[lag:]).sum())
                pairs += int((known[:n] & known[lag:]).sum())
        return total / max(pairs, 1)

    variance, length = covariance(0), 1.0
    for lag in range(1, max(len(values) for values, _ in centred)):
        correlation = covariance(lag) / variance
        if correlation <= 0:
            break
        length += 2 * correlation
    return length


def smoothing_time(
    series: Sequence[ArrayLike], *, spread: float, seconds: float, fps: float, gap: int
) -> float:
    """Maximum-likelihood time in seconds over which a slow error is smooth.

    Parameters
    ----------
    series : sequence of (T,) float
        Zero-mean errors, chains as in :mod:`imapper_prob.models.path_prior`.
    spread : float
        Standard deviation of all errors.
    seconds : float
        Half their integrated autocorrelation.
    fps : float
        Frames a second of the chains.
    gap : int
        Frames between successive errors.

    Returns
    -------
    float
        Seconds: 0 for errors that are rough from frame to frame, ``seconds / 2`` for the smoothest.
    """
    errors = [np.asarray(one, float) / spread for one in series]

    def cost(smoothing: float) -> float:
        rates = remembered(np.array([seconds]), np.array([smoothing]), fps)[0]
        total = 0.0
        for one in errors:
            correlation = autocorrelation(rates, gap * len(one))[::gap]
            factor = cho_factor(toeplitz(correlation), lower=True)
            total += np.log(np.diag(factor[0])).sum() + 0.5 * one @ cho_solve(factor, one)
        return float(total)

    inside = minimize_scalar(cost, bounds=(0.0, seconds / 2), options={"xatol": 1e-4 * seconds})
    return min((0.0, float(inside.x), seconds / 2), key=cost)


def change_within(series: Sequence[ArrayLike], *, apart: int) -> float:
    """Half the mean squared difference of values of a series that are far apart.

    Parameters
    ----------
    series : sequence of (T,) float
        Each has the same weight; series that are too short are not used.
    apart : int
        Least number of steps between two values.
    """
    found = []
    for one in series:
        values = np.asarray(one, float)
        first, second = np.triu_indices(len(values), k=apart)
        if len(first):
            found.append(0.5 * np.mean((values[first] - values[second]) ** 2))
    return float(np.mean(found))


def root_mean_square(values: ArrayLike) -> float:
    """Root mean square, the spread about zero."""
    return float(np.sqrt(np.mean(np.square(np.asarray(values, float)))))


def predictive_spread(values: ArrayLike) -> float:
    """Predictive standard deviation of the next value, including the error of the mean."""
    values = np.asarray(values, float)
    return float(values.std(ddof=1) * np.sqrt(1 + 1 / len(values)))


def between_groups(groups: Sequence[ArrayLike]) -> float:
    """Standard deviation of the means of groups, weighted by their sizes."""
    means = np.array([np.asarray(group, float).mean() for group in groups])
    sizes = np.array([np.size(group) for group in groups], float)
    centre = np.average(means, weights=sizes)
    return float(np.sqrt(np.average((means - centre) ** 2, weights=sizes)))


def balanced_logistic_fit(
    values: ArrayLike, trust: ArrayLike, flags: ArrayLike
) -> tuple[float, float]:
    """Level and slope of log odds ``trust * slope * (value - level)``, with balanced classes.

    Parameters
    ----------
    values, trust : (n,) float
        The predictor, and its weight.
    flags : (n,) bool
        The class; both classes must occur.
    """
    values, trust = np.asarray(values, float), np.asarray(trust, float)
    flags = np.asarray(flags, bool)
    weights = np.where(flags, 0.5 / flags.sum(), 0.5 / (~flags).sum())
    side = np.where(flags, 1.0, -1.0)

    def loss(parameters: Array) -> float:
        level, log_slope = parameters
        odds = trust * np.exp(log_slope) * (values - level)
        return float((weights * np.logaddexp(0.0, -side * odds)).sum())

    start = np.array([values.mean(), np.log(1.0 / values.std())])
    found = minimize(loss, start, method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-9})
    level, log_slope = found.x
    return float(level), float(np.exp(log_slope))


def jackknife_error(without: ArrayLike) -> Array:
    """Standard error of an estimate, from the estimates (n, ...) with one scene left out."""
    estimates: Array = np.asarray(without, float)
    n = len(estimates)
    estimates = estimates - estimates[0]  # removes rounding errors when all scenes agree
    spread = ((estimates - estimates.mean(0)) ** 2).sum(0)
    result: Array = np.sqrt((n - 1) / n * spread)
    return result


def autocorrelation(rates: Array, n: int) -> Array:
    """(n,) autocorrelation of one coordinate's errors at lags of 0, 1, … n - 1 frames.

    ``rates`` (2,) are r and s of the chain of :mod:`imapper_prob.models.path_prior`.
    """
    first, second = rates.sum(), -rates.prod()
    result = np.ones(max(n, 2))
    result[1] = first / (1.0 - second)
    for k in range(2, n):
        result[k] = first * result[k - 1] + second * result[k - 2]
    return result[:n]
