"""Ranks that are uniform are taken for uniform, as often as stated, and others are not."""

from __future__ import annotations

import numpy as np
import pytest

from lab.sbc import ecdf_and_band, rank_among, spread_ranks, uniformity

N_RANKS, N_DRAWS = 200, 31


def test_ranks_count_smaller_draws() -> None:
    rng = np.random.default_rng(0)
    assert rank_among(rng, 0.5, [0.1, 0.4, 0.6]) == 2
    assert rank_among(rng, -np.inf, [0.1, 0.4, 0.6]) == 0
    assert rank_among(rng, 2.0, [0.1, 0.4, 0.6]) == 3


def test_ties_are_ordered_by_chance() -> None:
    rng = np.random.default_rng(0)
    ranks = [rank_among(rng, 1.0, [0.0, 1.0, 1.0, 2.0]) for _ in range(3000)]
    counts = np.bincount(ranks, minlength=5)
    assert counts[[0, 4]].tolist() == [0, 0]
    assert np.abs(counts[1:4] - 1000).max() < 5 * np.sqrt(3000 * 2 / 9)


def test_a_rank_stays_in_its_cell() -> None:
    ranks = np.arange(N_DRAWS + 1)
    numbers = spread_ranks(ranks, n_draws=N_DRAWS)
    np.testing.assert_array_equal(np.floor(numbers * (N_DRAWS + 1)), ranks)
    np.testing.assert_array_equal(numbers, spread_ranks(ranks, n_draws=N_DRAWS))


@pytest.mark.parametrize("probability", [0.8, 0.95])
def test_the_band_holds_all_of_it_as_often_as_stated(probability: float) -> None:
    rng = np.random.default_rng(1)
    at, _, low, high = ecdf_and_band(rng.random(N_RANKS), probability=probability)
    inside = []
    for _ in range(2000):
        shares = np.searchsorted(np.sort(rng.random(N_RANKS)), at, side="right") / N_RANKS
        inside.append(bool(np.all((shares >= low - 1e-12) & (shares <= high + 1e-12))))
    # Counts are whole numbers, so that the band holds a little more than asked.
    error = np.sqrt(probability * (1 - probability) / 2000)
    assert -4 * error < np.mean(inside) - probability < 4 * error + 0.02


def test_p_values_of_uniform_ranks_are_uniform_and_those_of_others_small() -> None:
    rng = np.random.default_rng(2)

    def p_values(draw: str) -> np.ndarray:
        found = []
        for _ in range(400):
            u = rng.random(N_RANKS)
            if draw == "shifted":
                u = u**1.5
            if draw == "too narrow":
                u = np.where(rng.random(N_RANKS) < 0.2, (u > 0.5) * 0.999, u)
            ranks = np.floor(u * (N_DRAWS + 1))
            found.append(uniformity(spread_ranks(ranks, n_draws=N_DRAWS)))
        return np.array(found)

    even = p_values("even")
    for level in (0.05, 0.2, 0.5):
        assert (even < level).mean() == pytest.approx(level, abs=4.5 * np.sqrt(level / 400))
    assert (p_values("shifted") < 0.01).mean() > 0.95
    assert (p_values("too narrow") < 0.01).mean() > 0.95
