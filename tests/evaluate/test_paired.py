"""Differences between methods, object by object."""

from __future__ import annotations

import numpy as np
import pytest

from imapper_prob.evaluate.objects import ObjectScore, pair_up
from imapper_prob.evaluate.score import Score, paired_difference
from tests.evaluate.scenes import piece

TRUE = (piece("chair", 0.0, 4.0), piece("shelf", 3.0, 4.0))


def guess(chair: float, *, name: str = "guess", clip: str = "made up") -> Score:
    """A chair ``chair`` metres off, and no shelf."""
    pairs = pair_up(TRUE, (piece("chair", chair, 4.0),))
    return Score(name, clip, ObjectScore(pairs, TRUE, 1, 0.1, 0.0, 1.0), {})


def test_a_miss_costs_a_metre() -> None:
    np.testing.assert_allclose(guess(0.3).objects.losses, (0.3, 1.0))
    np.testing.assert_allclose(guess(3.0).objects.losses, (1.0, 1.0))


def test_the_mean_is_of_all_true_objects(rng: np.random.Generator) -> None:
    found = paired_difference([guess(0.3)], [guess(0.7, name="other")], rng)
    assert (found.name, found.other, found.objects) == ("guess", "other", 2)
    assert found.mean == pytest.approx(-20)
    assert found.low == pytest.approx(-40)
    assert found.high == pytest.approx(0)


def test_only_clips_of_both_count(rng: np.random.Generator) -> None:
    ours = [guess(0.3), guess(0.3, clip="another")]
    assert paired_difference(ours, [guess(0.7)], rng).objects == 2
    assert paired_difference(ours, [guess(0.7, clip="a third")], rng).objects == 0


def test_intervals_hold_the_true_difference(rng: np.random.Generator) -> None:
    # Losses differ by .1 m in the mean; 90 % of intervals should hold that.
    inside = 0
    for _ in range(60):
        ours = [guess(g, clip=str(k)) for k, g in enumerate(rng.uniform(0.2, 0.6, 25))]
        theirs = [guess(g, clip=str(k)) for k, g in enumerate(rng.uniform(0.4, 0.8, 25))]
        found = paired_difference(ours, theirs, rng)
        inside += found.low <= -10 <= found.high
    # Binomial(60, .85) is above 42 with probability .998; the half of zeros widens nothing.
    assert inside > 42
