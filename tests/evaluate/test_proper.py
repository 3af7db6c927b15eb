"""Proper scores: right values, and honesty pays."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imapper_prob.evaluate.claims import Claim, Draws
from imapper_prob.evaluate.probability import (
    brier,
    count_scores,
    energy_score,
    joint_energy_score,
    label_scores,
    presence_scores,
    scene_distance,
)
from imapper_prob.evaluate.truth import Outline
from tests.evaluate.scenes import CAMERA, piece, truth, walk

places = st.lists(
    st.tuples(st.sampled_from(("chair", "stool", "table")), st.integers(0, 4), st.integers(2, 6)),
    max_size=4,
)


def scene(items: list[tuple[str, int, int]]) -> tuple[Outline, ...]:
    return tuple(piece(label, 0.4 * x, 0.4 * y) for label, x, y in items)


def test_distances_misses_and_one_too_many() -> None:
    chair = piece("chair", 0, 4)
    assert scene_distance((chair,), (piece("couch", 0.3, 4.4),)) == pytest.approx(0.5)
    assert scene_distance((chair,), (piece("table", 0, 4),)) == 1
    assert scene_distance((chair,), ()) == 0.5
    assert scene_distance((chair,), (chair, piece("bed", 3, 4))) == 0.5
    # Beyond a metre two objects have nothing to do with each other.
    assert scene_distance((chair,), (piece("chair", 0, 9),)) == 1


@given(places, places, places)
def test_it_is_a_metric(a: list, b: list, c: list) -> None:
    one, two, three = scene(a), scene(b), scene(c)
    assert scene_distance(one, one) == 0
    assert scene_distance(one, two) == pytest.approx(scene_distance(two, one))
    through = scene_distance(one, three) + scene_distance(three, two)
    assert scene_distance(one, two) <= through + 1e-9


def test_energy_score_of_a_point_is_its_error() -> None:
    draws = ((piece("chair", 0.3, 4.0),),) * 10
    assert energy_score(draws, (piece("chair", 0, 4),)) == pytest.approx((0.3, 0.3))


def test_honest_spread_scores_better_than_false_confidence(rng: np.random.Generator) -> None:
    def drawn(spread: float, n: int) -> list[tuple[Outline, ...]]:
        return [(piece("chair", x, 4),) for x in spread * rng.standard_normal(n)]

    truths = drawn(0.3, 80)
    sure, honest, vague = (
        np.mean([energy_score(drawn(s, 30), t)[1] for t in truths]) for s in (0.03, 0.3, 1.5)
    )
    assert honest < sure
    assert honest < vague


def test_energy_of_joints(rng: np.random.Generator) -> None:
    joints = np.stack([walk() + np.array([s, 0, 0]) for s in (0.1, -0.1)])
    found = joint_energy_score(Draws(joints, CAMERA.project_camera(joints), ((), ())), truth())
    # Each is .1 off, and the two .2 from each other.
    assert found == pytest.approx((0.1, 0.0))


def test_counts() -> None:
    chair, table = piece("chair", 0, 4), piece("table", 0, 4)
    draws = ((chair,), (chair,), (chair,), (chair, table))
    square, log = count_scores(draws, (piece("stool", 3, 3),))
    assert square == pytest.approx(0.25**2 + 0.25**2)
    assert log == pytest.approx(-np.log(0.75))
    square, log = count_scores(draws, ())
    assert square == pytest.approx(1 + 0.75**2 + 0.25**2)
    assert log == pytest.approx(-np.log(0.5 / 4))


def test_probabilities_of_presence() -> None:
    def claim(label: str, x: float, y: float, probability: float) -> Claim:
        return Claim(probability, {label: 1.0}, (piece(label, x, y),))

    # The chair is there, a bed is not, and nobody thinks of the shelf.
    square, log = presence_scores((claim("chair", 0.3, 4, 0.9), claim("bed", 0, 8, 0.2)), truth())
    # Two objects are true.
    assert square == pytest.approx((0.1**2 + 0.2**2 + 1) / 2)
    assert log == pytest.approx(-(np.log(0.9) + np.log(0.8) + np.log(0.0025)) / 2)
    # Improbable clusters hardly change the score, wherever they are.
    rare = [claim("chair", 0.1, 4, 0.005), *(claim("bed", k, 9, 0.005) for k in range(5))]
    more, _ = presence_scores(
        (claim("chair", 0.3, 4, 0.9), *rare, claim("bed", 0, 8, 0.2)), truth()
    )
    assert more == pytest.approx(square, abs=1e-4)


def test_presence_is_matched_one_to_one_as_favourably_as_it_can_be() -> None:
    chairs = (piece("chair", 0, 4), piece("chair", 1.2, 4))
    known = replace(truth(chairs), used=(0, 1))
    claims = tuple(
        Claim(p, {"chair": 1.0}, (piece("chair", x, 4),)) for p, x in ((0.9, 0.7), (0.8, 2.0))
    )
    # The nearest chair of the first is the only one of the second.
    assert presence_scores(claims, known)[0] == pytest.approx((0.1**2 + 0.2**2) / 2)
    # Nothing is true: every claim costs.
    nothing = replace(truth(()), used=())
    assert presence_scores(claims, nothing)[0] == pytest.approx(0.9**2 + 0.8**2)
    assert np.isnan(presence_scores((), nothing)[0])


def test_labels() -> None:
    def claim(probability: float, x: float, y: float, label: str, **labels: float) -> Claim:
        return Claim(probability, {label: 1.0} | labels, (piece(label, x, y),))

    near = claim(0.9, 0.3, 4, "stool", stool=0.75, chair=0.25)
    found = label_scores((near, claim(0.4, 0.3, 4, "chair"), claim(1.0, 0, 8, "bed")), truth())
    assert (found.count, found.right, found.expected) == (1, 0, 0.75)
    assert found.logarithmic == pytest.approx(-np.log(0.25))
    # A label that is not listed.
    found = label_scores((claim(0.9, 0.3, 4, "stool"),), truth())
    assert found.logarithmic == pytest.approx(-np.log(0.0025))
    found = label_scores((claim(0.9, 0.3, 4, "chair"),), truth())
    assert (found.count, found.right, found.expected, found.logarithmic) == (1, 1, 1.0, 0.0)
    assert np.isnan(label_scores((), truth()).logarithmic)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.8])
def test_nothing_is_won_by_saying_otherwise(share: float) -> None:
    def expected(stated: float) -> np.ndarray:
        outcomes = [np.array(brier(np.array([stated]), np.array([y]))) for y in (1.0, 0.0)]
        return share * outcomes[0] + (1 - share) * outcomes[1]

    for stated, score in product(np.linspace(0.02, 0.98, 25), (0, 1)):
        assert expected(share)[score] <= expected(stated)[score] + 1e-12
