"""Scenes that chains start from are climbed to."""

from __future__ import annotations

import numpy as np
import pytest

from imapper_prob.models.log_posterior import State, empty_state, log_posterior
from imapper_prob.models.problem import Problem
from imapper_prob.sampling import ascent
from imapper_prob.sampling.ascent import climb
from imapper_prob.sampling.gains import gains_of
from imapper_prob.sampling.learning import learn
from imapper_prob.sampling.steps import Moves, scene_moves
from imapper_prob.sampling.visits import Visits
from tests.models import worlds
from tests.sampling import scenes
from tests.sampling.scenes import in_order


@pytest.fixture(scope="module")
def problem() -> Problem:
    return worlds.problem(20)


@pytest.fixture(scope="module")
def moves(problem: Problem) -> Moves:
    """Of a reference that expects scenelets on the static path, as that of a chain at first."""
    reference = learn(problem, gains_of(problem), scenes.similarity(), Visits())
    return scene_moves(problem, reference, None)


def climbed(problem: Problem, moves: Moves, state: State, *, most: int = 10**6) -> State:
    return climb(problem, moves, state, np.random.default_rng(0), most=most, report=lambda _: True)


@pytest.mark.parametrize("seed", range(6))
def test_no_exchange_of_a_scenelet_is_much_better_where_it_ends(problem, moves, seed):
    """Beside what was gained, wherever others are expected."""
    start = scenes.random_state(problem, seed)
    end = climbed(problem, moves, start)
    best = log_posterior(problem, end)
    assert in_order(problem, end)
    gained = best - log_posterior(problem, start)
    assert gained > 0
    for index in range(end.n_scenelets):
        place, size = end.placements[index], float(end.sizes[index])
        without = end.without_item(index)
        for scenelet in range(len(problem.lengths)):
            for at in range(problem.n_frames - int(problem.lengths[scenelet]) + 1):
                other = without.with_item(scenelet, at, place, size)
                if in_order(problem, other):
                    assert log_posterior(problem, other) < best + 0.1 * gained


@pytest.mark.parametrize("number", [2, 3])
def test_one_is_replaced_by_several_at_once(problem, moves, monkeypatch, number):
    monkeypatch.setattr(ascent, "_CHANGES", ((1, number),))
    alone = scenes.random_state(problem, 6)
    assert alone.n_scenelets == 1
    end = climbed(problem, moves, alone)
    assert end.n_scenelets == number
    assert in_order(problem, end)
    assert log_posterior(problem, end) > log_posterior(problem, alone)


@pytest.mark.slow
def test_starts_far_apart_arrive_at_scenes_as_good(problem, moves):
    starts = [empty_state(problem), *(scenes.random_state(problem, seed) for seed in range(8))]
    before = [log_posterior(problem, state) for state in starts]
    after = [log_posterior(problem, climbed(problem, moves, state)) for state in starts]
    assert np.ptp(after) < 0.1 * np.ptp(before)


def test_no_more_is_evaluated_than_allowed(problem, moves):
    start = scenes.random_state(problem, 1)
    assert climbed(problem, moves, start, most=100) is start


def test_asked_to_stop_it_returns_what_it_has(problem, moves):
    start = scenes.random_state(problem, 1)
    rng = np.random.default_rng(0)
    end = climb(problem, moves, start, rng, most=10**6, report=lambda _: False)
    assert end is start
