"""The collapsed path against a dense reference."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from imapper_prob.models.chain import chain

START, START_VAR, STEP = 0.3, 0.5, 0.04


def dense(
    item: np.ndarray, value: np.ndarray, measured: np.ndarray, precision: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """Evidence, mean and covariance of the free frames, by linear algebra on all of them."""
    n = len(item)
    fixed, free = np.flatnonzero(item >= 0), np.flatnonzero(item < 0)
    # Joint precision of the chain over all frames, steps inside a scenelet left out.
    matrix, shift, constant = np.zeros((n, n)), np.zeros(n), 0.0
    for t in range(n):
        if t > 0 and item[t] >= 0 and item[t] == item[t - 1]:
            continue
        variance = START_VAR if t == 0 else STEP
        matrix[t, t] += 1 / variance
        constant -= 0.5 * np.log(2 * np.pi * variance)
        if t == 0:
            shift[t] += START / variance
            constant -= 0.5 * START**2 / variance
        else:
            matrix[t - 1, t - 1] += 1 / variance
            matrix[t, t - 1] -= 1 / variance
            matrix[t - 1, t] -= 1 / variance
    for t in free:
        matrix[t, t] += precision[t]
        shift[t] += precision[t] * measured[t]
        constant -= 0.5 * precision[t] * measured[t] ** 2
    v = value[fixed]
    evidence = constant - 0.5 * v @ matrix[np.ix_(fixed, fixed)] @ v + shift[fixed] @ v
    if len(free) == 0:
        return evidence, np.zeros(0), np.zeros((0, 0))
    inner = matrix[np.ix_(free, free)]
    pull = shift[free] - matrix[np.ix_(free, fixed)] @ v
    covariance = np.linalg.inv(inner)
    mean = covariance @ pull
    evidence += 0.5 * pull @ mean + 0.5 * np.linalg.slogdet(2 * np.pi * covariance)[1]
    return evidence, mean, covariance


def layout(rng: np.random.Generator, n: int) -> np.ndarray:
    """Scenelets over random stretches of frames, some side by side."""
    item = np.full(n, -1, dtype=np.int64)
    t, index = int(rng.integers(0, 4)), 0
    while t < n:
        length = int(rng.integers(1, 5))
        item[t : t + length] = index
        index += 1
        t += length + int(rng.integers(0, 4))
    return item


def run(item: np.ndarray, value: np.ndarray, measured: np.ndarray, precision: np.ndarray,
        latent: np.ndarray) -> tuple[float, np.ndarray]:  # fmt: skip
    drawn = value.copy()
    work = np.empty((len(item), 2))
    args = (drawn, item, measured, precision, latent, START, START_VAR, STEP, work)
    return chain(*args), drawn


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 16))
def test_evidence_and_mean_equal_a_dense_reference(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    item = layout(rng, n)
    value, measured = rng.normal(size=n), rng.normal(size=n)
    precision = rng.uniform(0, 30, n) * (rng.random(n) < 0.8)
    expected, mean, _ = dense(item, value, measured, precision)
    evidence, drawn = run(item, value, measured, precision, np.zeros(n))
    assert evidence == pytest.approx(expected, abs=1e-8)
    # With all latent numbers zero every draw is its conditional mean, hence the joint mean.
    np.testing.assert_allclose(drawn[item < 0], mean, atol=1e-8)
    np.testing.assert_array_equal(drawn[item >= 0], value[item >= 0])


def test_draws_have_the_dense_covariance() -> None:
    rng = np.random.default_rng(5)
    item = np.array([-1, -1, 0, 0, -1, -1, -1, 1, 2, -1])
    n = len(item)
    value, measured = rng.normal(size=n), rng.normal(size=n)
    precision = rng.uniform(0, 30, n)
    _, mean, covariance = dense(item, value, measured, precision)
    _, base = run(item, value, measured, precision, np.zeros(n))
    # The draw is linear in the latent numbers: its matrix squared is the covariance.
    columns = []
    for t in range(n):
        unit = np.zeros(n)
        unit[t] = 1.0
        columns.append(run(item, value, measured, precision, unit)[1] - base)
    matrix = np.array(columns).T[item < 0]
    np.testing.assert_allclose(matrix @ matrix.T, covariance, atol=1e-10)
    np.testing.assert_allclose(base[item < 0], mean, atol=1e-10)


def test_without_data_the_chain_is_a_normalised_density() -> None:
    # Frames 0 and 3 fixed by two scenelets: their joint density under the directed walk.
    item = np.array([0, -1, -1, 1])
    value = np.array([0.1, 0.0, 0.0, -0.2])
    evidence, _ = run(item, value, np.zeros(4), np.zeros(4), np.zeros(4))
    covariance = [[START_VAR, START_VAR], [START_VAR, START_VAR + 3 * STEP]]
    expected = multivariate_normal([START, START], covariance).logpdf([0.1, -0.2])
    assert evidence == pytest.approx(expected)
