"""Results of other methods in files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imapper_prob.evaluate.i3db import read_authors
from imapper_prob.evaluate.prediction import PREDICTION_FORMAT, read_prediction, write_prediction
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.skeleton import N_JOINTS
from tests.clips.i3db_folder import I3dbFolder
from tests.evaluate.scenes import CAMERA, N_FRAMES, furniture, prediction, walk


def clip() -> Clip:
    flat = np.full((N_FRAMES, N_JOINTS), 0.9)
    pixels = CAMERA.project_camera(walk())
    track = Track("somebody", pixels, flat, walk() - walk()[:, [6]], np.zeros(N_FRAMES, bool))
    return Clip("made up", CAMERA, 10.0, np.arange(1, N_FRAMES + 1), (track,))


def document() -> dict[str, Any]:
    return {
        "format": PREDICTION_FORMAT,
        "version": 1,
        "method": "monocular depth",
        "clip": "made up",
        "joints": {
            "names": ["HEAD", "PELV"],
            "frames": {"2": [[0, 4, 1], [0, 4, 0]], "4": [None, [1, 4, 0]]},
        },
        "objects": [
            {"label": "chair", "points": [[0, 4, 0], [1, 4, 0], [0, 5, 1]], "sideways": [1, 0, 0]}
        ],
    }


def written(tmp_path: Path, data: Any) -> Path:
    path = tmp_path / "result.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    return path


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    write_prediction(path, prediction(objects=furniture()), clip())
    again = read_prediction(path, clip())
    assert again.name == "guess"
    np.testing.assert_allclose(again.joints, walk())
    np.testing.assert_allclose(again.pixels, CAMERA.project_camera(walk()))
    for one, other in zip(again.objects, furniture(), strict=True):
        assert (one.label, one.has_front) == (other.label, other.has_front)
        np.testing.assert_allclose(one.centre, other.centre, atol=1e-12)
        assert one.yaw == pytest.approx(other.yaw)
        assert one.hull.equals_exact(other.hull, 1e-12)


def test_some_joints_of_some_frames(tmp_path: Path) -> None:
    found = read_prediction(written(tmp_path, document()), clip())
    np.testing.assert_allclose(found.joints[2, 6], (0.5, 4, 0))  # between frames 2 and 4
    np.testing.assert_allclose(found.joints[1, 9], (0, 4, 1))
    assert np.isnan(found.joints[2:, 9]).all()
    assert np.isfinite(found.joints).all(-1).sum() == 4
    np.testing.assert_allclose(found.pixels[3, 6], (960 + 250, 540))
    assert not found.objects[0].has_front


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "other"}, "is no prediction"),
        ({"version": 2}, "has version 2"),
        ({"clip": "Scene99"}, "is of the clip 'Scene99', not of made up"),
        ({"joints": {"names": ["NOSE"], "frames": {}}}, "has 'NOSE'"),
        ({"joints": {"names": ["PELV", "PELV"], "frames": {}}}, "a joint twice"),
        ({"joints": {"names": ["PELV"], "frames": {"40": [[0, 4, 0]]}}}, "frame 40 is not of"),
        ({"joints": {"names": ["PELV"], "frames": {"2": []}}}, "frame 2: expected 1 joints"),
        ({"joints": {"names": ["PELV"], "frames": {"2": [[0, 4]]}}}, "joint PELV"),
        ({"objects": [{"label": "chair"}]}, "object 1 must have"),
        (
            {"objects": [{"label": "chair", "points": [[0, 0, 0]], "sideways": [1, 0, 0]}]},
            "chair 1: needs three points",
        ),
    ],
)
def test_faults_are_named(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_prediction(written(tmp_path, document() | change), clip())


@pytest.mark.parametrize(
    ("change", "message"),
    [({"scales": [[2.0], [0.0], [0.4]]}, "scales must be positive"),
     ({"axes": [[0.0] * 3] * 3}, "axes must be unit vectors")],
)  # fmt: skip
def test_faults_of_a_published_result_are_named(
    tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    files = I3dbFolder()
    folder = files.write(tmp_path / "Hall")
    (folder / "iMapper").mkdir()
    document = {"3d": files.lifted["3d"], "scenelets": {"obbs": ["00_couch_seat.obj"]}}
    (folder / "iMapper" / "skel_output.json").write_text(json.dumps(document))
    box = files.objects["00_couch_seat"] | change
    (folder / "iMapper" / "00_couch_seat.json").write_text(json.dumps(box))
    with pytest.raises(InputError, match=rf"00_couch_seat\.json: {message}"):
        read_authors(folder)


@pytest.mark.parametrize("name", ["../../00_couch_seat.obj", "/etc/00_couch_seat.obj"])
def test_a_published_result_names_files_of_its_own_folder_only(tmp_path: Path, name: str) -> None:
    files = I3dbFolder()
    folder = files.write(tmp_path / "Hall")
    (folder / "iMapper").mkdir()
    document = {"3d": files.lifted["3d"], "scenelets": {"obbs": [name]}}
    (folder / "iMapper" / "skel_output.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"skel_output\.json: object '.*' is not named"):
        read_authors(folder)
