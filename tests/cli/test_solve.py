"""``imapper-prob solve`` as a user meets it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from imapper_prob.api import demo_clip
from imapper_prob.cli import main
from imapper_prob.cli.solve import StageClock
from imapper_prob.clips.load import write_clip
from imapper_prob.evaluate.suite import first_part
from imapper_prob.models.scenelet import Library
from imapper_prob.scenelets.library import load_library, save_library

FILES = ["candidates.png", "charness.png", "config.toml", "manifest.json", "solution.json",
         "solution.npz", "stages.rrd"]  # fmt: skip
N_FRAMES = 65


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The solution of half the demo clip with a part of the built-in library, both from files."""
    base = tmp_path_factory.mktemp("solve")
    write_clip(base / "clip.npz", first_part(demo_clip(), 0.5))
    save_library(Library("part", tuple(load_library())[::8]), base / "part.npz")
    in_a_process(base, base / "out", hashes=1)
    return base / "out"


def in_a_process(base: Path, out: Path, *, hashes: int) -> None:
    """Solve in a process of its own, as users do.

    Kernels that were compiled for other arrays may serve later calls of one process, and round
    otherwise in the last digit.
    """
    subprocess.run(
        [sys.executable, "-m", "imapper_prob.cli", *command(base, out)],
        env={**os.environ, "PYTHONHASHSEED": str(hashes)}, check=True, capture_output=True,
    )  # fmt: skip


def command(base: Path, out: Path) -> list[str]:
    return ["solve", str(base / "clip.npz"), "--library", str(base / "part.npz"), "-o", str(out)]


def test_it_writes_everything_and_leaves_nothing_else(folder: Path) -> None:
    assert sorted(p.name for p in folder.iterdir()) == FILES
    assert sorted(p.name for p in folder.parent.iterdir()) == ["clip.npz", "out", "part.npz"]


def test_the_json_tells_scenes_and_stages(folder: Path) -> None:
    document = json.loads((folder / "solution.json").read_text(encoding="utf-8"))
    assert document["format"] == "imapper-prob solution"
    assert 1 <= len(document["scenes"]) <= 5
    values = [scene["log_posterior"] for scene in document["scenes"]]
    assert values == sorted(values, reverse=True)
    (actor,) = document["actors"]
    assert sum(n for what, n in actor["frames"].items() if "detected" not in what) >= N_FRAMES
    for maximum in actor["maxima"]:
        kept = [c for c in maximum["candidates"] if c["fate"] == "kept"]
        assert len(kept) == list(maximum["counts"].values())[-1] <= 3
    assert actor["combinations"]["complete"] == (actor["combinations"]["best_score_left"] is None)


def test_no_scenelet_twice_at_nearby_times(folder: Path) -> None:
    document = json.loads((folder / "solution.json").read_text(encoding="utf-8"))
    seen: list[tuple[str, int]] = []
    for scene in document["scenes"]:
        own = [(s["scenelet"], s["start"]) for a in scene["actors"] for s in a["scenelets"]]
        assert all(name != n or abs(start - t) >= 16 for name, start in own for n, t in seen)
        seen += own
    assert len(document["scenes"]) > 1


def test_the_archive_has_motions_and_curves(folder: Path) -> None:
    count = len(json.loads((folder / "solution.json").read_text(encoding="utf-8"))["scenes"])
    with np.load(folder / "solution.npz", allow_pickle=False) as arrays:
        assert arrays["actor0/joints"].shape == (count, N_FRAMES, 16, 3)
        assert np.isfinite(arrays["actor0/joints"]).all()
        assert arrays["actor0/charness"].shape == arrays["actor0/window_frame"].shape
        assert set(arrays["actor0/pose_source"]) <= {
            "its own", "no 3D pose", "filled in by the input", "implausible pose", "bad pose",
        }  # fmt: skip


def test_the_recording_passes_reruns_own_check(folder: Path) -> None:
    check = [sys.executable, "-m", "rerun_cli", "rrd", "verify", str(folder / "stages.rrd")]
    result = subprocess.run(check, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr


def test_an_earlier_solution_is_kept(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (folder / "solution.json").read_bytes()
    assert main(command(folder.parent, folder)) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert (folder / "solution.json").read_bytes() == before


@pytest.mark.parametrize(
    ("clip", "words"), [("nowhere.npz", "no such file"), (".", "not a known clip")]
)
def test_bad_input_is_one_line_exit_2_and_no_output(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], clip: str, words: str
) -> None:
    out = tmp_path / "out"
    assert main(["solve", str(tmp_path / clip), "-o", str(out)]) == 2
    message = capsys.readouterr().err
    assert words in message
    assert message.count("\n") == 1
    assert not out.exists()


def test_what_may_be_said_of_a_clip_is_what_run_understands(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = command(folder.parent, tmp_path / "out")
    assert main([*said, "--focal", "900", "--focal-spread", ".1"]) == 2
    assert "has its own focal" in capsys.readouterr().err


def test_foreign_files_are_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    assert main(["solve", "clip.npz", "-o", str(tmp_path), "--overwrite"]) == 2
    assert "thesis.tex" in capsys.readouterr().err
    assert (tmp_path / "thesis.tex").exists()


def test_the_clock_gives_every_second_to_one_stage() -> None:
    heard = []
    clock = StageClock(lambda stage, part: heard.append((stage, part)))
    for stage, part in (("one", 1.0), ("two", 0.5), ("two", 1.0)):
        clock(stage, part)
    assert [stage for stage, _ in clock.times] == ["one", "two"]
    assert all(seconds >= 0 for _, seconds in clock.times)
    assert heard == [("one", 1.0), ("two", 0.5), ("two", 1.0)]


@pytest.mark.slow
def test_another_process_writes_the_same_bytes(folder: Path) -> None:
    """Same clip, same library: whatever the order of hashes.

    But for the recording, whose pieces are numbered at random by the library that writes it, and
    the manifest, which has its checksum.
    """
    again = folder.parent / "again"
    in_a_process(folder.parent, again, hashes=7)
    for name in FILES:
        if name not in ("stages.rrd", "manifest.json"):
            assert (again / name).read_bytes() == (folder / name).read_bytes(), name
    shutil.rmtree(again)
