"""What is in a recording is what went in, read back by rerun's own reader."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader

from imapper_prob.models.errors import InputError
from imapper_prob.models.geometry import pack_boxes
from imapper_prob.models.scene import Clip, Scene, Truth
from imapper_prob.models.skeleton import PELV
from imapper_prob.recording import log
from imapper_prob.recording.log import write_recording
from imapper_prob.uncertainty.scenes import WeightedScene
from tests.recording.reading import Columns, read
from tests.recording.room import make_certainty, make_chains, make_room, make_traces

N_FRAMES = 30
UNKNOWN = slice(10, 13)
"""Frames about which the best scene knows nothing."""


def room_with_a_gap() -> tuple[Clip, list[WeightedScene], Truth]:
    clip, scenes, truth = make_room(N_FRAMES, n_ghosts=2)
    joints = scenes[0].scene.joints.copy()
    joints[UNKNOWN] = np.nan
    scenes[0] = replace(scenes[0], scene=replace(scenes[0].scene, joints=joints))
    return clip, scenes, truth


def write(path: Path) -> None:
    clip, scenes, truth = room_with_a_gap()
    write_recording(
        path, clip=clip, scenes=scenes, traces=make_traces(), truth=truth, description="# A room"
    )


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "room.rrd"
    write(path)
    return path


@pytest.fixture(scope="module")
def columns(recording: Path) -> Columns:
    return read(recording)


def test_the_motion_of_every_scene(columns: Columns) -> None:
    clip, scenes, _ = room_with_a_gap()
    for i, weighted in enumerate(scenes, 1):
        positions = columns[f"/world/scene_{i}/person", "Points3D:positions"]
        assert list(positions) == clip.frame_ids.tolist()
        for t, joints in zip(clip.frame_ids, weighted.scene.joints, strict=True):
            expected = joints[np.isfinite(joints).all(-1)].astype(np.float32)
            assert np.array_equal(np.reshape(positions[t], (-1, 3)), expected)
    lengths = [len(p) for p in columns["/world/scene_1/person", "Points3D:positions"].values()]
    assert lengths == [16] * 10 + [0] * 3 + [16] * 17


def test_the_path_is_broken_where_nothing_is_known(columns: Columns) -> None:
    _, scenes, _ = room_with_a_gap()
    strips = columns["/world/scene_1/path", "LineStrips3D:strips"][None]
    pelvis = scenes[0].scene.joints[:, PELV].astype(np.float32)
    assert [len(s) for s in strips] == [10, 17]
    assert np.array_equal(strips[1], pelvis[UNKNOWN.stop :])


def test_the_furniture_of_every_scene(columns: Columns) -> None:
    _, scenes, truth = room_with_a_gap()
    rooms = {f"/world/scene_{i}": s.scene.objects for i, s in enumerate(scenes, 1)}
    for entity, objects in {**rooms, "/world/truth": truth.objects}.items():
        boxes = pack_boxes(objects).astype(np.float32)
        found = {
            name: np.array(columns[f"{entity}/furniture", f"Boxes3D:{name}"][None])
            for name in ("centers", "half_sizes", "quaternions")
        }
        assert np.array_equal(found["centers"], boxes[:, :3])
        assert np.array_equal(found["half_sizes"], boxes[:, 3:6])
        x, y, z, w = found["quaternions"].T
        assert not np.any([x, y])
        turn = 2 * np.arctan2(z, w) - boxes[:, 6]
        assert np.allclose(np.cos(turn), 1, atol=1e-6)


def test_the_true_furniture_is_outlined_on_the_floor(columns: Columns) -> None:
    _, _, truth = room_with_a_gap()
    strips = columns["/world/truth/outlines", "LineStrips3D:strips"][None]
    for strip, o in zip(strips, truth.objects, strict=True):
        assert strip[0] == strip[-1]
        np.testing.assert_allclose(np.array(strip)[:4, :2], o.footprint, atol=1e-5)


def test_the_scenes_one_by_one(columns: Columns) -> None:
    _, scenes, _ = room_with_a_gap()
    centres = columns["/world/by_scene/furniture", "Boxes3D:centers"]
    assert list(centres) == [1, 2, 3]
    for i, weighted in enumerate(scenes, 1):
        expected = pack_boxes(weighted.scene.objects)[:, :3].astype(np.float32)
        assert np.array_equal(centres[i], expected)
    texts = columns["/summary", "TextDocument:text"]
    assert texts[2] == ["Scene 2: p = 0.23 ± 0.02: 1 seat, 1 shelf, 1 table"]


@pytest.mark.parametrize("roll", [0.0, 0.2])
def test_the_recorded_camera_projects_as_ours_does(tmp_path: Path, roll: float) -> None:
    clip, scenes, _ = make_room(4)
    camera = replace(scenes[0].scene.camera, roll=roll, fx=1400.0, cx=900.0)
    scenes = [replace(scenes[0], scene=replace(scenes[0].scene, camera=camera))]
    path = tmp_path / "room.rrd"
    write_recording(path, clip=clip, scenes=scenes, traces={}, description="")
    columns = read(path)

    def static(component: str, entity: str = "/world/camera") -> np.ndarray:
        return np.array(columns[entity, component][None][0], float)

    # rerun's matrices are column-major, its camera x right, y down, z forward.
    world_from_camera = static("Transform3D:mat3x3").reshape(3, 3).T
    origin = static("Transform3D:translation")
    intrinsics = static("Pinhole:image_from_camera", "/world/camera/image").reshape(3, 3).T
    joints = scenes[0].scene.joints
    homogeneous = (joints - origin) @ world_from_camera @ intrinsics.T
    pixels = homogeneous[..., :2] / homogeneous[..., 2:]
    assert (homogeneous[..., 2] > 0).all()
    assert np.allclose(pixels, camera.project(joints), atol=0.01)
    drawn = columns["/world/camera/image/reprojection", "Points2D:positions"]
    assert np.allclose(list(drawn.values()), pixels, atol=0.01)


def test_detections_and_only_those(columns: Columns) -> None:
    clip, _, _ = room_with_a_gap()
    track = clip.tracks[0]
    points = columns["/world/camera/image/detections", "Points2D:positions"]
    colours = columns["/world/camera/image/detections", "Points2D:colors"]
    for k, t in enumerate(clip.frame_ids):
        detected = track.confidences[k] > 0
        assert np.array_equal(points[t], track.keypoints[k, detected].astype(np.float32))
        assert len(colours[t]) == detected.sum()


def test_traces_keep_their_draws(columns: Columns) -> None:
    for name, chains in make_traces().items():
        entity = "/traces/" + name.replace(" ", "\\ ")
        for k, chain in enumerate(chains, 1):
            values = columns[f"{entity}/chain_{k}", "Scalars:scalars"]
            assert list(values) == list(range(len(chain)))
            assert np.array_equal(np.ravel(list(values.values())), chain)


def test_a_long_trace_is_thinned_and_a_gap_left_out(tmp_path: Path) -> None:
    clip, scenes, _ = make_room(4)
    trace = np.arange(9001.0)[None]
    trace[0, 10] = np.nan
    path = tmp_path / "room.rrd"
    write_recording(path, clip=clip, scenes=scenes, traces={"a": trace}, description="")
    values = read(path)["/traces/a/chain_1", "Scalars:scalars"]
    assert list(values) == [t for t in range(0, 9001, 5) if t != 10]
    assert all(v == [t] for t, v in values.items())


def test_the_distance_of_the_truth_is_plotted(columns: Columns) -> None:
    _, _, truth = room_with_a_gap()
    plotted = columns["/fit/distance/truth", "Scalars:scalars"]
    expected = np.linalg.norm(truth.joints[:, PELV] - truth.camera.centre, axis=1)
    assert np.allclose(np.ravel(list(plotted.values())), expected)


def test_the_text_names_each_scene(columns: Columns) -> None:
    (text,) = columns["/description", "TextDocument:text"][None]
    assert text.startswith("# A room\n")
    assert "| 1 | 0.62 ± 0.02 | 2 seats, 1 shelf, 1 table |" in text


def rerun(*arguments: str) -> str:
    """What rerun's own command says."""
    run = "import sys; from rerun_cli.__main__ import main; sys.exit(main())"
    command = [sys.executable, "-c", run, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def test_rerun_itself_finds_no_fault(recording: Path) -> None:
    assert "verified without error" in rerun("rrd", "verify", str(recording))


def test_there_is_one_blueprint_inside_which_every_viewer_shows(recording: Path) -> None:
    assert len(RrdReader(recording).blueprints()) == 1
    # A viewer in a browser, or one that has shown another recording, keeps a layout that is not
    # told to go.
    assert "make_active: true, make_default: true" in rerun("rrd", "print", "-vv", str(recording))


def test_the_same_run_makes_the_same_recording(
    recording: Path, columns: Columns, tmp_path: Path
) -> None:
    again = tmp_path / "again.rrd"
    write(again)
    assert read(again) == columns
    ids = [[r.recording_id for r in RrdReader(p).recordings()] for p in (recording, again)]
    assert ids[0] == ids[1]


def test_a_real_clip_stays_small(tmp_path: Path) -> None:
    clip, scenes, truth = make_room(540, n_ghosts=20)
    path = tmp_path / "room.rrd"
    write_recording(
        path,
        clip=clip,
        scenes=[*scenes, *scenes[:2]],
        traces={"energy": np.zeros((4, 50_000))},
        truth=truth,
        description="",
        certainty=make_certainty(400, scenes),
        draws=make_chains(400, 540, scenes),
    )
    assert path.stat().st_size < 15e6


def test_a_room_about_which_little_is_known(tmp_path: Path) -> None:
    clip, scenes, _ = make_room(5)
    scene = Scene(scenes[0].scene.camera, (), np.full((5, 16, 3), np.nan), (), 0.0)
    empty = WeightedScene(scene, 1.0, 0.0, np.zeros((0, 2, 2)), np.zeros((0, 5, 16, 3)))
    path = tmp_path / "room.rrd"
    write_recording(path, clip=clip, scenes=[empty, empty], traces={}, description="")
    columns = read(path)
    assert columns["/world/scene_1/furniture", "Boxes3D:half_sizes"][None] == []
    assert set(map(len, columns["/world/scene_1/person", "Points3D:positions"].values())) == {0}


def test_a_failed_write_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clip, scenes, _ = make_room(4)
    path = tmp_path / "room.rrd"
    path.write_bytes(b"old")

    def full(*_: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(log, "log_fit", full)
    with pytest.raises(OSError, match="no space"):
        write_recording(path, clip=clip, scenes=scenes, traces={}, description="")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_what_does_not_fit_is_refused(tmp_path: Path) -> None:
    clip, scenes, _ = make_room(4)
    path = tmp_path / "room.rrd"
    good: dict[str, Any] = {"clip": clip, "scenes": scenes, "traces": {}, "description": ""}
    with pytest.raises(InputError, match="at least one scene"):
        write_recording(path, **{**good, "scenes": []})
    with pytest.raises(InputError, match="scene 1 has 6 frames, clip room has 4"):
        write_recording(path, **{**good, "scenes": make_room(6)[1]})
    with pytest.raises(InputError, match="the truth has 6 frames, clip room has 4"):
        write_recording(path, **{**good, "truth": make_room(6)[2]})
    with pytest.raises(InputError, match=r"trace a has shape \(3,\)"):
        write_recording(path, **{**good, "traces": {"a": np.zeros(3)}})
    with pytest.raises(InputError, match="does not exist; make it first"):
        write_recording(tmp_path / "nowhere" / "room.rrd", **good)
    assert not list(tmp_path.iterdir())
