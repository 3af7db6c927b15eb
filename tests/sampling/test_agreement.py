"""Ensembles held against chains."""

from __future__ import annotations

import numpy as np
import pytest

from imapper_prob.models.log_posterior import empty_state
from imapper_prob.sampling.placements import PlacementDraws, compare, describe_agreement
from tests.models import worlds

PROBLEM, LIBRARY = worlds.problem(20), worlds.library()
ITEMS = np.array([[0, 2]])


def drawn(rng: np.random.Generator, count: int, *, off: float, wide: float) -> np.ndarray:
    """(count, 1, 3) placements without a turn."""
    places = np.zeros((count, 1, 3))
    places[..., 0] = 1.0 + off + 0.1 * wide * rng.standard_normal((count, 1))
    places[..., 1] = 4.0 + 0.2 * rng.standard_normal((count, 1))
    return places


def agreement(*, off: float = 0.0, wide: float = 1.0, count: int = 2000):
    rng = np.random.default_rng(0)
    walked = drawn(rng, 4000, off=0.0, wide=1.0).reshape(4, 50, 20, 1, 3)
    camera, sizes = np.zeros((4, 50, 20, 5)), np.zeros((4, 50, 20, 1))
    ensembles = PlacementDraws(ITEMS, camera, walked, sizes, np.ones(9), {})
    states = [
        empty_state(PROBLEM).with_item(0, 2, place[0])
        for place in drawn(rng, count, off=off, wide=wide)
    ]
    # Other assignments do not count.
    states += [empty_state(PROBLEM).with_item(1, 2, np.array([9.0, 9.0, 0.0]))] * 50
    return compare(LIBRARY, ensembles, states)


def test_the_same_distribution_agrees() -> None:
    found = agreement()
    assert found.labels == ("couch",)
    assert found.draws == 2000
    # Standard error 1 / sqrt(2000) = .022 and 1 / sqrt(4000) = .016.
    np.testing.assert_allclose(found.difference, 0.0, atol=0.12)
    np.testing.assert_allclose(found.ratio, 1.0, atol=0.08)
    assert describe_agreement([found]).startswith("Ensembles and chains agree on")


def test_another_mean_and_spread_are_found() -> None:
    found = agreement(off=0.2, wide=2.0)
    assert found.difference[0] == pytest.approx([-2.0, 0.0], abs=0.25)
    assert found.ratio[0] == pytest.approx([2.0, 1.0], abs=0.15)
    text = describe_agreement([found])
    assert "do not agree yet" in text
    assert "(2000 draws)" in text


def test_too_few_draws_say_nothing() -> None:
    found = agreement(count=3)
    assert np.isnan(found.difference).all()
    assert "cannot be compared" in describe_agreement([found])


def test_an_empty_room_has_nothing_to_compare() -> None:
    none = np.zeros((4, 50, 20, 0, 3))
    camera, sizes = np.zeros((4, 50, 20, 5)), np.zeros((4, 50, 20, 0))
    ensembles = PlacementDraws(np.empty((0, 2), np.int64), camera, none, sizes, np.ones(9), {})
    found = compare(LIBRARY, ensembles, [empty_state(PROBLEM)] * 40)
    assert (found.labels, found.draws) == ((), 40)
    assert "cannot be compared" in describe_agreement([found])
