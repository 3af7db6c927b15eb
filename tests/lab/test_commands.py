"""Every command of the laboratory: it says what it does, and does it, at the smallest size."""

from __future__ import annotations

import importlib
import json
import re
from pathlib import Path

import numpy as np
import pytest

from imapper_prob.clips.load import load_clip
from imapper_prob.evaluate.i3db import read_authors
from imapper_prob.evaluate.prediction import write_prediction
from imapper_prob.files import written_whole
from imapper_prob.models.calibrated import constants
from imapper_prob.models.scenelet import Library
from imapper_prob.scenelets.library import load_library
from tests.conftest import CORPUS, ROOT

LAB = ROOT / "lab"
SCENE = "Scene04"
"""The shortest."""


def commands() -> list[str]:
    """Modules that are run: those with a ``main``."""
    paths = sorted(LAB.rglob("*.py"))
    return [
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for path in paths
        if re.search(r"^def main\(arguments", path.read_text(encoding="utf-8"), re.MULTILINE)
    ]


def run(name: str, *arguments: str | Path) -> int | None:
    """In this process."""
    name = f"{name}.__main__" if (LAB / Path(*name.split(".")[1:])).is_dir() else name
    module = importlib.import_module(name)
    status: int | None = module.main([str(argument) for argument in arguments])
    return status


@pytest.fixture
def scenes(tmp_path: Path) -> Path:
    """A folder with one i3DB scene."""
    if not CORPUS.is_dir():
        pytest.skip(f"the i3DB scenes are not at {CORPUS}")
    folder = tmp_path / "scenes"
    folder.mkdir()
    (folder / SCENE).symlink_to(CORPUS / SCENE, target_is_directory=True)
    return folder


def test_there_are_commands() -> None:
    assert {"lab.speed", "lab.calibrate.__main__", "lab.eryn.evidence"} <= set(commands())


@pytest.mark.parametrize("name", commands())
def test_a_command_says_what_it_does(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    module = importlib.import_module(name)
    with pytest.raises(SystemExit) as ended:
        module.main(["--help"])
    assert ended.value.code == 0
    said = f"python -m {name.removesuffix('.__main__')}"
    assert f"    {said} " in str(module.__doc__)
    assert said in capsys.readouterr().out
    assert f"`{said}" in (LAB / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("path", sorted(LAB.rglob("*.py")), ids=lambda p: str(p.relative_to(LAB)))
def test_a_module_can_be_loaded(path: Path) -> None:
    if path.stem == "theirs":
        pytest.importorskip("eryn", reason="Eryn has an environment of its own")
    name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
    assert importlib.import_module(name.removesuffix(".__init__")).__doc__


def test_what_is_added_up_by_other_commands_stays(tmp_path: Path) -> None:
    from lab.speed import note

    file = tmp_path / "results.json"
    file.write_text('{"theirs": 1.0, "ours": 2.0}')
    note({"ours": 3.00004}, file)
    assert json.loads(file.read_text()) == {"theirs": 1.0, "ours": 3.0}


@pytest.mark.slow
def test_newcomer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("lab.newcomer", tmp_path / "new", "--borrow", "--brief") == 0
    told = capsys.readouterr().out
    assert told.count("| `") >= 15
    assert "\n0 went otherwise" in told


@pytest.mark.slow
def test_camera_heights(capsys: pytest.CaptureFixture[str]) -> None:
    run("lab.camera_heights", "2")
    assert capsys.readouterr().out.count("\n| ") == 3


@pytest.mark.slow
def test_crossings(capsys: pytest.CaptureFixture[str]) -> None:
    run("lab.crossings", "1")
    assert capsys.readouterr().out.count("skeletons right") == 6


def test_couple(tmp_path: Path) -> None:
    run("lab.couple", tmp_path / "table", "3")
    assert load_clip(tmp_path / "table" / "couple.npz").n_frames == 60
    assert (tmp_path / "table" / "chairs.npz").exists()


def test_takes_hold_one_piece_each() -> None:
    from lab.takes import takes_of

    takes, pieces = takes_of(0)
    assert [piece.label for piece in pieces] == ["couch", "shelf", "bed"]
    assert [take.name for take in takes] == ["take 1", "take 2", "take 3"]
    assert sum(take.n_frames for take in takes) == 240
    assert min(take.n_frames for take in takes) >= 50


@pytest.mark.slow
def test_takes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("lab.takes", tmp_path / "takes", "--steps", "100", "--workers", "1")
    told = capsys.readouterr().out
    assert "| piece | take 1 | take 2 | take 3 | together |" in told
    assert told.count("| ") > 15


@pytest.mark.slow
def test_speed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("lab.speed", "--seconds", "0.1", "-o", tmp_path / "results.json")
    found = json.loads((tmp_path / "results.json").read_text())
    assert found["demo_chain_steps_per_second"] > 0
    told = capsys.readouterr().out
    assert all(name in told for name in found)
    assert found.keys() <= json.loads((LAB / "results.json").read_text()).keys()


@pytest.mark.slow
def test_stages_of_the_solver(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from lab import speed

    monkeypatch.setattr(speed, "FRAMES", 130)
    monkeypatch.setattr(speed, "SCENELETS", 150)
    monkeypatch.setattr(speed, "INTERACTIONS", 1)
    run("lab.speed", "--solver")
    assert "Both runs agree to the last bit: yes" in capsys.readouterr().out
    run("lab.speed", "--fits", "cpu")
    assert "in 1.0000 of the fits" in capsys.readouterr().out


@pytest.mark.slow
def test_digests(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from lab import digests

    made, runs = digests.made, dict[str, dict[str, str]]()

    def made_once(folder: Path, run: str) -> dict[str, str]:
        if run not in runs:
            runs[run] = made(folder, run)
        return runs[run]

    monkeypatch.setattr(digests, "made", made_once)
    assert run("lab.digests", tmp_path / "digests.json", "--only", "one-worker") == 0
    assert "all arrays are the same" in capsys.readouterr().out
    found = json.loads((tmp_path / "digests.json").read_text())
    changed = next(iter(found["one-worker"]))
    found["one-worker"][changed] = "0"
    with written_whole(tmp_path / "digests.json") as beside:
        beside.write_text(json.dumps(found))
    assert run("lab.digests", tmp_path / "digests.json", "--only", "one-worker") == 1
    told = capsys.readouterr().out
    assert changed in told
    assert all(name not in told for name in found["one-worker"] if name != changed)


@pytest.mark.slow
def test_scaling(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from lab import mixing

    monkeypatch.setattr(mixing, "REPEATS", 1)
    monkeypatch.setattr(mixing, "note", lambda found: None)
    run("lab.mixing", "--scaling", "--steps", "50")
    assert "best on two over best on one" in capsys.readouterr().out


@pytest.mark.slow
def test_coverage(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from dataclasses import replace

    from lab import coverage

    brief = replace(coverage.DRAWN_SETTINGS, steps=800, draws=40)
    monkeypatch.setattr(coverage, "DRAWN_SETTINGS", brief)
    arguments = ["--drawn", "1", "--plausible", "1", "--wrong", "0", "--workers", "1"]
    run("lab.coverage", tmp_path, *arguments, "--picture", tmp_path / "curves.png")
    assert "plausible" in capsys.readouterr().out
    assert (tmp_path / "curves.png").stat().st_size > 10_000


@pytest.mark.slow
def test_alarms(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("lab.alarms", "1", "--only", "random joints") == 0
    assert re.search(r"random joints \| [01] of 1", capsys.readouterr().out)
    assert run("lab.alarms", "1", "--threshold") == 0
    assert "95 % by clip" in capsys.readouterr().out


@pytest.mark.slow
def test_unseen(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from lab.unseen.clips import UNCARRIED

    run("lab.unseen", tmp_path, "--clips", "1", "--only", UNCARRIED[0])
    assert f"| {UNCARRIED[0]} |" in capsys.readouterr().out


@pytest.mark.slow
def test_seats(run_of_demo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("lab.seats", run_of_demo, "-o", tmp_path / "maps.png")
    assert "something to sit on with p = " in capsys.readouterr().out
    assert (tmp_path / "maps.png").exists()


@pytest.mark.corpus
def test_misses(scenes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "suite" / SCENE).mkdir(parents=True)
    solution = tmp_path / "suite" / SCENE / "solver.json"
    write_prediction(solution, read_authors(scenes / SCENE), load_clip(scenes / SCENE))
    run("lab.misses", scenes, tmp_path / "suite")
    assert "| all of the found ones true | " in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.corpus
def test_lifting(scenes: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("lab.lifting", scenes)
    assert "mean: poses " in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.corpus
def test_parts_of_the_path(scenes: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("lab.ablation", scenes, "--path")
    rows = capsys.readouterr().out.splitlines()
    assert len(rows) == 14
    assert sum("pitch unknown" in row for row in rows) == 1
    assert {row.count("|") for row in rows if row.startswith("|")} == {8}


@pytest.mark.slow
@pytest.mark.corpus
def test_terms(
    scenes: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    first = min(scenes.iterdir())
    (tmp_path / first.name).symlink_to(first)
    part = Library("part", tuple(load_library())[::192])
    monkeypatch.setattr("lab.ablation.load_library", lambda: part)
    run("lab.ablation", tmp_path)
    told = capsys.readouterr().out
    assert "no sight lines" in told
    assert "published, no " in told


@pytest.mark.slow
@pytest.mark.corpus
def test_truth_and_rivals(scenes: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("lab.preference", scenes)
    assert "of them granted by the authors" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.corpus
def test_unfound(scenes: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("lab.unfound", scenes)
    assert capsys.readouterr().out.count("| scene | true |") == 2


@pytest.mark.slow
@pytest.mark.corpus
def test_pinned(
    scenes: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    part = Library("part", tuple(load_library())[::24])
    monkeypatch.setattr("imapper_prob.load_library", lambda: part)
    run("lab.pinned", scenes / SCENE, tmp_path / "pinned.png", "--steps", "400", "--workers", "1")
    told = capsys.readouterr().out
    assert told.startswith("Given: ")
    assert re.search(r"^after: [012] of 2 found, \d+ cm with misses, joints ", told, re.MULTILINE)
    assert (tmp_path / "pinned.png").stat().st_size > 10_000


@pytest.mark.slow
@pytest.mark.corpus
def test_libraries(scenes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("lab.libraries", scenes, tmp_path / "out", "--seeds", "1", "--workers", "1")
    assert "| mean |" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.corpus
def test_mixing(
    scenes: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from lab import mixing

    noted: dict[str, float] = {}
    monkeypatch.setattr(mixing, "note", noted.update)
    run("lab.mixing", scenes, tmp_path / "out", "--scenes", SCENE, "--steps", "100")
    assert capsys.readouterr().out.count(f"| {SCENE} |") == 2
    assert all(np.isscalar(value) for value in noted.values())
    assert len(noted) == 8


@pytest.mark.slow
@pytest.mark.corpus
def test_spoiled(scenes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from lab.spoiled.spoilings import SPOILINGS

    options = ["--scenes", scenes, "--only", SPOILINGS[0].name, "--static", "--workers", "1"]
    assert run("lab.spoiled", *options, "--results", tmp_path) == 0
    assert f"| {SPOILINGS[0].name} | " in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.corpus
def test_elsewhere(scenes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "paths.png"
    run("lab.elsewhere", *sorted(scenes.iterdir()), "--draws", "1", "--picture", picture)
    assert picture.stat().st_size > 10_000
    assert "| unspoiled | " in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.corpus
def test_scenelets(scenes: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # Real scenelets come from the other scenes.
    run("lab.scenelets", CORPUS)
    assert re.search(r"^other scenes +0\.", capsys.readouterr().out, re.MULTILINE)


def test_constants_are_of_all_four_scenes(scenes: Path) -> None:
    with pytest.raises(SystemExit, match="other scenes than the folds"):
        run("lab.calibrate", scenes)


@pytest.mark.slow
@pytest.mark.corpus
def test_constants(
    scenes: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What scenes give is tested by ``tests/lab/calibrate/test_stored.py``."""
    monkeypatch.setattr("lab.calibrate.__main__.calibrate", lambda *_: dict(constants()))
    run("lab.calibrate", CORPUS, "--clips", "2")
    assert re.search(r"^mean: pelvis ", capsys.readouterr().out, re.MULTILINE)
