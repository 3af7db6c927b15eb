"""The collapsed path against a dense reference."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from imapper_prob.models.chain import chain

MEMORY = 0.85


def dense(
    item: np.ndarray, value: np.ndarray, centre: np.ndarray, scale: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """Evidence, mean and covariance of the free frames, by linear algebra on all of them."""
    n = len(item)
    fixed, free = np.flatnonzero(item >= 0), np.flatnonzero(item < 0)
    # Joint precision of the errors in all frames, steps inside a scenelet left out.
    matrix, constant = np.zeros((n, n)), 0.0
    for t in range(n):
        if t > 0 and item[t] >= 0 and item[t] == item[t - 1]:
            continue
        variance = 1.0 if t == 0 else 1 - MEMORY**2
        constant -= 0.5 * np.log(2 * np.pi * variance) + np.log(scale[t])
        matrix[t, t] += 1 / variance
        if t > 0:
            matrix[t - 1, t - 1] += MEMORY**2 / variance
            matrix[t, t - 1] -= MEMORY / variance
            matrix[t - 1, t] -= MEMORY / variance
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


def run(item: np.ndarray, value: np.ndarray, centre: np.ndarray, scale: np.ndarray,
        latent: np.ndarray) -> tuple[float, np.ndarray]:  # fmt: skip
    drawn = value.copy()
    work = np.empty((len(item), 2))
    return chain(drawn, item, centre, scale, latent, MEMORY, work), drawn


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 16))
def test_evidence_and_mean_equal_a_dense_reference(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    item = layout(rng, n)
    value, centre = rng.normal(size=n), rng.normal(size=n)
    scale = rng.uniform(0.1, 2, n)
    expected, mean, _ = dense(item, value, centre, scale)
    evidence, drawn = run(item, value, centre, scale, np.zeros(n))
    assert evidence == pytest.approx(expected, rel=1e-9, abs=1e-8)
    # With all latent numbers zero every draw is its conditional mean, hence the joint mean.
    np.testing.assert_allclose(drawn[item < 0], mean, atol=1e-8)
    np.testing.assert_array_equal(drawn[item >= 0], value[item >= 0])


def test_draws_have_the_dense_covariance() -> None:
    rng = np.random.default_rng(5)
    item = np.array([-1, -1, 0, 0, -1, -1, -1, 1, 2, -1])
    n = len(item)
    value, centre = rng.normal(size=n), rng.normal(size=n)
    scale = rng.uniform(0.1, 2, n)
    _, mean, covariance = dense(item, value, centre, scale)
    _, base = run(item, value, centre, scale, np.zeros(n))
    # The draw is linear in the latent numbers: its matrix squared is the covariance.
    columns = []
    for t in range(n):
        unit = np.zeros(n)
        unit[t] = 1.0
        columns.append(run(item, value, centre, scale, unit)[1] - base)
    matrix = np.array(columns).T[item < 0]
    np.testing.assert_allclose(matrix @ matrix.T, covariance, atol=1e-10)
    np.testing.assert_allclose(base[item < 0], mean, atol=1e-10)


def test_the_chain_is_a_normalised_density() -> None:
    # Frames 0 and 3 fixed by two scenelets: their joint density, in units of the values.
    item = np.array([0, -1, -1, 1])
    value, centre = np.array([0.1, 0.0, 0.0, -0.2]), np.array([0.3, 0.0, 0.0, 0.1])
    scale = np.array([0.5, 1.0, 1.0, 0.2])
    evidence, _ = run(item, value, centre, scale, np.zeros(4))
    covariance = np.array([[1.0, MEMORY**3], [MEMORY**3, 1.0]]) * np.outer([0.5, 0.2], [0.5, 0.2])
    expected = multivariate_normal([0.3, 0.1], covariance).logpdf([0.1, -0.2])
    assert evidence == pytest.approx(expected)
