"""Exchanges: a scene gets better by what other candidates bring, until none brings anything."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from imapper_prob.models.log_posterior import State, empty_state, log_posterior
from imapper_prob.models.problem import Problem
from imapper_prob.solver import sequences
from imapper_prob.solver.candidates import Candidate, refine
from imapper_prob.solver.sequences import Exchange
from imapper_prob.solver.sequences import exchange as exchange_every
from tests.runs import solution


def gain_of(problem: Problem, state: State) -> float:
    return log_posterior(problem, state) - log_posterior(problem, empty_state(problem))


def scene_of(problem: Problem, candidate: Candidate) -> State:
    return empty_state(problem).with_item(
        candidate.scenelet, candidate.start, candidate.placement, candidate.size
    )


def exchange(
    problem: Problem, state: State, candidates: Sequence[Candidate]
) -> tuple[Exchange, ...]:
    return exchange_every(problem, state, candidates, step=solution().curve.step)


@pytest.fixture(scope="module")
def problem() -> Problem:
    return solution().problem


@pytest.fixture(scope="module")
def candidates() -> tuple[Candidate, ...]:
    return solution().candidates


@pytest.fixture(scope="module")
def from_nothing(problem: Problem, candidates: tuple[Candidate, ...]) -> tuple[Exchange, ...]:
    return exchange(problem, empty_state(problem), candidates)


def test_a_worse_candidate_is_exchanged_for_a_better_one(
    problem: Problem, candidates: tuple[Candidate, ...]
) -> None:
    best = max(candidates, key=lambda c: c.gain)
    beside = [c for c in candidates if abs(c.start - best.start) < 5 and c.gain < best.gain - 5]
    worse = max(beside, key=lambda c: c.gain)
    start = scene_of(problem, worse)
    done = exchange(problem, start, candidates)
    assert done
    assert worse.scenelet not in done[-1].state.items[:, 0]
    # At least what the best candidate has by itself.
    assert gain_of(problem, done[-1].state) >= best.gain - 0.5


def test_every_exchange_brings_what_it_says(
    problem: Problem, from_nothing: tuple[Exchange, ...]
) -> None:
    before = log_posterior(problem, empty_state(problem))
    assert from_nothing
    for step in from_nothing:
        after = log_posterior(problem, step.state)
        assert step.gain >= 0.5
        assert after - before == pytest.approx(step.gain, abs=1e-9)
        before = after


def test_nothing_is_left_that_would_bring_anything(
    problem: Problem, candidates: tuple[Candidate, ...], from_nothing: tuple[Exchange, ...]
) -> None:
    end = from_nothing[-1].state
    assert exchange(problem, end, candidates) == ()
    best = log_posterior(problem, end)
    for index in range(end.n_scenelets):
        assert log_posterior(problem, end.without_item(index)) < best + 0.5


def test_a_scenelet_that_costs_is_taken_out(
    problem: Problem, candidates: tuple[Candidate, ...]
) -> None:
    worst = min(candidates, key=lambda c: c.gain)
    assert worst.gain < -1
    (step,) = exchange(problem, scene_of(problem, worst), ())
    assert step.candidates == ()
    assert step.state.n_scenelets == 0
    assert step.gain == pytest.approx(-worst.gain, abs=1e-9)


def test_no_scenelets_overlap_and_the_camera_stays(
    problem: Problem, candidates: tuple[Candidate, ...]
) -> None:
    start = refine(problem, scene_of(problem, candidates[0]))
    steps = exchange(problem, start, candidates)
    assert steps
    for step in steps:
        first = step.state.items[:, 1]
        last = first + problem.lengths[step.state.items[:, 0]]
        assert np.all(first[1:] >= last[:-1])
        np.testing.assert_array_equal(step.state.camera, start.camera)


def test_with_nothing_to_exchange_nothing_happens(problem: Problem) -> None:
    assert exchange(problem, empty_state(problem), ()) == ()


def test_a_long_stretch_is_divided(
    problem: Problem, candidates: tuple[Candidate, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    windows = 8
    monkeypatch.setattr(sequences, "_LONGEST", windows)
    done = exchange(problem, empty_state(problem), candidates)
    spans = [
        max(c.start + int(problem.lengths[c.scenelet]) for c in step.candidates)
        - step.candidates[0].start
        for step in done
    ]
    # The whole clip would be filled at once, by more than fit into a part of it.
    assert len(done) > 1
    assert max(spans) <= windows * solution().curve.step
    # Later passes go across the borders, so that no good scenelet is left out.
    best = max(c.gain for c in candidates)
    assert gain_of(problem, done[-1].state) >= best - 0.5
