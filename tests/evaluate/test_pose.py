"""Errors of joints, on cases whose answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from imapper_prob.evaluate.prediction import between_frames
from imapper_prob.evaluate.score import pose_scores
from imapper_prob.evaluate.truth import segments
from imapper_prob.models.errors import InputError
from imapper_prob.models.skeleton import NECK, PELV, SCORED
from tests.evaluate.scenes import CAMERA, N_FRAMES, prediction, truth, walk

KNOWN = N_FRAMES - 1


def test_truth_against_itself_is_nothing() -> None:
    for score in pose_scores(prediction(), truth()).values():
        assert (score.world, score.local, score.pixels) == (0, 0, 0)
        assert score.left_out == 0


def test_a_shift_is_in_the_world_and_not_about_the_pelvis() -> None:
    found = pose_scores(prediction(walk() + np.array([0.3, 0.4, 0.0])), truth())["all frames"]
    assert found.world == pytest.approx(50)
    assert found.local == pytest.approx(0, abs=1e-9)
    assert found.joints == KNOWN * len(SCORED)


def test_pixels_are_those_of_the_image() -> None:
    joints = walk()
    moved = joints + joints[..., [1]] * (1, 0, 0) / CAMERA.fx * 7
    found = pose_scores(prediction(moved), truth())["all frames"]
    assert found.pixels == pytest.approx(7)


def test_pelvis_and_neck_are_not_scored() -> None:
    joints = walk()
    joints[:, NECK] += 1
    assert pose_scores(prediction(joints), truth())["all frames"].world == 0
    joints[:, PELV] += (0.1, 0, 0)
    found = pose_scores(prediction(joints), truth())["all frames"]
    assert (found.world, found.local) == (0, pytest.approx(10))


def test_hidden_joints_alone_and_frames_with_three_of_them() -> None:
    joints = walk()
    joints[:, 0] += (0, 0.1, 0)
    found = pose_scores(prediction(joints), truth())
    # Joint 0 is hidden in three frames, four joints are in the first two.
    assert found["occluded joints"].joints == 9
    assert found["occluded joints"].world == pytest.approx(10 * np.sqrt(3 / 9))
    assert found["occ3"].joints == 2 * len(SCORED)
    assert found["occ3"].world == pytest.approx(10 * np.sqrt(1 / 14))


def test_frames_are_filled_in_between_and_not_beyond() -> None:
    joints = walk()
    joints[[0, 1, 5, 10, 11]] = np.nan
    filled = between_frames(joints)
    np.testing.assert_allclose(filled[5], walk()[5], atol=1e-12)
    assert np.isnan(filled[[0, 1, 10, 11]]).all()
    found = pose_scores(prediction(filled), truth())["all frames"]
    assert found.world == pytest.approx(0, abs=1e-9)
    assert found.left_out == 3 * len(SCORED)


def test_joints_that_a_method_does_not_have_are_counted() -> None:
    joints = walk() + np.array([0.1, 0, 0])
    joints[:, 0] = np.nan
    joints[:, PELV] = np.nan
    found = pose_scores(prediction(joints), truth())["all frames"]
    assert found.world == pytest.approx(10)
    assert found.left_out == KNOWN
    # The pelvis is the middle of the hips then, and of the truth its own.
    assert np.isfinite(found.local)


def test_everybody_whom_the_truth_knows_is_scored() -> None:
    """The second person is a metre off; of them nothing is said, or nothing is known."""
    one, other = walk(), walk() + np.array([0.0, 1.0, 0.0])
    everybody = prediction(np.concatenate([one, other]), people=2)
    first = truth()
    both = replace(
        first,
        joints=np.concatenate([first.joints] * 2),
        pixels=np.concatenate([first.pixels] * 2),
        hidden=np.concatenate([first.hidden] * 2),
    )
    found = pose_scores(everybody, both)["all frames"]
    assert found.world == pytest.approx(100 * np.sqrt(0.5))
    assert found.joints == 2 * KNOWN * len(SCORED)
    assert pose_scores(everybody, first)["all frames"].world == 0
    alone = pose_scores(prediction(one), both)["all frames"]
    assert (alone.world, alone.left_out) == (0, KNOWN * len(SCORED))


def test_what_two_people_do_is_apart() -> None:
    words = ("walk", "sit", "sit", "walk")
    assert [frames for _, frames in segments(words, 2)] == [
        slice(0, 1), slice(1, 2), slice(2, 3), slice(3, 4)
    ]  # fmt: skip
    assert [frames for _, frames in segments(words, 4)] == [slice(0, 1), slice(1, 3), slice(3, 4)]


def test_an_empty_prediction_has_no_errors() -> None:
    found = pose_scores(prediction(np.full_like(walk(), np.nan)), truth())["all frames"]
    assert np.isnan([found.world, found.local, found.pixels]).all()
    assert (found.joints, found.left_out) == (0, KNOWN * len(SCORED))


@pytest.mark.parametrize(
    ("frames", "people", "said"),
    [
        (N_FRAMES - 1, 1, "has 11 rows of joints of one person, but made up has 12 frames"),
        (2 * N_FRAMES, 1, "has 24 rows of joints of one person, but made up has 12 frames"),
        (N_FRAMES, 2, "has 12 rows of joints of 2 people, but made up has 12 frames"),
        (0, 1, "has 0 rows of joints of one person"),
        (0, 0, "a prediction is of one person at least"),
    ],
)
def test_rows_that_are_not_those_of_its_people_are_refused(
    frames: int, people: int, said: str
) -> None:
    joints = np.resize(walk(), (frames, *walk().shape[1:]))
    with pytest.raises(InputError, match=said):
        pose_scores(prediction(joints, people=people), truth())
    whole = prediction()
    with pytest.raises(InputError, match="rows of pixels of one person"):
        pose_scores(replace(whole, pixels=whole.pixels[:-1]), truth())
