"""The command line as a user meets it."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imapper_prob.api import demo_clip
from imapper_prob.cli import main
from imapper_prob.clips.load import write_clip
from imapper_prob.evaluate.suite import first_part
from imapper_prob.models.scene import Clip
from imapper_prob.models.scenelet import Library
from imapper_prob.models.skeleton import DETECTED
from imapper_prob.scenelets.library import load_library, save_library
from tests.clips.i3db_folder import I3dbFolder

SHORT = "[sample]\nchains = 2\nsteps = 300\ndraws = 30\ntemperatures = 2\nensemble_steps = 8\n"


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short run of half the demo clip with a part of the built-in library, all from files."""
    base = tmp_path_factory.mktemp("run")
    write_clip(base / "clip.npz", first_part(demo_clip(), 0.5))
    save_library(Library("part", tuple(load_library())[::8]), base / "part.npz")
    (base / "short.toml").write_text(SHORT)
    arguments = ["run", str(base / "clip.npz"), "-o", str(base / "out"), "--workers", "1"]
    arguments += ["--library", str(base / "part.npz")]
    assert main([*arguments, "--config", str(base / "short.toml"), "--seed", "5"]) == 0
    return base / "out"


def test_run_writes_all_its_files(run_folder: Path) -> None:
    names = sorted(p.name for p in run_folder.iterdir())
    assert names == [
        "chains", "config.toml", "manifest.json", "posterior.nc", "recording.rrd", "report.html",
        "scenes", "scenes.json",
    ]  # fmt: skip
    shown = json.loads((run_folder / "scenes.json").read_text())["scenes"]
    models = sorted(p.name for p in (run_folder / "scenes").iterdir())
    assert models == [f"scene_{n}.glb" for n in range(1, len(shown) + 1)]
    assert "seed = 5" in (run_folder / "config.toml").read_text()
    assert json.loads((run_folder / "scenes.json").read_text())["scenes"]
    assert not list(run_folder.parent.glob(".*partial*"))


def test_the_recording_passes_reruns_own_check(run_folder: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "rerun_cli",
        "rrd",
        "verify",
        str(run_folder / "recording.rrd"),
    ]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr


def test_info_prints_the_table_again(run_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(run_folder)]) == 0
    text = capsys.readouterr().out
    assert "Scenes" in text
    assert "±" in text


def test_an_earlier_run_is_not_overwritten_by_accident(
    run_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (run_folder / "scenes.json").read_bytes()
    clip = run_folder.parent / "clip.npz"
    assert main(["run", str(clip), "-o", str(run_folder)]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert (run_folder / "scenes.json").read_bytes() == before


def test_a_folder_with_other_files_is_left_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    assert main(["demo", "-o", str(tmp_path), "--overwrite"]) == 2
    assert "thesis.tex" in capsys.readouterr().err
    assert (tmp_path / "thesis.tex").exists()


def cut_in_half(folder: Path) -> None:
    path = next(folder.glob("skel_*_2d_00.json"))
    text = path.read_text()
    path.write_text(text[: len(text) // 2])


def not_a_number(folder: Path) -> None:
    path = next(folder.glob("skel_*_2d_00.json"))
    document = json.loads(path.read_text())
    frame = sorted(document["3d"])[3]
    document["3d"][frame]["4"][0] = float("nan")
    path.write_text(json.dumps(document))


def no_intrinsics(folder: Path) -> None:
    (folder / "intrinsics.json").unlink()


def nothing(folder: Path) -> None:
    for path in sorted(folder.rglob("*"), reverse=True):
        path.unlink() if path.is_file() else path.rmdir()


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (cut_in_half, "_2d_00.json"),
        (not_a_number, "LKNE"),
        (no_intrinsics, "intrinsics.json"),
        (nothing, "not a known clip"),
    ],
)
def test_bad_input_is_one_line_exit_2_and_no_output(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], spoil, words: str
) -> None:
    folder = tmp_path / "Scene99"
    I3dbFolder().write(folder)
    spoil(folder)
    out = tmp_path / "out"
    assert main(["run", str(folder), "-o", str(out)]) == 2
    message = capsys.readouterr().err
    assert words in message
    assert message.count("\n") == 1
    assert "Traceback" not in message
    assert not out.exists()


def test_three_frames_are_too_few(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "Scene99"
    I3dbFolder().write(folder)
    path = next(folder.glob("skel_*_2d_00.json"))
    document = json.loads(path.read_text())
    for frame in sorted(document["3d"])[3:]:
        del document["3d"][frame]
    for table in ("confidence", "visibility"):
        for values in document.get(table, {}).values():
            del values[3:]
    path.write_text(json.dumps(document))
    assert main(["run", str(folder), "-o", str(tmp_path / "out")]) == 2
    assert "3 frames" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def jumping_about(clip: Clip) -> Clip:
    """The detector is somewhere else in every frame, all joints together."""
    track, rng = clip.tracks[0], np.random.default_rng(0)
    to = rng.uniform(-1.0, 1.0, (clip.n_frames, 1, 2)) * (900.0, 500.0)
    return replace(clip, tracks=(replace(track, keypoints=track.keypoints + to),))


def nobodys_joints(clip: Clip) -> Clip:
    """Every joint strays through the picture by itself."""
    track, rng = clip.tracks[0], np.random.default_rng(0)
    stray = 5.0 * np.cumsum(rng.standard_normal(track.keypoints.shape), axis=0)
    confidences = np.zeros(track.confidences.shape)
    confidences[:, list(DETECTED)] = 0.9
    points = rng.uniform(0.2, 0.8, (1, 16, 2)) * (clip.camera.width, clip.camera.height) + stray
    return replace(clip, tracks=(replace(track, keypoints=points, confidences=confidences),))


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (jumping_about, "jump across the picture as nobody does, first in frame"),
        (nobodys_joints, "are not a person's"),
    ],
)
def test_what_is_no_person_is_refused_by_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], spoil, words: str
) -> None:
    write_clip(tmp_path / "clip.npz", spoil(demo_clip()))
    out = tmp_path / "out"
    assert main(["run", str(tmp_path / "clip.npz"), "-o", str(out), "--workers", "1"]) == 2
    message = capsys.readouterr().err
    assert "clip demo, track actor: in 1" in message
    assert words in message
    assert "Traceback" not in message
    assert not out.exists()


def test_frames_elsewhere_are_named_before_a_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clip = demo_clip()
    points = np.array(clip.tracks[0].keypoints)
    points[40:52] += (-600.0, 0.0)
    spoiled = replace(clip, tracks=(replace(clip.tracks[0], keypoints=points),))
    for shown, words in ((clip, "throughout"), (spoiled, "frames 40-51")):
        write_clip(tmp_path / "clip.npz", shown)
        assert main(["info", str(tmp_path / "clip.npz")]) == 0
        assert words in capsys.readouterr().out.replace("\n", " ")


def test_checks_are_in_the_files_and_alarms_are_said_first(
    run_folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    document = json.loads((run_folder / "scenes.json").read_text())
    assert [c["name"] for c in document["checks"]] == [
        "upright", "height", "slope", "camera", "resemblance", "prediction", "elsewhere",
    ]  # fmt: skip
    assert document["alarms"] == [c["sentence"] for c in document["checks"] if c["alarmed"]]
    assert list(document).index("alarms") < list(document).index("scenes")
    told = {**document["checks"][0], "alarmed": True, "sentence": "It [/red] cannot be."}
    from imapper_prob.uncertainty import tree

    attributes = {**tree.read_attributes(run_folder / "posterior.nc"), "checks": json.dumps([told])}
    monkeypatch.setattr(tree, "read_attributes", lambda path: attributes)
    capsys.readouterr()
    assert main(["info", str(run_folder)]) == 0
    text = capsys.readouterr().out
    assert 0 < text.index("It [/red] cannot be.") < text.index("Scenes")
    assert "Checks" in text
