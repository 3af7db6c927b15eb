"""Libraries on the command line: built, shown, plotted, recorded."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from imapper_prob.cli import main
from imapper_prob.models.scenelet import Library
from imapper_prob.scenelets.captures import Capture, write_capture
from imapper_prob.scenelets.library import built_in_library, load_library, save_library
from tests.scenelets.motions import box, standing


@pytest.fixture(scope="module")
def capture() -> Capture:
    """Somebody who glides past a chair for six seconds, then stands for two."""
    joints = standing(80)
    joints[:, :, 1] += np.minimum(np.arange(80), 60)[:, None] * 0.1
    actions = ("walk",) * 60 + ("stand",) * 20
    return Capture("hall", "hall", joints, (box("chair", x=0.6, y=3.0),), 10.0, actions)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory, capture: Capture) -> Path:
    path = tmp_path_factory.mktemp("recordings") / "hall.npz"
    write_capture(path, capture)
    return path


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file with every fortieth scenelet of the built-in library."""
    path = tmp_path_factory.mktemp("library") / "few.npz"
    save_library(Library("few", built_in_library().scenelets[::40]), path)
    return path


def error_of(capsys: pytest.CaptureFixture[str]) -> str:
    """The one line that was said, of nothing else."""
    said = capsys.readouterr().err
    assert said.startswith("imapper-prob: ")
    assert said.count("\n") == 1
    assert "Traceback" not in said
    return said


def test_a_library_is_built_from_a_capture_file(
    recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "new" / "mine.npz"
    assert main(["scenelets", "build", "--from", "npz", str(recordings), "-o", str(out)]) == 0
    built = load_library(out)
    assert built.name == "mine"
    assert {"walk", "stand"} == {s.action for s in built}
    assert any("chair" in s.labels for s in built)
    text = capsys.readouterr().out
    assert f"{len(built)} scenelets from 1 captures" in text
    assert "built-in," in text
    assert [p.name for p in out.parent.iterdir()] == ["mine.npz"]


def test_info_counts_by_action_and_category(
    library: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "160")
    assert main(["scenelets", "info", "--library", str(library)]) == 0
    text = capsys.readouterr().out
    few = load_library(library)
    assert f"few: {len(few)} scenelets, digest {few.digest[:12]}" in text
    for word in {s.action for s in few} | {label for s in few for label in s.labels}:
        assert word in text


@pytest.mark.slow
def test_plot_writes_three_pictures(library: Path, tmp_path: Path) -> None:
    folder = tmp_path / "figures"
    assert main(["scenelets", "plot", "--library", str(library), "-o", str(folder)]) == 0
    names = sorted(p.name for p in folder.iterdir())
    assert names == ["charness.png", "embedding.png", "furniture.png"]
    for path in folder.iterdir():
        with Image.open(path) as image:
            assert min(image.size) > 300


def test_record_writes_a_sheet(library: Path, tmp_path: Path) -> None:
    path = tmp_path / "sheet.rrd"
    assert main(["scenelets", "record", "--library", str(library), "-o", str(path)]) == 0
    assert path.read_bytes()[:3] == b"RRF"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("command", "name"), [("plot", "embedding.png"), ("record", "a.rrd"), ("build", "a.npz")]
)
def test_nothing_is_overwritten_by_accident(
    command: str,
    name: str,
    library: Path,
    recordings: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    there = tmp_path / name
    there.write_bytes(b"years of work")
    words = {
        "plot": ["--library", str(library), "-o", str(tmp_path)],
        "record": ["--library", str(library), "-o", str(there)],
        "build": ["--from", "npz", str(recordings), "-o", str(there)],
    }[command]
    assert main(["scenelets", command, *words]) == 2
    assert "--overwrite" in error_of(capsys)
    assert there.read_bytes() == b"years of work"
    assert list(tmp_path.iterdir()) == [there]
    assert main(["scenelets", command, *words, "--overwrite"]) == 0
    assert there.read_bytes() != b"years of work"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["info", "--library", "nowhere.npz"], "nowhere.npz: no such file"),
        (["record", "-o", "sheet.png"], "must end in .rrd"),
        (["build", "--from", "npz", "nowhere.npz", "-o", "a.npz"], "nowhere.npz"),
        (["build", "--from", "i3db", "nowhere", "-o", "a.npz"], "nowhere"),
        (["build", "--from", "pigraphs", "nowhere", "-o", "a.npz"], "nowhere"),
        (["build", "--from", "npz", "nowhere.npz", "-o", "a.txt"], "must end in .npz"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(
    words: list[str],
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["scenelets", *words]) == 2
    assert said in error_of(capsys)
    assert list(tmp_path.iterdir()) == []


def test_what_the_disk_refuses_is_said(
    recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("no folder")
    out = tmp_path / "file" / "mine.npz"
    assert main(["scenelets", "build", "--from", "npz", str(recordings), "-o", str(out)]) == 2
    assert "is a file; name another folder" in error_of(capsys)


def test_a_recording_of_nobody_is_no_library(
    tmp_path: Path, capture: Capture, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "nobody.npz"
    write_capture(path, capture)
    with np.load(path) as archive:
        arrays = dict(archive)
    arrays["joints"] = np.full_like(arrays["joints"], np.nan)
    np.savez(path, **arrays)
    out = tmp_path / "a.npz"
    assert main(["scenelets", "build", "--from", "npz", str(path), "-o", str(out)]) == 2
    assert "nobody.npz" in error_of(capsys)
    assert not out.exists()


def test_debug_shows_the_traceback() -> None:
    with pytest.raises(ValueError, match="no such file"):
        main(["scenelets", "info", "--library", "nowhere.npz", "--debug"])


def test_a_source_must_be_known(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["scenelets", "build", "--from", "bvh", "a.bvh", "-o", "a.npz"])
    assert end.value.code == 2
    assert "i3db" in capsys.readouterr().err
