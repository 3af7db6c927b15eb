"""How many detections count as one, where it is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from imapper_prob.models.detector import DetectionModel
from imapper_prob.models.scene import Truth
from imapper_prob.models.skeleton import DETECTED, PELV
from lab.calibrate.evidence import Neighbours, neighbours, repeats
from tests.models import worlds

TOLERANCE = 0.08
FRAMES = 12
DIRECTIONS = 400
JOINTS = worlds.walk(FRAMES, span=0.2)
POSE = JOINTS - JOINTS[:, [PELV]]
HIDDEN = np.zeros(JOINTS.shape[:2], bool)
HIDDEN[:, ::3] = True
TRUTH = Truth(worlds.CAMERA, (), JOINTS, HIDDEN)


def squares(
    rng: np.random.Generator, *, frames_alike: int = 1, joints_alike: int = 1
) -> np.ndarray:
    """Squared scores of detections that go by the model, but so many of which are one and the same.

    Ways from scenelet to scenelet are the same for those that are alike. Joints are hidden only if
    none are, for hidden ones are not like those in view.
    """
    joints = list(DETECTED)
    beside = neighbours(TRUTH, [(0, POSE)])
    model = DetectionModel()
    found = []
    for _ in range(DIRECTIONS):
        looseness = np.broadcast_to((TOLERANCE * beside.per_metre).mean(), (FRAMES, 14))
        hidden = HIDDEN[:, joints] & (frames_alike == joints_alike == 1)
        detected, confidence = model.draw(
            rng, np.zeros((FRAMES, 14, 2)), hidden, short_side=1080, looseness=looseness
        )
        apart = rng.standard_normal((1, FRAMES, 14, 2))
        first = np.arange(FRAMES) // frames_alike * frames_alike
        group = np.arange(14) // joints_alike * joints_alike
        one = np.ix_(first, group)
        clip = worlds.clip_of(JOINTS, rng)
        track = clip.tracks[0]
        keypoints, confidences = track.keypoints.copy(), track.confidences.copy()
        keypoints[:, joints] = beside.pixels + detected[one]
        confidences[:, joints] = confidence[one]
        clip = replace(clip, tracks=(replace(track, keypoints=keypoints, confidences=confidences),))
        way = Neighbours(beside.frames, beside.pixels, looseness / TOLERANCE, apart[0][one][None])
        truth = replace(TRUTH, hidden=HIDDEN & (frames_alike == joints_alike == 1))
        found.append(repeats(way, clip, truth, detections=model, tolerance=(TOLERANCE,) * 16))
    return np.concatenate(found)


@pytest.mark.parametrize(("frames", "joints"), [(1, 1), (4, 1), (1, 7), (3, 2)])
def test_as_many_count_as_one_as_are_alike(frames: int, joints: int) -> None:
    told = squares(np.random.default_rng(5), frames_alike=frames, joints_alike=joints)
    assert len(told) == DIRECTIONS
    error = told.std() / np.sqrt(len(told))
    assert told.mean() == pytest.approx(frames * joints, abs=4 * error)
    assert error < 0.1 * frames * joints


def test_scenelets_are_laid_upon_the_truth_and_looked_at() -> None:
    late = POSE[4:] + np.array([0.1, 0.0, 0.0]) * (np.arange(16) == 0)[:, None]
    beside = neighbours(TRUTH, [(0, POSE + 0.3), (4, late)])
    joints = list(DETECTED)
    # A pose that is the true one, but somewhere else, is laid where the person is.
    np.testing.assert_allclose(beside.pixels, worlds.CAMERA.project(JOINTS)[:, joints], atol=1e-6)
    assert np.isnan(beside.apart[0, :4]).all()
    # One joint of sixteen is .1 m aside: the whole is laid a sixteenth of that the other way.
    metres = beside.apart[0, 4:, :, 0] / beside.per_metre[4:]
    expected = np.where(np.asarray(joints) == 0, 0.1 * 15 / 16, -0.1 / 16)
    np.testing.assert_allclose(metres, np.broadcast_to(expected, metres.shape), atol=1e-3)


def test_unknown_frames_and_lost_joints_say_nothing() -> None:
    joints = JOINTS.copy()
    joints[5:7] = np.nan
    truth = replace(TRUTH, joints=joints)
    beside = neighbours(truth, [(0, POSE), (8, POSE[8:] * 1.02)])
    assert beside.frames.tolist() == [0, 1, 2, 3, 4, 7, 8, 9, 10, 11]
    clip = worlds.clip_of(JOINTS, np.random.default_rng(0))
    lost = replace(clip.tracks[0], confidences=np.zeros((FRAMES, 16)))
    model = DetectionModel()
    seen = repeats(beside, clip, truth, detections=model, tolerance=(TOLERANCE,) * 16)
    assert seen.shape == (1,)
    nothing = repeats(
        beside, replace(clip, tracks=(lost,)), truth, detections=model, tolerance=(TOLERANCE,) * 16
    )
    assert nothing.shape == (0,)
