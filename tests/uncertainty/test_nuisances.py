"""Prior against posterior."""

from __future__ import annotations

import numpy as np
import pytest

from imapper_prob.models.path_prior import CAMERA
from imapper_prob.uncertainty.parameters import nuisances


def test_every_parameter_with_its_prior(rng: np.random.Generator) -> None:
    mean = np.arange(5.0)
    covariance = np.diag([0.04, 0.01, 0.09, 0.16, 0.25])
    covariance[0, 1] = covariance[1, 0] = 0.01
    draws = mean + 0.1 + 0.1 * rng.standard_normal((4, 500, 5))
    found = nuisances(draws, mean=mean, covariance=covariance)
    assert tuple(found) == CAMERA
    for i, one in enumerate(found.values()):
        sample = draws[..., i]
        assert one.prior_mean == mean[i]
        assert one.prior_standard_deviation == pytest.approx(np.sqrt(covariance[i, i]))
        assert one.mean == pytest.approx(sample.mean())
        assert one.standard_deviation == pytest.approx(sample.std(ddof=1))
        ratio = sample.var(ddof=1) / covariance[i, i]
        assert one.contraction == pytest.approx(1 - ratio)
        assert one.shift == pytest.approx((sample.mean() - mean[i]) / np.sqrt(covariance[i, i]))
        low, high = one.interval(0.9)
        # To one draw at each end.
        assert np.mean((sample >= low) & (sample <= high)) == pytest.approx(0.9, abs=2 / 2000)
