"""``info --energy`` as a user meets it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from imapper_prob.cli import main
from imapper_prob.demo import demo_clip
from imapper_prob.inputs import write_clip
from imapper_prob.models.scenelet import Library
from imapper_prob.output import write_run
from imapper_prob.scenelets.library import built_in_library, save_library
from tests.runs import posterior


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A short run of the demo."""
    write_run(tmp_path / "out", posterior(), overwrite=False)
    return tmp_path / "out"


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
    for name, _ in shown.layout:
        assert name in text
    for word in ("Layouts", "free_pose", "Lost without an object", f"{shown.log_posterior:.1f}"):
        assert word in text
    document = json.loads((folder / "energy.json").read_text())
    assert [s["name"] for s in document["scenelets"]] == [name for name, _ in shown.layout]
    assert len(document["objects"]) == len(shown.objects)
    with Image.open(folder / "energy.png") as image:
        assert min(image.size) > 600


def test_the_clip_can_be_named(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Any other clip than the run's is refused, by its name or by what is in it."""
    clip = demo_clip()
    write_clip(tmp_path / "other.npz", replace(clip, name="other"))
    assert main(["info", str(folder), "--energy", "--clip", str(tmp_path / "other.npz")]) == 2
    assert "clip demo, not of other" in error_of(capsys)
    person = clip.tracks[0]
    moved = replace(person, keypoints=np.asarray(person.keypoints) + 1)
    write_clip(tmp_path / "demo.npz", replace(clip, tracks=(moved,)))
    assert main(["info", str(folder), "--energy", "--clip", str(tmp_path / "demo.npz")]) == 2
    assert "other detections" in error_of(capsys)
    assert not (folder / "energy.json").exists()


def test_a_clip_that_cannot_be_made_again_must_be_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = posterior()
    office = replace(run.solution, clip=replace(run.clip, name="office"))
    write_run(tmp_path / "out", replace(run, solution=office), overwrite=False)
    assert main(["info", "--energy", str(tmp_path / "out")]) == 2
    assert "--clip" in error_of(capsys)


def test_another_library_is_told_apart(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    few = tmp_path / "few.npz"
    save_library(Library("few", built_in_library().scenelets[:5]), few)
    settings = folder / "config.toml"
    settings.write_text(settings.read_text().replace('"built-in"', f'"{few}"'))
    assert main(["info", "--energy", str(folder)]) == 2
    assert "another library" in capsys.readouterr().err


def test_files_of_two_runs_are_told_apart(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenes = folder / "scenes.json"
    document = json.loads(scenes.read_text())
    document["scenes"][0]["log_posterior"] -= 1.0
    scenes.write_text(json.dumps(document))
    assert main(["info", "--energy", str(folder)]) == 2
    assert "not of the same run" in capsys.readouterr().err


def test_a_clip_without_energy_is_a_mistake(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["info", str(folder), "--clip", "clip.npz"]) == 2
    assert "--energy" in error_of(capsys)


def test_what_is_no_run_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", "--energy", str(tmp_path)]) == 2
    assert "cannot be read" in error_of(capsys)
