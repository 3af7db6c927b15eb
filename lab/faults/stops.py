"""Runs that are killed or interrupted, through the command line.

Each stop is set to some time after some number of progress reports, which an undisturbed run of the
same command has recorded. Each case is a fork of one process that has run everything before, so
that nothing is compiled; processes of chains are new ones.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import sys
import tempfile
import threading
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final
from unittest import mock

import numpy as np

import imapper_prob.cli.run
import imapper_prob.sampling.sample
from imapper_prob.cli.main import main
from imapper_prob.clips.load import write_clip
from imapper_prob.config import to_toml
from imapper_prob.models.errors import InputError
from imapper_prob.results.load import load_posterior
from imapper_prob.samplers.checkpoint import run_resumable_chains
from imapper_prob.scenelets.library import save_library
from lab.faults.disk import UndisturbedError, digest
from lab.robustness.runs import CONFIG, small_clip, small_library, warm_up

__all__ = ["stop_runs", "stops_section"]

_CHAINS: Final = "jumping between scenes"
"""Name of the stage in which chains run."""
_READING: Final = "reading"
_PRINTING: Final = "printing"
"""Names of the time before the first progress report, and after the last."""
_STEPS: Final = 2000
"""Steps of each chain, enough for ten checkpoints."""
_PATIENCE: Final = 900
"""Seconds after which a run counts as hanging; the machine may be busy."""
_ALONE: Final = "kill -9"
_ALL: Final = "kill -9 of all processes"
_ONE: Final = "kill -9 of a chain's process"
_INTERRUPT: Final = "Ctrl-C"
_TERMINATE: Final = "SIGTERM"
_UNEXPECTED: Final = 99
"""Exit code of a command that did not catch an exception."""
_WORDS: Final = {
    "nothing was written": "stopped, nothing written",
    "what there is was kept": "stopped, checkpoints kept",
    "holds what there is": "stopped, its draws so far written",
}
"""Messages of an interrupted run, and the outcomes they stand for."""


@dataclass(frozen=True)
class _World:
    people: int
    workers: int


@dataclass(frozen=True)
class _Stop:
    """A stop at some number of seconds after some number of reports."""

    how: str
    reports: int
    seconds: float


@dataclass(frozen=True)
class _Base:
    """Files that all runs read, and the commands that read them."""

    folder: Path

    def arguments(self, world: _World) -> list[str]:
        """Arguments of the command line."""
        clip = self.folder / f"clip-{world.people}.npz"
        if not clip.exists():
            write_clip(clip, small_clip(world.people))
        library, config = self.folder / "part.npz", self.folder / "short.toml"
        if not config.exists():
            save_library(small_library(), library)
            sample = replace(CONFIG.sample, steps=_STEPS, draws=20)
            config.write_text(to_toml(replace(CONFIG, sample=sample)), encoding="utf-8")
        arguments = ["run", str(clip), "--library", str(library), "--config", str(config)]
        return [*arguments, "--workers", str(world.workers), "-o", str(self.folder / "out")]


def stop_runs(kills: int, interrupts: int) -> dict[str, Any]:
    """Kill runs while their chains run, and stop others in every stage.

    Parameters
    ----------
    kills : int
        Kills of a run of one process, and of one of two; runs of two and three people share as
        many.
    interrupts : int
        Interruptions in each stage, for one, two and three people.

    Returns
    -------
    dict
        ``outcomes``: counts of outcomes by people, processes, kind of stop and stage; ``wrong``:
        cases with a forbidden outcome.

    Raises
    ------
    UndisturbedError
        A run that is not stopped fails.
    """
    warm_up()
    rng = np.random.default_rng(20190708)
    outcomes: Counter[tuple[Any, ...]] = Counter()
    wrong: list[str] = []
    with tempfile.TemporaryDirectory() as folder, _checkpoints_all_the_time():
        base = Path(folder)
        sound: dict[int, dict[str, str]] = {}
        for world, counts in _plan(kills, interrupts).items():
            ended, said, told = _forked(_Base(base).arguments(world), None, base)
            if ended != "done":
                raise UndisturbedError(f"{world} that nobody stops is not done but {ended}: {said}")
            load_posterior(base / "out")
            found = digest(base / "out")
            if sound.setdefault(world.people, found) != found:
                wrong.append(f"{world}: undisturbed, but other draws than with one process")
            shutil.rmtree(base / "out")
            for how, stage, count in counts:
                for name, stop in _moments(told, stage, how, count, rng):
                    ended, bad = _case(world, stop, base, sound[world.people])
                    place = f"{world.people} people, {world.workers} processes, {how} in {name}"
                    outcomes[world.people, world.workers, how, name, ended] += 1
                    wrong += [f"{place}: {case}" for case in bad]
                    words = f"{place}: {ended}, {len(wrong)} wrong {bad or ''}"
                    print(words, file=sys.stderr, flush=True)
    return {"outcomes": [[*key, n] for key, n in outcomes.items()], "wrong": wrong}


def _plan(kills: int, interrupts: int) -> dict[_World, list[tuple[str, str | None, int]]]:
    """Number of stops of each kind in each stage, by world; None means every stage."""
    half, few = kills // 2, max(1, kills // 10)
    return {
        _World(1, 1): [
            (_ALONE, _CHAINS, kills), (_INTERRUPT, None, interrupts), (_TERMINATE, None, interrupts)
        ],
        _World(1, 2): [
            (_ALONE, _CHAINS, kills - half), (_ALL, _CHAINS, half), (_ONE, _CHAINS, few),
            (_INTERRUPT, _CHAINS, few),
        ],
        _World(2, 1): [(_ALONE, _CHAINS, few), (_INTERRUPT, None, interrupts)],
        _World(2, 2): [(_ALL, _CHAINS, few)],
        _World(3, 1): [(_ALONE, _CHAINS, few), (_INTERRUPT, None, interrupts)],
        _World(3, 2): [(_ALL, _CHAINS, few)],
    }  # fmt: skip


@contextmanager
def _checkpoints_all_the_time() -> Iterator[None]:
    """Write a checkpoint at every opportunity instead of every few seconds."""
    module = imapper_prob.sampling.sample
    eager = partial(run_resumable_chains, every_seconds=0.0)
    with mock.patch.object(module, "run_resumable_chains", eager):
        yield


_Told = list[tuple[str, float]]
"""Stage of each report, and seconds since the report before."""


def _moments(
    told: _Told, stage: str | None, how: str, count: int, rng: np.random.Generator
) -> Iterator[tuple[str, _Stop]]:
    """``count`` random moments in a stage, or in each stage, with the name of the stage."""
    for name in dict.fromkeys(name for name, _ in told) if stage is None else (stage,):
        own = [k for k, (other, _) in enumerate(told) if other == name]
        for _ in range(count):
            k = int(rng.choice(own))
            yield name, _Stop(how, k, float(rng.uniform(0, told[k][1])))


def _case(world: _World, stop: _Stop, base: Path, sound: dict[str, str]) -> tuple[str, list[str]]:
    """Outcome of an interrupted run, and faults of that run and of its continuation."""
    out, wrong = base / "out", []
    ended, said, _ = _forked(_Base(base).arguments(world), stop, base)
    if ended not in ("done", "killed", *_WORDS.values()):
        wrong.append(f"{stop}: {ended}: {said}")
    if "Traceback" in said or ("leaked" in said and ended != "killed"):
        wrong.append(f"{stop}: {said}")
    if (out / "posterior.nc").exists() and not (out / ".partial" / "manifest.json").exists():
        try:
            digest(out)
        except (InputError, OSError) as error:
            wrong.append(f"{stop}: left what cannot be read: {error}")
    # With one process, whatever their number was: the draws must be the same.
    resumed, said, _ = _forked(_Base(base).arguments(_World(world.people, 1)), None, base)
    whole = resumed == "done" or "no more is asked for" in said
    found = digest(out) if whole else {}
    if found != sound:
        names = sorted(k for k in found.keys() | sound if found.get(k) != sound.get(k))
        wrong.append(f"{stop}: {ended}; gone on with: {resumed}, {names}, {said}")
    left = sorted(path.name for path in (base / "tmp").iterdir())
    if left:
        wrong.append(f"{stop}: left in the temporary folder: {left}")
    for folder in (out, base / "tmp"):
        shutil.rmtree(folder, ignore_errors=True)
    return ended, wrong


def _forked(arguments: list[str], stop: _Stop | None, base: Path) -> tuple[str, str, _Told]:
    """Outcome of a command, its standard error, and its reports."""
    (base / "tmp").mkdir(exist_ok=True)
    said, reports = base / "said", base / "reports"
    reports.unlink(missing_ok=True)
    child = os.fork()
    if child == 0:
        os.setpgid(0, 0)
        # Shells let programs in the background ignore Ctrl-C.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        os.environ["TMPDIR"] = str(base / "tmp")
        tempfile.tempdir = None
        with said.open("wb") as file, open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 1)
            os.dup2(file.fileno(), 2)
        # Who calls may have put something else in the place of these streams, as pytest does.
        sys.stdout, sys.stderr = (
            os.fdopen(to, "w", buffering=1, encoding="utf-8", closefd=False) for to in (1, 2)
        )
        try:
            watched = _Watched(stop)
            with mock.patch.object(imapper_prob.cli.run, "progress_bars", watched.bars):
                code = main(arguments)
            watched.tell(reports)
        except BaseException:
            traceback.print_exc()
            code = _UNEXPECTED
        os._exit(code)
    deadline = time.monotonic() + _PATIENCE
    while (done := os.waitpid(child, os.WNOHANG))[0] == 0:
        if time.monotonic() > deadline:
            os.killpg(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return "hangs", said.read_text(), []
        time.sleep(0.02)
    words = said.read_text(encoding="utf-8", errors="replace")
    lines = reports.read_text(encoding="utf-8").splitlines() if reports.exists() else []
    told = [(name, float(seconds)) for seconds, name in (line.split(" ", 1) for line in lines)]
    return _outcome(os.waitstatus_to_exitcode(done[1]), words), words, told


def _outcome(code: int, said: str) -> str:
    if code in (128 + signal.SIGINT, 128 + signal.SIGTERM):
        return next((name for words, name in _WORDS.items() if words in said), "stopped")
    if code == -signal.SIGKILL:
        return "killed"
    return {0: "done", 2: "refused"}.get(code, f"ended with {code}")


class _Watched:
    """Records the reports of a run, and stops it at the planned time."""

    def __init__(self, stop: _Stop | None) -> None:
        self._stop = stop
        self._told: list[tuple[str, float]] = []
        self._last = time.monotonic()
        self._set()

    @contextmanager
    def bars(self) -> Iterator[_Watched]:
        """Replaces `imapper_prob.cli.console.progress_bars`."""
        yield self

    def __call__(self, stage: str, part: float) -> None:
        """Record a report."""
        now = time.monotonic()
        self._told.append((stage if self._told else _READING, now - self._last))
        self._last = now
        self._set()

    def say(self, text: str) -> None:
        """Ignore a text between reports."""

    def tell(self, file: Path) -> None:
        """Write the recorded reports and the end of the run."""
        self(_PRINTING, 1.0)
        lines = (f"{seconds} {stage}" for stage, seconds in self._told)
        file.write_text("\n".join(lines), encoding="utf-8")

    def _set(self) -> None:
        stop = self._stop
        if stop is not None and len(self._told) == stop.reports:
            timer = threading.Timer(stop.seconds, _ENDS[stop.how])
            timer.daemon = True
            timer.start()


def _kill_a_chain() -> None:
    for process in multiprocessing.active_children()[:1]:
        process.kill()


_ENDS: Final[dict[str, Callable[[], None]]] = {
    _ALONE: lambda: os.kill(os.getpid(), signal.SIGKILL),
    _ALL: lambda: os.killpg(0, signal.SIGKILL),
    _ONE: _kill_a_chain,
    _INTERRUPT: lambda: os.killpg(0, signal.SIGINT),
    _TERMINATE: lambda: os.kill(os.getpid(), signal.SIGTERM),
}


def stops_section(told: dict[str, Any]) -> str:
    """A paragraph and tables of the results of :func:`stop_runs`."""
    ways: Counter[tuple[Any, ...]] = Counter()
    stages: dict[str, Counter[str]] = {}
    for people, workers, how, stage, ended, n in told["outcomes"]:
        ways[how, people, workers, ended] += n
        if how == _INTERRUPT:
            stages.setdefault(stage.split(": ")[-1], Counter())[ended] += n
    ends = [*_WORDS.values(), "done"]
    lines = [f"| {' | '.join(map(str, key))} | {n} |" for key, n in sorted(ways.items())]
    by_stage = [
        f"| {stage} | {' | '.join(str(counts[end]) for end in ends)} |"
        for stage, counts in stages.items()
    ]
    return f"""A small run is stopped at moments drawn from a fixed seed, through the command line,
with a checkpoint at every chance. *Done* is a run that was over before it heard of it, or that made
up for a process that was killed. After each the same command is given again, with one process. It
must end well, with the draws, scenes and files of an undisturbed run, bit by bit, whatever the
number of processes was, and with nothing left in the temporary folder. What lies in the run's
folder in between must be whole.

| stopped by | people | processes | the run | cases |
|---|---|---|---|---|
{chr(10).join(lines)}

Ctrl-C by stage, of one, two and three people together:

| stage | {" | ".join(ends)} |
|{"---|" * (1 + len(ends))}
{chr(10).join(by_stage)}

{sum(ways.values())} stops, {len(told["wrong"])} of which ended otherwise, left something behind, or
went on to something else.
"""
