"""The estimators find what numbers were drawn with."""

from __future__ import annotations

from types import SimpleNamespace

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from scipy.signal import lfilter
from scipy.stats import multivariate_t
from scipy.stats import t as student

from imapper_prob.models.path_prior import remembered
from lab.calibrate.constants import FROM_PATH
from lab.calibrate.estimators import (
    between_groups,
    change_within,
    confusion_mean,
    correlation_length,
    jackknife_error,
    predictive_spread,
    root_mean_square,
    shares,
    sight_width_fit,
    smoothing_time,
    student_t_fit,
    student_t_score,
    wrapped_cauchy_fit,
)


def draw_t(rng: np.random.Generator, n: int, d: int, scale: float, dof: float) -> np.ndarray:
    mixing = rng.chisquare(dof, n) / dof
    return scale * rng.standard_normal((n, d)) / np.sqrt(mixing)[:, None]


def test_shares_are_those_that_were_drawn() -> None:
    edges, n = np.array([0.0, 0.1, 0.5, 1.0]), 20000
    expected = np.diff(edges)
    found = shares(np.random.default_rng(0).random(n), edges)
    # Five standard errors of a binomial share.
    assert np.all(np.abs(found - expected) < 5 * np.sqrt(expected * (1 - expected) / n))


@given(values=st.lists(st.floats(0, 1), max_size=30))
def test_shares_are_a_distribution_without_impossible_bins(values: list[float]) -> None:
    found = shares(values, [0.0, 0.3, 0.6, 1.0])
    assert found.sum() == pytest.approx(1.0)
    assert np.all(found > 0)


@pytest.mark.parametrize(("d", "scale", "dof"), [(1, 0.04, 1.8), (2, 14.9, 4.2), (3, 0.07, 2.3)])
def test_student_t_is_found(d: int, scale: float, dof: float) -> None:
    """Twice the gain in log-likelihood over the truth is chi-squared with two degrees."""
    errors = draw_t(np.random.default_rng(d), 4000, d, scale, dof)
    found_scale, found_dof = student_t_fit(errors)

    def likelihood(s: float, nu: float) -> float:
        return float(multivariate_t(np.zeros(d), s**2 * np.eye(d), nu).logpdf(errors).sum())

    gain = 2 * (likelihood(found_scale, found_dof) - likelihood(scale, dof))
    assert -1e-3 < gain < 18.4  # all but one in ten thousand


@pytest.mark.parametrize("width", [0.02, 0.1])
def test_the_width_of_a_step_is_found(width: float) -> None:
    """A logistic scale of n numbers around the step is known to some 2 / sqrt(n)."""
    rng, n = np.random.default_rng(1), 20000
    clearance = rng.uniform(-5 * width, 5 * width, n)
    seen = 0.02 + 0.96 / (1 + np.exp(-clearance / width))
    found = sight_width_fit(clearance, rng.random(n) > seen, visibility_error=0.02)
    assert found == pytest.approx(width, rel=5 * 2 / np.sqrt(n))


@pytest.mark.parametrize("scale", [0.02, 0.1, 1.0])
def test_wrapped_cauchy_is_found(scale: float) -> None:
    """The most likely log scale of n angles has a standard error near sqrt(2 / n)."""
    n = 4000
    angles = scale * np.random.default_rng(3).standard_cauchy(n)
    found = wrapped_cauchy_fit(angles)
    assert abs(np.log(found / scale)) < 5 * np.sqrt(2 / n) * max(1.0, scale)
    assert wrapped_cauchy_fit(angles + 2 * np.pi) == pytest.approx(found, rel=1e-4)


@given(factor=st.floats(1e-3, 1e3))
def test_student_t_does_not_care_for_units(factor: float) -> None:
    errors = draw_t(np.random.default_rng(7), 300, 2, 1.0, 3.0)
    scale, dof = student_t_fit(errors)
    other_scale, other_dof = student_t_fit(factor * errors)
    assert other_scale == pytest.approx(factor * scale, rel=1e-3)
    assert other_dof == pytest.approx(dof, rel=1e-2)


def test_too_few_errors_are_refused() -> None:
    with pytest.raises(ValueError, match="5 errors are too few"):
        student_t_fit(np.ones((5, 2)))


def test_the_score_is_the_slope_of_the_log_density() -> None:
    error, scale, dof = np.array([3.0, -2.0]), 1.7, 2.5
    density = multivariate_t(np.zeros(2), scale**2 * np.eye(2), dof)
    step = 1e-6 * np.eye(2)
    slope = [(density.logpdf(error - h) - density.logpdf(error + h)) / 2e-6 for h in step]
    score = student_t_score(error, scale, dof)
    np.testing.assert_allclose(np.asarray(slope) / score, (dof + 2) / dof / scale, rtol=1e-6)


def test_gross_errors_hardly_count() -> None:
    near, far = student_t_score(np.array([[2.0, 0.0], [2000.0, 0.0]]), 1.0, 2.0)[:, 0]
    assert far < near / 100


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.8])
def test_correlation_length_of_a_forgetful_process(memory: float) -> None:
    """(1 + r) / (1 - r) for neighbours that correlate by r.

    Summed over m lags, an estimate from n numbers has a relative variance of 2 (2 m + 1) / n
    (Madras and Sokal 1988); no sum here runs over more than a hundred.
    """
    rng = np.random.default_rng(1)
    n_frames, n_signals = 2000, 40
    x = rng.standard_normal((n_frames, n_signals))
    for t in range(1, n_frames):
        x[t] = memory * x[t - 1] + np.sqrt(1 - memory**2) * x[t]
    x[rng.random(x.shape) < 0.1] = np.nan
    expected = (1 + memory) / (1 - memory)
    found = correlation_length([x[: n_frames // 2], 3.0 + x[n_frames // 2 :]])
    assert found == pytest.approx(expected, rel=5 * np.sqrt(2 * 201 / (0.9 * x.size)))


@pytest.mark.parametrize("smoothing", [0.0, 0.1, 0.5])
def test_the_smoothing_time_is_found(smoothing: float) -> None:
    """Of chains known in every second frame, ten times over."""
    rng = np.random.default_rng(8)
    r, s = remembered(np.array([1.0]), np.array([smoothing]), 10.0)[0]
    estimates = []
    for _ in range(10):
        shocks = rng.standard_normal((700, 4))
        chains = lfilter([1.0], [1.0, -r - s, r * s], shocks, axis=0)[100::2]
        spread = np.sqrt((1 + r * s) / ((1 - r * r) * (1 - s * s) * (1 - r * s)))
        series = list((3.0 / spread * chains).T)
        estimates.append(smoothing_time(series, spread=3.0, seconds=1.0, fps=10.0, gap=2))
    error = np.std(estimates, ddof=1) / np.sqrt(10)
    # At either end estimates can err to one side only, by about as much as they spread.
    allowed = 5 * error + (0.0 if smoothing == 0.1 else np.std(estimates, ddof=1)) + 1e-3
    assert np.mean(estimates) == pytest.approx(smoothing, abs=allowed)
    assert np.std(estimates) < 0.1


def test_a_change_within_series_is_that_of_values_far_apart_in_each() -> None:
    # Of 0, 1, 2 only the ends are two apart; the short series has no pair, the even one no change.
    assert change_within([[0.0, 1.0, 2.0], [5.0, 9.0], [3.0] * 5], apart=2) == pytest.approx(1.0)


def test_root_mean_square_is_about_zero() -> None:
    assert root_mean_square([3.0, -4.0]) == pytest.approx(np.sqrt(12.5))


def test_a_predictive_spread_knows_that_its_mean_is_doubtful() -> None:
    """The next value is off by a Student-t of n - 1 degrees in these units."""
    rng, n, worlds = np.random.default_rng(2), 4, 4000
    values = rng.standard_normal((worlds, n + 1))
    inside = [
        abs(v[n] - v[:n].mean()) < student.ppf(0.95, n - 1) * predictive_spread(v[:n])
        for v in values
    ]
    assert np.mean(inside) == pytest.approx(0.9, abs=5 * np.sqrt(0.9 * 0.1 / worlds))


def test_between_groups_sees_nothing_within_them() -> None:
    assert between_groups([[1.0, 3.0], [2.0, 2.0]]) == 0.0
    assert between_groups([[1.0], [3.0]]) == pytest.approx(1.0)
    # A group of three counts three times.
    assert between_groups([[0.0, 0.0, 0.0], [4.0]]) == pytest.approx(np.sqrt(3.0))


def test_the_jackknife_of_a_mean_is_its_standard_error() -> None:
    values = np.random.default_rng(3).standard_normal(9)
    without = [np.delete(values, k).mean() for k in range(9)]
    assert jackknife_error(without) == pytest.approx(values.std(ddof=1) / 3)


@pytest.mark.parametrize("confusion", [0.1, 0.5, 0.9])
def test_confusion_is_how_often_a_label_is_that_of_another(
    rng: np.random.Generator, confusion: float
) -> None:
    population = np.array([0.5, 0.3, 0.2])
    true = rng.choice(3, 20_000, p=population)
    told = np.where(rng.random(len(true)) < confusion, rng.choice(3, len(true), p=population), true)
    found = confusion_mean(np.column_stack([told == true, population[true]]))
    # The agreement of n labels is known to less than .5 / sqrt(n), and grows by .62 a unit.
    assert found == pytest.approx(confusion, abs=4 * 0.5 / np.sqrt(len(true)) / 0.62 + 5e-4)


def test_confusion_without_any_label_is_what_it_was_before() -> None:
    assert confusion_mean(np.empty((0, 2))) == pytest.approx(0.5)
    # One label that agrees, of a population of two: the mean of c (1 - c / 2) over that of 1 - c/2.
    assert confusion_mean([[1.0, 0.5]]) == pytest.approx((1 / 2 - 1 / 6) / (1 - 1 / 4), abs=1e-3)


def test_ankles_of_scenes_have_a_mean_and_the_doubt_of_the_next_scene() -> None:
    """Medians of .1, .2 and .3 m: mean .2 m, deviation .1 m times sqrt(1 + 1 / 3)."""
    evidence = [
        SimpleNamespace(path=SimpleNamespace(ankle=np.array([m - 0.02, m, m + 0.5])))
        for m in (0.1, 0.2, 0.3)
    ]
    estimators = {e.name: e.estimate for e in FROM_PATH}
    assert estimators["ankle.height"](evidence) == pytest.approx(0.2)
    assert estimators["ankle.offset"](evidence) == pytest.approx(0.1 * np.sqrt(4 / 3))
