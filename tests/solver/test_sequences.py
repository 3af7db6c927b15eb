"""Sequences: the best by dynamic programming are the best there are, and fit together."""

from __future__ import annotations

from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imapper_prob.models.log_posterior import State, empty_state, log_posterior, motion
from imapper_prob.models.skeleton import PELV
from imapper_prob.solver.candidates import Candidate, assigned
from imapper_prob.solver.sequences import best_before, best_sequences
from tests.runs import solution

Pairs = dict[tuple[int, int], float]


def worth(
    chosen: tuple[int, ...], starts: np.ndarray, ends: np.ndarray, gains: np.ndarray, pairs: Pairs
) -> float:
    """Of options in order of time; -inf where they overlap, or touch and cannot join."""
    total = float(gains[list(chosen)].sum())
    for one, other in pairwise(chosen):
        if starts[other] == ends[one]:
            total += pairs.get((one, other), -np.inf)
        elif starts[other] < ends[one]:
            return -np.inf
    return total


@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 9))
def test_the_best_sequence_is_found(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    starts = rng.integers(0, 12, n)
    ends = starts + rng.integers(1, 5, n)
    gains = rng.normal(1.0, 3.0, n)
    pairs = {
        (i, j): float(rng.normal(0.0, 3.0))
        for i in range(n)
        for j in range(n)
        if ends[i] == starts[j] and rng.random() < 0.7
    }
    before = {j: [(i, v) for (i, k), v in pairs.items() if k == j] for j in range(n)}
    value, came = best_before(starts, ends, gains, before)
    in_time = np.argsort(starts, kind="stable").tolist()
    every = [c for size in range(1, n + 1) for c in combinations(in_time, size)]
    for last in range(n):
        best = max(worth(c, starts, ends, gains, pairs) for c in every if c[-1] == last)
        assert value[last] == pytest.approx(best)
        chain = [last]
        while came[chain[-1]] >= 0:
            chain.append(int(came[chain[-1]]))
        assert worth(tuple(chain[::-1]), starts, ends, gains, pairs) == pytest.approx(best)


def sequences(
    within: tuple[int, int], *, context: State | None = None, count: int = 5
) -> tuple[tuple[Candidate, ...], ...]:
    found = solution()
    return best_sequences(
        found.problem, context or empty_state(found.problem), found.candidates,
        within=within, slide=found.curve.step // 2, count=count,
    )  # fmt: skip


def scene_of(members: tuple[Candidate, ...]) -> State:
    return assigned(empty_state(solution().problem), members)


def test_sequences_stay_in_their_stretch_and_differ() -> None:
    problem = solution().problem
    begin, end = 20, problem.n_frames - 10
    found = sequences((begin, end))
    assert len({tuple(c.scenelet for c in members) for members in found}) == len(found) == 5
    for members in found:
        assert members[0].start >= begin
        stops = [c.start + problem.lengths[c.scenelet] for c in members]
        assert stops[-1] <= end
        assert all(after.start >= stop for stop, after in zip(stops[:-1], members[1:], strict=True))


def test_who_joins_goes_on_where_the_other_was() -> None:
    problem, joins = solution().problem, 0
    for members in sequences((0, problem.n_frames)):
        joints = motion(problem, scene_of(members))
        for one, other in pairwise(members):
            if one.start + problem.lengths[one.scenelet] == other.start:
                joins += 1
                away = np.linalg.norm(joints[other.start - 1 : other.start + 1, PELV, :2], axis=-1)
                assert away[1] == pytest.approx(away[0], abs=1e-9)
    assert joins


def test_several_in_a_row_do_better_than_any_one() -> None:
    """The demo's person comes, sits and goes."""
    problem = solution().problem
    best = sequences((0, problem.n_frames), count=1)[0]
    assert len(best) > 1
    gain = log_posterior(problem, scene_of(best)) - log_posterior(problem, empty_state(problem))
    assert gain > max(c.gain for c in solution().candidates)


def test_no_candidates_no_sequences() -> None:
    found = solution()
    empty = empty_state(found.problem)
    assert best_sequences(found.problem, empty, (), within=(0, 50), slide=3, count=4) == ()
    assert sequences((0, 3)) == ()
