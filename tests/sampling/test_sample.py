"""The whole sampler on the demo clip, briefly."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imapper_prob.api import demo_clip
from imapper_prob.models.log_posterior import log_posterior
from imapper_prob.results.load import load_posterior
from imapper_prob.results.posterior import Posterior
from imapper_prob.sampling import chain
from imapper_prob.sampling import sample as sample_module
from imapper_prob.sampling.reference import Reference
from imapper_prob.sampling.sample import Samples, functionals, judge_draws, sample_scenes
from imapper_prob.sampling.schedule import learning_of
from imapper_prob.solver.solver import solve
from tests.runs import BRIEF, half_library, posterior, small_posterior, small_solution, solution


def samples(*, seed: int, workers: int = 1) -> Samples:
    sequence = np.random.SeedSequence(seed)
    return sample_scenes(small_solution(), BRIEF.sample, seed=sequence, workers=workers)


def test_draws_do_not_depend_on_the_number_of_workers() -> None:
    one, two = small_posterior().samples, samples(seed=BRIEF.seed, workers=2)
    np.testing.assert_array_equal(one.log_posterior, two.log_posterior)
    for a, b in zip(one.states, two.states, strict=True):
        np.testing.assert_array_equal(a.items, b.items)
        np.testing.assert_array_equal(a.placements, b.placements)
        np.testing.assert_array_equal(a.camera, b.camera)
        np.testing.assert_array_equal(a.latent, b.latent)
    np.testing.assert_array_equal(one.layouts.indicator, two.layouts.indicator)


def test_another_seed_gives_other_draws() -> None:
    first, second = small_posterior().samples, samples(seed=BRIEF.seed + 1)
    assert not np.array_equal(first.log_posterior, second.log_posterior)


def test_a_reference_is_learnt_once_for_all_chains(monkeypatch: pytest.MonkeyPatch) -> None:
    learnt = []

    def learn(*data: Any) -> Reference:
        learnt.append(chain_learn(*data))
        return learnt[-1]

    chain_learn = chain.learn
    monkeypatch.setattr(chain, "learn", learn)
    drawn = samples(seed=BRIEF.seed)
    # One of the solver's scenes, and one after each mark, for two chains.
    marks = [end for end in learning_of(BRIEF.sample).ends if end < BRIEF.sample.rounds]
    assert len(learnt) == 1 + len(marks) > 2
    np.testing.assert_array_equal(drawn.log_posterior, small_posterior().samples.log_posterior)


def test_draws_from_before_equilibrium_are_left_out(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    brief = replace(BRIEF, sample=replace(BRIEF.sample, ensemble_steps=0))
    seed = np.random.SeedSequence(1)
    whole = sample_scenes(small_solution(), brief.sample, seed=seed)
    monkeypatch.setattr(sample_module, "equilibrated", lambda _: 4)
    rest = sample_scenes(small_solution(), brief.sample, seed=np.random.SeedSequence(1))
    chains, draws = whole.shape
    assert rest.shape == (chains, draws - 4)
    np.testing.assert_array_equal(rest.log_posterior, whole.log_posterior[:, 4:])
    kept = [n for n in range(chains * draws) if n % draws >= 4]
    for state, n in zip(rest.states, kept, strict=True):
        np.testing.assert_array_equal(state.placements, whole.states[n].placements)
    assert rest.probabilities.n_draws == draws - 4
    assert "the first 4 draws of each, from before, are left out" in rest.verdict.text
    assert "left out" not in whole.verdict.text
    Posterior(small_solution(), rest, brief).save(tmp_path)
    opened = load_posterior(tmp_path).samples
    assert opened.verdict.text == rest.verdict.text
    np.testing.assert_array_equal(opened.log_posterior, rest.log_posterior)
    # They move on in ensembles as others do.
    walked = sample_scenes(small_solution(), BRIEF.sample, seed=np.random.SeedSequence(1))
    assert walked.shape == rest.shape
    assert "left out" in walked.verdict.text


def test_draws_have_the_log_posterior_they_say() -> None:
    drawn = posterior().samples
    for n in (0, 57, len(drawn.states) - 1):
        value = log_posterior(solution().problem, drawn.states[n])
        # Lines of sight are in single precision in both, and not worked out in the same order.
        assert drawn.log_posterior.flat[n] == pytest.approx(value, rel=1e-6)


def test_a_verdict_judges_log_posterior_number_of_objects_and_body() -> None:
    drawn = small_posterior().samples
    found = functionals(drawn.log_posterior, drawn.states, drawn.objects)
    assert list(found) == ["log posterior", "number of objects", "body scale"]
    np.testing.assert_array_equal(found["log posterior"], drawn.log_posterior)
    count = [len(own) for own in drawn.objects]
    np.testing.assert_array_equal(found["number of objects"].ravel(), count)
    scales = [state.camera[3] for state in drawn.states]
    np.testing.assert_array_equal(found["body scale"].ravel(), scales)


def test_draws_of_a_run_are_judged_as_any_draws_are() -> None:
    drawn = small_posterior().samples
    _, layout_seed, _ = np.random.SeedSequence(BRIEF.seed).spawn(3)
    found = judge_draws(
        drawn.states, drawn.log_posterior, drawn.objects,
        radius=BRIEF.sample.layout_radius, rng=np.random.default_rng(layout_seed),
    )  # fmt: skip
    np.testing.assert_array_equal(found.layouts.indicator, drawn.layouts.indicator)
    np.testing.assert_array_equal(
        found.probabilities.standard_error, drawn.probabilities.standard_error
    )
    finer = judge_draws(
        drawn.states, drawn.log_posterior, drawn.objects, radius=0.01, rng=np.random.default_rng(0)
    )
    assert len(finer.layouts.leaders) > len(found.layouts.leaders)


def test_solver_finds_a_seat_and_the_shelf_of_the_demo() -> None:
    solved = solution()
    found = {label for s, _ in solved.states[0].items for label in solved.library[s].labels}
    assert "shelf" in found
    assert found & {"couch", "chair", "stool"}


@pytest.mark.slow
def test_solving_twice_gives_the_same_bits() -> None:
    again = solve(demo_clip(), half_library())
    for a, b in zip(solution().states, again.states, strict=True):
        np.testing.assert_array_equal(a.items, b.items)
        np.testing.assert_array_equal(a.placements, b.placements)
