from __future__ import annotations

import itertools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imapper_prob.models.errors import InputError
from imapper_prob.models.settings import StaticPathSettings
from imapper_prob.models.skeleton import (
    DETECTED,
    HEAD,
    LSHO,
    MIRROR,
    PELV,
    RSHO,
    RWRI,
    SCORED,
    THRX,
)
from imapper_prob.solver.path_fit import (
    Motion,
    Observations,
    _of_frames,
    _walk_precision,
    evidence,
    place_deviation,
    solve_chain,
)
from imapper_prob.solver.poses import bones_of, fill_directions, joints_of, lifted_body
from imapper_prob.solver.static_path import estimate_static_path
from tests.solver.walkers import LIFTER_SCALE, Walk, bones, walk, with_track

CORPUS = Path(__file__).parents[3] / "shared" / "i3db"
SCENES = ("Scene04", "Scene10", "Scene13", "Scene14")


def one_frame_bound(walk: Walk, pixel_error: float) -> np.ndarray:
    """(2,) Cramér-Rao bound of bearing and log depth from one frame and half of its joints.

    Around the mean, a joint at offset X of a body at depth d is seen at f (b + X / d): the
    bearing averages the errors, and log depth is a slope against the f X / d of both axes.
    With a known pose all 14 joints would count; bones that bend dilute what the limbs say.
    """
    camera = walk.clip.camera
    pixels = camera.project_camera(walk.joints)[:, list(DETECTED)]
    size = ((pixels - pixels.mean(1, keepdims=True)) ** 2).sum((1, 2)).mean()
    return pixel_error * np.array([1 / (camera.fx * np.sqrt(7)), 1 / np.sqrt(size / 2)])


def root_mean_square(errors: np.ndarray) -> np.ndarray:
    return np.sqrt((errors**2).mean(0))


def test_recovers_path_and_pose_better_than_single_frames() -> None:
    truth = walk(np.random.default_rng(0))
    path = estimate_static_path(truth.clip)
    assert np.all(root_mean_square(path.estimate - truth.place) < one_frame_bound(truth, 15.0))
    assert path.posed.all()
    # No worse than a detection put at the depth of the pelvis.
    offsets = truth.joints - truth.pelvis[:, None]
    one_joint = 15.0 / truth.clip.camera.fx * np.mean(truth.pelvis[:, 1])
    assert root_mean_square((path.poses - offsets).ravel()) < 1.1 * one_joint
    assert np.all(path.poses[:, PELV] == 0)


def test_gross_jumps_are_survived() -> None:
    rng = np.random.default_rng(1)
    truth = walk(rng)
    keypoints = truth.clip.tracks[0].keypoints.copy()
    hit = rng.random(keypoints.shape[:2]) < 0.1
    angle = rng.uniform(0, 2 * np.pi, hit.sum())
    keypoints[hit] += 1000 * np.stack([np.cos(angle), np.sin(angle)], -1)
    path = estimate_static_path(with_track(truth.clip, keypoints=keypoints))
    bound = one_frame_bound(truth, 15.0) / np.sqrt(0.9)
    assert np.all(root_mean_square(path.estimate - truth.place) < bound)


def test_whole_person_jumping_for_half_a_second_is_survived() -> None:
    truth = walk(np.random.default_rng(2))
    keypoints = truth.clip.tracks[0].keypoints.copy()
    keypoints[60:65] += (-700.0, 200.0)
    path = estimate_static_path(with_track(truth.clip, keypoints=keypoints))
    assert np.abs(path.estimate - truth.place)[60:65].max() < 0.1


def test_lost_frames_are_bridged_by_the_walk() -> None:
    truth = walk(np.random.default_rng(3))
    track = truth.clip.tracks[0]
    lost = np.zeros(len(track.keypoints), bool)
    lost[50:70] = True
    clip = with_track(
        truth.clip,
        keypoints=np.where(lost[:, None, None], np.nan, track.keypoints),
        confidences=np.where(lost[:, None], 0.0, track.confidences),
        poses=np.where(lost[:, None, None], np.nan, track.poses),
    )
    path = estimate_static_path(clip)
    # In the middle of n lost frames a walk of step s has standard deviation s sqrt(n) / 2.
    reach = 3 * np.array([0.03, 0.02]) * np.sqrt(lost.sum()) / 2
    assert np.all(np.abs(path.estimate - truth.place)[lost] < reach)
    # Errors of the estimate stay as they are; where nobody was seen those of the walk come on top.
    assert np.all(path.deviation[55:65] > 1.1 * path.deviation[~lost].max(0))
    assert np.all(np.diff(path.deviation[49:60], axis=0) > 0)
    assert np.all(np.diff(path.deviation[60:71], axis=0) < 0)
    np.testing.assert_array_equal(path.posed, ~lost)


def test_detections_of_no_confidence_are_not_looked_at() -> None:
    rng = np.random.default_rng(4)
    track = (clip := walk(rng).clip).tracks[0]
    confidences = track.confidences.copy()
    confidences[30:45] = 0.0
    garbage = track.keypoints.copy()
    garbage[30:45] = rng.uniform(-1e4, 1e4, garbage[30:45].shape)
    nothing = track.keypoints.copy()
    nothing[30:45] = np.nan
    paths = [
        estimate_static_path(with_track(clip, keypoints=k, confidences=confidences))
        for k in (garbage, nothing)
    ]
    np.testing.assert_array_equal(paths[0].estimate, paths[1].estimate)
    np.testing.assert_array_equal(paths[0].deviation, paths[1].deviation)


def test_contradicted_poses_are_replaced() -> None:
    truth = walk(np.random.default_rng(5))
    poses = truth.clip.tracks[0].poses.copy()
    poses[40:44] = poses[40:44][..., [2, 1, 0]]  # lying on the side
    path = estimate_static_path(with_track(truth.clip, poses=poses))
    assert not path.posed[40:44].any()
    assert path.posed.sum() == len(poses) - 4
    offsets = truth.joints - truth.pelvis[:, None]
    assert root_mean_square((path.poses - offsets)[40:44].ravel()) < 0.1


def test_poses_the_input_interpolated_are_not_its_own() -> None:
    clip = walk(np.random.default_rng(6)).clip
    interpolated = np.arange(clip.n_frames) % 7 == 0
    path = estimate_static_path(with_track(clip, interpolated=interpolated))
    np.testing.assert_array_equal(path.posed, ~interpolated)


def test_works_without_a_single_lifted_pose() -> None:
    truth = walk(np.random.default_rng(7))
    nothing = np.full_like(truth.clip.tracks[0].poses, np.nan)
    path = estimate_static_path(with_track(truth.clip, poses=nothing))
    assert not path.posed.any()
    # What a body that stands stiffly explains: a swing of .4 rad shortens a leg by 8 %.
    assert np.all(root_mean_square(path.estimate - truth.place) < 0.08)


def test_scale_of_the_lifter_does_not_matter() -> None:
    clip = walk(np.random.default_rng(8)).clip
    larger = with_track(clip, poses=1.5 * clip.tracks[0].poses)
    one, other = estimate_static_path(clip), estimate_static_path(larger)
    np.testing.assert_allclose(one.estimate, other.estimate, atol=1e-9)
    np.testing.assert_allclose(one.poses, other.poses, atol=1e-9)


def test_size_of_the_image_does_not_matter() -> None:
    clip = walk(np.random.default_rng(9)).clip
    camera = clip.camera
    double = replace(
        camera, width=2 * camera.width, height=2 * camera.height,
        fx=2 * camera.fx, fy=2 * camera.fy, cx=2 * camera.cx, cy=2 * camera.cy,
    )  # fmt: skip
    larger = with_track(replace(clip, camera=double), keypoints=2 * clip.tracks[0].keypoints)
    one, other = estimate_static_path(clip), estimate_static_path(larger)
    for name in ("estimate", "deviation", "lift", "poses"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=1e-7)


def test_mirror_image_gives_the_mirrored_path() -> None:
    clip = walk(np.random.default_rng(10)).clip
    track = clip.tracks[0]
    other_side = list(MIRROR)
    keypoints = track.keypoints[:, other_side].copy()
    keypoints[..., 0] = 2 * clip.camera.cx - keypoints[..., 0]
    poses = track.poses[:, other_side] * (-1, 1, 1)
    mirrored = estimate_static_path(with_track(clip, keypoints=keypoints, poses=poses))
    path = estimate_static_path(clip)
    np.testing.assert_allclose(mirrored.estimate, path.estimate * (-1, 1), atol=1e-7)
    np.testing.assert_allclose(mirrored.poses, path.poses[:, other_side] * (-1, 1, 1), atol=1e-7)


def test_same_input_same_output() -> None:
    clip = walk(np.random.default_rng(11)).clip
    one, other = estimate_static_path(clip), estimate_static_path(clip)
    for name in ("estimate", "deviation", "poses"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_every_frame_twice_at_twice_the_rate_is_the_same_clip() -> None:
    clip = walk(np.random.default_rng(12), pixel_error=40.0).clip
    track = clip.tracks[0]
    double = replace(
        clip,
        fps=20.0,
        frame_ids=np.arange(2 * clip.n_frames),
        tracks=(
            replace(
                track,
                keypoints=np.repeat(track.keypoints, 2, axis=0),
                confidences=np.repeat(track.confidences, 2, axis=0),
                poses=np.repeat(track.poses, 2, axis=0),
                interpolated=np.repeat(track.interpolated, 2),
            ),
        ),
    )
    one, other = (estimate_static_path(c).estimate for c in (clip, double))
    apart = root_mean_square(other.reshape(-1, 2, 2).mean(1) - one)
    assert np.all(apart < 0.5 * root_mean_square(np.diff(one, axis=0)))


def test_deviation_covers_the_truth_under_slow_errors() -> None:
    """Errors are those that the fit states; 100 of them that are independent, known to 7 %."""
    still = walk(np.random.default_rng(0), n_frames=300)
    across, along = estimate_static_path(still.clip).deviation.mean(0)
    slow_error = (across * still.pelvis[:, 1].mean(), along)
    z = []
    for seed in range(4):
        truth = walk(np.random.default_rng(seed), n_frames=300, slow_error=slow_error)
        path = estimate_static_path(truth.clip)
        z.append((path.estimate - truth.place) / path.deviation)
    errors = np.concatenate(z)
    assert np.all(root_mean_square(errors) > 0.5)
    assert np.all(root_mean_square(errors) < 1 + 3 * 0.07)
    assert np.all((np.abs(errors) < 1.645).mean(0) > 0.9 - 3 * 0.03)


def test_the_error_is_in_proportion_to_its_factors() -> None:
    clip = walk(np.random.default_rng(3)).clip
    once = estimate_static_path(clip).deviation
    own = StaticPathSettings()
    twice = replace(
        own,
        bias_factor_along=2 * own.bias_factor_along,
        bias_factor_across=3 * own.bias_factor_across,
    )
    more = estimate_static_path(clip, settings=twice).deviation
    # Most of the error is the slow one; bearing comes first.
    ratio = np.median(more / once, axis=0)
    assert 2.0 < ratio[0] <= 3.0 + 1e-9
    assert 1.4 < ratio[1] <= 2.0 + 1e-9


def test_nobody_detected_is_an_error_that_names_clip_and_track() -> None:
    clip = walk(np.random.default_rng(13)).clip
    nobody = with_track(clip, confidences=np.zeros_like(clip.tracks[0].confidences))
    with pytest.raises(InputError, match="clip walk, track walker"):
        estimate_static_path(nobody)


def test_one_frame_is_enough() -> None:
    truth = walk(np.random.default_rng(14), n_frames=1)
    path = estimate_static_path(truth.clip)
    bound = one_frame_bound(truth, 15.0)
    assert np.all(np.abs(path.estimate - truth.place) < 4 * bound)


def test_evidence_is_the_gradient_of_its_likelihood() -> None:
    clip = walk(np.random.default_rng(15), n_frames=2).clip
    track = clip.tracks[0]
    constants = StaticPathSettings(dof=4.0, lifted_across=0.15, lifted_along=0.20)
    observations = Observations(
        clip.camera,
        track.keypoints[:, list(DETECTED)],
        track.confidences[:, list(DETECTED)],
        lifted_body(track, np.ones(2, bool)),
        clip.fps,
    )

    def loss(unknowns: np.ndarray) -> float:
        """Of frame 0, written from the formula in the module's docstring."""
        bearing, lift, log_depth = unknowns[:3]
        vectors = unknowns[3:].reshape(14, 3)
        pelvis = np.exp(log_depth) * np.array([bearing, 1.0, lift])
        pixels = clip.camera.project_camera(pelvis + joints_of(vectors))[list(DETECTED)]
        squared = ((pixels - observations.pixels[0]) ** 2).sum(-1)
        data = (0.9 * 6 / 2 * np.log1p(squared / (4 * 15.0**2))).sum()
        body = observations.body
        deviation = np.array([0.15, 0.20, 0.15]) * body.lengths[:, None]
        return float(data + 0.5 * (((vectors - body.bones[0]) / deviation) ** 2).sum())

    rng = np.random.default_rng(16)
    motion = Motion(
        np.tile([0.1, -0.15, 1.5], (2, 1)),
        observations.body.bones + rng.normal(0, 0.02, (2, 14, 3)),
    )
    information, pull = evidence(observations, motion, constants, pixel_scale=15.0, free_bones=True)
    at = motion.vector(free_bones=True)[0]
    numeric = [(loss(at - step) - loss(at + step)) / 2e-6 for step in 1e-6 * np.eye(len(at))]
    np.testing.assert_allclose(pull[0], numeric, rtol=1e-4, atol=1e-3)
    np.testing.assert_allclose(information, information.transpose(0, 2, 1), rtol=1e-9, atol=1e-9)


def test_the_thorax_is_midway_between_the_shoulders() -> None:
    """Wherever a lifter puts it."""
    truth = walk(np.random.default_rng(17), n_frames=3)
    track, trusted = truth.clip.tracks[0], np.ones(3, bool)
    poses = np.array(track.poses)
    poses[:, THRX] += (0.0, 0.02, 0.08)
    moved = lifted_body(replace(track, poses=poses), trusted)
    np.testing.assert_allclose(moved.bones, lifted_body(track, trusted).bones, atol=1e-9)


def test_the_deviation_is_that_of_the_inverse_hessian() -> None:
    clip = walk(np.random.default_rng(18), n_frames=4).clip
    track, constants = clip.tracks[0], StaticPathSettings()
    confidences = np.array(track.confidences[:, list(DETECTED)])
    confidences[2, 3:] = 0.0
    observations = Observations(
        clip.camera, track.keypoints[:, list(DETECTED)], confidences,
        lifted_body(track, np.ones(4, bool)), clip.fps,
    )  # fmt: skip
    motion = Motion(np.tile([0.1, -0.15, 1.5], (4, 1)), observations.body.bones)
    size = motion.vector(free_bones=True).size
    # The pull of a unit step of each unknown is a column of the Hessian, by solving for it.
    columns = [place_response(observations, motion, constants, k) for k in range(size)]
    covariance = np.array(columns)
    expected = np.sqrt(np.diag(covariance)).reshape(4, -1)[:, [0, 2]]
    np.testing.assert_allclose(
        place_deviation(observations, motion, constants), expected, rtol=1e-6
    )


def place_response(
    observations: Observations, motion: Motion, constants: StaticPathSettings, k: int
) -> np.ndarray:
    """Column ``k`` of the inverse Hessian, from the banded solver of the fit."""
    information, pull = _of_frames(
        observations, motion, constants, pixel_scale=constants.pixel_scale, free_bones=True
    )
    unit = np.zeros(pull.size)
    unit[k] = 1.0
    walk_precision = _walk_precision(constants, observations.fps, free_bones=True)
    return solve_chain(information, unit.reshape(pull.shape), walk_precision).ravel()


@pytest.mark.parametrize("seen", [[HEAD], [RWRI], [HEAD, RSHO, LSHO, THRX]])
def test_a_person_of_whom_little_is_seen_is_less_certain(seen: list[int]) -> None:
    truth = walk(np.random.default_rng(19))
    track = truth.clip.tracks[0]
    confidences = np.array(track.confidences)
    few = np.zeros(len(confidences), bool)
    few[50:70] = True
    confidences[np.ix_(few, [j for j in range(16) if j not in seen])] = 0.0
    poses = np.where(few[:, None, None], np.nan, track.poses)
    path = estimate_static_path(with_track(truth.clip, confidences=confidences, poses=poses))
    assert (path.deviation[55:65] > 1.1 * path.deviation[~few].max(0)).all()


def test_lifted_body_has_the_reference_legs() -> None:
    truth = walk(np.random.default_rng(17))
    body = lifted_body(truth.clip.tracks[0], np.ones(truth.clip.n_frames, bool))
    np.testing.assert_allclose(body.bones, bones(truth.clip.n_frames), atol=1e-9)
    assert LIFTER_SCALE != 1


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_bones_and_joints_are_two_views_of_a_pose(seed: int) -> None:
    vectors = np.random.default_rng(seed).normal(size=(3, 14, 3))
    np.testing.assert_allclose(bones_of(joints_of(vectors)), vectors, atol=1e-12)


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n_frames=st.integers(1, 30))
def test_filled_directions_turn_evenly(seed: int, n_frames: int) -> None:
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(n_frames, 4, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    known = rng.random(n_frames) < 0.3
    known[rng.integers(n_frames)] = True
    filled = fill_directions(directions, known)
    np.testing.assert_allclose(np.linalg.norm(filled, axis=-1), 1)
    np.testing.assert_allclose(filled[known], directions[known], atol=1e-9)
    frames = np.flatnonzero(known)
    ends = np.concatenate(
        [filled[: frames[0]] - filled[frames[0]], filled[frames[-1] :] - filled[frames[-1]]]
    )
    np.testing.assert_allclose(ends, 0, atol=1e-12)
    for left, right in itertools.pairwise(frames):
        turn = np.arccos(
            np.clip((filled[left:right] * filled[left + 1 : right + 1]).sum(-1), -1, 1)
        )
        np.testing.assert_allclose(turn, np.broadcast_to(turn[0], turn.shape), atol=1e-4)


@pytest.mark.corpus
@pytest.mark.skipif(not CORPUS.is_dir(), reason="i3DB scenes are not beside the repository")
def test_beats_the_input_path_of_the_benchmark() -> None:
    """Pelvis in top view and 14 joints, RMSE in cm; inputs have 51 and 54, iMapper 55 and 57."""
    from imapper_prob.clips.i3db import read_i3db

    scores = []
    for scene in SCENES:
        clip = read_i3db(CORPUS / scene)
        path = estimate_static_path(clip)
        (annotation,) = (CORPUS / scene / "gt").glob("skel_*_GT.json")
        truth = json.loads(annotation.read_text(encoding="utf-8"))["3d"]
        row = []
        for frame, joints in truth.items():
            index = int(frame) - int(clip.frame_ids[0])
            if int(frame) % 2 == 0 and 0 <= index < clip.n_frames:
                x, y, z = np.array([joints[str(j)] for j in range(16)]).T
                row.append(path.joints[index] - np.stack([x, z, -y], -1))
        errors = 100 * np.array(row)
        scores.append(
            (
                np.sqrt((errors[:, PELV, :2] ** 2).sum(-1).mean()),
                np.sqrt((errors[:, list(SCORED)] ** 2).sum(-1).mean()),
            )
        )
    pelvis, world = np.mean(scores, axis=0)
    assert pelvis < 36
    assert world < 41
