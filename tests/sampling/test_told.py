"""Chains that are given statements against exact numbers, and draws that are led to them.

With the likelihood switched off every assignment has the probability of its prior odds, for places,
sizes and paths integrate to one; so whatever is said of labels and camera has a posterior and an
evidence on paper.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from scipy.stats import norm

import imapper_prob as im
from imapper_prob.config import SampleSettings
from imapper_prob.models.log_posterior import empty_state
from imapper_prob.models.problem import Problem, labels_of, seat_chances
from imapper_prob.models.settings import ModelSettings
from imapper_prob.models.statement_rows import tell
from imapper_prob.models.statements import Statement
from imapper_prob.samplers.diagnostics import mean_error
from imapper_prob.samplers.reweighting import reweigh
from imapper_prob.sampling.actors import JointProblem
from imapper_prob.sampling.conditioning import (
    continued,
    reweighted,
    statement_values,
    with_statements,
)
from imapper_prob.sampling.sample import Samples, sample_scenes
from tests.models import worlds

RATE, DOUBT = 0.12, 1e-3
"""Prior odds of all scenelets at one start, and of an answer by chance."""
N_STARTS = 3
LIBRARY = worlds.library()
CHAIR = N_STARTS * RATE / 3 / (1 + N_STARTS * RATE)
"""Probability that the one scenelet of three that has a chair is there, at any of three starts."""
SETTINGS = SampleSettings(
    chains=4, steps=3000, draws=300, temperatures=3, burn_in=0.2, ensemble_steps=0
)
SURE = im.Presence("chair", doubt=DOUBT)
OF_COUCH = float(seat_chances(LIBRARY, ModelSettings().seat_confusion)[0])
OF_CHAIR = 1 - ModelSettings().seat_confusion + OF_COUCH
"""Probability that the seat of a scenelet with a couch, or of one with a chair, is a chair."""
TRUE_CHAIR = CHAIR * (OF_CHAIR + 2 * OF_COUCH)
"""Probability that there is a chair: two of the three scenelets have a couch."""
EVIDENCE = (1 - DOUBT) * TRUE_CHAIR + DOUBT / 2
CERTAIN = ((1 - DOUBT) * OF_CHAIR + DOUBT / 2) * CHAIR / EVIDENCE
"""Of the statement, and the probability of the scenelet with a chair given it."""


@cache
def source() -> JointProblem:
    """Eight frames with room for one scenelet of six, of which nobody has seen anything."""
    settings = ModelSettings(likelihood=0.0, scenelet_rate=RATE)
    problem = worlds.problem(8, settings=settings, scenelets=LIBRARY)
    clip = worlds.clip_of(worlds.walk(8), np.random.default_rng(0))
    states = (empty_state(problem).with_item(0, 0, np.array([0.0, 3.5, 0.0])), empty_state(problem))
    distances = 1.0 - np.eye(3)
    return JointProblem(clip, LIBRARY, problem, distances, states, np.zeros(8))


def told(statements: list[Statement]) -> Problem:
    return tell(source().problem, statements, source().clip, labels_of(LIBRARY))


@cache
def samples() -> Samples:
    return sample_scenes(source(), SETTINGS, seed=np.random.SeedSequence(5))


def shares(drawn: Samples) -> tuple[np.ndarray, np.ndarray]:
    """(C, N) whether the scenelet with a chair is there, and the height of the camera."""
    chair = [any(s.items[:, 0] == 2) for s in drawn.states]
    height = [s.camera[1] for s in drawn.states]
    return np.reshape(chair, drawn.shape).astype(float), np.reshape(height, drawn.shape)


def close(values: np.ndarray, exact: float) -> bool:
    return abs(values.mean() - exact) < 4 * float(mean_error(values)) + 1e-3


def test_without_statements_chains_sample_the_prior() -> None:
    chair, height = shares(samples())
    assert close(chair, CHAIR)
    assert close(height, 1.5)


def test_chains_that_are_told_sample_the_renormalised_enumeration() -> None:
    problem = told([SURE, im.Measured("height", 1.7, 0.1)])
    drawn = sample_scenes(
        with_statements(source(), problem), SETTINGS, seed=np.random.SeedSequence(6)
    )
    chair, height = shares(drawn)
    assert close(chair, CERTAIN)
    # Two normal measurements of one deviation, .1, one of which is the prior.
    assert close(height, 1.6)
    assert height.std() == pytest.approx(math.sqrt(0.5) * 0.1, rel=0.15)


def test_weights_give_the_same_posterior_and_the_bayes_factor() -> None:
    doubtful = im.Presence("chair", doubt=0.4)
    said = im.Measured("height", 1.6, 0.1)
    values = statement_values(told([doubtful, said]), samples().states)
    found = reweigh(values.reshape(samples().shape))
    evidence = 0.6 * TRUE_CHAIR + 0.2
    exact = math.log(evidence) + norm.logpdf(1.6, 1.5, math.hypot(0.1, 0.1))
    assert found.good
    assert abs(found.log_ratio - exact) < 4 * found.error
    assert found.error < 0.1
    # One that is not normalised would be seen.
    assert abs(found.log_ratio + math.log(1.5) - exact) > 4 * found.error
    chosen = reweighted(
        samples(), found, values=values, settings=SETTINGS, rng=np.random.default_rng(0)
    )
    assert len(chosen.states) == pytest.approx(found.effective, abs=4)
    chair, height = shares(chosen)
    assert close(chair, (0.6 * OF_CHAIR + 0.2) * CHAIR / evidence)
    assert close(height, 1.55)


@pytest.mark.slow
def test_draws_are_led_to_what_few_agree_with() -> None:
    problem = told([SURE, im.Measured("height", 2.0, 0.03)])
    values = statement_values(problem, samples().states)
    found = reweigh(values.reshape(samples().shape))
    assert not found.good
    exact = math.log(EVIDENCE) + norm.logpdf(2.0, 1.5, math.hypot(0.1, 0.03))
    weight = 0.1**2 / (0.1**2 + 0.03**2)
    off, errors = [], []
    for seed in (7, 8, 9):
        drawn, evidence = continued(
            source(), samples(), problem=problem, fresh=np.ones(2), found=found, settings=SETTINGS,
            seed=np.random.SeedSequence(seed),
        )  # fmt: skip
        assert evidence.method == "resampled"
        assert 0 < evidence.error < 1.5
        off.append(evidence.log_ratio - exact)
        errors.append(evidence.error)
        chair, height = shares(drawn)
        assert close(chair, CERTAIN)
        assert close(height, 1.5 + weight * 0.5)
    # The square of the error is right in the mean; that of a single run is known from the few
    # families that survive.
    assert np.abs(off).max() < 4 * np.sqrt(np.mean(np.square(errors)))


@pytest.mark.slow
def test_what_was_known_already_is_no_news() -> None:
    first = im.Measured("height", 1.6, 0.1)
    before = sample_scenes(
        with_statements(source(), told([first])), SETTINGS, seed=np.random.SeedSequence(9)
    )
    second = told([first, SURE])
    alone = second._replace(given_power=np.array([0.0, 1.0]))
    found = reweigh(statement_values(alone, before.states).reshape(before.shape))
    _, evidence = continued(
        source(), before, problem=second, fresh=np.array([0.0, 1.0]), found=found,
        settings=SETTINGS,
        seed=np.random.SeedSequence(10),
    )  # fmt: skip
    assert abs(evidence.log_ratio - math.log(EVIDENCE)) < 4 * evidence.error
