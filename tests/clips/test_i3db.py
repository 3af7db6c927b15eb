"""Every trap of the benchmark's format, on a scene whose world is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from imapper_prob.clips.i3db import read_i3db, read_i3db_truth
from imapper_prob.models.skeleton import (
    DETECTED,
    HEAD,
    LHIP,
    N_JOINTS,
    NECK,
    PELV,
    RANK,
    RHIP,
    THRX,
)
from tests.clips.i3db_folder import CAMERA, FRAMES, STEM, I3dbFolder, box, true_joints


def test_pixels_are_those_of_the_full_image(tmp_path: Path) -> None:
    track = read_i3db(I3dbFolder().write(tmp_path / "Hall")).tracks[0]
    expected = CAMERA.project(true_joints())
    assert_allclose(track.keypoints[:, DETECTED], expected[:, DETECTED])


def test_name_rate_and_nominal_camera(tmp_path: Path) -> None:
    clip = read_i3db(I3dbFolder().write(tmp_path / "Hall"))
    assert clip.name == "Hall"
    assert clip.tracks[0].name == "hall"
    assert clip.fps == 10
    assert not clip.focal_known
    assert clip.truth is None
    camera = clip.camera
    assert (camera.width, camera.height) == (1920, 1080)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (1900.0, 1950.0, 960.0, 540.0)
    assert camera.pitch == pytest.approx(np.deg2rad(-4))


def test_synthesised_joints_have_no_confidence(tmp_path: Path) -> None:
    track = read_i3db(I3dbFolder().write(tmp_path / "Hall")).tracks[0]
    assert_array_equal(track.confidences[:, [PELV, NECK]], 0)
    assert_allclose(track.keypoints[:, PELV], track.keypoints[:, [RHIP, LHIP]].mean(1))
    assert_allclose(track.keypoints[:, NECK], track.keypoints[:, [THRX, HEAD]].mean(1))
    assert track.confidences[0, RANK] == pytest.approx(0.51)


def test_poses_are_relative_to_the_pelvis_in_camera_axes(tmp_path: Path) -> None:
    track = read_i3db(I3dbFolder().write(tmp_path / "Hall")).tracks[0]
    joints = CAMERA.to_camera(true_joints())
    assert_allclose(track.poses, joints - joints[:, [PELV]], atol=1e-12)


def test_lost_frames_are_empty_and_the_others_stay_in_place(tmp_path: Path) -> None:
    files = I3dbFolder()
    files.drop_detection(5)
    clip = read_i3db(files.write(tmp_path / "Hall"))
    track = clip.tracks[0]
    assert_array_equal(clip.frame_ids, list(FRAMES))
    assert np.isnan(track.keypoints[4]).all()
    assert_array_equal(track.confidences[4], 0)
    expected = CAMERA.project(true_joints())
    assert_allclose(track.keypoints[5:, DETECTED], expected[5:, DETECTED])
    assert track.confidences[5, RANK] == pytest.approx(0.56)


def test_clip_runs_from_first_to_last_detection(tmp_path: Path) -> None:
    files = I3dbFolder()
    for frame in (1, 2, 12):
        files.drop_detection(frame)
    clip = read_i3db(files.write(tmp_path / "Hall"))
    assert_array_equal(clip.frame_ids, range(3, 12))
    joints = CAMERA.to_camera(true_joints())[2:11]
    assert_allclose(clip.tracks[0].poses, joints - joints[:, [PELV]], atol=1e-12)
    assert_array_equal(np.flatnonzero(clip.tracks[0].interpolated), [1, 3])


def test_frames_without_a_lifted_pose(tmp_path: Path) -> None:
    files = I3dbFolder()
    del files.lifted["3d"]["00007"]
    track = read_i3db(files.write(tmp_path / "Hall")).tracks[0]
    assert_array_equal(np.flatnonzero(~track.has_pose), [6])
    assert_array_equal(np.flatnonzero(track.interpolated), [3, 5])


def test_frames_listed_out_of_order_are_sorted_by_number(tmp_path: Path) -> None:
    files = I3dbFolder()
    expected = read_i3db(files.write(tmp_path / "in_order")).tracks[0]
    files.detections["3d"] = dict(reversed(files.detections["3d"].items()))
    files.lifted["3d"] = dict(reversed(files.lifted["3d"].items()))
    confidence = files.detections["confidence"]
    confidence["frame_ids"].reverse()
    confidence["values"].reverse()
    found = read_i3db(files.write(tmp_path / "reversed")).tracks[0]
    assert_array_equal(found.keypoints, expected.keypoints)
    assert_array_equal(found.confidences, expected.confidences)
    assert_array_equal(found.poses, expected.poses)


@pytest.mark.parametrize(
    "numbers", [[0.1 * t for t in range(11)], [1] * 11, list(range(11)), [[3]] * 11, None]
)
def test_confidences_follow_the_joints_where_their_own_numbers_mean_nothing(
    tmp_path: Path, numbers: object
) -> None:
    files = I3dbFolder()
    files.drop_detection(5)
    expected = read_i3db(files.write(tmp_path / "right")).tracks[0]
    files.detections["confidence"]["frame_ids"] = numbers
    found = read_i3db(files.write(tmp_path / "odd")).tracks[0]
    assert_array_equal(found.confidences, expected.confidences)


def test_raw_heat_values_are_recognised_whatever_the_flag_says(tmp_path: Path) -> None:
    files = I3dbFolder()
    for entry in files.detections["confidence"]["values"]:
        entry.update(dict.fromkeys(entry, 0.0019))
    files.detections["confidence"]["values"][0]["0"] = -0.0001
    files.detections["confidence"]["values"][0]["1"] = 0.0
    confidences = read_i3db(files.write(tmp_path / "Hall")).tracks[0].confidences
    assert confidences[0, 0] == 0
    assert confidences[0, 1] == pytest.approx(1 / (1 + np.exp(9.5)))
    assert_allclose(confidences[1:, DETECTED], 0.5)
    assert_array_equal(confidences[:, [PELV, NECK]], 0)


def test_truth_recovers_the_camera_above_the_floor(tmp_path: Path) -> None:
    folder = I3dbFolder().write(tmp_path / "Hall")
    truth = read_i3db_truth(folder, read_i3db(folder))
    for name in ("pitch", "roll", "elevation"):
        assert getattr(truth.camera, name) == pytest.approx(getattr(CAMERA, name)), name


def test_truth_is_annotated_on_even_frames_only(tmp_path: Path) -> None:
    folder = I3dbFolder().write(tmp_path / "Hall")
    truth = read_i3db_truth(folder, read_i3db(folder))
    annotated = np.array([f % 2 == 0 for f in FRAMES])
    assert_allclose(truth.joints[annotated], true_joints()[annotated], atol=1e-9)
    assert np.isnan(truth.joints[~annotated]).all()
    hidden = np.array([[f == j and f % 2 == 0 for j in range(N_JOINTS)] for f in FRAMES])
    assert_array_equal(truth.hidden, hidden)


def test_truth_objects_stand_where_they_were_put(tmp_path: Path) -> None:
    folder = I3dbFolder().write(tmp_path / "Hall")
    couch, table = read_i3db_truth(folder, read_i3db(folder)).objects
    assert (couch.label, table.label) == ("couch", "table")
    assert couch.placement.yaw == pytest.approx(np.deg2rad(30))
    assert np.cos(table.placement.yaw - np.deg2rad(-70)) == pytest.approx(1)

    seat, back = couch.cuboids
    assert (seat.part, back.part) == ("seat", "back")
    assert_allclose(couch.placement.apply(seat.centre), (0.5, 4.5, 0.2), atol=1e-9)
    assert_allclose(seat.size, (2.0, 0.8, 0.4))
    assert_allclose(back.size, (2.0, 0.1, 0.4))
    assert_allclose(back.centre - seat.centre, (0, -0.35, 0.4), atol=1e-9)
    assert_allclose(couch.centre[:2], (couch.placement.x, couch.placement.y), atol=1e-9)

    top, leg = table.cuboids
    assert (top.part, leg.part) == ("top", "leg")
    assert_allclose(table.centre, (-1, 3, 0.375), atol=1e-9)
    assert table.bounds[0, 2] == pytest.approx(0, abs=1e-9)


def test_object_files_that_are_not_listed_are_leftovers(tmp_path: Path) -> None:
    files = I3dbFolder()
    files.objects["09_shelf_bottom"] = box((2, 6, 1), (1, 0.4, 2), 0.0)
    folder = files.write(tmp_path / "Hall")
    assert (folder / "gt" / f"{STEM}_GT_objects" / "09_shelf_bottom.json").exists()
    truth = read_i3db_truth(folder, read_i3db(folder))
    assert [o.label for o in truth.objects] == ["couch", "table"]


def test_actions_count_from_zero_lose_their_remarks_and_may_end_early(tmp_path: Path) -> None:
    files = I3dbFolder(actions="")
    files.actions = "0\twalking\n1\tstanding(from sitting)\n2\tsitting\n\n\n"
    folder = files.write(tmp_path / "Hall")
    actions = read_i3db_truth(folder, read_i3db(folder)).actions
    assert actions[:4] == ("walking", "standing", "sitting", "")
    assert len(actions) == len(FRAMES)


def test_reading_the_clip_never_opens_the_truth(tmp_path: Path) -> None:
    folder = I3dbFolder().write(tmp_path / "Hall")
    for file in (folder / "gt").rglob("*.*"):
        if file.is_file():
            file.write_text("no JSON")
    assert read_i3db(folder).n_frames == len(FRAMES)
