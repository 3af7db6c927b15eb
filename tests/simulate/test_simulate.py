"""Simulated clips: what they claim as truth is true, and the data belong to it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import combinations

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from shapely import Polygon

from imapper_prob.models.detector import DetectionModel
from imapper_prob.models.errors import InputError
from imapper_prob.models.geometry import pack_boxes, sight_clearance
from imapper_prob.models.problem import resample
from imapper_prob.models.scene import Clip
from imapper_prob.models.scenelet import Library
from imapper_prob.models.skeleton import BONE_LENGTHS, BONES, HEAD, LANK, NECK, PELV, RANK, RHIP
from imapper_prob.scenelets.library import built_in_library
from imapper_prob.simulate import clips
from imapper_prob.simulate.clips import (
    LIFT_SCALE,
    NOMINAL_CAMERA,
    draw_camera,
    simulate_clip,
    simulate_track,
)
from imapper_prob.simulate.scene import Gait

DETECTOR = DetectionModel()


@cache
def clip(seed: int) -> Clip:
    return simulate_clip(np.random.default_rng(seed), built_in_library())


def truths(clip: Clip) -> tuple[np.ndarray, np.ndarray]:
    """Joints and hidden flags of a clip."""
    assert clip.truth is not None
    return clip.truth.joints, clip.truth.hidden


any_clip = st.integers(0, 2**32 - 1).map(clip)
some = settings(max_examples=8)


def test_the_same_seed_gives_the_same_clip() -> None:
    one, other = (simulate_clip(np.random.default_rng(3), built_in_library()) for _ in range(2))
    np.testing.assert_array_equal(one.tracks[0].keypoints, other.tracks[0].keypoints)
    np.testing.assert_array_equal(one.tracks[0].poses, other.tracks[0].poses)
    np.testing.assert_array_equal(truths(one)[0], truths(other)[0])
    assert not np.array_equal(truths(one)[0], truths(clip(4))[0])


@some
@given(any_clip)
def test_a_clip_has_what_was_asked_for(clip: Clip) -> None:
    assert clip.n_frames == 150
    assert clip.camera == NOMINAL_CAMERA
    assert clip.truth is not None
    assert clip.truth.camera != NOMINAL_CAMERA
    assert 2 <= len(clip.truth.objects) <= 5
    assert len(clip.truth.actions) == clip.n_frames
    doing = np.array([action != "walking" for action in clip.truth.actions])
    # Two stays, each of two seconds or more.
    edges = np.flatnonzero(np.diff(np.concatenate([[0], doing, [0]])))
    lengths = edges[1::2] - edges[::2]
    assert len(lengths) == 2
    assert lengths.min() >= 20


@some
@given(any_clip)
def test_the_person_walks_on_the_floor_without_jumps(clip: Clip) -> None:
    joints, _ = truths(clip)
    step = np.linalg.norm(np.diff(joints, axis=0), axis=-1)
    # Somebody walks at 2 m/s and drops half a metre onto a bed, at its end by 3.1 m/s.
    assert step[:, PELV].max() < 0.37
    # A swinging foot or a hand at 5 m/s, a body 15 % larger, and some noise.
    assert step.max() < 0.7
    ankles = joints[:, [RANK, LANK], 2]
    assert ankles.min() > 0.06
    assert clip.truth is not None
    # Both feet leave the floor for a seat or a bed only, and for two seconds beside it.
    resting = np.isin(clip.truth.actions, ("sitting", "lying"))
    near = np.convolve(resting, np.ones(41), "same") > 0
    assert (ankles.min(1)[~near] < 0.15).all()
    assert joints[..., 1].min() > 0.5


@some
@given(any_clip)
def test_the_body_has_one_scale(clip: Clip) -> None:
    joints, _ = truths(clip)
    # Over a clip the tracker's noise of two motions averages out: 2.3 % in the worst of 300 clips.
    scale = [
        np.linalg.norm(joints[:, a] - joints[:, b], axis=-1).mean() / length
        for (a, b), length in BONE_LENGTHS.items()
        if (a, b) in BONES or (b, a) in BONES
    ]
    # Shins, thighs, upper arms, forearms and the trunk; the others span two bones.
    assert len(scale) == 9
    np.testing.assert_allclose(scale, np.mean(scale), rtol=0.03)
    assert 0.8 < np.mean(scale) < 1.25


def test_furniture_has_the_scale_of_the_body(rng: np.random.Generator) -> None:
    library = built_in_library()
    name = "sit-couch-table-003"
    made = simulate_clip(rng, library, script=[name], n_bystanders=0)
    assert made.truth is not None
    joints, _ = truths(made)
    own = next(s for s in library if s.name == name)
    ratios = [
        np.ptp(true.bounds, axis=0) / np.ptp(piece.bounds, axis=0)
        for true, piece in zip(made.truth.objects, own.objects, strict=True)
    ]
    np.testing.assert_allclose(ratios, ratios[0][0])
    bones = [
        np.linalg.norm(joints[:, a] - joints[:, b], axis=-1).mean() / length
        for (a, b), length in BONE_LENGTHS.items()
    ]
    assert np.median(bones) == pytest.approx(ratios[0][0], rel=0.02)


@some
@given(any_clip)
def test_in_a_stay_the_motion_is_a_scenelets(clip: Clip) -> None:
    joints, _ = truths(clip)
    assert clip.truth is not None
    start = next(t for t, action in enumerate(clip.truth.actions) if action != "walking")

    # Distances between joints do not depend on placement; the shin gives the scale.
    def shape(pose: np.ndarray) -> np.ndarray:
        return np.linalg.norm(pose[:, None] - pose[None], axis=-1) / np.linalg.norm(
            pose[0] - pose[1]
        )

    found = min(np.abs(shape(joints[start]) - shape(s.joints[0])).max() for s in built_in_library())
    assert found < 1e-9


@some
@given(any_clip)
def test_furniture_stands_apart(clip: Clip) -> None:
    assert clip.truth is not None
    footprints = [Polygon(o.footprint) for o in clip.truth.objects]
    for one, other in combinations(footprints, 2):
        # A chair may stand under its own table.
        assert one.intersection(other).area < 0.25 * min(one.area, other.area)


@some
@given(any_clip)
def test_hidden_is_what_furniture_hides(clip: Clip) -> None:
    joints, hidden = truths(clip)
    assert clip.truth is not None
    boxes = pack_boxes(clip.truth.objects)
    clearance = sight_clearance(clip.truth.camera.centre, joints, boxes)
    assert not hidden[clearance > 0].any()
    assert hidden[clearance < -0.03].all()


@some
@given(any_clip)
def test_what_is_not_detected_is_marked_so(clip: Clip) -> None:
    (track,) = clip.tracks
    missing = np.isnan(track.keypoints).any(-1)
    assert (track.confidences[missing] == 0).all()
    assert (track.confidences[:, [PELV, NECK]] == 0).all()
    lost = (track.confidences == 0).all(1)
    np.testing.assert_array_equal(track.has_pose, ~lost)
    np.testing.assert_allclose(track.poses[~lost, PELV], 0.0, atol=1e-12)
    hips = (track.keypoints[:, RHIP] + track.keypoints[:, RHIP + 1]) / 2
    np.testing.assert_array_equal(track.keypoints[:, PELV], hips)


def test_detections_scatter_about_the_truth_as_the_tables_say() -> None:
    errors = []
    for seed in range(20):
        joints, hidden = truths(clip(seed))
        truth, (track,) = clip(seed).truth, clip(seed).tracks
        assert truth is not None
        sure = (track.confidences > 0.5) & ~hidden
        errors.append((track.keypoints - truth.camera.project(joints))[sure])
    error = np.linalg.norm(np.concatenate(errors), axis=-1)
    scale, dof = DETECTOR.error_scale[1, 2], DETECTOR.error_dof[1, 2]
    # The squared error over twice the squared scale is F(2, dof); this is its median.
    median = scale * np.sqrt(dof * (2 ** (2 / dof) - 1))
    # Standard error of a median: 1 / (2 f(m) sqrt(n)), f(m) about 1 / (2.2 m) here.
    assert np.median(error) == pytest.approx(median, rel=5 * 1.1 / np.sqrt(len(error)))


def test_hidden_joints_have_the_confidence_of_hidden_joints() -> None:
    low = {True: [], False: []}  # type: dict[bool, list[float]]
    for seed in range(20):
        _, hidden = truths(clip(seed))
        (track,) = clip(seed).tracks
        detected = track.confidences > 0
        for flag in (True, False):
            low[flag] += list(track.confidences[detected & (hidden == flag)] < 0.02)
    for flag, row in ((True, 0), (False, 1)):
        p, n = DETECTOR.confidence[row, 0], len(low[flag])
        assert np.mean(low[flag]) == pytest.approx(p, abs=5 * np.sqrt(p * (1 - p) / n))


def test_a_few_frames_are_lost_in_runs() -> None:
    lost = np.array([~clip(seed).tracks[0].has_pose for seed in range(20)])
    assert 0.005 < lost.mean() < 0.10
    # A lost frame is far more often followed by another than an arbitrary one is.
    assert lost[:, 1:][lost[:, :-1]].mean() > 5 * lost.mean()


def test_lifted_poses_are_six_per_cent_small_and_right_way_up() -> None:
    scales, errors = [], []
    for seed in range(20):
        joints, hidden = truths(clip(seed))
        truth, (track,) = clip(seed).truth, clip(seed).tracks
        assert truth is not None
        true = truth.camera.to_camera(joints)
        true = true - true[:, [PELV]]
        use = track.has_pose
        x, y = true[use], track.poses[use]
        scales.append((x * y).sum() / (x * x).sum())
        errors.append(np.abs(y - LIFT_SCALE * x)[~hidden[use]].mean())
    # Scale: 3 % a clip; the noise of 4 cm averages out within a clip.
    assert np.mean(scales) == pytest.approx(LIFT_SCALE, abs=4 * 0.035 / np.sqrt(20))
    # Joint and pelvis both err by 4 cm an axis: mean |N| is 0.8 sigma.
    assert np.mean(errors) == pytest.approx(0.8 * 0.04 * np.sqrt(2), rel=0.25)


def test_poses_are_lifted_into_camera_axes(rng: np.random.Generator) -> None:
    joints, _ = truths(clip(0))
    hidden = np.zeros(joints.shape[:2], bool)
    steep = NOMINAL_CAMERA.posed(pitch=-0.3, roll=0.1, elevation=2.5)
    tracks = [simulate_track(rng, joints, hidden, camera=steep, fps=10.0) for _ in range(20)]
    lifted = np.nanmean([track.poses[:, HEAD] for track in tracks], axis=(0, 1))
    upright = (joints[:, HEAD] - joints[:, PELV]).mean(0)
    # Errors of 6 cm (joint and pelvis) forget themselves in ten frames; the scale is 3 % off
    # a track.
    tolerance = 5 * (0.06 / np.sqrt(20 * len(joints) / 20) + 0.03 * 0.7 / np.sqrt(20))
    np.testing.assert_allclose(
        lifted, LIFT_SCALE * upright @ steep.rotation, atol=tolerance, rtol=0
    )
    assert tolerance < 0.5 * abs(lifted[1])


def test_hidden_joints_are_lifted_worse(rng: np.random.Generator) -> None:
    joints, _ = truths(clip(0))
    hidden = np.zeros(joints.shape[:2], bool)
    hidden[:, RANK] = True
    camera = draw_camera(rng)
    poses = np.array(
        [simulate_track(rng, joints, hidden, camera=camera, fps=10.0).poses for _ in range(30)]
    )
    spread = np.nanstd(poses, axis=0).mean((0, 2))
    assert spread[RANK] > 1.8 * spread[LANK]


def test_the_drawn_camera_has_the_spread_of_its_prior(rng: np.random.Generator) -> None:
    cameras = [draw_camera(rng) for _ in range(2000)]
    pitch = np.degrees([c.pitch for c in cameras])
    assert pitch.mean() == pytest.approx(-4.0, abs=5 * 3 / np.sqrt(2000))
    assert pitch.std() == pytest.approx(3.0, rel=5 / np.sqrt(2 * 2000))
    roll = np.degrees([c.roll for c in cameras])
    assert roll.mean() == pytest.approx(0.0, abs=5 * 1.35 / np.sqrt(2000))
    assert roll.std() == pytest.approx(1.35, rel=5 / np.sqrt(2 * 2000))
    log_focal = np.log([c.fx / NOMINAL_CAMERA.fx for c in cameras])
    assert log_focal.std() == pytest.approx(0.05, rel=5 / np.sqrt(2 * 2000))


def test_a_given_camera_is_the_true_one(rng: np.random.Generator) -> None:
    camera = NOMINAL_CAMERA.posed(pitch=-0.12, roll=0.02, elevation=1.6)
    made = simulate_clip(rng, built_in_library(), camera=camera, n_interactions=1, n_frames=90)
    assert made.truth is not None
    assert made.truth.camera == camera
    assert made.camera == NOMINAL_CAMERA


@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 3), others=st.integers(0, 4))
def test_any_number_of_interactions_and_objects(seed: int, n: int, others: int) -> None:
    made = simulate_clip(
        np.random.default_rng(seed), built_in_library(), n_frames=40 + 75 * n,
        n_interactions=n, n_bystanders=others,
    )  # fmt: skip
    assert made.truth is not None
    assert n <= len(made.truth.objects) <= 2 * n + others
    doing = np.array([action != "walking" for action in made.truth.actions])
    assert np.diff(np.concatenate([[0], doing, [0]]).astype(int)).clip(0).sum() == n


def test_a_library_without_walks_borrows_them() -> None:
    whole = built_in_library()
    seats = Library("seats", tuple(s for s in whole if s.name.startswith("sit-chair")))
    made = simulate_clip(
        np.random.default_rng(0), seats, walks=whole, n_interactions=1, n_frames=90
    )
    assert made.truth is not None
    assert {"walking", "sitting"} == set(made.truth.actions)


def test_scenelets_of_other_frame_rates_are_resampled() -> None:
    whole = built_in_library()
    fast = [
        replace(s, joints=resample(s.joints, fps=10.0, to_fps=25.0), fps=25.0)
        for s in whole
        if s.name.startswith("sit-chair")
    ]
    seats = Library("fast", (*fast, *(s for s in whole if s.action == "walk")))
    made = simulate_clip(np.random.default_rng(0), seats, n_interactions=1, n_frames=230)
    assert made.fps == 25.0
    assert made.truth is not None
    step = np.linalg.norm(np.diff(made.truth.joints[:, PELV], axis=0), axis=-1)
    assert step.max() < 0.1


def test_a_script_is_performed_in_order(rng: np.random.Generator) -> None:
    made = simulate_clip(
        rng, built_in_library(), script=("reach-shelf-004", "sit-couch-002"), n_bystanders=0
    )
    assert made.truth is not None
    assert [o.label for o in made.truth.objects] == ["shelf", "couch"]
    actions = list(dict.fromkeys(a for a in made.truth.actions if a != "walking"))
    assert actions == ["reaching", "sitting"]


def test_a_bystander_hides_somebody() -> None:
    counts = []
    for seed in range(6):
        for n in (0, 2):
            made = simulate_clip(
                np.random.default_rng(seed), built_in_library(), n_bystanders=n, n_interactions=1
            )
            counts.append(truths(made)[1].mean())
    alone, crowded = counts[::2], counts[1::2]
    assert np.mean(crowded) > np.mean(alone)


def test_the_gait_closes() -> None:
    gait = Gait.of(built_in_library())
    assert 0.8 <= gait.stride <= 1.9
    along = np.linspace(0, 3 * gait.stride, 100)
    np.testing.assert_allclose(gait.at(along), gait.at(along + gait.stride), atol=1e-9)
    step = np.linalg.norm(np.diff(gait.at(along), axis=0), axis=-1)
    assert step.max() < 0.15


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"script": ("sit-cloud-000",)}, "no scenelet sit-cloud-000"),
        ({"script": ("walk-000",)}, "no scenelet walk-000 that stays put"),
        ({"n_interactions": 0}, "ask for one or more"),
        ({"n_frames": 30}, "more frames or fewer interactions"),
    ],
)
def test_what_cannot_be_simulated_is_said(
    options: dict[str, object], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(clips, "_ROOMS", 10)
    with pytest.raises(InputError, match=message):
        simulate_clip(np.random.default_rng(0), built_in_library(), **options)  # type: ignore[arg-type]


def test_a_library_without_walks_is_named() -> None:
    seats = Library("seats", tuple(s for s in built_in_library() if s.action == "sit"))
    with pytest.raises(InputError, match="library seats: no walking scenelet"):
        simulate_clip(np.random.default_rng(0), seats)


def test_a_library_without_furniture_is_named() -> None:
    walks = Library("walks", tuple(s for s in built_in_library() if s.action == "walk"))
    with pytest.raises(InputError, match="library walks: no scenelet stays with an object"):
        simulate_clip(np.random.default_rng(0), walks)
