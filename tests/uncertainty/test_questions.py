"""What an answer would tell, against information that is known on paper."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import entropy, norm

import imapper_prob as im
from imapper_prob.uncertainty.questions import information
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
        layouts = drawn(np.random.default_rng(seed))
        yes = YES[layouts.ravel()]
        found, error = information(layouts, np.stack([yes, 1 - yes], -1))
        scores.append((found - exact()) / error)
    assert abs(np.mean(scores)) < 4 / np.sqrt(40) + 0.3
    assert np.std(scores) < 1.8


def test_the_entropy_falls_by_what_was_predicted(rng: np.random.Generator) -> None:
    """Of the layouts, when the answer is given and layouts are weighted by it."""
    layouts = drawn(rng)
    yes = YES[layouts.ravel()]
    predicted, error = information(layouts, np.stack([yes, 1 - yes], -1))
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
        told.append(information(layouts, norm.pdf(heard[:, None], values, std))[0])
    assert told[0] < told[1] < told[2]
    assert told[2] == pytest.approx(1.0, abs=0.02)


def test_what_has_nothing_to_do_with_it_tells_nothing(rng: np.random.Generator) -> None:
    layouts = rng.choice(40, (CHAINS, DRAWS))
    yes = rng.uniform(size=CHAINS * DRAWS)
    found, error = information(layouts, np.stack([yes, 1 - yes], -1))
    assert abs(found) < 4 * error + 0.02


def test_layouts_that_are_met_once_tell_nothing() -> None:
    layouts = np.arange(40).reshape(2, 20)
    yes = np.linspace(0.1, 0.9, 40)
    assert information(layouts, np.stack([yes, 1 - yes], -1))[0] == pytest.approx(0.0)


def test_questions_are_asked_of_a_posterior() -> None:
    posterior = small_posterior()
    questions = posterior.questions()
    assert list(questions) == sorted(questions, key=lambda q: -q.bits)
    assert {"height", "stature"} <= {
        q.open.quantity for q in questions if isinstance(q.open, im.Measured)
    }
    for question in questions:
        assert question.bits < 1.5
        assert str(question).endswith(" bit")
        answer = question.answered(1.6 if isinstance(question.open, im.Measured) else False)
        assert posterior.given([answer], steps=20).told is not None
        break
