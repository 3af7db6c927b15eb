"""Sequences of a pool: sums and draws against brute force, and the target stays exactly."""

from __future__ import annotations

import itertools
import math
from collections import Counter

import numpy as np
import pytest
from scipy.stats import chi2

from imapper_prob.samplers.pools import (
    draw_sequence,
    log_arrangements,
    sequence_weight,
    sum_sequences,
)

Sequence = tuple[int, ...]


def pool(rng: np.random.Generator, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Order, log weights and log factors of elements that begin and end somewhere."""
    start, length = rng.integers(0, 8, size), rng.integers(1, 4, size)
    weight = np.where(rng.random(size) < 0.15, -np.inf, rng.normal(0, 2, size))
    apart = (start + length)[:, None] <= start
    return (
        np.argsort(start, kind="stable"), weight,
        np.where(apart, rng.normal(0, 2, (size, size)), -np.inf),
    )  # fmt: skip


def all_sequences(weight: np.ndarray, pair: np.ndarray) -> dict[Sequence, float]:
    """Log weight of each sequence, by trying all."""
    found = {}
    for count in range(len(weight) + 1):
        for chosen in itertools.permutations(range(len(weight)), count):
            nats = sequence_weight(weight, pair, np.array(chosen, int), count)
            if nats > -np.inf:
                found[chosen] = nats
    return found


def test_sums_are_those_of_all_sequences() -> None:
    rng = np.random.default_rng(0)
    for _ in range(60):
        order, weight, pair = pool(rng, int(rng.integers(1, 8)))
        total = sum_sequences(order, weight, pair, np.empty(len(weight)))
        nats = list(all_sequences(weight, pair).values())
        assert total == pytest.approx(np.logaddexp.reduce(nats), abs=1e-12)


def test_draws_have_the_probability_that_their_weight_says() -> None:
    rng, n = np.random.default_rng(1), 20_000
    order, weight, pair = pool(rng, 7)
    ending, out = np.empty(7), np.empty(8, np.int64)
    total = sum_sequences(order, weight, pair, ending)
    drawn: Counter[Sequence] = Counter()
    for _ in range(n):
        count = draw_sequence(order, pair, ending, total, rng.random(9), out)
        drawn[tuple(out[:count].tolist())] += 1
    expected = {s: n * math.exp(nats - total) for s, nats in all_sequences(weight, pair).items()}
    assert set(drawn) <= set(expected)
    often = [s for s, mean in expected.items() if mean > 5]
    misfit = sum((drawn[s] - expected[s]) ** 2 / expected[s] for s in often)
    assert len(often) > 5
    assert misfit < chi2.ppf(1 - 1e-5, len(often) - 1)


def test_what_has_no_room_is_no_draw() -> None:
    order, weight, pair = np.arange(3), np.full(3, 20.0), np.where(np.eye(3), -np.inf, 0.0)
    pair = np.where(np.triu(np.ones((3, 3)), 1) > 0, 0.0, -np.inf)
    ending = np.empty(3)
    total = sum_sequences(order, weight, pair, ending)
    room = np.empty(2, np.int64)
    assert draw_sequence(order, pair, ending, total, np.full(3, 0.5), room) == -1


# A toy of four elements that may be drawn from q again and again: which of them are there is
# drawn anew by a pool, several tries picked among by what they are worth.
STARTS, LENGTHS, Q = (0, 0, 2, 3), (2, 3, 2, 2), (0.4, 0.1, 0.3, 0.2)


def allowed(sequence: Sequence) -> bool:
    return all(STARTS[a] + LENGTHS[a] <= STARTS[b] for a, b in itertools.pairwise(sequence))


STATES = [s for r in range(3) for s in itertools.permutations(range(4), r) if allowed(s)]


def transitions(
    pi: np.ndarray, size: int, tries: int, *, counted: bool, weighed: bool
) -> np.ndarray:
    """The transition matrix, over all pools and draws."""
    rng = np.random.default_rng(2)
    single, pair = rng.normal(0, 1, 4), rng.normal(0, 1, (4, 4))
    index = {state: i for i, state in enumerate(STATES)}
    matrix = np.zeros((len(STATES), len(STATES)))
    for state in STATES:
        for fresh in itertools.product(range(4), repeat=size - len(state)):
            held = [*state, *fresh]
            choices = [
                c
                for r in range(3)
                for c in itertools.permutations(range(size), r)
                if allowed(tuple(held[i] for i in c))
            ]
            named = [tuple(held[i] for i in c) for c in choices]
            nats = [
                sum(single[e] - math.log(Q[e] * size) for e in s)
                + sum(pair[a, b] for a, b in itertools.pairwise(s))
                for s in named
            ]
            chance = np.exp(nats) / np.exp(nats).sum()
            worth = np.array([pi[index[s]] for s in named]) / chance
            if counted:
                worth *= [math.exp(-log_arrangements(size, len(s))) for s in named]
            if weighed:
                worth /= [math.prod(Q[e] for e in s) for s in named]
            here = choices.index(tuple(range(len(state))))
            for drawn in itertools.product(range(len(choices)), repeat=tries):
                own = worth[[here, *drawn]]
                likely = math.prod(Q[e] for e in fresh) * math.prod(chance[list(drawn)])
                for part, to in zip(own / own.sum(), (here, *drawn), strict=True):
                    matrix[index[state], index[named[to]]] += likely * part
    return matrix


@pytest.mark.parametrize(("size", "tries"), [(2, 1), (3, 1), (3, 2)])
def test_a_target_is_left_as_it_is(size: int, tries: int) -> None:
    pi = np.random.default_rng(3).dirichlet(np.ones(len(STATES)))
    matrix = transitions(pi, size, tries, counted=True, weighed=True)
    np.testing.assert_allclose(matrix.sum(1), 1, atol=1e-12)
    np.testing.assert_allclose(pi @ matrix, pi, atol=1e-12)
    for wrong in ({"counted": False, "weighed": True}, {"counted": True, "weighed": False}):
        assert np.abs(pi @ transitions(pi, size, tries, **wrong) - pi).max() > 1e-3
