"""Runs that are gone on with, by the command line."""

from __future__ import annotations

import shutil
from argparse import Namespace
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import imapper_prob
from imapper_prob.api import demo_clip
from imapper_prob.cli import main
from imapper_prob.cli.going_on import how_to_go_on, words_of_block
from imapper_prob.clips.load import write_clip
from imapper_prob.config import read_config
from imapper_prob.evaluate.suite import first_part
from imapper_prob.models.scenelet import Library
from imapper_prob.samplers.verdict import Measures, Verdict
from imapper_prob.sampling.blocks import Block
from imapper_prob.scenelets.library import load_library, save_library

BRIEF = (
    "seed = 4\n[sample]\nsteps = 300\nburn_in = 0.4\ndraws = 6\nchains = 2\ntemperatures = 2\n"
    "ensemble_steps = 2\n"
)


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a clip, a small library, settings, and a finished run ``out``."""
    folder = tmp_path_factory.mktemp("going-on")
    write_clip(folder / "clip.npz", first_part(demo_clip(), 0.5))
    save_library(Library("part", tuple(load_library())[::16]), folder / "part.npz")
    (folder / "brief.toml").write_text(BRIEF)
    assert main(command(folder, folder / "out", "--config", str(folder / "brief.toml"))) == 0
    return folder


def command(base: Path, out: Path, *more: str) -> list[str]:
    arguments = ["run", str(base / "clip.npz"), "-o", str(out), "--workers", "1"]
    return [*arguments, "--library", str(base / "part.npz"), *more]


def test_a_finished_run_goes_on_as_one_that_was_longer_from_the_start(
    base: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, whole = tmp_path / "out", tmp_path / "whole"
    shutil.copytree(base / "out", out)
    assert sorted(p.name for p in (out / "chains").iterdir()) == ["chain-0.npz", "chain-1.npz"]
    assert '"chains/chain-1.npz"' in (out / "manifest.json").read_text()
    assert main(command(base, out, "--steps", "600")) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "Not converged: " in said
    assert f"imapper-prob run {base / 'clip.npz'} -o {out} --workers 1" in said
    assert "--until good --minutes" in said
    config = read_config(out / "config.toml")
    assert (config.seed, config.sample.steps, config.sample.last_step) == (4, 300, 600)
    assert not (out / "checkpoints").exists()
    # What it wrote about itself repeats it in one go.
    assert main(command(base, whole, "--config", str(out / "config.toml"))) == 0
    one, other = imapper_prob.load_posterior(out), imapper_prob.load_posterior(whole)
    assert one.samples.shape == (2, 9)  # 140 rounds, whole pieces
    np.testing.assert_array_equal(one.samples.log_posterior, other.samples.log_posterior)
    assert (out / "scenes.json").read_bytes() == (whole / "scenes.json").read_bytes()


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ((), "holds a finished run of 300 steps, and no more is asked for; go on with --minutes"),
        (("--steps", "300"), "holds a finished run of 300 steps, and no more is asked for"),
        (("--steps", "200"), "--steps 200: "),
        (("--steps", "600", "--minutes", "1"), "leave --steps out"),
        (("--seed", "5", "--minutes", "1"), "holds a run with seed = 4, not 5"),
        (("--preset", "paper", "--minutes", "1"), "holds a run with model.energy = default"),
        (("--frames", "0:40", "--minutes", "1"), "holds a run of another clip"),
        (("--library", "built-in", "--minutes", "1"), "holds a run of another library"),
        (("--minutes", "0"), "minutes = 0 must be a positive number"),
        (("--minutes", "nan"), "minutes = nan must be a positive number"),
    ],
)
def test_what_cannot_be_gone_on_with_is_refused_and_left_alone(
    base: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    more: tuple[str, ...],
    words: str,
) -> None:
    monkeypatch.setattr(imapper_prob, "sample", None)  # nothing is computed
    before = {path: path.stat().st_mtime_ns for path in (base / "out").rglob("*")}
    assert main(command(base, base / "out", *more)) == 2
    assert words in capsys.readouterr().err
    assert before == {path: path.stat().st_mtime_ns for path in (base / "out").rglob("*")}


def test_a_good_run_has_nothing_left_to_do(
    base: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from imapper_prob.results import folders

    earlier = folders.earlier_run(base / "out")
    assert earlier is not None
    assert not earlier.good
    good = replace(earlier, good=True, verdict="Converged: so it is.")
    monkeypatch.setattr(folders, "earlier_run", lambda _: good)
    monkeypatch.setattr(imapper_prob, "sample", None)
    assert main(command(base, base / "out", "--until", "good")) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "Converged: so it is. Nothing is left to do." in said


def changed(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def missing(path: Path) -> None:
    path.unlink()


@pytest.mark.parametrize(
    ("spoil", "words"),
    [(changed, "is not the file that was written"), (missing, "its chain cannot go on")],
)
def test_chains_that_are_not_what_was_written_are_refused(
    base: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], spoil: object, words: str
) -> None:
    out = tmp_path / "out"
    shutil.copytree(base / "out", out)
    spoil(out / "chains" / "chain-1.npz")  # type: ignore[operator]
    assert main(command(base, out, "--minutes", "1")) == 2
    error = capsys.readouterr().err
    assert words in error
    assert "chain-1.npz" in error
    assert (out / "scenes.json").read_bytes() == (base / "out" / "scenes.json").read_bytes()


def test_a_run_of_another_version_is_refused(
    base: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("imapper_prob.results.folders.version", lambda _: "9.9")
    assert main(command(base, base / "out", "--minutes", "1")) == 2
    assert "which imapper-prob 9.9 cannot go on with" in capsys.readouterr().err


def block(**changed: object) -> Block:
    known = Block(
        steps=30_000,
        draws=400,
        finished=True,
        measures=Measures(
            error=0.123,
            rhat=1.04,
            rhat_of="number of objects",
            effective_draws=80.0,
            effective_draws_of="layout 2",
            effective_layouts=90.0,
            comparable=True,
        ),
        verdict=Verdict(False, 900, None, ""),
        seconds=60.0,
        seconds_to_good=300.0,
        seconds_left=40.0,
    )
    return replace(known, **changed)  # type: ignore[arg-type]


def test_a_block_is_one_line() -> None:
    assert words_of_block(3, block()) == (
        "block 3, 30000 steps: probabilities off by 0.13, R-hat 1.04, 90 effective draws of "
        "layouts; 40 s left, good in about 5 min"
    )
    assert words_of_block(3, block(seconds_left=0.0)).endswith("; the time is up")
    assert words_of_block(3, block(finished=False)).endswith("; interrupted")
    good = block(verdict=Verdict(True, 0, None, ""), seconds_to_good=0.0)
    assert words_of_block(3, good).endswith("; good")


def test_the_command_that_goes_on_is_the_one_that_was_given() -> None:
    given = [
        "run",
        "my clip",
        "-o",
        "out",
        "--steps",
        "300",
        "--minutes=2",
        "--overwrite",
        "--fps",
        "5",
    ]
    said = how_to_go_on(block(), Namespace(words=given))
    assert said == (
        "About 5 min more are needed; go on with\n"
        "  imapper-prob run 'my clip' -o out --fps 5 --until good --minutes 5"
    )
    unknown = how_to_go_on(block(seconds_to_good=float("nan")), Namespace(words=given))
    assert unknown.endswith("--minutes 10")
    disagree = block(
        verdict=Verdict(False, 0, (1, 2), ""), seconds_to_good=float("nan"), seconds=1200.0
    )
    assert "or not:" in how_to_go_on(disagree, Namespace(words=given))
    assert how_to_go_on(disagree, Namespace(words=given)).endswith("--minutes 20")
    never = how_to_go_on(block(seconds_to_good=1e6), Namespace(words=given))
    assert "too long to be worth it" in never
