"""Poses from 2D joints alone, against motion that is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from imapper_prob.clips.i3db import read_i3db, read_i3db_truth
from imapper_prob.lifting import distinct_poses, lift_clip, lift_keypoints, views_of
from imapper_prob.models.camera import Camera
from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.scenelet import Library
from imapper_prob.models.skeleton import LHIP, N_JOINTS, PELV, RHIP, SCORED
from imapper_prob.scenelets.library import built_in_library
from tests.conftest import CORPUS

Array = NDArray[np.float64]
CAMERA = Camera(1280, 720, 1000, 1000, 640, 360, pitch=-0.1, elevation=1.6)
RIGHT = 0.15
"""Metres of root-mean-square joint error, half of what guessing a pose of the library gives."""


@pytest.fixture(scope="module")
def poses() -> Array:
    """Every tenth scenelet of the built-in library will do."""
    return distinct_poses(Library("tenth", tuple(built_in_library())[::10]))


def performed(name: str, yaw: float, at: tuple[float, float]) -> Array:
    """(T, 16, 3) joints in the world of a scenelet placed before the camera."""
    scenelet = next(s for s in built_in_library() if s.name == name)
    cos, sin = np.cos(yaw), np.sin(yaw)
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    joints: Array = scenelet.joints @ turn.T + (*at, 0)
    return joints


def names(action: str) -> list[str]:
    """Scenelets whose poses the fixture does not hold."""
    scenelets = tuple(built_in_library())
    return [s.name for i, s in enumerate(scenelets) if s.action == action and i % 10 == 5]


@pytest.mark.parametrize("action", ["walk", "sit", "reach"])
def test_motion_of_the_library_is_found_again(
    action: str, poses: Array, rng: np.random.Generator
) -> None:
    errors = []
    for name in names(action)[:6]:
        at = (rng.uniform(-1.5, 1.5), rng.uniform(3, 5))
        joints = performed(name, rng.uniform(-np.pi, np.pi), at)
        keypoints = CAMERA.project(joints) + rng.normal(0, 3, (len(joints), N_JOINTS, 2))
        confidences = np.full(keypoints.shape[:2], 0.85)
        lifted = lift_keypoints(CAMERA, keypoints, confidences, fps=10, poses=poses)
        truth = CAMERA.to_camera(joints)
        truth -= truth[:, PELV, None]
        errors.append(np.sqrt(((lifted.poses - truth) ** 2).sum(-1).mean()))
    assert np.median(errors) < RIGHT


def test_confidence_decides_what_counts(poses: Array) -> None:
    joints = performed(names("walk")[0], 0.5, (0, 4))
    keypoints = CAMERA.project(joints)
    confidences = np.full(keypoints.shape[:2], 0.9)
    before = lift_keypoints(CAMERA, keypoints, confidences, fps=10, poses=poses)
    keypoints[:, 0] += 300
    confidences[:, 0] = 0.0
    after = lift_keypoints(CAMERA, keypoints, confidences, fps=10, poses=poses)
    confidences[:, 0] = 0.9
    misled = lift_keypoints(CAMERA, keypoints, confidences, fps=10, poses=poses)
    off = [np.abs(other.poses[:, 5] - before.poses[:, 5]).max() for other in (after, misled)]
    assert off[0] < 0.5
    assert np.abs(misled.poses - before.poses).max() > np.abs(after.poses - before.poses).max()


def test_too_few_joints_give_no_pose(poses: Array) -> None:
    joints = performed(names("walk")[0], 0.5, (0, 4))
    keypoints = CAMERA.project(joints)
    confidences = np.full(keypoints.shape[:2], 0.9)
    confidences[3, 5:] = 0
    keypoints[3, 5:] = np.nan
    lifted = lift_keypoints(CAMERA, keypoints, confidences, fps=10, poses=poses)
    assert np.isnan(lifted.poses[3]).all()
    assert np.isnan(lifted.spread[3])
    assert np.isfinite(np.delete(lifted.poses, 3, 0)).all()


def test_half_a_body_is_more_ambiguous_than_a_whole_one(poses: Array) -> None:
    joints = performed(names("sit")[0], 0.3, (0, 4))
    keypoints = CAMERA.project(joints)
    confidences = np.full(keypoints.shape[:2], 0.9)
    whole = lift_keypoints(CAMERA, keypoints, confidences, fps=10, poses=poses)
    confidences[:, :6] = 0  # a table hides the legs
    half = lift_keypoints(CAMERA, keypoints, confidences, fps=10, poses=poses)
    assert half.spread.mean() > whole.spread.mean()


def test_a_track_with_poses_is_left_alone() -> None:
    joints = performed(names("walk")[0], 0.0, (0, 4))
    keypoints = CAMERA.project(joints)
    own = np.full((len(joints), N_JOINTS, 3), np.nan)
    flat = Track(
        "flat", keypoints, np.full(keypoints.shape[:2], 0.9), own, np.zeros(len(own), bool)
    )
    own = CAMERA.to_camera(joints)
    posed = replace(flat, name="posed", poses=own - own[:, PELV, None])
    clip = Clip("both", CAMERA, 10, np.arange(len(own)), (flat, posed))
    lifted = lift_clip(clip)
    assert lifted.tracks[1] is posed
    assert lifted.tracks[0].has_pose.all()


def test_views_look_straight_at_the_person() -> None:
    joints = performed(names("walk")[0], 0.0, (1.5, 4))
    keypoints = CAMERA.project(joints)
    views = views_of(CAMERA, keypoints, np.full(keypoints.shape[:2], 0.9))
    assert np.abs(views.tangents.mean(1)).max() < 0.02
    np.testing.assert_allclose(
        views.axes @ views.axes.transpose(0, 2, 1),
        np.broadcast_to(np.eye(3), views.axes.shape),
        atol=1e-12,
    )
    # Upright stays upright: up in the world is z of the view.
    up = CAMERA.rotation.T @ [0, 0, 1]
    np.testing.assert_allclose(views.axes[:, :, 2], np.broadcast_to(up, (len(joints), 3)))


def test_poses_keep_their_distance_and_have_mirror_images(poses: Array) -> None:
    half = len(poses) // 2
    flat = poses[:half].reshape(half, -1)
    squared = ((flat[:, None] - flat[None]) ** 2).sum(-1) / N_JOINTS
    assert np.sqrt(squared[~np.eye(half, dtype=bool)].min()) > 0.05
    np.testing.assert_allclose(poses[:half, RHIP, 0], -poses[half:, LHIP, 0])


@pytest.mark.slow
@pytest.mark.corpus
def test_nearly_as_good_as_a_lifter_on_the_benchmark() -> None:
    folder = CORPUS / "Scene13"
    if not folder.is_dir():
        pytest.skip(f"the i3DB scenes are not at {CORPUS}")
    clip = read_i3db(folder)
    truth = read_i3db_truth(folder, clip)
    true = truth.camera.to_camera(truth.joints)
    track = clip.tracks[0]
    own = replace(track, poses=np.full_like(track.poses, np.nan))
    lifted = lift_clip(replace(clip, tracks=(own,))).tracks[0]

    def error(poses: Array) -> float:
        middle = [p - (p[:, RHIP, None] + p[:, LHIP, None]) / 2 for p in (poses, true)]
        squared = ((middle[0] - middle[1])[:, list(SCORED)] ** 2).sum(-1)
        return float(np.sqrt(np.nanmean(squared)))

    # 16.4 and 13.1 cm when this was written.
    assert error(lifted.poses) < 1.4 * error(track.poses)
