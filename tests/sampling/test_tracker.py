"""What chains are told of a scene is the log-posterior, in the same two parts by either way."""

from __future__ import annotations

import numpy as np
import pytest

from imapper_prob.models.log_posterior import State, empty_state, log_posterior
from imapper_prob.sampling.chain import SceneTracker, scene_moves, tempering_split
from imapper_prob.sampling.learning import learn
from imapper_prob.sampling.reference import Reference, log_reference
from imapper_prob.sampling.visits import Visits
from tests.models import worlds
from tests.sampling.test_moves import candidates, setup, similarity

PROBLEM = worlds.problem(20)


def reference() -> Reference:
    visits = Visits()
    visits.note(empty_state(PROBLEM).with_item(1, 4, np.array([0.1, 4.0, 0.3])))
    return learn(PROBLEM, candidates(), similarity(), visits)


@pytest.mark.parametrize("learnt", [True, False])
def test_both_ways_say_the_same_of_every_proposal(learnt: bool) -> None:
    state, rng = empty_state(PROBLEM), np.random.default_rng(4)
    known = reference() if learnt else None
    mixture, tracker = scene_moves(setup(PROBLEM)), SceneTracker(PROBLEM, known, state)
    counts = set()
    for _ in range(1000):
        move = mixture.choose(rng)
        proposal = move.propose(rng, state)
        if proposal is None:
            continue
        told, whole = tracker(proposal.state), tempering_split(PROBLEM, known, proposal.state)
        assert told.log_prior == pytest.approx(whole.log_prior, abs=1e-4)
        assert told.log_likelihood == pytest.approx(whole.log_likelihood, abs=1e-4)
        if np.isfinite(whole.at(0.5)) and rng.random() < 0.3:
            state = proposal.state
            tracker.move(state)
            counts.add(state.n_scenelets)
    assert len(counts) > 2


def test_parts_go_from_the_reference_to_the_log_posterior() -> None:
    known = reference()
    state: State = empty_state(PROBLEM).with_item(1, 4, np.array([0.1, 4.0, 0.3]))
    parts = tempering_split(PROBLEM, known, state)
    assert parts.at(1.0) == pytest.approx(log_posterior(PROBLEM, state), rel=1e-12)
    of_reference = log_reference(
        known, state.camera, state.items, state.placements, state.sizes
    )  # fmt: skip
    assert parts.at(0.0) == of_reference
    without = tempering_split(PROBLEM, None, state)
    assert without == (0.0, log_posterior(PROBLEM, state))


def test_outside_the_support_of_the_reference_nothing_is_said() -> None:
    state = empty_state(PROBLEM).with_item(1, 4, np.array([0.1, -4.0, 0.3]))
    parts = tempering_split(PROBLEM, reference(), state)
    assert parts.at(0.0) == parts.at(0.5) == -np.inf
