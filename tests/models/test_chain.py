"""The collapsed path against a dense reference."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal, norm

from imapper_prob.models.kernels.path import draw_segment
from imapper_prob.models.path_prior import path_tables, remembered
from lab.calibrate.estimators import autocorrelation

RATES = [(0.85, 0.0), (0.85, 0.85), (0.9, 0.4), (0.998, 0.0)]
"""A rough chain, the smoothest, one between, and one that forgets hardly anything."""
rates_of_a_coordinate = st.sampled_from(RATES)


@cache
def lagged(rates: tuple[float, float]) -> np.ndarray:
    """Correlation of errors so many frames apart, as a sum of shocks of the long past."""
    r, s = rates
    left = np.convolve(r ** np.arange(10000.0), s ** np.arange(10000.0))[:10000]
    return np.array([left[: len(left) - k] @ left[k:] for k in range(40)]) / (left @ left)


def correlations(rates: tuple[float, float], n: int) -> np.ndarray:
    """(n, n) of a stationary chain."""
    return lagged(rates)[np.abs(np.subtract.outer(np.arange(n), np.arange(n)))]


def dense(
    item: np.ndarray, starts: np.ndarray, value: np.ndarray, centre: np.ndarray,
    scale: np.ndarray, rates: tuple[float, float],
) -> tuple[float, np.ndarray, np.ndarray]:  # fmt: skip
    """Evidence, mean and covariance of the free frames, by linear algebra on all of them.

    The density is a product of steps, each of a frame given the two before it, of the
    stationary chain. Steps inside a scenelet are left out.
    """
    n = len(item)
    fixed, free = np.flatnonzero(item >= 0), np.flatnonzero(item < 0)
    stationary = correlations(rates, 3)
    matrix, constant, begin = np.zeros((n, n)), 0.0, 0
    for t in range(n):
        begin = t if starts[t] else begin
        if t > begin and item[t] >= 0 and item[t] == item[t - 1]:
            continue
        past = np.arange(max(begin, t - 2), t)
        order = len(past)
        weights = np.linalg.solve(stationary[:order, :order], stationary[:order, order])
        if (rates[1] == 0.0 or order == 2) and order:
            # The solution of a nearly singular system is known in advance.
            weights = np.array([-rates[0] * rates[1], sum(rates)])[-order:]
        variance = 1.0 - weights @ stationary[:order, order]
        step = np.zeros(n)
        step[past], step[t] = -weights, 1.0
        matrix += np.outer(step, step) / variance
        constant -= 0.5 * np.log(2 * np.pi * variance) + np.log(scale[t])
    v = ((value - centre) / scale)[fixed]
    evidence = constant - 0.5 * v @ matrix[np.ix_(fixed, fixed)] @ v
    if len(free) == 0:
        return evidence, np.zeros(0), np.zeros((0, 0))
    inner = matrix[np.ix_(free, free)]
    covariance = np.linalg.inv(inner)
    pull = -matrix[np.ix_(free, fixed)] @ v
    mean = covariance @ pull
    evidence += 0.5 * pull @ mean + 0.5 * len(free) * np.log(2 * np.pi)
    evidence += 0.5 * np.linalg.slogdet(covariance)[1] + np.log(scale[free]).sum()
    spread = scale[free]
    return evidence, centre[free] + spread * mean, spread[:, None] * covariance * spread


def layout(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Scenelets over random stretches of frames, some side by side, and people in a row."""
    item = np.full(n, -1, dtype=np.int64)
    starts = rng.random(n) < 0.1
    starts[0] = True
    t, index = int(rng.integers(0, 4)), 0
    while t < n:
        length = int(rng.integers(2, 5))
        if t + length <= n and not starts[t + 1 : t + length].any():
            item[t : t + length] = index
            index += 1
            t += length
        t += int(rng.integers(0, 4))
    return item, starts


def run(
    item: np.ndarray, starts: np.ndarray, value: np.ndarray, centre: np.ndarray,
    scale: np.ndarray, latent: np.ndarray, rates: tuple[float, float],
) -> tuple[float, np.ndarray]:  # fmt: skip
    """Evidence and path of one coordinate; the other has nothing to say."""
    n, evidence, path = len(item), 0.0, value.copy()
    mean, draw = path_tables(np.array([rates, (0.5, 0.0)]), n)
    beside, one = np.zeros(n), np.ones(n)
    begin = np.flatnonzero((item >= 0) & (np.diff(item, prepend=-1) != 0))
    end = np.flatnonzero((item >= 0) & (np.diff(item, append=-1) != 0)) + 1
    pelvis = np.zeros((len(begin), 6))
    pelvis[:, 0], pelvis[:, 2], pelvis[:, 4] = value[begin], value[end - 2], value[end - 1]
    drawn = np.empty((n, 2))
    for k in range(len(begin) + 1):
        first, last = end[k - 1] if k else 0, begin[k] if k < len(begin) else n
        right = k if k < len(begin) else -1
        evidence += draw_segment(
            starts, np.full(n, -1), 1, np.stack([centre, beside], -1),
            np.stack([scale, one], -1), mean, draw, np.zeros(5),
            np.stack([latent, beside], -1), first, last, pelvis, k - 1, right,
            np.empty(n, np.int64), drawn,
        )  # fmt: skip
        path[first:last] = drawn[first:last, 0]
        if right >= 0:
            # The other coordinate's step of a chain that is 0 all along; it forgets by halves.
            known = k > 0 and not starts[first : last + 1].any()
            variance = 1.0 - 0.25 ** (last - first + 1) if known else 1.0
            evidence -= norm.logpdf(0.0, 0.0, np.sqrt(variance))
    return evidence, path


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 20), rates=rates_of_a_coordinate)
def test_evidence_and_mean_equal_a_dense_reference(
    seed: int, n: int, rates: tuple[float, float]
) -> None:
    rng = np.random.default_rng(seed)
    item, starts = layout(rng, n)
    value, centre = rng.normal(size=n), rng.normal(size=n)
    scale = rng.uniform(0.1, 2, n)
    expected, mean, _ = dense(item, starts, value, centre, scale, rates)
    evidence, drawn = run(item, starts, value, centre, scale, np.zeros(n), rates)
    assert evidence == pytest.approx(expected, rel=1e-7, abs=1e-6)
    # With all latent numbers zero every draw is its conditional mean, hence the joint mean.
    np.testing.assert_allclose(drawn[item < 0], mean, atol=1e-6)
    np.testing.assert_array_equal(drawn[item >= 0], value[item >= 0])


@pytest.mark.parametrize("most", [1, 3])
def test_in_a_stay_the_error_along_the_view_stands_still(most: int) -> None:
    """Ten frames between two scenelets, a stay but for the first and the last of them.

    With a step a frame the error goes on; with few steps it is one number from the last of them
    on, and the frame after the stay is as many steps away.
    """
    rng, n, rates = np.random.default_rng(3), 14, (0.85, 0.4)
    starts, stay = np.arange(n) == 0, np.where((np.arange(n) > 2) & (np.arange(n) < 11), 5, -1)
    mean, draw = path_tables(np.array([rates, rates]), n)
    pelvis, latent = rng.normal(size=(2, 6)), rng.normal(size=(n, 2))

    def between(stay: np.ndarray, last: int) -> tuple[float, np.ndarray]:
        drawn = np.zeros((n, 2))
        nats = draw_segment(
            starts, stay, most, np.zeros((n, 2)), np.ones((n, 2)), mean, draw, np.zeros(5),
            latent, 2, last, pelvis, 0, 1, np.empty(n, np.int64), drawn,
        )  # fmt: skip
        return nats, drawn[2:last]

    _, errors = between(stay, 12)
    assert np.ptp(errors[most:9, 1]) == 0.0
    assert len(set(errors[:, 0])) == 10
    assert len(set(errors[:, 1])) == 2 + most
    # The same without a stay, in as many frames as there were steps.
    pelvis[:, [0, 2, 4]] = 0.0
    stretched, shrunk = between(stay, 12)[0], between(np.full(n, -1), 4 + most)[0]
    one = norm.logpdf(0.0, 0.0, draw[0, [11, 3 + most], 0, 2])
    assert stretched - one[0] == pytest.approx(shrunk - one[1])


@pytest.mark.parametrize("rates", RATES)
def test_draws_have_the_dense_covariance(rates: tuple[float, float]) -> None:
    rng = np.random.default_rng(5)
    item = np.array([-1, -1, -1, 0, 0, -1, -1, -1, -1, 1, 1, 2, 2, -1, -1, -1, -1, -1, 3, 3, -1])
    n = len(item)
    starts = np.zeros(n, bool)
    starts[[0, 16]] = True
    value, centre = rng.normal(size=n), rng.normal(size=n)
    scale = rng.uniform(0.1, 2, n)
    _, mean, covariance = dense(item, starts, value, centre, scale, rates)
    _, base = run(item, starts, value, centre, scale, np.zeros(n), rates)
    # The draw is linear in the latent numbers: its matrix squared is the covariance.
    columns = [run(item, starts, value, centre, scale, unit, rates)[1] - base for unit in np.eye(n)]
    matrix = np.array(columns).T[item < 0]
    np.testing.assert_allclose(matrix @ matrix.T, covariance, atol=1e-8)
    np.testing.assert_allclose(base[item < 0], mean, atol=1e-8)


@pytest.mark.parametrize("rates", RATES)
def test_the_chain_is_a_normalised_density(rates: tuple[float, float]) -> None:
    # Frame 0 and frame 5 fixed by the first of two scenelets: the second given two values.
    item = np.array([0, 0, -1, -1, -1, 1, 1])
    starts = np.arange(7) == 0
    value, centre = np.array([0.1, 0.2, 0, 0, 0, -0.2, 0.4]), np.array([0.3, 0, 0, 0, 0, 0.1, 0])
    scale = np.array([0.5, 0.3, 1.0, 1.0, 1.0, 0.2, 1.0])
    evidence, _ = run(item, starts, value, centre, scale, np.zeros(7), rates)
    spread = scale[[0, 1, 5]]
    joint = correlations(rates, 6)[np.ix_([0, 1, 5], [0, 1, 5])] * np.outer(spread, spread)
    three = multivariate_normal(centre[[0, 1, 5]], joint).logpdf(value[[0, 1, 5]])
    second = multivariate_normal(centre[:2], joint[:2, :2]).logpdf(value[:2])
    first = multivariate_normal(0.3, 0.25).logpdf(0.1)
    assert evidence == pytest.approx(three - second + first)


@pytest.mark.parametrize("rates", RATES)
def test_free_draws_correlate_as_the_chain_does(rates: tuple[float, float]) -> None:
    n = 12
    free, starts = np.full(n, -1), np.arange(n) == 0
    zeros, ones = np.zeros(n), np.ones(n)
    matrix = np.array([run(free, starts, zeros, zeros, ones, e, rates)[1] for e in np.eye(n)]).T
    np.testing.assert_allclose(matrix @ matrix.T, correlations(rates, n), atol=1e-9)
    np.testing.assert_allclose(autocorrelation(np.array(rates), n), correlations(rates, n)[0])


def test_rates_keep_the_time_in_which_errors_are_forgotten() -> None:
    """Half the integral of the autocorrelation is ``seconds``, whatever the smoothing time."""
    fps = 1000.0
    for smoothing in (0.0, 0.1, 0.5):
        rates = remembered(np.array([1.0]), np.array([smoothing]), fps)[0]
        assert autocorrelation(rates, 20000).sum() / fps == pytest.approx(1.0, abs=2 / fps)
