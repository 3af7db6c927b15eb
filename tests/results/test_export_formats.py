"""Other people's formats say the same as the scene they were made of."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose

from imapper_prob.cli import main
from imapper_prob.clips.i3db import read_i3db_truth
from imapper_prob.models.camera import Camera
from imapper_prob.models.errors import InputError
from imapper_prob.models.geometry import pack_boxes, sight_clearance
from imapper_prob.models.scene import Cuboid, Placement, SceneObject
from imapper_prob.models.skeleton import PELV
from imapper_prob.results.exports import (
    evenly_spaced,
    intrinsics,
    scene_document,
    to_benchmark,
    write_i3db,
    yaw_in_camera,
)
from tests.runs import posterior
from tests.uncertainty.rooms import CAMERA, FRAME_IDS, clip_of_scene, couch_and_table

CORNERS = np.stack(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5]), -1).reshape(-1, 3)


def corners(o: SceneObject, c: Cuboid) -> np.ndarray:
    """(8, 3) corners of a part in the world."""
    return o.placement.apply(c.centre + CORNERS * c.size)


def in_order(points: np.ndarray) -> np.ndarray:
    return points[np.lexsort(np.round(points, 4).T)]


def through(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Pixels of points in the camera frame, by the matrix alone."""
    homogeneous = np.asarray(points) @ np.asarray(matrix).T
    return homogeneous[..., :2] / homogeneous[..., 2:]


def test_the_axes_of_the_benchmark_by_hand() -> None:
    level = Camera(640, 480, 500.0, 500.0, 320.0, 240.0, elevation=1.5)
    # Right, up and forward of a level camera 1.5 m above the floor.
    assert_allclose(to_benchmark(level, [1.0, 4.0, 2.0]), [1.0, -0.5, 4.0])
    chair = replace(couch_and_table().objects[0], placement=Placement(0, 4, 0.7))
    assert yaw_in_camera(level, chair) == pytest.approx(0.7)
    # A camera that looks down by 30 degrees sees what is level with it above the centre.
    down = replace(level, pitch=np.radians(-30))
    assert_allclose(to_benchmark(down, [0.0, 2.0, 1.5]), [0, -1, np.sqrt(3)])
    assert_allclose(through(intrinsics(down), to_benchmark(down, [0.3, 2, 1.0])),
                    down.project([0.3, 2, 1.0]))  # fmt: skip


def test_the_benchmarks_files_are_read_back_as_the_same_scene(tmp_path: Path) -> None:
    scene = couch_and_table()
    clip = clip_of_scene(scene)
    write_i3db(tmp_path / "out", scene, clip)
    # The same files with the names of annotations are what our reader takes.
    gt = tmp_path / "Scene99" / "gt"
    shutil.copytree(tmp_path / "out", gt)
    (gt / "skel_output.json").rename(gt / "skel_output_GT.json")
    truth = read_i3db_truth(tmp_path / "Scene99", clip)
    assert truth.camera.pitch == pytest.approx(CAMERA.pitch)
    assert truth.camera.roll == pytest.approx(CAMERA.roll)
    assert truth.camera.elevation == pytest.approx(CAMERA.elevation)
    for mine, theirs in zip(scene.objects, truth.objects, strict=True):
        assert theirs.label == mine.label
        assert np.cos(theirs.placement.yaw - mine.placement.yaw) == pytest.approx(1)
        assert_allclose(theirs.centre, mine.centre, atol=1e-9)
        boxes = [in_order(np.concatenate([corners(o, c) for c in o.cuboids]))
                 for o in (mine, theirs)]  # fmt: skip
        assert_allclose(*boxes, atol=1e-9)
    even = FRAME_IDS % 2 == 0  # the others are not annotated, the reader says
    assert_allclose(truth.joints[even], scene.joints[even], atol=1e-9)
    hidden = sight_clearance(CAMERA.centre, scene.joints, pack_boxes(scene.objects)) < 0
    assert hidden.any()
    np.testing.assert_array_equal(truth.hidden[even], hidden[even])
    with pytest.raises(InputError, match="exists already"):
        write_i3db(tmp_path / "out", scene, clip)


def test_json_joints_land_on_the_pixels_of_their_draw() -> None:
    run = posterior()
    document = scene_document(run, scene=1, samples=7)
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    draws = evenly_spaced(run, 7)
    assert len(document["samples"]) == 7
    bodies = [(document, run.scene(1).scene)]
    bodies += [
        (b, replace(run.draw(n), objects=run.furniture[n]))
        for b, n in zip(document["samples"], draws, strict=True)
    ]
    focal = set()
    for body, scene in bodies:
        assert [int(k) for k in body["joints3d"]] == run.clip.frame_ids.tolist()
        joints = np.array(list(body["joints3d"].values()))
        shown: slice | list[int] = slice(None)
        if body is not document:
            # Limbs and heights of draws differ from the scenelets'; where they stand does not.
            shown = [PELV]
            there = np.array([to_benchmark(scene.camera, at) for at in scene.joints[:, PELV]])
            up = np.array(body["floor"]["up"])
            joints -= ((joints[:, PELV] - there) @ up)[:, None, None] * up
        assert_allclose(
            through(body["camera_matrix"], joints[:, shown]),
            scene.camera.project(scene.joints[:, shown]),
            atol=0.02,
        )
        focal.add(body["camera_matrix"][0][0])
        assert body["log_prob"] == scene.log_posterior
        for o, mine in zip(body["objects"], scene.objects, strict=True):
            assert o["label"] == mine.label
            assert_allclose(through(body["camera_matrix"], np.array(o["center"])),
                            scene.camera.project(mine.centre), atol=0.02)  # fmt: skip
    assert len(focal) > 3  # every draw has its own camera


def test_json_boxes_stand_as_the_fields_say() -> None:
    """Corners from centre, size and yaw are the true ones, up to the tilt of the camera."""
    run = posterior()
    document = scene_document(run)
    assert document["scene"] is None
    assert document["probability"] is None
    scene = run.estimate
    for o, mine in zip(document["objects"], scene.objects, strict=True):
        width, height, depth = o["size"]
        low, high = mine.bounds
        assert_allclose([width, depth, height], high - low, atol=1e-4)
        c, s = np.cos(o["yaw"]), np.sin(o["yaw"])
        flat = np.array([[c, s], [-s, c]])
        rows = np.array(o["axes"])
        for axis, expected in zip(rows[:2], flat, strict=True):
            level = axis[[0, 2]] / np.linalg.norm(axis[[0, 2]])
            assert level @ expected == pytest.approx(1, abs=5e-3)
        # With the axes in full the corners are exact.
        sides = CORNERS * (width, depth, height)
        world = mine.placement.apply(mine.bounds.mean(0) + sides)
        assert_allclose(o["center"] + sides @ rows, to_benchmark(scene.camera, world), atol=1e-4)
        assert len(o["parts"]) == len(mine.cuboids)
    assert document["joint_names"][6] == "PELV"
    # A point of the floor of the world is one of the floor that is described.
    floor = document["floor"]
    on_floor = to_benchmark(scene.camera, [[-1.0, 3.0, 0.0], [2.0, 5.0, 0.0]])
    assert_allclose(on_floor @ floor["up"], -floor["camera_height"], atol=1e-4)


def test_samples_are_spread_evenly_over_the_chains() -> None:
    run = posterior()
    chains, draws = run.samples.shape
    numbers = np.array(evenly_spaced(run, 2 * chains))
    assert np.bincount(numbers // draws).tolist() == [2] * chains
    assert evenly_spaced(run, chains * draws) == list(range(chains * draws))
    for count in (0, chains * draws + 1):
        with pytest.raises(InputError, match="ask for 1 to"):
            evenly_spaced(run, count)


@pytest.fixture(scope="module")
def folder(run_of_demo: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "run"
    shutil.copytree(run_of_demo, folder)
    return folder


def test_every_format_from_the_command_line(folder: Path, tmp_path: Path) -> None:
    for form, name in (("glb", "a.glb"), ("json", "a.json"), ("i3db", "a")):
        arguments = ["export", str(folder), "--format", form, "-o", str(tmp_path / name)]
        arguments += ["--scene", "1"] if form == "glb" else []
        assert main(arguments) == 0
    exported, written = (
        trimesh.load(path) for path in (tmp_path / "a.glb", folder / "scenes" / "scene_1.glb")
    )
    assert set(exported.graph.nodes) == set(written.graph.nodes)
    assert_allclose(exported.bounds, written.bounds, atol=1e-4)
    document = json.loads((tmp_path / "a.json").read_text())
    assert document["clip"] == "demo"
    assert "samples" not in document
    assert (tmp_path / "a" / "skel_output.json").exists()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a", "a.glb", "a.json"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--format", "glb", "--samples", "3"], "--format json only"),
        (["--format", "glb", "--scene", "99"], "scene 99: the run has"),
        (["--format", "json", "--samples", "100000"], "ask for 1 to"),
        (["--format", "json", "--samples", "-1"], "at least 0 are needed"),
    ],
)
def test_what_cannot_be_exported_is_said(
    folder: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    words: str,
) -> None:
    output = tmp_path / f"x.{arguments[1]}"
    assert main(["export", str(folder), "-o", str(output), *arguments]) == 2
    assert words in capsys.readouterr().err
    assert not output.exists()
    for form, place, said in (
        ("glb", tmp_path, "is a folder"),
        ("glb", tmp_path / "no" / "x.glb", "there is no folder"),
        ("json", folder / "manifest.json", "is a file of the run"),
    ):
        assert main(["export", str(folder), "--format", form, "-o", str(place)]) == 2
        assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "name", "told"),
    [
        (["export", "--format", "glb"], "posterior.nc", "must end in .glb"),
        (["export", "--format", "json"], "scenes.json", "is a file of the run"),
        (["export", "--format", "glb"], "scenes/scene_1.glb", "is a file of the run"),
        (["record"], "posterior.nc", "must end in .rrd"),
    ],
)
def test_no_file_of_a_run_is_replaced_by_another_form(
    folder: Path, capsys: pytest.CaptureFixture[str], words: list[str], name: str, told: str
) -> None:
    before = (folder / name).read_bytes(), (folder / "manifest.json").read_bytes()
    assert main([words[0], str(folder), *words[1:], "-o", str(folder / name)]) == 2
    assert told in capsys.readouterr().err
    assert before == ((folder / name).read_bytes(), (folder / "manifest.json").read_bytes())


def test_a_recording_and_a_report_have_names_of_their_kind(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="must end in"):
        posterior().record(tmp_path / "clip.npz")
    with pytest.raises(InputError, match="must end in"):
        posterior().report(tmp_path / "clip.npz")
    assert list(tmp_path.iterdir()) == []
