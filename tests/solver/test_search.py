"""Best-first search against brute force."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imapper_prob.solver import combinations
from imapper_prob.solver.combinations import best_first, bound

Problem = tuple[list[np.ndarray], np.ndarray, np.ndarray]


@st.composite
def problems(draw: st.DrawFn) -> Problem:
    """Groups of 0 to 3 members with gains, pair terms of either sign, and pairs that cannot be."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    sizes = draw(st.lists(st.integers(0, 3), min_size=1, max_size=5))
    n = sum(sizes)
    together = rng.normal(scale=draw(st.sampled_from([0.1, 3.0, 30.0])), size=(n, n))
    together[rng.random((n, n)) < draw(st.sampled_from([0.0, 0.3]))] = -np.inf
    together = np.triu(together, 1) + np.triu(together, 1).T if n else together
    ends = np.cumsum(sizes)
    groups = [np.arange(e - k, e) for e, k in zip(ends, sizes, strict=True)]
    return groups, rng.normal(2.0, 5.0, n), together


def score(members: tuple[int, ...], gain: np.ndarray, together: np.ndarray) -> float:
    pairs = itertools.combinations(members, 2)
    return float(gain[list(members)].sum() + sum(together[a, b] for a, b in pairs))


def every(groups: list[np.ndarray]) -> list[tuple[int, ...]]:
    choices = [[(), *((int(k),) for k in group)] for group in groups]
    return [sum(picked, ()) for picked in itertools.product(*choices)]


@given(problems())
def test_everything_comes_out_once_and_in_order(problem: Problem) -> None:
    groups, gain, together = problem
    found = list(best_first(groups, gain, together))
    possible = {m for m in every(groups) if np.isfinite(score(m, gain, together))}
    assert {m for m, _ in found} == possible
    assert len(found) == len(possible)
    values = [s for _, s in found]
    np.testing.assert_allclose(values, [score(m, gain, together) for m, _ in found], atol=1e-9)
    assert all(a >= b - 1e-9 for a, b in itertools.pairwise(values))


@given(problems())
def test_the_bound_is_never_below_what_is_possible(problem: Problem) -> None:
    groups, gain, together = problem
    most = max(
        sum(float(gain[k]) for k in m)
        + sum(
            float(together[a, b])
            for g, h in itertools.pairwise(groups)
            for a in m
            for b in m
            if a in g and b in h
        )
        for m in every(groups)
    )
    np.testing.assert_allclose(bound(groups, gain, together), most, atol=1e-9)


def test_equal_combinations_come_in_the_same_order() -> None:
    groups = [np.arange(3), np.arange(3, 6)]
    one, other = (
        [m for m, _ in best_first(groups, np.zeros(6), np.zeros((6, 6)))] for _ in range(2)
    )
    assert one == other
    assert len(set(one)) == 16


def test_few_are_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 4^12 combinations the best comes out at once, though neighbours exclude each other."""
    rng = np.random.default_rng(0)
    group = np.arange(36) // 3
    together = -rng.exponential(1.0, (36, 36))
    beside = abs(group[:, None] - group) == 1
    together[beside & (rng.random((36, 36)) < 0.7)] = -np.inf
    together = np.minimum(together, together.T)
    looked_at = []

    def counted(*arguments: Any) -> float:
        looked_at.append(1)
        return bound(*arguments)

    monkeypatch.setattr(combinations, "bound", counted)
    groups = list(np.arange(36).reshape(12, 3))
    members, best = next(best_first(groups, rng.uniform(20.0, 60.0, 36), together))
    assert members
    assert np.isfinite(best)
    assert len(looked_at) < 1000
