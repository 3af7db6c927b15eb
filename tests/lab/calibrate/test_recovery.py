"""Told constants by the simulator, the estimation finds them again."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from imapper_prob.models.calibrated import Number, constants
from imapper_prob.scenelets.library import built_in_library
from lab.calibrate.procedure import recover

CLIPS = 24
DETECTIONS = {"seen": 20000, "hidden": 2000}
"""At least so many there are in these clips of 150 frames."""


@cache
def recovered() -> dict[str, tuple[Number, Number]]:
    """With other constants than those in use, which an estimate might have come from."""
    values = {name: c.value for name, c in constants().items()}
    values |= {
        "detections.seen_confidence": (0.05,) * 8 + (0.1, 0.1, 0.2, 0.2),
        "detections.hidden_confidence": (0.3, 0.1) + (0.06,) * 10,
        "detections.seen_error_scale": (20.0, 10.0),
        "detections.seen_error_dof": (2.5, 6.0),
        "detections.hidden_error_scale": (40.0, 25.0),
        "detections.hidden_error_dof": (2.0, 1.5),
        "path.pixel_scale": 10.0,
        "path.pixel_dof": 6.0,
        "side_flips.rate": 0.05,
        "side_flips.length": 0.8,
    }
    return recover(np.random.default_rng(0), built_in_library(), values, n_clips=CLIPS)


@pytest.mark.parametrize("state", ["seen", "hidden"])
@pytest.mark.slow
def test_confidences(state: str) -> None:
    known, found = (np.asarray(v) for v in recovered()[f"detections.{state}_confidence"])
    # Five standard errors of a binomial share.
    assert np.all(np.abs(found - known) < 5 * np.sqrt(known * (1 - known) / DETECTIONS[state]))


@pytest.mark.parametrize("state", ["seen", "hidden"])
def test_pixel_errors(state: str) -> None:
    """Of n errors a scale is known to about 1 / sqrt(n), degrees of freedom to a few times that.

    The rarest class has a seventh of the detections; frames with flipped sides that were not
    recognised leave some per cent.
    """
    n = DETECTIONS[state] / 7
    for what, tolerance in (("scale", 5 / np.sqrt(n)), ("dof", 15 / np.sqrt(n))):
        known, found = (np.asarray(v) for v in recovered()[f"detections.{state}_error_{what}"])
        np.testing.assert_allclose(found, known, rtol=tolerance + 0.05, err_msg=what)


def test_frames_that_err_independently() -> None:
    known, found = recovered()["frames.correlation_time"]
    assert found == pytest.approx(known, rel=0.2)


def test_side_flips() -> None:
    """Runs are a Poisson count, their lengths geometric."""
    rate, found_rate = recovered()["side_flips.rate"]
    length, found_length = recovered()["side_flips.length"]
    assert isinstance(rate, float)
    runs = rate * CLIPS * 15
    assert found_rate == pytest.approx(rate, rel=4 / np.sqrt(runs))
    assert found_length == pytest.approx(length, rel=4 / np.sqrt(runs))


def test_cameras() -> None:
    known, found = recovered()["camera.pitch"]
    assert found == pytest.approx(known, rel=5 / np.sqrt(2 * CLIPS))
