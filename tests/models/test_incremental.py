"""The incremental evaluation: the same number as the full one, whatever came before."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba.core.runtime import rtsys
from numba.core.runtime._nrt_python import memsys_disable_stats, memsys_enable_stats

from imapper_prob.api import demo_clip
from imapper_prob.models.jit import compiled
from imapper_prob.models.kernels.cache import Evaluator, open_evaluator
from imapper_prob.models.kernels.incremental import NOWHERE, commit, place_scene, weigh_placed
from imapper_prob.models.log_posterior import (
    Incremental,
    State,
    change_from,
    empty_state,
    log_posterior,
    log_posterior_near,
)
from imapper_prob.models.problem import Problem, pack_problem
from imapper_prob.models.settings import ModelSettings
from imapper_prob.scenelets.library import load_library
from imapper_prob.solver.camera_prior import estimate_camera
from imapper_prob.solver.static_path import estimate_static_path
from tests.models import worlds

Move = Callable[[np.random.Generator, Problem, State], State]
ARGUMENTS = 14
"""Arrays handed to compiled code with a proposal, seven, and copies that kernels may write to."""
AHEAD = np.array([0.0, 4.0, 0.0])


@compiled
def place(
    evaluator: Evaluator,
    n_before: int,
    camera_before: np.ndarray,
    latent_before: np.ndarray,
    camera: np.ndarray,
    items: np.ndarray,
    placements: np.ndarray,
    sizes: np.ndarray,
    latent: np.ndarray,
) -> float:
    return place_scene(  # type: ignore[no-any-return]
        evaluator, n_before, camera_before, latent_before,
        camera, items, placements, sizes, latent,
    )  # fmt: skip


@compiled
def weigh(
    evaluator: Evaluator, n_before: int, camera: np.ndarray, items: np.ndarray, least: float
) -> float:
    return weigh_placed(  # type: ignore[no-any-return]
        evaluator, n_before, camera, items, least
    )


@cache
def small_world() -> Problem:
    """Somebody walks across the view for 60 frames, half of which a scenelet may cover."""
    problem = worlds.facing_about(worlds.problem(60))
    return problem._replace(free_cost=np.linspace(0.0, 3.0, 60))


@cache
def world_of_three() -> Problem:
    """The frames of three people, one after the other."""
    starts = np.isin(np.arange(60), (0, 25, 41))
    return worlds.problem(60, starts=starts)._replace(free_cost=np.linspace(0.0, 3.0, 60))


@cache
def demo_world() -> Problem:
    """The demo clip and the built-in library."""
    clip = demo_clip()
    path = estimate_static_path(clip)
    return pack_problem(clip, path, estimate_camera(clip, path), load_library())


def anywhere(rng: np.random.Generator) -> np.ndarray:
    """A placement in front of the camera, now and then behind it."""
    return rng.uniform([-2.0, -1.0 if rng.random() < 0.1 else 2.0, -4.0], [2.0, 6.0, 4.0])


def birth(rng: np.random.Generator, problem: Problem, state: State) -> State:
    scenelet = int(rng.integers(len(problem.lengths)))
    last = problem.n_frames - int(problem.lengths[scenelet])
    size = float(rng.normal(0.0, 0.06))
    return state.with_item(scenelet, int(rng.integers(-1, last + 2)), anywhere(rng), size)


def death(rng: np.random.Generator, problem: Problem, state: State) -> State:
    k = state.n_scenelets
    return state.without_item(int(rng.integers(k))) if k else state


def swap(rng: np.random.Generator, problem: Problem, state: State) -> State:
    return birth(rng, problem, death(rng, problem, state))


def walk(rng: np.random.Generator, problem: Problem, state: State) -> State:
    if state.n_scenelets == 0:
        return state
    index = int(rng.integers(state.n_scenelets))
    step = rng.normal(0.0, [0.05, 0.2, 0.2]) * rng.choice([0.01, 1.0])
    size = float(state.sizes[index] + rng.choice([0.0, rng.normal(0.0, 0.03)]))
    return state.with_placement(index, state.placements[index] + step, size)


def shift(rng: np.random.Generator, problem: Problem, state: State) -> State:
    items = state.items.copy()
    if len(items):
        items[rng.integers(len(items)), 1] += rng.integers(-3, 4)
    return replace(state, items=items)


def refresh(rng: np.random.Generator, problem: Problem, state: State) -> State:
    latent = state.latent.copy()
    first = int(rng.integers(len(latent)))
    latent[first : first + 10] = rng.standard_normal(latent[first : first + 10].shape)
    return replace(state, latent=latent)


def camera(rng: np.random.Generator, problem: Problem, state: State) -> State:
    return replace(state, camera=state.camera + rng.normal(0.0, 0.02, 5))


def everything(rng: np.random.Generator, problem: Problem, state: State) -> State:
    for move in (walk, refresh, shift, swap):
        state = move(rng, problem, state)
    return state


MOVES: tuple[Move, ...] = (
    birth,
    birth,
    death,
    swap,
    walk,
    walk,
    shift,
    refresh,
    camera,
    everything,
)


def wander(problem: Problem, seed: int, steps: int) -> int:
    """Propose at random, accept half, compare every value; returns the most scenelets seen."""
    rng = np.random.default_rng(seed)
    state = empty_state(problem)
    evaluator, most = Incremental(problem, state), 0
    for _ in range(steps):
        move = MOVES[int(rng.integers(len(MOVES)))]
        proposed = move(rng, problem, state)
        value, expected = sum(evaluator.propose(proposed)), log_posterior(problem, proposed)
        assert value == pytest.approx(expected, rel=1e-9), move.__name__
        if np.isfinite(value) and rng.random() < 0.5:
            evaluator.accept()
            state = proposed
            assert sum(evaluator.parts) == value
        most = max(most, state.n_scenelets)
    return most


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_equal_to_the_full_evaluation_in_a_small_world(seed: int) -> None:
    assert wander(small_world(), seed, 300) > 2


@pytest.mark.parametrize("world", [small_world, world_of_three, demo_world])
def test_only_what_is_below_the_least_of_interest_is_left_out(world: Callable[[], Problem]) -> None:
    """The bound is an upper bound, and often near enough to spare the rest."""
    problem, rng, left_out, below = world(), np.random.default_rng(3), 0, 0
    state, evaluator = empty_state(problem), open_evaluator(problem, 20)
    change_from(evaluator, NOWHERE, state, state)
    commit(evaluator)
    for _ in range(600):
        proposed = MOVES[int(rng.integers(len(MOVES)))](rng, problem, state)
        before = state.n_scenelets, state.camera.copy(), state.latent.copy()
        new = proposed.copies()
        prior = place(evaluator, *before, *new)
        if prior == -math.inf:
            continue
        likelihood = log_posterior(problem, proposed) - prior
        least = likelihood + rng.choice([-1.0, 0.0, 1.0, 30.0, 300.0])
        value = weigh(evaluator, state.n_scenelets, *new[:2], least)
        below += likelihood < least
        if value == -math.inf:
            left_out += 1
            assert likelihood < least
            continue
        assert value == pytest.approx(likelihood, rel=1e-9, abs=1e-9)
        if rng.random() < 0.5:
            commit(evaluator)
            state = proposed
    assert 0.2 * below < left_out < below


@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_equal_to_the_full_evaluation_with_people_in_a_row(seed: int) -> None:
    assert wander(world_of_three(), seed, 300) > 2


@pytest.mark.parametrize("seed", [0, 1])
def test_equal_to_the_full_evaluation_on_the_demo_clip(seed: int) -> None:
    assert wander(demo_world(), seed, 500) > 2


def test_refused_proposals_change_nothing() -> None:
    problem, rng = small_world(), np.random.default_rng(3)
    state = empty_state(problem).with_item(0, 5, AHEAD).with_item(2, 30, AHEAD + 0.4)
    evaluator = Incremental(problem, state)
    before = sum(evaluator.parts)
    for _ in range(200):
        evaluator.propose(everything(rng, problem, camera(rng, problem, state)))
    assert evaluator.state is state
    assert sum(evaluator.parts) == before
    assert sum(evaluator.propose(state)) == pytest.approx(before, rel=1e-14)
    walked = walk(rng, problem, state)
    assert sum(evaluator.propose(walked)) == pytest.approx(
        log_posterior(problem, walked), rel=1e-12
    )


def test_many_small_steps_do_not_add_up_to_an_error() -> None:
    """Steps too small to move a far frame are measured from where it was last worked out."""
    problem = small_world()
    state = empty_state(problem).with_item(1, 20, AHEAD)
    evaluator = Incremental(problem, state)
    for _ in range(400):
        state = state.with_placement(0, state.placements[0] + [3e-10, 7e-10, 0.0])
        evaluator.propose(state)
        evaluator.accept()
    assert sum(evaluator.parts) == pytest.approx(log_posterior(problem, state), rel=1e-9)


def test_nothing_is_allocated_but_what_arguments_are_handed_over_in() -> None:
    problem, rng = demo_world(), np.random.default_rng(5)
    state = empty_state(problem).with_item(0, 5, AHEAD).with_item(2, 40, AHEAD + 0.4)
    evaluator = Incremental(problem, state)
    memsys_enable_stats()
    try:
        for move in (walk, birth, death, refresh, camera):
            proposed = move(rng, problem, state)
            before = rtsys.get_allocation_stats().alloc
            value = sum(evaluator.propose(proposed))
            assert rtsys.get_allocation_stats().alloc - before <= ARGUMENTS, move.__name__
            if np.isfinite(value):
                evaluator.accept()
                assert rtsys.get_allocation_stats().alloc - before <= ARGUMENTS, move.__name__
                evaluator.propose(state)
                evaluator.accept()
    finally:
        memsys_disable_stats()


def test_room_is_made_for_more_scenelets() -> None:
    problem = worlds.problem(130)
    state = empty_state(problem)
    evaluator = Incremental(problem, state)
    for k in range(20):
        state = state.with_item(k % 3, 6 * k, AHEAD + np.array([0.1 * (k % 5), 0.2 * k, k]))
        assert sum(evaluator.propose(state)) == pytest.approx(
            log_posterior(problem, state), rel=1e-9
        )
        evaluator.accept()
    assert evaluator.state.n_scenelets == 20


def test_only_states_inside_the_support_are_accepted() -> None:
    problem = small_world()
    one = empty_state(problem).with_item(0, 3, AHEAD)
    evaluator = Incremental(problem, one)
    low = np.array([0.0, 0.1, 0.0, 0.0, 0.0])
    for outside in (
        one.with_item(1, 8, AHEAD), one.with_item(1, 55, AHEAD), one.with_item(1, -1, AHEAD),
        replace(one, camera=low),
    ):  # fmt: skip
        assert sum(evaluator.propose(outside)) == -np.inf
        with pytest.raises(ValueError, match="no proposal inside"):
            evaluator.accept()
        with pytest.raises(ValueError, match="outside the support"):
            Incremental(problem, outside)
    assert sum(evaluator.propose(one)) == pytest.approx(log_posterior(problem, one))
    evaluator.accept()
    with pytest.raises(ValueError, match="no proposal"):
        evaluator.accept()


def test_the_prior_alone() -> None:
    prior = small_world()._replace(likelihood=0.0)
    assert wander(prior, 4, 200) > 2


def test_near_a_state_is_what_it_is_anywhere() -> None:
    paper = worlds.problem(settings=ModelSettings(energy="paper", paper_nats=30.0))
    for problem in (small_world(), paper):
        one = empty_state(problem).with_item(0, 3, AHEAD)
        overlapping = one.with_item(1, 8, AHEAD)
        for start in (one, overlapping):
            value = log_posterior_near(problem, start)
            for state in (one, one.with_placement(0, AHEAD + 0.1), one.without_item(0)):
                assert value(state) == pytest.approx(log_posterior(problem, state), abs=1e-6)
            assert value(overlapping) == -np.inf
