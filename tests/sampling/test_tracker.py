"""What chains are told of a scene is the log-posterior, in the same two parts by either way."""

from __future__ import annotations

import numpy as np
import pytest

from imapper_prob.models.log_posterior import empty_state, log_posterior
from imapper_prob.samplers.reversible_jump import Redraw
from imapper_prob.sampling.chain import SceneTracker, scene_moves, tempering_split
from tests.models import worlds
from tests.sampling.test_moves import setup

PROBLEM = worlds.problem(20)


def test_both_ways_say_the_same_of_every_proposal() -> None:
    state, rng = empty_state(PROBLEM), np.random.default_rng(4)
    mixture, tracker = scene_moves(setup(PROBLEM)), SceneTracker(PROBLEM, state)
    counts = set()
    for _ in range(400):
        move = mixture.choose(rng)
        assert not isinstance(move, Redraw)
        proposal = move.propose(rng, state)
        if proposal is None:
            continue
        told, known = tracker(proposal.state), tempering_split(PROBLEM, proposal.state)
        assert told.log_prior == pytest.approx(known.log_prior, abs=1e-4)
        assert told.log_likelihood == pytest.approx(known.log_likelihood, abs=1e-4)
        if np.isfinite(known.log_prior) and rng.random() < 0.3:
            state = proposal.state
            tracker.move(state)
            counts.add(state.n_scenelets)
    assert len(counts) > 2


def test_parts_add_up_to_the_log_posterior_and_odds_are_flattened() -> None:
    empty = empty_state(PROBLEM)
    state = empty.with_item(1, 4, np.array([0.1, 4.0, 0.3]))
    parts = tempering_split(PROBLEM, state)
    assert parts.at(1.0) == pytest.approx(log_posterior(PROBLEM, state), rel=1e-12)
    other = PROBLEM._replace(log_rate=PROBLEM.log_rate - 5.0)
    assert tempering_split(other, state).log_prior == parts.log_prior
    assert tempering_split(other, state).at(0.2) - parts.at(0.2) == pytest.approx(-1.0)
    tracked = SceneTracker(other, state)(state)
    assert tracked.at(0.2) - parts.at(0.2) == pytest.approx(-1.0, abs=1e-4)
