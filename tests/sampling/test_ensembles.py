"""Draws of chains that walk in ensembles remain draws, each of its own scenelets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from imapper_prob.models.log_posterior import State, log_posterior
from imapper_prob.models.problem import Problem
from imapper_prob.models.settings import ModelSettings
from imapper_prob.samplers.tempering import POSTERIOR
from imapper_prob.sampling import ensembles
from imapper_prob.sampling.ensembles import QUANTITIES, describe_refinement, refine_draws
from imapper_prob.sampling.steps import SceneChain
from tests.models import worlds
from tests.sampling import scenes

CHAINS, DRAWS, STEPS = 4, 150, 60


@pytest.fixture(scope="module")
def problem() -> Problem:
    """One scene in three has a scenelet, and little is known about its place."""
    return worlds.problem(20, settings=ModelSettings(frame_weight=0.02, scenelet_rate=0.1))


@pytest.fixture(scope="module")
def drawn(problem: Problem) -> tuple[list[State], np.ndarray]:
    """Draws of chains, far apart."""
    moves = scenes.moves_of(problem)
    states = []
    for chain in range(CHAINS):
        rng = np.random.default_rng(chain)
        scene_chain = SceneChain(problem, moves, scenes.random_state(problem, chain))
        scene_chain.advance(rng, POSTERIOR, 4_000)
        for _ in range(DRAWS):
            states.append(scene_chain.advance(rng, POSTERIOR, 400)[0].state)
    values = np.array([log_posterior(problem, state) for state in states])
    return states, values.reshape(CHAINS, DRAWS)


def walked(problem, drawn, steps=STEPS, **options):
    return refine_draws(problem, *drawn, steps, seed=np.random.SeedSequence(5), **options)


def test_draws_keep_their_scenelets_and_their_distribution(problem, drawn):
    told = []
    states, values, found = walked(problem, drawn, on_progress=told.append)
    assert found.walkers > 0.9 * CHAINS * DRAWS
    assert found.steps == STEPS
    for before, after in zip(drawn[0], states, strict=True):
        np.testing.assert_array_equal(before.items, after.items)
    moved = [not np.array_equal(a.camera, b.camera) for a, b in zip(drawn[0], states, strict=True)]
    assert np.mean(moved) > 0.8
    np.testing.assert_allclose(
        values.ravel(), [log_posterior(problem, state) for state in states], atol=1e-6
    )
    assert found.agrees
    assert (found.rhat < 1.05).all()
    assert (found.after > 0.7 * found.before).all()
    assert set(found.acceptance) == {"differential evolution", "snooker", "latent"}
    assert "agree with the chains" in describe_refinement(found)
    assert told[-1] == 1.0
    assert told == sorted(told)


def test_with_another_density_of_depths_they_do_not(problem, drawn, monkeypatch):
    monkeypatch.setattr(ensembles, "log_area", lambda log_depth: -20.0 * log_depth)
    found = walked(problem, drawn)[2]
    assert not found.agrees
    text = describe_refinement(found)
    assert "do not agree with the chains, which have not arrived" in text
    worst = np.argmax(np.abs(found.change) / found.error)
    assert QUANTITIES[worst].replace("_", " ") in text


def test_draws_of_another_distribution_do_not_agree(problem, drawn):
    """The chains' cameras are all too high, as in a run that has not arrived."""
    up = np.array([0.0, 0.1, 0.0, 0.0, 0.0])
    states = [replace(state, camera=state.camera + up) for state in drawn[0]]
    values = np.reshape([log_posterior(problem, state) for state in states], (CHAINS, DRAWS))
    assert np.isfinite(values).all()
    found = walked(problem, (states, values))[2]
    assert not found.agrees
    assert found.change[QUANTITIES.index("elevation")] < 0


@pytest.mark.slow
def test_the_same_seed_gives_the_same_draws_in_any_number_of_processes(problem, drawn):
    few = ([s for n in range(CHAINS) for s in drawn[0][n * DRAWS :][:60]], drawn[1][:, :60])
    one, two = (walked(problem, few, steps=4, workers=workers) for workers in (1, 2))
    for first, second in zip(one[0], two[0], strict=True):
        np.testing.assert_array_equal(first.placements, second.placements)
        np.testing.assert_array_equal(first.latent, second.latent)
    np.testing.assert_array_equal(one[1], two[1])


def test_too_few_draws_stay_where_they_are(problem, drawn):
    few = (drawn[0][:8], drawn[1][:2, :4])
    states, values, found = walked(problem, few)
    assert states == tuple(few[0])
    np.testing.assert_array_equal(values, few[1])
    assert found.walkers == 0
    assert describe_refinement(found) == describe_refinement(None)
    assert "too few" in describe_refinement(None)
