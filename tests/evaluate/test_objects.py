"""Scores of furniture, on cases whose answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imapper_prob.evaluate.objects import object_scores, pair_up, yaw_error
from imapper_prob.evaluate.score import score, summarise
from imapper_prob.evaluate.truth import outline_of
from imapper_prob.models.scene import Cuboid, Placement, SceneObject
from tests.evaluate.scenes import CAMERA, furniture, piece, prediction, truth, walk


def test_used_objects_are_sat_on_stood_at_or_reached_into() -> None:
    # The table is three metres away.
    assert truth().used == (0, 3)
    near = (*furniture()[:2], piece("table", 0.0, 4.4), furniture()[3])
    assert truth(near).used == (0, 2, 3)


def test_the_shelf_is_that_of_the_hands() -> None:
    joints = walk()
    at_the_pelvis = piece("shelf", *joints[9, 6, :2], has_front=False)
    at_the_hands = piece("shelf", *joints[9, 10, :2], has_front=False)
    assert truth((at_the_pelvis, at_the_hands)).used == (1,)


def test_all_objects_count_where_nobody_says_what_is_done() -> None:
    assert len(replace(truth(), used=(0, 1, 2, 3)).used_objects) == 4


def test_truth_against_itself_is_nothing(rng: np.random.Generator) -> None:
    known = truth()
    found = object_scores(known.used_objects, known, rng)
    assert (found.distances == 0).all()
    assert (found.yaws == 0).all()
    assert (found.found, found.spurious) == (2, 0)
    assert found.overlap == pytest.approx(1)


def test_distances_found_and_spurious(rng: np.random.Generator) -> None:
    claimed = (
        piece("stool", 0.5, 4.4, yaw=20),  # 0.5 m from the chair
        piece("shelf", 1.0, 6.0),  # 1.5 m from the shelf
        piece("bed", 1.0, 4.5),  # where the shelf is, but never taken for one
    )
    found = object_scores(claimed, truth(), rng)
    np.testing.assert_allclose(sorted(found.distances), [0.5, 1.5])
    assert (found.true, found.found, found.spurious) == (2, 1, 2)
    np.testing.assert_allclose(found.yaws, [20])


def test_partners_are_those_of_least_sum() -> None:
    true = [piece("chair", 0, 4), piece("couch", 1, 4)]
    found = [piece("chair", 0.9, 4), piece("chair", 2.5, 4)]
    # Greedily the couch would take the first; the chair would then have one at 2.5 m.
    pairs = pair_up(true, found)
    np.testing.assert_allclose([p.distance for p in pairs], [0.9, 1.5])


@given(st.floats(-720, 720), st.floats(-720, 720))
def test_yaw_errors(one: float, other: float) -> None:
    front = yaw_error(piece("chair", 0, 4, yaw=one), piece("chair", 0, 4, yaw=other))
    axis = yaw_error(
        piece("table", 0, 4, yaw=one, has_front=False), piece("table", 0, 4, yaw=other)
    )
    difference = abs(one - other) % 360
    assert front == pytest.approx(min(difference, 360 - difference), abs=1e-6)
    assert axis == pytest.approx(min(difference % 180, 180 - difference % 180), abs=1e-6)


def test_overlap_is_of_all_furniture_together(rng: np.random.Generator) -> None:
    known = truth((piece("chair", 0.2, 4.0),))
    half = object_scores((piece("chair", 0.7, 4.0),), known, rng)
    assert half.overlap == pytest.approx(1 / 3)
    two = object_scores((piece("chair", 0.2, 4.0), piece("bed", 3.0, 4.0)), known, rng)
    assert two.overlap == pytest.approx(1 / 2)


def test_chance_grows_with_what_is_claimed(rng: np.random.Generator) -> None:
    known = truth()
    none, one, many = (
        object_scores((piece("chair", 0.2, 4.0),) * n, known, rng).chance for n in (0, 1, 5)
    )
    assert none == 0 < one < many < 1


def test_a_tilted_camera_sees_an_object_where_it_is() -> None:
    camera = CAMERA.posed(pitch=-0.1, roll=0.05, elevation=1.4)
    box = Cuboid("seat", np.array([0, 0, 0.2]), np.array([0.5, 0.4, 0.4]))
    item = SceneObject("chair", Placement(0.3, 4.0, 0.7), (box,))
    seen = outline_of(item, camera)
    expected = camera.to_camera(item.centre)[:2]
    np.testing.assert_allclose(seen.centre, expected, atol=1e-9)
    assert seen.yaw == pytest.approx(0.7, abs=0.01)
    assert seen.has_front


def test_summaries_pool_objects_and_average_poses() -> None:
    known = truth()
    here = score(prediction(objects=(piece("chair", 0.2, 4.3),)), known)
    farther = walk() + np.array([0.2, 0, 0])
    there = score(prediction(farther, (piece("chair", 0.2, 4.5),)), known)
    both = summarise([here, there])
    assert both.error == pytest.approx(40)
    assert both.spread == pytest.approx(10)
    assert (both.paired, both.true, both.found, both.spurious) == (2, 4, 2, 0)
    assert both.pose["all frames"] == pytest.approx((10, 0, both.pose["all frames"][2]))


def test_nothing_claimed_is_a_row_that_says_so() -> None:
    empty = summarise([score(prediction(np.full_like(walk(), np.nan)), truth())])
    assert np.isnan([empty.error, empty.yaw, *empty.pose["all frames"]]).all()
    assert (empty.found, empty.true, empty.overlap) == (0, 2, 0)
