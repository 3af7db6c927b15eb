"""Recordings of PiGraphs: read right, and faults told."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imapper_prob.models.errors import InputError
from imapper_prob.models.skeleton import JOINTS, LWRI
from imapper_prob.scenelets.build import captures_from
from imapper_prob.scenelets.pigraphs import read_pigraphs, read_scan
from tests.clips import pigraphs_folder as world
from tests.clips.pigraphs_folder import NAME, PigraphsFolder, motion


@pytest.fixture
def files() -> PigraphsFolder:
    return PigraphsFolder()


def read(files: PigraphsFolder, folder: Path) -> list[Any]:
    return read_pigraphs(files.write(folder), folder=folder)


def test_motion_is_brought_to_the_world_and_to_even_times(
    files: PigraphsFolder, tmp_path: Path
) -> None:
    (capture,) = read(files, tmp_path)
    assert (capture.name, capture.scene, capture.fps) == (NAME, "office", 10.0)
    seconds = np.arange(len(capture.joints)) / capture.fps
    assert seconds[-1] == pytest.approx(2.0)
    np.testing.assert_allclose(capture.joints, motion(seconds), atol=1e-9)


def test_furniture_is_grouped_upright_and_faces_away_from_its_back(
    files: PigraphsFolder, tmp_path: Path
) -> None:
    (capture,) = read(files, tmp_path)
    chair, table = capture.objects
    assert (chair.label, table.label) == ("chair", "table")
    assert [c.part for c in chair.cuboids] == ["seat", "backrest"]
    assert chair.placement.yaw == pytest.approx(world.CHAIR_YAW)
    seat, back = chair.cuboids
    np.testing.assert_allclose(seat.size, (0.5, 0.45, 0.45))
    np.testing.assert_allclose(chair.placement.apply(seat.centre), (1.0, 1.5, 0.225), atol=1e-9)
    np.testing.assert_allclose(back.centre - seat.centre, (0.0, -0.25, 0.425), atol=1e-9)
    # The table's long side is its width, and its front looks at the middle of the room.
    np.testing.assert_allclose(table.cuboids[0].size, (1.4, 0.7, 0.75))
    assert np.sin(2 * (table.placement.yaw - world.TABLE_YAW)) == pytest.approx(0.0, abs=1e-9)
    front = table.placement.apply([0.0, 1.0, 0.0]) - table.placement.apply(np.zeros(3))
    assert front[:2] @ ((0.0, 1.3) - table.centre[:2]) > 1.0


def test_actions_follow_the_interactions(files: PigraphsFolder, tmp_path: Path) -> None:
    (capture,) = read(files, tmp_path)
    words = list(capture.actions)
    assert words[:10] == ["walk"] * 10
    assert words[10:16] == ["sit"] * 6
    assert words[16:] == [""] * (len(words) - 16)


def test_microseconds_are_told_from_ticks(files: PigraphsFolder, tmp_path: Path) -> None:
    for skeleton in files.skeletons:
        skeleton["timestamp"] //= 10
    (capture,) = read(files, tmp_path)
    np.testing.assert_allclose(capture.joints, motion(np.arange(21) / 10), atol=1e-5)


def test_a_camera_in_columns_is_told_from_one_in_rows(
    files: PigraphsFolder, tmp_path: Path
) -> None:
    files.recording["camera"] = world.camera().T.reshape(-1).tolist()
    (capture,) = read(files, tmp_path)
    np.testing.assert_allclose(capture.joints, motion(np.arange(21) / 10), atol=1e-9)


def test_axes_in_columns_are_told_from_axes_in_rows(files: PigraphsFolder, tmp_path: Path) -> None:
    for part in files.scan["segGroups"]:
        axes = np.reshape(part["obb"]["normalizedAxes"], (3, 3))
        part["obb"]["normalizedAxes"] = axes.T.reshape(-1).tolist()
    (capture,) = read(files, tmp_path)
    chair, table = capture.objects
    assert chair.placement.yaw == pytest.approx(world.CHAIR_YAW)
    np.testing.assert_allclose(table.cuboids[0].size, (1.4, 0.7, 0.75))


def test_a_box_that_lies_askew_gets_one_around_it(files: PigraphsFolder, tmp_path: Path) -> None:
    tilt = np.pi / 4
    c, s = np.cos(tilt), np.sin(tilt)
    files.scan["segGroups"].append(
        {
            "label": "lamp",
            "objectId": 9,
            "obb": {
                "centroid": [0.0, 0.0, 1.0],
                "axesLengths": [1.0, 0.2, 0.1],
                "normalizedAxes": [c, 0.0, s, 0.0, 1.0, 0.0, -s, 0.0, c],
            },
        }
    )
    (capture,) = read(files, tmp_path)
    (box,) = next(o for o in capture.objects if o.label == "lamp").cuboids
    np.testing.assert_allclose(box.size, (1.1 * c, 0.2, 1.1 * c), atol=1e-9)


def test_without_a_labelled_floor_it_is_below_the_furniture(
    files: PigraphsFolder, tmp_path: Path
) -> None:
    del files.scan["segGroups"][0]
    path = files.write(tmp_path)
    objects, floor = read_scan(tmp_path / "scans" / "office.segs.json")
    assert floor == pytest.approx(world.FLOOR)
    assert min(o.bounds[0, 2] for o in objects) == pytest.approx(0.0, abs=1e-9)
    assert read_pigraphs(path, folder=tmp_path)


def test_a_joint_lost_for_a_moment_is_bridged_and_for_long_is_not(
    files: PigraphsFolder, tmp_path: Path
) -> None:
    wrist = world.KINECT_OF[JOINTS[LWRI]]
    for skeleton in files.skeletons[10:15]:
        skeleton["jointConfidences"][wrist] = 0.0
        skeleton["jointPositions"][wrist] = [9.0, 9.0, 9.0]
    for skeleton in files.skeletons[30:50]:
        skeleton["jointPositions"][wrist] = [float("nan")] * 3
    (capture,) = read(files, tmp_path)
    there = np.isfinite(capture.joints).all((1, 2))
    lost = np.flatnonzero(~there)
    assert lost.min() / 10 == pytest.approx(1.0, abs=0.1)
    assert lost.max() / 10 == pytest.approx(1.68, abs=0.1)
    np.testing.assert_allclose(capture.joints[there], motion(np.arange(21) / 10)[there], atol=1e-9)


def test_several_people_are_told_apart(files: PigraphsFolder, tmp_path: Path) -> None:
    other = [dict(s, trackingId=5, timestamp=s["timestamp"] + 1000) for s in files.skeletons[20:]]
    nobody = [dict(s, trackingId=0, jointConfidences=[0.0] * 25) for s in files.skeletons[:3]]
    files.recording["skeletons"] = [*nobody, *files.skeletons, *other]
    first, second = read(files, tmp_path)
    assert (first.name, second.name) == (f"{NAME}-1", f"{NAME}-2")
    assert first.scene == second.scene == "office"
    assert np.isfinite(first.joints).all()
    assert np.isnan(second.joints[:6]).all()


def test_what_is_no_furniture_is_counted(
    files: PigraphsFolder, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    files.scan["segGroups"] += [
        world.group("unknown", 11, (0.0, 0.0, 0.5), (0.3, 0.3, 0.3), 0.0),
        world.group("", 12, (0.0, 0.0, 0.5), (0.3, 0.3, 0.3), 0.0),
    ]
    files.interactions += "1.6-1.8,juggle:ball\n"
    with caplog.at_level(logging.WARNING):
        (capture,) = read(files, tmp_path)
    assert len(capture.objects) == 2
    assert "1 floor, 1 wall, 1 unknown, 1 without a label" in caplog.text
    assert "1 of juggle" in caplog.text


def _no_skeletons(files: PigraphsFolder) -> None:
    files.skeletons.clear()


def _nobody(files: PigraphsFolder) -> None:
    for skeleton in files.skeletons:
        skeleton["jointConfidences"] = [0] * 25


def _one_wrist_never(files: PigraphsFolder) -> None:
    for skeleton in files.skeletons:
        skeleton["jointPositions"][6] = [float("nan")] * 3


def _short_skeleton(files: PigraphsFolder) -> None:
    files.skeletons[7]["jointPositions"].pop()


def _words(files: PigraphsFolder) -> None:
    files.skeletons[7]["jointPositions"][0] = ["left", 0, 0]


def _bad_time(files: PigraphsFolder) -> None:
    files.skeletons[7]["timestamp"] = "noon"


def _far_time(files: PigraphsFolder) -> None:
    files.skeletons[-1]["timestamp"] += 10**13


def _no_camera(files: PigraphsFolder) -> None:
    del files.recording["camera"]


def _bent_camera(files: PigraphsFolder) -> None:
    files.recording["camera"][0] = 3.0


def _no_scan(files: PigraphsFolder) -> None:
    files.scan = {}


def _empty_scan(files: PigraphsFolder) -> None:
    files.scan = {"segGroups": []}


def _only_walls(files: PigraphsFolder) -> None:
    files.scan["segGroups"] = files.scan["segGroups"][:2]


def _bent_box(files: PigraphsFolder) -> None:
    files.scan["segGroups"][2]["obb"]["normalizedAxes"][0] = 2.0


def _no_box(files: PigraphsFolder) -> None:
    del files.scan["segGroups"][2]["obb"]


def _bad_interactions(files: PigraphsFolder) -> None:
    files.interactions = "0.0-1.0,walk:floor\nsitting from 1 to 2\n"


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (_no_skeletons, r"nobody was tracked \(no skeletons\)"),
        (_nobody, "nobody was tracked in any of 60 skeletons"),
        (_one_wrist_never, "nobody was tracked with all joints"),
        (_short_skeleton, r"skeleton 7: jointPositions have shape \(24, 3\)"),
        (_words, "skeleton 7: jointPositions must be numbers"),
        (_bad_time, "skeleton 7, timestamp: expected one number"),
        (_far_time, "hours; one is damaged"),
        (_no_camera, "no entry 'camera'"),
        (_bent_camera, "camera is not a rotation"),
        (_no_scan, r"no scan office\.segs\.json"),
        (_empty_scan, "'segGroups' lists no parts"),
        (_only_walls, "no part of 2 is labelled as furniture"),
        (_bent_box, "group 2, normalizedAxes: not three unit vectors"),
        (_no_box, r"no entry 'obb'"),
        (_bad_interactions, "line 2: expected <start>-<end>"),
    ],
)
def test_a_fault_is_named(files: PigraphsFolder, tmp_path: Path, spoil: Any, message: str) -> None:
    spoil(files)
    with pytest.raises(InputError, match=message):
        read(files, tmp_path)


def test_a_recording_cut_off_is_named(files: PigraphsFolder, tmp_path: Path) -> None:
    path = files.write(tmp_path)
    path.write_text(path.read_text()[:500])
    with pytest.raises(InputError, match=f"{NAME}.json: not valid JSON"):
        captures_from("pigraphs", tmp_path)


def test_a_folder_is_searched_and_bad_recordings_are_named(
    files: PigraphsFolder, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = files.write(tmp_path)
    path.with_name("hall_kinect_2.json").write_text("{}")
    with caplog.at_level(logging.WARNING):
        captures = captures_from("pigraphs", tmp_path)
    assert [c.name for c in captures] == [NAME]
    assert "left out" in caplog.text
    assert "hall_kinect_2.json" in caplog.text


def test_a_folder_without_recordings_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no PiGraphs recording there"):
        captures_from("pigraphs", tmp_path)
