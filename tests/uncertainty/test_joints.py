"""Joints over draws, against numpy's own covariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from imapper_prob.uncertainty.motion import joint_summary
from tests.uncertainty.motions import exactly


def test_mean_and_covariance_are_the_sample_s(rng: np.random.Generator) -> None:
    motions = rng.normal(size=(25, 3, 16, 3)) * (0.1, 0.5, 0.05) + (100.0, 400.0, 1.0)
    found = joint_summary(exactly(joints) for joints in motions)
    np.testing.assert_allclose(found.mean, motions.mean(0))
    for t, j in ((0, 0), (2, 15), (1, 6)):
        expected = np.cov(motions[:, t, j].T)
        np.testing.assert_allclose(found.covariance[t, j], expected, rtol=1e-9, atol=1e-14)
    expected = motions.std(0, ddof=1)
    np.testing.assert_allclose(found.standard_deviation, expected, rtol=1e-9)


def test_one_draw_has_no_covariance() -> None:
    with pytest.raises(ValueError, match="two draws"):
        joint_summary([exactly(np.zeros((3, 16, 3)))])


def test_what_each_draw_leaves_open_comes_on_top(rng: np.random.Generator) -> None:
    motions = rng.normal(size=(25, 3, 16, 3))
    open_ = [replace(exactly(joints), spread=np.full(16, 0.1)) for joints in motions]
    alone = joint_summary(exactly(joints) for joints in motions)
    found = joint_summary(open_)
    np.testing.assert_allclose(found.mean, alone.mean)
    np.testing.assert_allclose(
        found.covariance - alone.covariance,
        np.broadcast_to(0.01 * np.eye(3), found.covariance.shape),
        atol=1e-12,
    )
