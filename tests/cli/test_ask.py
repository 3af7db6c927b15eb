"""``ask`` and ``run --given`` by the command line."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import imapper_prob as im
from imapper_prob.api import demo_clip
from imapper_prob.cli import main
from imapper_prob.clips.load import write_clip
from imapper_prob.evaluate.suite import first_part
from imapper_prob.models.scenelet import Library
from imapper_prob.scenelets.library import load_library, save_library

BRIEF = (
    "seed = 4\n[sample]\nsteps = 200\ndraws = 10\nchains = 2\ntemperatures = 2\n"
    "ensemble_steps = 2\n"
)
MILD = "[camera]\nheight = [1.5, 1.0]\n"


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a clip, a small library, settings, statements, and a run given them."""
    folder = tmp_path_factory.mktemp("ask")
    write_clip(folder / "clip.npz", first_part(demo_clip(), 0.5))
    save_library(Library("part", tuple(load_library())[::16]), folder / "part.npz")
    (folder / "brief.toml").write_text(BRIEF)
    (folder / "mild.toml").write_text(MILD)
    assert main([*command(folder, folder / "out"), "--given", str(folder / "mild.toml")]) == 0
    return folder


def command(base: Path, out: Path) -> list[str]:
    arguments = ["run", str(base / "clip.npz"), "-o", str(out), "--workers", "1"]
    more = ["--library", str(base / "part.npz"), "--config", str(base / "brief.toml")]
    return [*arguments, *more]


def ask(base: Path, text: str, *more: str) -> list[str]:
    (base / "given.toml").write_text(text)
    arguments = ["ask", str(base / "out"), "--given", str(base / "given.toml"), "--workers", "1"]
    return [*arguments, "-o", str(base / "told"), "--library", str(base / "part.npz"), *more]


def test_a_run_that_is_given_something_says_so(base: Path) -> None:
    told = im.load_posterior(base / "out").told
    assert told is not None
    assert told.text == "Given: height 1.5 ± 1 m."


def test_a_finished_run_is_asked(base: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(ask(base, "[person]\nstature = [1.7, 0.5]\n")) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "Given: height 1.5 ± 1 m, stature 1.7 ± 0.5 m. Log evidence ratio -0." in said
    assert "What changed" in said
    assert "camera height" in said
    files = {path.name for path in (base / "told").iterdir()}
    assert {"posterior.nc", "recording.rrd", "report.html", "changes.json"} <= files
    # It is a run like any other, which is not replaced unasked.
    assert main(ask(base, "[person]\nstature = [1.7, 0.5]\n")) == 2
    assert "--overwrite" in capsys.readouterr().err
    shutil.rmtree(base / "told")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[camera]\nheight = 3", "must be [value, standard deviation]"),
        ('[[present]]\nlabel = "piano"', "has no 'piano'"),
        ('[[object]]\nlabel = "couch"\nplace = [0, -3]', "behind the camera"),
        ('[[joint]]\njoint = "PELV"\nframe = 9999\npoint = [0, 3, 1]\nstd = 1', "no frame 9999"),
        ("[camera]\nheight = [9.0, 0.01]", "contradict each other"),
    ],
)
def test_what_cannot_be_known_is_refused(
    base: Path, text: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    # The run was given a height of 1.5 m, give or take one.
    assert main(ask(base, text)) == 2
    assert words in " ".join(capsys.readouterr().err.split())
    assert not (base / "told").exists()


def test_a_run_does_not_go_on_with_other_statements(
    base: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(base / "out", tmp_path / "out")
    arguments = ["run", str(base / "clip.npz"), "-o", str(tmp_path / "out"), "--workers", "1"]
    more = ["--library", str(base / "part.npz"), "--steps", "400"]
    assert main([*arguments, *more]) == 2
    assert "with other statements" in " ".join(capsys.readouterr().err.split())
    assert main([*arguments, *more, "--given", str(base / "mild.toml")]) == 0
