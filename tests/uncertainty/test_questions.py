"""What an answer would tell, against information that is known on paper."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import entropy, norm

import imapper_prob as im
from imapper_prob.layouts import merged_objects
from imapper_prob.models.log_posterior import empty_state
from imapper_prob.models.skeleton import REFERENCE_STATURE
from imapper_prob.models.statement_rows import tell
from imapper_prob.sampling.conditioning import statement_values
from imapper_prob.uncertainty.questions import Open, Question, _about_people, _parted, information
from imapper_prob.uncertainty.stored import categories_of
from tests.runs import small_posterior

CHAINS, DRAWS = 4, 200
LAYOUTS = np.array([0.5, 0.3, 0.2])
YES = np.array([0.95, 0.4, 0.02])
"""Probability that the answer is yes, by layout."""


def drawn(rng: np.random.Generator) -> np.ndarray:
    return rng.choice(3, (CHAINS, DRAWS), p=LAYOUTS)


def bits(p: np.ndarray) -> float:
    return float(entropy(p, base=2))


def exact() -> float:
    yes = float(LAYOUTS @ YES)
    given = sum(w * bits(np.array([p, 1 - p])) for w, p in zip(LAYOUTS, YES, strict=True))
    return bits(np.array([yes, 1 - yes])) - given


def test_an_answer_tells_what_it_tells_on_paper() -> None:
    scores = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        layouts = drawn(rng)
        yes = YES[layouts.ravel()]
        found, error = information(layouts, np.stack([yes, 1 - yes], -1), rng=rng)
        scores.append((found - exact()) / error)
    assert abs(np.mean(scores)) < 4 / np.sqrt(40) + 0.3
    assert np.std(scores) < 1.8


def test_the_entropy_falls_by_what_was_predicted(rng: np.random.Generator) -> None:
    """Of the layouts, when the answer is given and layouts are weighted by it."""
    layouts = drawn(rng)
    yes = YES[layouts.ravel()]
    predicted, error = information(layouts, np.stack([yes, 1 - yes], -1), rng=rng)
    share = np.bincount(layouts.ravel()) / layouts.size
    fell = 0.0
    for answer in (YES, 1 - YES):
        chance = float(share @ answer)
        fell += chance * (bits(share) - bits(share * answer / chance))
    assert abs(predicted - fell) < 4 * error


def test_a_measurement_tells_more_the_finer_it_is(rng: np.random.Generator) -> None:
    layouts = rng.choice(2, (CHAINS, DRAWS))
    values, told = layouts.ravel() * 1.0, []
    for std in (3.0, 0.5, 0.05):
        heard = values + std * rng.standard_normal(len(values))
        told.append(information(layouts, norm.pdf(heard[:, None], values, std), rng=rng)[0])
    assert told[0] < told[1] < told[2]
    assert told[2] == pytest.approx(1.0, abs=0.02)


def test_what_has_nothing_to_do_with_it_tells_nothing(rng: np.random.Generator) -> None:
    layouts = rng.choice(40, (CHAINS, DRAWS))
    yes = rng.uniform(size=CHAINS * DRAWS)
    found, error = information(layouts, np.stack([yes, 1 - yes], -1), rng=rng)
    assert abs(found) < 4 * error + 0.02


def test_layouts_that_are_met_once_tell_nothing(rng: np.random.Generator) -> None:
    layouts = np.arange(40).reshape(2, 20)
    yes = np.linspace(0.1, 0.9, 40)
    assert information(layouts, np.stack([yes, 1 - yes], -1), rng=rng)[0] == pytest.approx(0.0)


def test_answers_that_no_other_draw_gives_tell_nothing(rng: np.random.Generator) -> None:
    assert information(np.array([[0, 1], [1, 0]]), np.eye(4), rng=rng) == (0.0, 0.0)


def test_chains_that_stay_in_layouts_of_their_own_leave_the_error_unknown(
    rng: np.random.Generator,
) -> None:
    layouts = np.repeat(np.arange(4), DRAWS).reshape(4, DRAWS)
    yes = np.repeat([0.0, 0.0, 1.0, 1.0], DRAWS)
    found, error = information(layouts, np.stack([yes, 1 - yes], -1), rng=rng)
    # One bit, less what layouts moved by a part f of a chain tell: 1 - h(f) / 2, .64 in the mean.
    assert 0.2 < found < 0.52
    assert np.isnan(error)
    layouts[0, 0] = 1
    assert not np.isnan(information(layouts, np.stack([yes, 1 - yes], -1), rng=rng)[1])


@pytest.mark.parametrize("times", [(1, 1), (20, 60)])
def test_chains_that_mix_slowly_tell_no_more_than_they_know(times: tuple[int, int]) -> None:
    """Layouts and a number have nothing to do with each other, but few draws of each count."""
    found = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        layouts = np.stack([_held(rng.choice(20, 400), times[0], rng) for _ in range(2)])
        values = np.stack([_held(rng.standard_normal(400), times[1], rng) for _ in range(2)])
        heard = values.ravel() + 0.1 * rng.standard_normal(800)
        densities = norm.pdf(heard[:, None], values.ravel(), 0.1)
        found.append(information(layouts, densities, rng=rng)[0])
    assert abs(np.mean(found)) < 4 * np.std(found) / np.sqrt(12)
    assert np.std(found) < 0.3


def _held(values: np.ndarray, time: int, rng: np.random.Generator) -> np.ndarray:
    """A chain that leaves a value after ``time`` steps on average."""
    last = np.maximum.accumulate(
        np.where(rng.uniform(size=len(values)) < 1 / time, np.arange(len(values)), 0)
    )
    return values[last]


def test_questions_are_asked_of_a_posterior() -> None:
    posterior = small_posterior()
    questions = posterior.questions()
    assert list(questions) == sorted(questions, key=lambda q: -q.bits)
    assert {"height", "stature"} <= {
        q.open.quantity for q in questions if isinstance(q.open, im.Measured)
    }
    kinds = [type(q.open) for q in questions]
    assert kinds.count(im.DepthOf) == kinds.count(im.JointAt) == 1
    for question in questions:
        assert question.bits < 1.5
        assert str(question).endswith(" bit")
    depth = questions[kinds.index(im.DepthOf)]
    assert isinstance(depth.open, im.DepthOf)
    (nearly,) = depth.open.depths
    assert posterior.given([depth.answered(nearly)], steps=20).told is not None


def test_answers_become_statements() -> None:
    def of(about: Open, answer: Any) -> object:
        return Question("?", 0.5, 0.1, about).answered(answer)

    presence = im.Presence("chair", region=((0, 0), (1, 0), (1, 1)))
    assert of(presence, False) == replace(presence, there=False)
    assert of(im.Measured("height", 1.4, 0.02), 1.5) == im.Measured("height", 1.5, 0.02)
    assert of(im.DepthOf((3,), (2.0,), 0.05), 2.5) == im.DepthOf((3,), (2.5,), 0.05)
    asked = im.JointAt("PELV", 3, (0.0, 3.0, 0.9), 0.05)
    assert of(asked, (0.1, 3.2, 0.8)) == replace(asked, point=(0.1, 3.2, 0.8))
    with pytest.raises(im.InputError, match="an answer of 1 numbers; give x, y and z in metres"):
        of(asked, 1.0)
    with pytest.raises(im.InputError, match="is answered by True or False, not by 'no'"):
        of(presence, "no")
    with pytest.raises(im.InputError, match="is answered by metres, not by True"):
        of(im.Measured("height", 1.4, 0.02), True)


def test_the_frame_that_parts_layouts_is_asked_for(rng: np.random.Generator) -> None:
    """Not the one in which all of them are widely scattered."""
    layouts = rng.choice(2, 100)
    paths = 0.1 * rng.standard_normal((100, 5, 3))
    paths[:, 1] *= 10
    paths[:, 3, 0] += layouts
    assert _parted(paths, layouts).argmax() == 3
    assert _parted(paths, np.zeros(100, int)).argmax() == 1
    assert np.isfinite(_parted(np.zeros((100, 5, 3)), layouts)).all()


def test_draws_answer_where_their_own_person_is() -> None:
    posterior = small_posterior()
    samples = posterior.samples
    found = _about_people(samples, posterior.solution, np.random.default_rng(0))
    depth, place = (densities for _, _, densities in found)
    n = len(samples.states)
    assert depth.shape == place.shape == (n, n)
    # Each answer is most probable by draws as far away as the one that gives it.
    own = [np.median(d.diagonal() / d.max(1)) for d in (depth, place)]
    assert min(own) > 0.2


def sometimes_less() -> im.Posterior:
    """A posterior in which every third draw has no furniture."""
    run = small_posterior()
    source = run.solution
    empty = empty_state(source.problem)
    states = [empty if n % 3 == 0 else state for n, state in enumerate(run.samples.states)]
    objects = [merged_objects(source.problem, source.library, state) for state in states]
    samples = replace(run.samples, states=tuple(states), objects=tuple(objects))
    return type(run)(source, samples, run.config)


def test_questions_are_about_what_is_open() -> None:
    run = sometimes_less()
    asked = run.questions()
    samples, source = run.samples, run.solution
    unsure = [c for c in run.clusters() if 0.03 < c.presence < 0.97]
    labels = [p for c in run.clusters() for p in c.labels.values() if 0.03 < p < 0.97]
    about = [q for q in asked if isinstance(q.open, im.Presence)]
    assert len(about) == len(unsure) + len(labels) > len(labels) > 0
    for cluster in unsure:
        x, y = cluster.mean
        text = f"Is there a {' or '.join(cluster.labels)} at ({x:.1f}, {y:.1f}) m?"
        (question,) = [q for q in about if q.text == text]
        assert isinstance(question.open, im.Presence)
        assert question.open.labels == tuple(cluster.labels)
        np.testing.assert_allclose(np.mean(question.open.region, 0), cluster.mean, atol=1e-9)
        # Its information is that of the statement's probability under each draw.
        told = tell(source.problem, [question.open], run.clip, categories_of(source))
        yes = np.exp(statement_values(told, samples.states))
        known = samples.layouts.indicator.reshape(samples.shape)
        direct = [
            information(known, np.stack([yes, 1 - yes], -1), rng=np.random.default_rng(seed))[0]
            for seed in range(20)
        ]
        assert abs(question.bits - np.mean(direct)) < 5 * np.std(direct) + 1e-9
    measured = {q.open.quantity: q.open for q in asked if isinstance(q.open, im.Measured)}
    heights, bodies = np.transpose([(s.camera[1], s.camera[3]) for s in samples.states])
    assert measured["height"].value == pytest.approx(heights.mean())
    assert measured["stature"].value == pytest.approx(np.mean(REFERENCE_STATURE * np.exp(bodies)))
    assert [q.bits for q in asked] == sorted((q.bits for q in asked), reverse=True)
