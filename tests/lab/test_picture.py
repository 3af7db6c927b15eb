"""The viewer itself draws a recording, and complains of nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Scene
from imapper_prob.recording.log import write_recording
from imapper_prob.uncertainty.scenes import WeightedScene
from lab.picture import PictureUnavailable, main, render_recording
from tests.recording.room import make_certainty, make_chains, make_room, make_traces


def render(recording: Path, png: Path, **size: int) -> list[str]:
    try:
        return render_recording(recording, png, **size)
    except PictureUnavailable as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    clip, scenes, truth = make_room(40)
    path = tmp_path_factory.mktemp("picture") / "room.rrd"
    write_recording(
        path,
        clip=clip,
        scenes=scenes,
        traces=make_traces(),
        truth=truth,
        # The viewer ends at a sign that its font does not have.
        description="# A room, 部屋 █",
        certainty=make_certainty(20, scenes),
        draws=make_chains(20, 40, scenes),
        acceptance={"birth": 0.02, "path": 0.9},
    )
    return path


def test_a_picture_without_a_complaint(recording: Path, tmp_path: Path) -> None:
    png = tmp_path / "room.png"
    assert render(recording, png, width=1200, height=800) == []
    assert png.stat().st_size < 1_500_000
    with Image.open(png) as image:
        assert image.size == (1200, 800)
        colours = np.asarray(image.convert("RGB"), dtype=int).reshape(-1, 3)
    # The person is there (yellow) and so is a couch (teal): the views are not blank.
    yellow = (colours[:, 0] > 200) & (colours[:, 1] > 160) & (colours[:, 2] < 130)
    teal = (colours[:, 1] - colours[:, 0] > 30) & (abs(colours[:, 1] - colours[:, 2]) < 20)
    assert yellow.sum() > 500
    assert teal.sum() > 500
    assert list(tmp_path.iterdir()) == [png]


def test_an_empty_room_is_no_reason_to_complain(tmp_path: Path) -> None:
    clip, scenes, _ = make_room(5)
    scene = Scene(scenes[0].scene.camera, (), np.full((5, 16, 3), np.nan), (), 0.0)
    empty = WeightedScene(scene, 1.0, 0.0, np.zeros((0, 2, 2)), np.zeros((0, 5, 16, 3)))
    path = tmp_path / "room.rrd"
    write_recording(path, clip=clip, scenes=[empty, empty], traces={}, description="")
    assert render(path, tmp_path / "room.png", width=640, height=480) == []


def test_no_driver_is_said_in_one_line(
    recording: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for variable in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES"):
        monkeypatch.setenv(variable, str(tmp_path / "none.json"))
    png = tmp_path / "room.png"
    with pytest.raises(SystemExit) as end:
        main([str(recording), str(png)])
    assert end.value.code == 2
    assert "mesa-vulkan-drivers" in capsys.readouterr().err
    assert not png.exists()


def test_a_missing_recording_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nothing\.rrd: no such recording"):
        render_recording(tmp_path / "nothing.rrd", tmp_path / "a.png")
