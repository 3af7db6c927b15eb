"""Formats that other programs write, read to known joint positions."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imapper_prob.clips.keypoints import KEYPOINT_SETS, not_reported, sixteen
from imapper_prob.clips.load import ClipOptions, format_of, read_whatever
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip
from imapper_prob.models.skeleton import HEAD, JOINTS, LANK, N_JOINTS, NECK, PELV, RWRI, THRX
from tests.clips.bodies import (
    N_FRAMES,
    POINTS,
    SIZE,
    instances,
    landmarks,
    place,
    results,
    table,
    write_json,
    write_openpose,
)
from tests.conftest import ROOT

OPTIONS = ClipOptions(size=SIZE, fps=25, focal=1000)
SAME_AS = {
    **{
        joint: {"R": "right_", "L": "left_"}[joint[0]] + word
        for joint in JOINTS
        for short, word in {
            "ANK": "ankle", "KNE": "knee", "HIP": "hip",
            "WRI": "wrist", "ELB": "elbow", "SHO": "shoulder",
        }.items()
        if joint[1:] == short
    },
    "PELV": "mid_hip",
    "THRX": "neck",
}  # fmt: skip


def check(clip: Clip) -> None:
    """Every joint where the drawing has it, in every frame."""
    keypoints = clip.tracks[0].keypoints
    assert len(keypoints) == N_FRAMES
    for frame in range(N_FRAMES):
        for joint, name in SAME_AS.items():
            expected = np.add(POINTS[name], place(frame))
            np.testing.assert_allclose(
                keypoints[frame, JOINTS.index(joint)], expected, atol=1e-6, err_msg=joint
            )
        # The middle of the head is half-way between the ears.
        np.testing.assert_allclose(keypoints[frame, HEAD], np.add((0, -162), place(frame)))
    confidences = clip.tracks[0].confidences
    assert (confidences[:, [PELV, NECK]] == 0).all()
    assert (confidences[:, LANK] > 0).all()


@pytest.mark.parametrize("order", ["body_25", "body_25b", "coco_18"])
@pytest.mark.parametrize("said", [True, False])
def test_openpose(order: str, said: bool, tmp_path: Path) -> None:
    folder = write_openpose(tmp_path / "film", order)
    assert format_of(folder) == "openpose"
    options = ClipOptions(order if said else None, size=SIZE, fps=25, focal=1000)
    check(read_whatever(folder, options))


@pytest.mark.parametrize("form", ["coco_17", "halpe_26"])
def test_result_lists(form: str, tmp_path: Path) -> None:
    path = write_json(tmp_path / "results.json", results(form))
    assert format_of(path) == "results"
    check(read_whatever(path, OPTIONS))
    check(read_whatever(write_json(tmp_path / "own.json", instances(form)), OPTIONS))


def test_mediapipe(tmp_path: Path) -> None:
    path = write_json(tmp_path / "dump.json", landmarks())
    assert format_of(path) == "mediapipe"
    clip = read_whatever(path, ClipOptions(focal=1000))
    check(clip)
    assert (clip.camera.width, clip.camera.height, clip.fps) == (*SIZE, 25)
    pose = clip.tracks[0].poses[3]
    np.testing.assert_allclose(pose[PELV], 0, atol=1e-12)
    # 24 pixels to the right and 160 down, at 200 pixels a metre; z follows x by a tenth. Seen
    # straight on; the rays to the trunk are 13 degrees to the left and 4 up.
    ray = clip.camera.rays(np.mean([clip.tracks[0].keypoints[3, [2, 3, 12, 13]]], (0, 1)))
    ray /= np.linalg.norm(ray)
    ankle = np.array([0.12, 0.012, -0.8])
    assert np.linalg.norm(pose[LANK]) == pytest.approx(np.linalg.norm(ankle))
    assert pose[LANK] @ ray == pytest.approx(ankle[1])


def test_mediapipe_only_guesses_outside_of_the_picture(tmp_path: Path) -> None:
    dump = landmarks()
    ankle = KEYPOINT_SETS["mediapipe_33"].index("left_ankle")
    dump["frames"][3]["landmarks"][ankle]["y"] = 1.1
    track = read_whatever(write_json(tmp_path / "dump.json", dump), OPTIONS).tracks[0]
    assert track.confidences[3, LANK] == 0
    assert track.confidences[4, LANK] > 0


def test_mediapipe_rows_and_absence(tmp_path: Path) -> None:
    frames = landmarks(world=False)["frames"]
    rows: list[Any] = [
        [[p["x"], p["y"], p["z"], p["visibility"]] for p in f["landmarks"]] for f in frames
    ]
    dump = [{"pose_landmarks": r} for r in rows]
    dump[4] = {"pose_landmarks": None}  # type: ignore[dict-item]
    clip = read_whatever(write_json(tmp_path / "dump.json", dump), OPTIONS)
    assert (clip.tracks[0].confidences[4] == 0).all()
    assert not clip.tracks[0].has_pose.any()
    np.testing.assert_allclose(
        clip.tracks[0].keypoints[5, RWRI], np.add(POINTS["right_wrist"], place(5))
    )


@pytest.mark.parametrize("said", ["body_25", "body_25b"])
def test_the_other_order_of_25_is_refused(said: str, tmp_path: Path) -> None:
    other = {"body_25": "body_25b", "body_25b": "body_25"}[said]
    folder = write_openpose(tmp_path / "film", other)
    with pytest.raises(InputError, match=f"order of {other.upper()}, not {said.upper()}"):
        read_whatever(folder, ClipOptions(said, size=SIZE))


def test_25_points_that_tell_nothing(tmp_path: Path) -> None:
    folder = write_openpose(tmp_path / "film", "body_25")
    for path in folder.iterdir():
        data = json.loads(path.read_text())
        flat = np.array(data["people"][0]["pose_keypoints_2d"]).reshape(-1, 3)
        flat[[0, *range(15, 25)]] = 0
        data["people"][0]["pose_keypoints_2d"] = flat.ravel().tolist()
        path.write_text(json.dumps(data))
    with pytest.raises(InputError, match=r"say --format body_25 or --format body_25b"):
        read_whatever(folder, OPTIONS)
    assert read_whatever(folder, ClipOptions("body_25", size=SIZE)).n_frames == N_FRAMES


def test_real_files_are_body_25b() -> None:
    folder = ROOT.parent / "shared" / "fixtures" / "openpose_body25b"
    if not folder.is_dir():
        pytest.skip(f"no OpenPose files at {folder}")
    options = ClipOptions(size=(1080, 1920), fps=30)
    clip = read_whatever(folder, options)
    assert len(clip.tracks) == 2
    first = json.loads((folder / "cam01.0000.json").read_text())["people"]
    ankles = {tuple(np.round(p["pose_keypoints_2d"][45:47], 3)) for p in first}
    found = {tuple(np.round(track.keypoints[0, LANK], 3)) for track in clip.tracks}
    assert found <= ankles  # keypoint 15 of BODY_25B; in BODY_25 it would be an eye
    with pytest.raises(InputError, match="order of BODY_25B"):
        read_whatever(folder, ClipOptions("body_25", size=(1080, 1920)))


def test_two_people_in_any_order_are_two_tracks(tmp_path: Path) -> None:
    clip = read_whatever(write_openpose(tmp_path / "film", "body_25", people=2), OPTIONS)
    assert [track.name for track in clip.tracks] == ["film-0", "film-1"]
    at = [[t.keypoints[f, PELV, 0] - place(f)[0] for f in range(N_FRAMES)] for t in clip.tracks]
    assert sorted(np.ptp(a) for a in at) == pytest.approx([0, 0], abs=1e-9)
    alone = read_whatever(tmp_path / "film", ClipOptions(size=SIZE, people=1))
    assert len(alone.tracks) == 1


def test_track_numbers_are_kept(tmp_path: Path) -> None:
    entries = results("coco_17") + [
        {**entry, "idx": 7, "keypoints": table("coco_17", f, 1).ravel().tolist()}
        for f, entry in enumerate(results("coco_17"))
    ]
    for entry in entries[:N_FRAMES]:
        entry["idx"] = 3
    clip = read_whatever(write_json(tmp_path / "two.json", entries), OPTIONS)
    assert [track.name for track in clip.tracks] == ["3", "7"]
    np.testing.assert_allclose(clip.tracks[1].keypoints[2, PELV], place(2, 1))


@pytest.mark.parametrize(("one", "other"), [(1000001, 1000002), (3.0, 4.0), ("ann", "bob")])
def test_long_track_numbers_and_names_are_told_apart(one: Any, other: Any, tmp_path: Path) -> None:
    entries = [
        {**entry, "idx": one if f < 4 else other} for f, entry in enumerate(results("coco_17"))
    ]
    clip = read_whatever(write_json(tmp_path / "two.json", entries), OPTIONS)
    assert [track.name for track in clip.tracks] == [
        str(name).removesuffix(".0") for name in (one, other)
    ]


def test_joints_outside_of_the_image_speak_against_its_size(tmp_path: Path) -> None:
    folder = write_openpose(tmp_path / "film", "body_25")
    with pytest.raises(InputError, match=r"joints are outside of images of 128 x 72; .*--size"):
        read_whatever(folder, ClipOptions(size=(128, 72), fps=25))


def test_a_byte_order_mark_is_no_part_of_a_clip(tmp_path: Path) -> None:
    path = write_json(tmp_path / "one.json", results("coco_17"))
    path.write_text(path.read_text(), encoding="utf-8-sig")
    check(read_whatever(path, OPTIONS))


def test_zeros_are_missing_joints_not_the_corner(tmp_path: Path) -> None:
    folder = write_openpose(tmp_path / "film", "body_25")
    path = sorted(folder.iterdir())[2]
    data = json.loads(path.read_text())
    flat = data["people"][0]["pose_keypoints_2d"]
    flat[3 * 14 : 3 * 14 + 3] = [0, 0, 0]
    path.write_text(json.dumps(data))
    track = read_whatever(folder, OPTIONS).tracks[0]
    assert track.confidences[2, LANK] == 0
    assert np.isnan(track.keypoints[2, LANK]).all()


def test_frames_without_files_are_empty(tmp_path: Path) -> None:
    folder = write_openpose(tmp_path / "film", "coco_18")
    (folder / "film_000000000005_keypoints.json").unlink()
    clip = read_whatever(folder, OPTIONS)
    assert clip.n_frames == N_FRAMES
    assert (clip.tracks[0].confidences[5] == 0).all()


def test_parts_of_the_image(tmp_path: Path) -> None:
    folder = write_openpose(tmp_path / "film", "body_25")
    for path in folder.iterdir():
        data = json.loads(path.read_text())
        flat = np.array(data["people"][0]["pose_keypoints_2d"]).reshape(-1, 3) / (*SIZE, 1)
        data["people"][0]["pose_keypoints_2d"] = flat.ravel().tolist()
        path.write_text(json.dumps(data))
    check(read_whatever(folder, OPTIONS))


def test_size_must_be_known(tmp_path: Path) -> None:
    folder = write_openpose(tmp_path / "film", "body_25")
    with pytest.raises(InputError, match="how large the image is"):
        read_whatever(folder, ClipOptions())


def test_a_thorax_between_shoulders_is_no_evidence() -> None:
    for form, names in KEYPOINT_SETS.items():
        points = np.arange(2.0 * len(names)).reshape(1, -1, 2)
        found, scores = sixteen(points, np.ones((1, len(names))), names)
        assert np.isfinite(found).all(), form
        assert (scores[0, THRX] > 0) == ("neck" in names)
        assert ("THRX" in not_reported(names)) == ("neck" not in names)


def test_head_from_one_ear_or_the_nose() -> None:
    names = KEYPOINT_SETS["coco_17"]
    points = np.arange(34.0).reshape(1, 17, 2) + 1
    scores = np.ones((1, 17))
    scores[0, names.index("left_ear")] = 0
    found, _ = sixteen(points, scores, names)
    np.testing.assert_allclose(found[0, HEAD], points[0, names.index("right_ear")])
    scores[0, 1:5] = 0
    found, sure = sixteen(points, scores, names)
    np.testing.assert_allclose(found[0, HEAD], points[0, names.index("nose")])
    assert sure.shape == (1, N_JOINTS)
    scores[0, 0] = 0
    found, sure = sixteen(points, scores, names)
    assert np.isnan(found[0, HEAD]).all()
    assert sure[0, HEAD] == 0
