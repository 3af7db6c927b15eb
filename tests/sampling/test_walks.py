"""Chains walk about the scene that they start from, and later references remember it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from imapper_prob.config import SampleSettings
from imapper_prob.models.log_posterior import empty_state, log_posterior
from imapper_prob.models.view import to_floor
from imapper_prob.sampling import chain
from imapper_prob.sampling.chain import Chain, Setup, run_chain
from imapper_prob.sampling.sample import setup_of
from imapper_prob.sampling.schedule import learning_of
from imapper_prob.sampling.visits import Visits
from tests.runs import small_solution

BRIEF = SampleSettings(chains=2, steps=400, draws=10, temperatures=2, ensemble_steps=2)
"""Eighty rounds; references are learnt at the beginning, after the walk, and after 18."""


def run(setup: Setup) -> Chain:
    states = small_solution().states[:1]
    return run_chain(setup, states, np.random.default_rng(5), lambda _: True)


def test_a_walk_stays_among_scenes_that_are_about_as_good() -> None:
    setup = setup_of(small_solution(), BRIEF)
    walk = run(setup).progress.visits[0].arrays()
    assert len(walk["counts"]) == 17  # four in a hundred steps, and the beginning
    best, empty = (
        log_posterior(setup.problem, state)
        for state in (small_solution().states[0], empty_state(setup.problem))
    )
    places, sizes = to_floor(walk["where"])
    ends = np.cumsum(walk["counts"])
    for camera, begin, end in zip(walk["cameras"], ends - walk["counts"], ends, strict=True):
        own = slice(begin, end)
        state = replace(
            empty_state(setup.problem), camera=camera, items=walk["items"][own],
            placements=places[own], sizes=sizes[own],
        )  # fmt: skip
        assert log_posterior(setup.problem, state) > empty + 0.5 * (best - empty)


def test_later_references_remember_what_walks_visited(monkeypatch: pytest.MonkeyPatch) -> None:
    setup = setup_of(small_solution(), BRIEF)
    empty = empty_state(setup.problem)
    walk, later, known, learn = Visits(), Visits(), [], chain.learn
    for _ in range(10):
        walk.note(small_solution().states[0])
    for _ in range(80):
        later.note(empty)

    def listen(problem, gains, similarity, visits):
        known.append(visits.arrays()["counts"])
        return learn(problem, gains, similarity, visits)

    monkeypatch.setattr(chain, "learn", listen)
    run(replace(setup, known=((walk,), (later,))))
    _, _, third = known
    # A fourth of the eighty: the ten of the walk twice.
    assert (third > 0).sum() == 20
    assert (third == 0).sum() == 80


def test_every_reference_remembers_the_best_scene_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    walk, about = chain._walk, []

    def listen(learnt, first, rng, steps):
        about.append(first)
        return walk(learnt, first, rng, steps)

    monkeypatch.setattr(chain, "_walk", listen)
    setup = setup_of(small_solution(), BRIEF)
    found = run(setup)
    ends = [end for end in learning_of(BRIEF).ends if end <= BRIEF.rounds]
    assert len(about) == len(ends) > 1
    values = [log_posterior(setup.problem, state) for state in about[1:]]
    assert values == sorted(values)
    best = found.progress.best
    assert best.log_density == pytest.approx(log_posterior(setup.problem, best.state), abs=1e-6)
    # Chains keep values that are rounded otherwise.
    assert best.log_density >= max(*values, *found.log_posterior) - 1e-6
    # A walk of 17 states is a fourth as much as what was visited, or a little more or less.
    for visits, state in zip(found.progress.visits[1:], about[1:], strict=False):
        rows = visits.arrays()
        firsts = (rows["cameras"] == state.camera).all(1).sum()
        others = len(rows["counts"]) - 17 * firsts
        assert firsts >= max(1, round(0.25 * others / 17))
