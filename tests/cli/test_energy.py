"""``info --energy`` as a user meets it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from PIL import Image

from imapper_prob.cli import main
from tests.runs import posterior


@pytest.fixture
def folder(run_of_demo: Path, tmp_path: Path) -> Path:
    """A short run of the demo."""
    return Path(shutil.copytree(run_of_demo, tmp_path / "out"))


def error_of(capsys: pytest.CaptureFixture[str]) -> str:
    """The one line that was said, of nothing else but how far things are."""
    said = capsys.readouterr().err.lstrip("\n")
    assert said.startswith("imapper-prob: ")
    assert said.count("\n") == 1
    return said


def test_a_run_of_the_demo_explains_itself(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["info", "--energy", str(folder)]) == 0
    text = capsys.readouterr().out
    shown = posterior().scenes(1)[0].scene
    for name, _ in shown.assignment:
        assert name in text
    for word in ("Scenes", "free_pose", "Lost without an object", f"{shown.log_posterior:.1f}"):
        assert word in text
    document = json.loads((folder / "energy.json").read_text())
    assert [s["name"] for s in document["scenelets"]] == [name for name, _ in shown.assignment]
    assert len(document["objects"]) == len(shown.objects)
    with Image.open(folder / "energy.png") as image:
        assert min(image.size) > 600


def test_what_is_no_run_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", "--energy", str(tmp_path)]) == 2
    assert "is neither the folder of a run nor a clip" in error_of(capsys)
