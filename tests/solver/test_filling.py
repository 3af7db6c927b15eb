"""Poses that are missing or impossible, and what is put in their place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from imapper_prob.api import demo_clip
from imapper_prob.models import skeleton as sk
from imapper_prob.models.scene import Clip
from imapper_prob.solver.poses import (
    TREE,
    PoseSource,
    bones_of,
    fill_directions,
    fill_poses,
    implausible_poses,
    joints_of,
    torso_axes,
)
from imapper_prob.solver.static_path import examine_frames
from tests.solver.walkers import Walk, walk, with_track

HIDDEN = slice(50, 62)
"""Frames in which something hides the legs and confuses the lifter."""


def angles(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.degrees(np.arccos(np.clip((one * other).sum(-1), -1, 1)))


def crouching() -> np.ndarray:
    """(14, 3) directions of a body whose limbs all stand off at an angle."""
    right, up, ahead = np.eye(3)[0], np.eye(3)[2], np.eye(3)[1]
    off = {sk.RHIP: right, sk.LHIP: -right, sk.THRX: up, sk.HEAD: up + 0.3 * ahead,
           sk.RSHO: right, sk.LSHO: -right}  # fmt: skip
    directions = [off.get(child, ahead + (0.8 if child % 2 else -0.7) * up) for _, child in TREE]
    return np.array([d / np.linalg.norm(d) for d in directions])


def test_a_body_that_turns_round_out_of_sight_turns_as_a_whole() -> None:
    """Known at both ends of 170 degrees: the limbs keep their places on the body between."""
    n = 20
    turns = Rotation.from_euler("z", np.linspace(0.0, 170.0, n)[:, None], degrees=True).as_matrix()
    true = crouching() @ turns.transpose(0, 2, 1)
    known = np.zeros(n, bool)
    known[[0, -1]] = True
    np.testing.assert_allclose(fill_poses(true, known), true, atol=1e-9)
    # Bone by bone, what is raised would go over the head.
    assert angles(fill_directions(true, known), true).max() > 40


@given(seed=st.integers(0, 2**32 - 1), n_frames=st.integers(1, 20))
def test_filling_keeps_what_is_known_and_the_lengths(seed: int, n_frames: int) -> None:
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(n_frames, 14, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    known = rng.random(n_frames) < 0.3
    known[rng.integers(n_frames)] = True
    filled = fill_poses(directions, known)
    np.testing.assert_array_equal(filled[known], directions[known])
    np.testing.assert_allclose(np.linalg.norm(filled, axis=-1), 1)
    first, last = np.flatnonzero(known)[[0, -1]]
    np.testing.assert_allclose(filled[: first + 1], filled[[first]].repeat(first + 1, 0), atol=1e-9)
    rest = n_frames - last
    np.testing.assert_allclose(filled[last:], filled[[last]].repeat(rest, 0), atol=1e-9)


@given(seed=st.integers(0, 2**32 - 1))
def test_filling_does_not_depend_on_the_axes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(6, 14, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    known = np.array([True, False, False, True, False, True])
    turn = Rotation.random(rng=rng).as_matrix()
    one = fill_poses(directions, known) @ turn.T
    np.testing.assert_allclose(fill_poses(directions @ turn.T, known), one, atol=1e-7)
    axes = torso_axes(directions)
    np.testing.assert_allclose(np.linalg.det(axes), 1)


def missing(poses: np.ndarray) -> np.ndarray:
    return np.full_like(poses, np.nan)


def collapsed(poses: np.ndarray) -> np.ndarray:
    """Legs of a few centimetres, as if all of them were at the hips; the arms twice as long."""
    bones = bones_of(poses)
    shrunk = [
        k for k, (_, child) in enumerate(TREE) if child in (sk.RKNE, sk.RANK, sk.LKNE, sk.LANK)
    ]
    longer = [
        k for k, (_, child) in enumerate(TREE) if child in (sk.RELB, sk.LELB, sk.RWRI, sk.LWRI)
    ]
    bones[:, shrunk] *= 0.1
    bones[:, longer] *= 2.0
    return joints_of(bones)


def upside_down(poses: np.ndarray) -> np.ndarray:
    return poses * (1.0, 1.0, -1.0)


def broken_knee(poses: np.ndarray) -> np.ndarray:
    """The right shin points where the person faces."""
    bones = bones_of(poses)
    directions = bones / np.linalg.norm(bones, axis=-1, keepdims=True)
    shin = TREE.index((sk.RKNE, sk.RANK))
    bones[:, shin] = 0.4 * torso_axes(directions)[..., 1]
    return joints_of(bones)


def hidden_legs(truth: Walk, spoil: object) -> Clip:
    """Nothing detected below the hips for a while, and a lifter that then fails in its way."""
    track = truth.clip.tracks[0]
    confidences, poses = track.confidences.copy(), track.poses.copy()
    confidences[HIDDEN, [[sk.RKNE], [sk.RANK], [sk.LKNE], [sk.LANK]]] = 0.0
    # Too few are left to contradict a pose.
    confidences[HIDDEN] = np.minimum(confidences[HIDDEN], 0.4)
    poses[HIDDEN] = spoil(poses[HIDDEN])  # type: ignore[operator]
    return with_track(truth.clip, confidences=confidences, poses=poses)


@pytest.mark.parametrize("spoil", [collapsed, upside_down, broken_knee])
def test_an_implausible_pose_is_as_good_as_none(spoil: object) -> None:
    """Both ways in which lifters fail behind furniture end in the same path, and a good one."""
    truth = walk(np.random.default_rng(5))
    path, frames = examine_frames(hidden_legs(truth, spoil))
    without, none = examine_frames(hidden_legs(truth, missing))
    assert set(frames.pose[HIDDEN]) == {PoseSource.IMPLAUSIBLE}
    assert set(none.pose[HIDDEN]) == {PoseSource.MISSING}
    assert frames.counts()["its own"] == none.counts()["its own"] == 120 - 12
    np.testing.assert_array_equal(path.poses, without.poses)
    np.testing.assert_array_equal(path.estimate, without.estimate)
    offsets = truth.joints - truth.pelvis[:, None]
    error = np.sqrt(((path.poses - offsets)[HIDDEN] ** 2).sum(-1).mean())
    # Twelve frames are two swings of the legs; .2 m is what standing still would miss by.
    assert error < 0.2
    assert np.abs(path.estimate - truth.place)[HIDDEN].max() < 0.15


def test_a_lifter_that_is_always_odd_is_taken_at_its_word() -> None:
    clip = walk(np.random.default_rng(6)).clip
    odd = with_track(clip, poses=broken_knee(clip.tracks[0].poses))
    assert not implausible_poses(odd.tracks[0], odd.camera).any()


def test_what_people_do_is_plausible() -> None:
    clip, demo = walk(np.random.default_rng(7)).clip, demo_clip()
    assert not implausible_poses(clip.tracks[0], clip.camera).any()
    assert implausible_poses(demo.tracks[0], demo.camera).mean() < 0.02
    nothing = replace(clip.tracks[0], poses=np.full_like(clip.tracks[0].poses, np.nan))
    assert not implausible_poses(nothing, clip.camera).any()


@pytest.mark.parametrize("pitch", [0.0, -0.3, -0.8])
@pytest.mark.parametrize("roll", [0.0, 0.6])
def test_somebody_who_lies_is_not_upside_down_for_a_tilted_camera(
    pitch: float, roll: float
) -> None:
    truth = walk(np.random.default_rng(7))
    camera = replace(truth.clip.camera, pitch=pitch, roll=roll)
    offsets = truth.joints - truth.pelvis[:, None]
    x, y, z = np.moveaxis(offsets, -1, 0)
    # With the head towards the camera, or to one side.
    for lying in ((x, -z, y), (z, y, -x), (-z, y, x)):
        world = offsets.copy()
        world[-30:] = np.stack(lying, -1)[-30:]
        track = replace(truth.clip.tracks[0], poses=world @ camera.rotation)
        assert not implausible_poses(track, camera).any()
    world[-30:] = np.stack((x, -y, -z), -1)[-30:]
    track = replace(truth.clip.tracks[0], poses=world @ camera.rotation)
    assert implausible_poses(track, camera)[-30:].all()
