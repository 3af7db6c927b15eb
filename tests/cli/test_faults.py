"""The command line under interrupts, strange names, and folders that hold something."""

from __future__ import annotations

import json
import os
import shutil
import signal
import time
from argparse import Namespace
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import imapper_prob
from imapper_prob.api import demo_clip
from imapper_prob.cli import main
from imapper_prob.cli.console import (
    Stopped,
    Terminated,
    console,
    interrupt_message,
    printable,
    stoppable,
)
from imapper_prob.clips.load import write_clip
from imapper_prob.config import SampleSettings
from imapper_prob.evaluate.suite import first_part
from imapper_prob.models.scene import SceneObject
from imapper_prob.models.scenelet import Library
from imapper_prob.results.posterior import Posterior
from imapper_prob.sampling import ensembles
from imapper_prob.sampling.sample import sample_scenes
from imapper_prob.scenelets.library import load_library, save_library
from tests.runs import SHORT, half_library, posterior, small_posterior, small_solution

TINY = "[sample]\nsteps = 60\ndraws = 5\ntemperatures = 2\nchains = 2\nensemble_steps = 2\n"
HOSTILE = "a[/red]\x1b[31m$\\frac{$\n<script>\udce8"
"""Markup of rich, an order to the terminal, half a formula, HTML, and a byte of Latin-1."""


def renamed(o: SceneObject) -> SceneObject:
    return replace(o, label="$\\frac{$[/b]" if o.label == "couch" else o.label)


@pytest.fixture(scope="module")
def hostile_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str, str]:
    """A run with such names wherever a user can put one, its output and its errors."""
    base = tmp_path_factory.mktemp("hostile")
    (base / "tiny.toml").write_text(TINY)
    clip = first_part(demo_clip(), 0.5)
    track = replace(clip.tracks[0], name=HOSTILE)
    write_clip(base / "clip.npz", replace(clip, name=HOSTILE, tracks=(track,)))
    scenelets = [s for s in load_library() if s.name.startswith(("sit-couch", "walk"))][::4]
    spoiled = [replace(s, objects=tuple(map(renamed, s.objects))) for s in scenelets]
    library = base / "part\nof\x1b[31mit.npz"
    save_library(Library(HOSTILE, tuple(spoiled)), library)
    out = base / "[/red]$\\frac{$\x1b[31mout"
    arguments = ["run", str(base / "clip.npz"), "-o", str(out), "--workers", "1"]
    arguments += ["--library", str(library), "--config", str(base / "tiny.toml")]
    with (
        (base / "stdout").open("w", encoding="utf-8") as stdout,
        (base / "stderr").open("w", encoding="utf-8") as stderr,
        redirect_stdout(stdout),
        redirect_stderr(stderr),
    ):
        assert main(arguments) == 0
        for command in (["info"], ["info", "--energy"], ["report"], ["record"]):
            assert main([*command, str(out)]) == 0
        assert main(["evaluate", str(out)]) == 2  # its truth is not known
        for command in others(base, base / "clip.npz", library, out):
            assert main([str(word) for word in command]) == 0
    return out, (base / "stdout").read_text(), (base / "stderr").read_text()


def others(base: Path, clip: Path, library: Path, out: Path) -> list[list[str | Path]]:
    """The other commands that print such names, or write them."""
    (base / "given.toml").write_text("[camera]\nheight = [1.6, 5.0]\n")
    return [
        ["info", clip],
        ["solve", clip, "--library", library, "-o", base / "[/red]solved"],
        ["export", out, "--format", "json", "--samples", "2", "-o", base / "[/red]\n.json"],
        ["export", out, "--format", "glb", "-o", base / "$\\frac{$.glb"],
        ["export", out, "--format", "i3db", "-o", base / "<b>\x1b[31m"],
        ["ask", out, "--given", base / "given.toml", "--workers", "1", "-o", base / "told"],
        ["scenelets", "info", "--library", library],
        ["scenelets", "record", "--library", library, "-o", base / "[/red]sheet.rrd"],
    ]


@pytest.mark.slow
def test_names_of_others_pass_through_every_output(hostile_run: tuple[Path, str, str]) -> None:
    out, printed, said = hostile_run
    assert "\x1b" not in printed + said
    assert "a[/red]\ufffd[31m$\\frac{$ <script>è" in printed
    assert "Traceback" not in said
    page = (out / "report.html").read_text()
    assert "<script>è" not in page
    assert "&lt;script&gt;" in page
    opened = imapper_prob.load_posterior(out)
    assert opened.clip.name == "a[/red]\ufffd[31m$\\frac{$ <script>è"
    assert opened.config.library.endswith("part\nof\x1b[31mit.npz")
    (base,) = (parent for parent in out.parents if (parent / "given.toml").exists())
    written = [path for path in base.rglob("*") if path.suffix in (".json", ".html")]
    assert {path.parent.name for path in written} >= {out.name, "red]solved", "told", "["}
    for path in written:
        text = path.read_text(encoding="utf-8")
        assert "\x1b" not in text
        if path.suffix == ".json":
            json.loads(text)


def test_a_refusal_names_what_it_is_about_on_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", f"{tmp_path}/\x1b[31m\nclip", "-o", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert "\x1b" not in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_what_is_printed_is_what_is_written(capsys: pytest.CaptureFixture[str]) -> None:
    console().print("[bold]x[/red] :smile: \x1b]0;title\x07")
    assert capsys.readouterr().out == "[bold]x[/red] :smile: \ufffd]0;title\ufffd\n"
    assert printable("one\n\u202etwo") == "one\n\ufffdtwo"


def interrupted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C when walkers have begun to walk."""
    judge, calls = ensembles.log_posteriors, []

    def judged(*scenes: object) -> object:
        calls.append(None)
        if len(calls) == 4:
            os.kill(os.getpid(), signal.SIGINT)
        return judge(*scenes)

    monkeypatch.setattr(ensembles, "log_posteriors", judged)


def test_ensembles_that_were_interrupted_are_not_finished_and_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = SampleSettings(
        steps=300, draws=30, temperatures=2, chains=2, ensemble_steps=8,
    )  # fmt: skip
    seed = np.random.SeedSequence(5)
    with monkeypatch.context() as patch:
        interrupted_once(patch)
        part = sample_scenes(small_solution(), settings, seed=seed, checkpoints=tmp_path)
    assert not part.finished
    assert part.walked is not None
    assert part.walked.steps < settings.ensemble_steps
    seed = np.random.SeedSequence(5)
    whole = sample_scenes(small_solution(), settings, seed=seed, checkpoints=tmp_path)
    assert whole.finished
    undisturbed = sample_scenes(small_solution(), settings, seed=np.random.SeedSequence(5))
    for one, other in zip(whole.states, undisturbed.states, strict=True):
        np.testing.assert_array_equal(one.camera, other.camera)


def test_an_interrupted_run_is_written_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run, out = posterior(), tmp_path / "out"
    samples = replace(run.samples, finished=False)

    def sample(*_: object, checkpoints: Path, **__: object) -> object:
        checkpoints.mkdir(exist_ok=True)
        (checkpoints / "chain-0.npz").touch()
        return replace(run, samples=samples)

    monkeypatch.setattr(imapper_prob, "sample", sample)
    write_clip(tmp_path / "clip.npz", demo_clip())
    save_library(half_library(), tmp_path / "half.npz")
    arguments = ["run", str(tmp_path / "clip.npz"), "--library", str(tmp_path / "half.npz")]
    arguments += ["-o", str(out), "--workers", "1"]
    assert main(arguments) == 130
    assert "the same command goes on" in capsys.readouterr().err
    assert (out / "checkpoints" / "chain-0.npz").exists()
    samples = replace(samples, finished=True)
    assert main(arguments) == 0
    assert not (out / "checkpoints").exists()
    assert main(arguments) == 2


@pytest.mark.parametrize("reports", [1, 5])
def test_a_run_that_is_stopped_while_chains_burn_in_is_written_and_read(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    reports: int,
) -> None:
    """In the first round, and before temperatures stay."""
    settings = replace(SHORT.sample, ensemble_steps=0)
    heard = []

    def sample(*_: object, checkpoints: Path, **__: object) -> object:
        def progress(stage: str, part: float) -> None:
            heard.append(part)
            if len(heard) == reports:
                os.kill(os.getpid(), signal.SIGINT)

        samples = sample_scenes(
            small_solution(),
            settings,
            seed=np.random.SeedSequence(3),
            checkpoints=checkpoints,
            progress=progress,
        )
        assert samples.shape == (2, 1)
        return Posterior(small_solution(), samples, replace(SHORT, sample=settings))

    monkeypatch.setattr(imapper_prob, "sample", sample)
    out = tmp_path / "out"
    assert main(["demo", "-o", str(out), "--workers", "1"]) == 130
    assert "1 draws of each of 2 chains" in capsys.readouterr().err
    assert (out / "posterior.nc").exists()
    for command in ("info", "report"):
        assert main([command, str(out)]) == 0
    assert "nan to nan" not in (out / "report.html").read_text()


@pytest.mark.parametrize("stage", ["sample", "write_run"])
def test_an_interrupt_at_any_other_time_keeps_the_checkpoints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], stage: str
) -> None:
    out = tmp_path / "out"
    (out / "checkpoints").mkdir(parents=True)
    (out / "checkpoints" / "chain-0.npz").touch()

    def sample(*_: object, **__: object) -> object:
        if stage == "sample":
            os.kill(os.getpid(), signal.SIGINT)
        return small_posterior()

    def record(*_: object, **__: object) -> None:
        os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr(imapper_prob, "sample", sample)
    monkeypatch.setattr("imapper_prob.results.posterior.Posterior.record", record)
    code = 130 if stage == "sample" else 143
    assert main(["demo", "-o", str(out), "--workers", "1"]) == code
    assert "what there is was kept, the same command goes on" in capsys.readouterr().err
    assert sorted(p.name for p in out.rglob("*")) == ["chain-0.npz", "checkpoints"]


def test_sigterm_is_heard_and_forgotten() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(Terminated), stoppable():
        os.kill(os.getpid(), signal.SIGTERM)
    assert signal.getsignal(signal.SIGTERM) is before
    assert interrupt_message(Terminated(), Namespace()) == ("interrupted; nothing was written", 143)
    assert interrupt_message(Stopped("all kept"), Namespace()) == (
        "interrupted; all kept; the same command goes on", 130,
    )  # fmt: skip
    kept = Stopped("all kept", goes_on=False)
    assert interrupt_message(kept, Namespace()) == ("interrupted; all kept", 130)


def test_an_interrupt_while_arguments_are_read_is_one_too(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def parse(*_: object) -> None:
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr("imapper_prob.cli.parser.Parser.parse_args", parse)
    assert main(["demo"]) == 130
    assert capsys.readouterr().err == "imapper-prob: interrupted; nothing was written\n"


def test_a_command_in_the_background_goes_on_ignoring_ctrl_c() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with stoppable():
            os.kill(os.getpid(), signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)


class Finalised:
    """Python ignores what is thrown while it is deleted."""

    def __init__(self, number: signal.Signals) -> None:
        self.number = number

    def __del__(self) -> None:
        os.kill(os.getpid(), self.number)
        time.sleep(0.01)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_an_interruption_is_not_lost_in_a_finaliser(number: signal.Signals) -> None:
    def work() -> None:
        Finalised(number)
        time.sleep(5)

    with pytest.raises(KeyboardInterrupt), stoppable():
        work()


def test_overwrite_deletes_nothing_before_there_is_something_else(
    run_of_demo: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    shutil.copytree(run_of_demo, out)
    (out / "checkpoints").mkdir()
    (out / "checkpoints" / "chain-0.npz").write_bytes(b"hours of work")
    before = sorted(out.rglob("*"))
    for arguments in (["no-such-clip.npz"], ["--seed", "-1", str(tmp_path)]):
        assert main(["run", *arguments, "-o", str(out), "--overwrite"]) == 2
        assert sorted(out.rglob("*")) == before


def test_overwrite_goes_on_with_its_own_checkpoints_and_drops_those_of_others(
    tmp_path: Path,
) -> None:
    brief = replace(SHORT.sample, steps=60, draws=5, chains=2, ensemble_steps=2)
    for seed in (1, 2):
        sample_scenes(
            small_solution(),
            brief,
            seed=np.random.SeedSequence(seed),
            checkpoints=tmp_path,
            anew=True,
        )
    before = (tmp_path / "chain-0.npz").stat().st_mtime_ns
    (tmp_path / "chain-1.npz").write_bytes(b"cut short")
    sample_scenes(
        small_solution(), brief, seed=np.random.SeedSequence(2), checkpoints=tmp_path, anew=True
    )
    assert (tmp_path / "chain-1.npz").stat().st_size > 1000
    assert (tmp_path / "chain-0.npz").stat().st_mtime_ns != before  # a chain saves when it ends


@pytest.mark.parametrize(
    ("option", "words"),
    [
        (["--seed", "-1"], "seed = -1 must be at least 0"),
        (["--pitch", "89"], "a camera of pitch 89"),
        (["--camera-height", "1e9"], "m above the floor"),
        (["--focal", "1e12"], "focal length fx"),
        (["--focal", "1e-6"], "focal length fx"),
        (["--fps", "1e12"], "1e+12 frames a second; films have 1000 at most"),
        (["--fps", "1e-3"], "0.001 frames a second; library built-in 4 needs at least 1.43"),
        (["--people", "1000000000"], "people = 1000000000"),
    ],
)
def test_what_cannot_be_is_refused_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], option: list[str], words: str
) -> None:
    landmarks = [{"x": 0.3 + 0.01 * j, "y": 0.2 + 0.02 * j, "visibility": 0.9} for j in range(33)]
    frames = [{"frame": t, "landmarks": landmarks} for t in range(20)]
    (tmp_path / "clip.json").write_text(json.dumps(frames))
    arguments = ["run", str(tmp_path / "clip.json"), "--size", "1920x1080"]
    assert main([*arguments, *option, "-o", str(tmp_path / "out")]) == 2
    assert words in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "out").exists()
