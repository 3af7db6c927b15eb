"""Errors of tracking: how large, how long, and of which joints."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from imapper_prob.scenelets.procedural.body import TRACKER_ERROR, TRACKER_MEMORY, as_tracked

FPS = 10.0
N_CLIPS, N_FRAMES = 300, 20


@pytest.fixture(scope="module")
def errors() -> NDArray[np.float64]:
    rng = np.random.default_rng(0)
    still = np.zeros((N_FRAMES, 16, 3))
    return np.stack([as_tracked(rng, still, fps=FPS) for _ in range(N_CLIPS)])


def test_errors_are_as_large_as_stated(errors: NDArray[np.float64]) -> None:
    # At least five independent values a clip, axis and joint: 72,000 in all, so that a variance
    # is good to .5 % (one standard deviation).
    assert (errors**2).sum(-1).mean() == pytest.approx(TRACKER_ERROR**2, rel=0.03)
    # A joint has 4,500 of them, and a frame 14,400: 2 % and 1.2 %.
    np.testing.assert_allclose((errors**2).sum(-1).mean((0, 1)), TRACKER_ERROR**2, rtol=0.1)
    np.testing.assert_allclose((errors**2).sum(-1).mean((0, 2)), TRACKER_ERROR**2, rtol=0.06)


def test_errors_last_as_long_as_stated(errors: NDArray[np.float64]) -> None:
    one = errors / errors.std()
    for lag in (1, 3, 6, 10):
        correlation = (one[:, lag:] * one[:, :-lag]).mean()
        scaled = np.sqrt(3) * lag / FPS / TRACKER_MEMORY
        assert correlation == pytest.approx((1 + scaled) * np.exp(-scaled), abs=0.03)


def test_errors_of_joints_and_axes_are_their_own(errors: NDArray[np.float64]) -> None:
    flat = errors[:, ::10].reshape(-1, 48)  # frames a second apart have forgotten each other
    correlation = np.corrcoef(flat.T) - np.eye(48)
    # 600 rows: a standard deviation of .041, the largest of 1,128 pairs within 5 of them.
    assert np.abs(correlation).max() < 5 / np.sqrt(len(flat))


def test_motion_is_kept_and_chance_is_given() -> None:
    joints = np.arange(15 * 48.0).reshape(15, 16, 3)
    one, same, other = (
        as_tracked(np.random.default_rng(seed), joints, fps=FPS) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(one, same)
    assert np.abs(one - other).max() > 0
    assert np.abs(one - joints).max() < 6 * TRACKER_ERROR
