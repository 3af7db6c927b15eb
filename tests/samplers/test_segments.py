"""Sums over segmentations against all of them, one by one."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest

from imapper_prob.samplers.segments import (
    Segments,
    draw_sequence,
    forward,
    new_sums,
    sequence_weight,
)

TIMES, KINDS = 9, 2


def table(rng: np.random.Generator, n: int = 14) -> Segments:
    """Segments of two to four units, some alike in time, of weights that differ by much."""
    length = rng.integers(2, 5, n)
    start = np.sort(rng.integers(0, TIMES - 1, n))
    start = np.minimum(start, TIMES - length)
    order = np.argsort(start, kind="stable")
    start, end = start[order], (start + length)[order]
    by_end = np.argsort(end, kind="stable")
    times = np.arange(TIMES + 2)
    starting, ending = np.searchsorted(start, times), np.searchsorted(end[by_end], times)
    count = np.diff(starting) * np.diff(ending)
    return Segments(
        start, end, rng.integers(0, KINDS, n), by_end, starting, ending, rng.normal(0, 3, n),
        np.exp(rng.normal(0, 1, (KINDS, KINDS))), 0.6, np.concatenate([[0], np.cumsum(count)]),
        np.exp(rng.normal(0, 2, count.sum())).astype(np.float32),
    )  # fmt: skip


def sequences(given: Segments, begin: int, finish: int) -> Iterator[tuple[int, ...]]:
    """All of them, by trying every segment after every other."""

    def after(t: int) -> Iterator[tuple[int, ...]]:
        yield ()
        for b in range(len(given.start)):
            if given.start[b] >= t and given.end[b] <= finish:
                for rest in after(int(given.end[b])):
                    yield (b, *rest)

    return after(begin)


def weight(given: Segments, found: tuple[int, ...], left: np.ndarray, right: np.ndarray) -> float:
    """Log weight of a sequence, term by term."""
    if not found:
        return -0.3
    total = float(left[found[0]] + right[found[-1]] + given.log_weight[list(found)].sum())
    for a, b in pairwise(found):
        t = given.start[b]
        total += math.log(given.follow[given.kind[a], given.kind[b]])
        if given.end[a] < t:
            total += math.log(given.gap)
            continue
        ends = given.by_end[given.ending[t] : given.ending[t + 1]].tolist()
        at = given.pairs[t] + (b - given.starting[t]) * len(ends) + ends.index(a)
        total += math.log(given.flush[at])
    return total


def stretches() -> list[tuple[int, int]]:
    return [(0, TIMES), (1, 7), (2, 4), (3, 3)]


@pytest.mark.parametrize(("begin", "finish"), stretches())
@pytest.mark.parametrize("seed", range(6))
def test_forward_sums_are_those_over_all_sequences(begin: int, finish: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    given = table(rng)
    left, right = rng.normal(0, 3, (2, len(given.start)))
    every = list(sequences(given, begin, finish))
    assert len(set(every)) == len(every)
    weights = np.array([weight(given, s, left, right) for s in every])
    # What is outside of the stretch is not looked at.
    outside = (given.start < begin) | (given.end > finish)
    left[outside], right[outside] = 5000.0, np.nan
    sums = new_sums(given)
    total = forward(given, begin, finish, left, right, -0.3, sums)
    assert total == pytest.approx(np.logaddexp.reduce(weights), abs=1e-9)
    for found, expected in zip(every, weights, strict=True):
        got = sequence_weight(given, np.array(found, np.int64), len(found), left, right, -0.3)
        assert got == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("shift", [-600.0, 0.0, 600.0])
def test_weights_of_any_size_are_summed(shift: float) -> None:
    rng = np.random.default_rng(3)
    given = table(rng)
    given = given._replace(log_weight=given.log_weight + shift)
    left, right = rng.normal(0, 3, (2, len(given.start)))
    every = list(sequences(given, 0, TIMES))
    weights = np.array([weight(given, s, left, right) for s in every])
    total = forward(given, 0, TIMES, left, right, -0.3, new_sums(given))
    assert total == pytest.approx(np.logaddexp.reduce(weights), rel=1e-12, abs=1e-9)


def chi_square(
    given: Segments, begin: int, finish: int, *, n: int = 20_000, forgotten: bool = False
) -> float:
    """Of drawn sequences against their probabilities, by degree of freedom."""
    rng = np.random.default_rng(11)
    left, right = rng.normal(0, 2, (2, len(given.start)))
    sums = new_sums(given)
    total = forward(given, begin, finish, left, right, -0.3, sums)
    if forgotten:
        forward(given, begin, finish, left, 0 * right, -0.3, sums)
    drawn: Counter[tuple[int, ...]] = Counter()
    out = np.empty(TIMES, np.int64)
    for _ in range(n):
        count = draw_sequence(given, begin, finish, left, sums, rng.random(20), out)
        drawn[tuple(out[:count].tolist())] += 1
    assert sum(drawn.values()) == n
    terms, expected_rest, rest = [], float(n), n
    for found in sequences(given, begin, finish):
        expected = n * math.exp(weight(given, found, left, right) - total)
        if expected > 5:
            terms.append((drawn[found] - expected) ** 2 / expected)
            expected_rest, rest = expected_rest - expected, rest - drawn[found]
    assert len(terms) > 4
    return (sum(terms) + (rest - expected_rest) ** 2 / max(expected_rest, 1.0)) / len(terms)


@pytest.mark.parametrize(("begin", "finish"), stretches()[:2])
@pytest.mark.parametrize("seed", range(3))
def test_sequences_are_drawn_as_often_as_stated(begin: int, finish: int, seed: int) -> None:
    given = table(np.random.default_rng(seed))
    given = given._replace(log_weight=given.log_weight / 3)
    # Of five degrees of freedom, or more, beyond once in 100,000 times.
    assert chi_square(given, begin, finish) < 6


def test_a_forgotten_factor_of_the_last_is_seen() -> None:
    given = table(np.random.default_rng(1))
    given = given._replace(log_weight=given.log_weight / 3)
    assert chi_square(given, 0, TIMES, forgotten=True) > 6
