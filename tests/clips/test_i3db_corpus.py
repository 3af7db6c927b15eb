"""The four scenes of the benchmark, as they lie on disk."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from imapper_prob.clips.i3db import read_i3db_truth
from imapper_prob.clips.load import load_clip
from imapper_prob.clips.parsing import frames_of_joints, load_json
from imapper_prob.models.skeleton import DETECTED, SCORED

pytestmark = pytest.mark.corpus

N_FRAMES = {"Scene04": 115, "Scene10": 225, "Scene13": 540, "Scene14": 431}
N_LOST = {"Scene04": 0, "Scene10": 17, "Scene13": 0, "Scene14": 0}
N_POSES = {"Scene04": 103, "Scene10": 224, "Scene13": 539, "Scene14": 430}
N_FILLED_IN = {"Scene04": 12, "Scene10": 79, "Scene13": 27, "Scene14": 47}
LABELS = {
    "Scene04": ["couch", "table"],
    "Scene10": ["couch"] * 3 + ["table"],
    "Scene13": ["chair"] * 4 + ["couch"] + ["shelf"] * 4 + ["stool"],
    "Scene14": ["chair"] * 3 + ["couch", "table"],
}
SURE = 0.8
"""Confidence from which a detection is compared with a projection."""


def test_frames(i3db_scene: Path) -> None:
    clip = load_clip(i3db_scene)
    track = clip.tracks[0]
    name = clip.name
    assert clip.n_frames == N_FRAMES[name]
    assert clip.frame_ids[0] == 1
    lost = np.isnan(track.keypoints).all((1, 2))
    assert lost.sum() == N_LOST[name]
    assert np.isfinite(track.keypoints[~lost]).all()
    assert track.has_pose.sum() == N_POSES[name]
    assert track.interpolated.sum() == N_FILLED_IN[name]


def test_confidences_are_on_one_scale(i3db_scene: Path) -> None:
    # Two of the files hold heat values of at most 0.003; mapped or not, most joints of a
    # scene are seen and a detector says so.
    confidences = load_clip(i3db_scene).tracks[0].confidences
    assert confidences.min() >= 0
    assert confidences.max() <= 1
    assert 0.6 < np.median(confidences[:, DETECTED]) < 0.95


def test_lifted_joints_project_onto_the_detections(i3db_scene: Path) -> None:
    """Axes, image scale and frame numbers at once: a shift by one frame is clearly worse."""
    clip = load_clip(i3db_scene)
    track = clip.tracks[0]
    path = next(i3db_scene.glob("skel_*_unannot.json"))
    lifted = np.full((clip.n_frames, 16, 3), np.nan)
    for frame, joints in frames_of_joints(path, load_json(path)).items():
        x, down, forward = joints.T
        lifted[frame - 1] = np.stack([x, forward, -down], -1)
    error = np.linalg.norm(clip.camera.project_camera(lifted) - track.keypoints, axis=-1)
    seen = (track.confidences > SURE) & track.has_pose[:, None]
    assert np.median(error[seen]) < 20
    for shift in (-1, 1):
        moved = np.linalg.norm(
            clip.camera.project_camera(lifted[1:-1])
            - np.roll(track.keypoints, shift, axis=0)[1:-1],
            axis=-1,
        )
        both = seen[1:-1] & np.isfinite(moved)
        assert np.median(moved[both]) > 1.2 * np.median(error[1:-1][both])


def test_truth_projects_onto_its_own_2d_annotation_and_the_detections(i3db_scene: Path) -> None:
    clip = load_clip(i3db_scene)
    truth = read_i3db_truth(i3db_scene, clip)
    annotated = clip.frame_ids % 2 == 0
    assert np.isfinite(truth.joints[annotated]).all()
    pixels = truth.camera.project(truth.joints)[annotated][:, SCORED]

    path = i3db_scene / "gt" / "skel_GT_2d.json"
    table = frames_of_joints(path, load_json(path))
    marked = np.stack([table[f][:, :2] for f in clip.frame_ids[annotated]])[:, SCORED]
    # GT is good to about 0.03 m across the ray, 15 px at 4 m.
    assert np.median(np.linalg.norm(pixels - marked, axis=-1)) < 20

    track = clip.tracks[0]
    error = np.linalg.norm(pixels - track.keypoints[annotated][:, SCORED], axis=-1)
    seen = track.confidences[annotated][:, SCORED] > SURE
    assert np.median(error[seen]) < 30


def test_true_furniture_stands_on_the_floor(i3db_scene: Path) -> None:
    clip = load_clip(i3db_scene)
    truth = read_i3db_truth(i3db_scene, clip)
    assert sorted(o.label for o in truth.objects) == LABELS[clip.name]
    bottoms = np.array([o.bounds[0, 2] for o in truth.objects])
    assert np.median(bottoms) == pytest.approx(0, abs=1e-9)
    # One chair of Scene13 has a leg 0.22 m too long in the annotation.
    assert (np.abs(bottoms) < 0.05).sum() >= len(bottoms) - 1
    assert np.deg2rad(-7) < truth.camera.pitch < 0
    assert abs(truth.camera.roll) < np.deg2rad(3)
    assert 0.9 < truth.camera.elevation < 1.6
    for o in truth.objects:
        assert 0.25 < np.ptp(o.bounds[:, 2]) < 2.3
        assert 2 < o.centre[1] < 8


def test_seats_face_away_from_their_backrests(i3db_scene: Path) -> None:
    truth = read_i3db_truth(i3db_scene, load_clip(i3db_scene))
    for o in truth.objects:
        centres = {c.part: c.centre for c in o.cuboids}
        if {"seat", "back"} <= set(centres):
            behind = centres["back"] - centres["seat"]
            assert behind[1] < -0.1
            assert abs(behind[0]) < 0.15  # couches with one arm are not symmetric
            assert behind[2] > 0.15


def test_actions_and_hidden_joints(i3db_scene: Path) -> None:
    clip = load_clip(i3db_scene)
    truth = read_i3db_truth(i3db_scene, clip)
    assert len(truth.actions) == clip.n_frames
    assert set(truth.actions) <= {"walking", "sitting", "standing", "reaching", ""}
    annotated = clip.frame_ids % 2 == 0
    assert not truth.hidden[~annotated].any()
    assert 0.05 < truth.hidden[annotated].mean() < 0.4
    # People sit lower than they walk: the words belong to these frames.
    pelvis = truth.joints[:, 6, 2]
    words = np.array(truth.actions)
    sitting = np.nanmedian(pelvis[words == "sitting"])
    assert sitting + 0.15 < np.nanmedian(pelvis[words == "walking"])
