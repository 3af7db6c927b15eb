"""Runs whose disk fails at any write, flush, renaming or removal.

Linux with a C compiler: ``faults.c`` is loaded before the C library, so that calls of libraries
that are not Python are intercepted too. Each case is a fork of one process that has solved the
clips.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
import rerun  # noqa: F401  here, so that no fork has to load it

from imapper_prob.files import require_intact
from imapper_prob.models.errors import InputError
from imapper_prob.results.folders import CHECKPOINTS, run_folder, write_run
from imapper_prob.results.load import load_posterior
from lab.robustness.runs import SEED, small_joint_problem, small_posterior, warm_up

__all__ = [
    "KINDS",
    "WORLDS",
    "UndisturbedError",
    "compiler",
    "digest",
    "disk_faults",
    "disk_section",
]

KINDS: Final = ("disk full", "refused", "killed", "killed in a write")
_PATIENCE: Final = 300
"""Seconds after which a run counts as hanging; the machine may be busy."""
_SHIM: Final = "IMAPPER_PROB_FAULTS"
"""Environment variable with the path of the compiled ``faults.c``."""
_CALLS: Final = {
    "m": "folders made", "o": "files opened", "r": "renamings", "s": "flushes", "u": "removals",
    "w": "writes",
}  # fmt: skip
_REFUSED, _UNEXPECTED = 3, 4
"""Exit codes of a run that ended with a one-sentence error, and with a traceback."""


@dataclass(frozen=True)
class World:
    """A kind of run: people, and whether it replaces an earlier result.

    Parameters
    ----------
    people : int
    replaces : bool
        Whether the folder holds an earlier result.
    share : float
        Fraction of all faults.
    """

    people: int
    replaces: bool
    share: float


WORLDS: Final = {
    "one person": World(1, replaces=False, share=0.4),
    "one person, an earlier run there": World(1, replaces=True, share=0.3),
    "two people": World(2, replaces=False, share=0.15),
    "three people": World(3, replaces=False, share=0.15),
}


class UndisturbedError(RuntimeError):
    """A run without any fault fails, so that nothing can be learnt from one with a fault."""


_Run = Callable[[Path, int | None, Callable[[], str]], int]
"""Maps a folder, a file descriptor for results and a function to call at the end to an exit
code."""


def compiler() -> str | None:
    """Path of a C compiler, or None if there is none or faults cannot be injected."""
    return shutil.which("cc") if sys.platform.startswith("linux") else None


def disk_faults(faults: int) -> dict[str, Any]:
    """Inject faults spread over all calls of the runs of all worlds.

    Parameters
    ----------
    faults : int
        Total number of faults.

    Returns
    -------
    dict
        ``worlds``: by name the numbers of calls of an undisturbed run by kind (see ``faults.c``)
        and outcomes of runs by kind of fault; ``wrong``: cases with a forbidden outcome.

    Raises
    ------
    UndisturbedError
        A run without a fault fails.
    """
    with tempfile.TemporaryDirectory() as folder:
        shim = Path(folder) / "faults.so"
        source = Path(__file__).with_name("faults.c")
        command = [str(compiler()), "-O1", "-shared", "-fPIC", "-o", str(shim), str(source), "-ldl"]
        subprocess.run(command, check=True)
        done = subprocess.run(
            [sys.executable, "-m", "lab.faults.disk", str(faults)],
            env={**os.environ, "LD_PRELOAD": str(shim), _SHIM: str(shim)}, check=True, text=True,
            stdout=subprocess.PIPE,
        )  # fmt: skip
    told: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    if "failed" in told:
        raise UndisturbedError(told["failed"])
    return told


def _inject(faults: int, base: Path) -> dict[str, Any]:
    """The work of :func:`disk_faults`, in a process whose calls are intercepted."""
    shim = ctypes.CDLL(os.environ[_SHIM])
    shim.fault_kinds.restype = ctypes.c_char_p
    warm_up()
    worlds, wrong = {}, []
    for name, world in WORLDS.items():
        count = round(faults * world.share)
        calls, outcomes, bad = _inject_into(world, count, shim, base)
        wrong += [f"{name}, {case}" for case in bad]
        worlds[name] = {
            "calls": Counter(calls),
            "outcomes": [[*key, n] for key, n in sorted(outcomes.items())],
        }
    return {"worlds": worlds, "wrong": wrong}


def _inject_into(
    world: World, faults: int, shim: ctypes.CDLL, base: Path
) -> tuple[str, Counter[tuple[str, str]], list[str]]:
    """Calls of an undisturbed run, outcomes by kind, and cases with a forbidden outcome."""
    run, folder, earlier = _prepared(world.people), base / "out", base / "earlier"
    sound = _undisturbed(run, shim, base / "sound")[1]
    known = [sound]
    if world.replaces:
        known.append(_undisturbed(_prepared(world.people, SEED + 1), shim, earlier)[1])

    def begun() -> None:
        if world.replaces:
            shutil.copytree(earlier, folder)

    begun()
    calls, found = _undisturbed(run, shim, folder)
    shutil.rmtree(folder)
    wrong = [] if found == sound else [f"undisturbed: {_differences(found, sound)}"]
    outcomes: Counter[tuple[str, str]] = Counter()
    for case, at in enumerate(np.linspace(0, len(calls) - 1, faults).round().astype(int).tolist()):
        kind = case % len(KINDS)
        place = f"{KINDS[kind]} at call {at} ({calls[at]})"
        begun()
        ended, _ = _forked(run, shim, folder, at=at, kind=kind)
        outcomes[KINDS[kind], ended] += 1
        if ended not in ("done", "refused in a sentence", "killed"):
            wrong.append(f"{place}: {ended}")
        if world.replaces and not _is_one_of(folder, known):
            wrong.append(f"{place}: neither the earlier result is there nor the new one")
        resumed, told = _forked(run, shim, folder)
        found = told.get("found", {})
        if resumed != "done" or found != sound:
            wrong.append(f"{place}: gone on with: {resumed}, {_differences(found, sound)}")
        shutil.rmtree(folder, ignore_errors=True)
        print(f"{case + 1} {place}: {ended}, {len(wrong)} wrong", file=sys.stderr, flush=True)
    for made in (base / "sound", earlier):
        shutil.rmtree(made, ignore_errors=True)
    return calls, outcomes, wrong


def _undisturbed(run: _Run, shim: ctypes.CDLL, folder: Path) -> tuple[str, dict[str, str]]:
    """Calls and digests of a run without a fault, whose result must be one that can be read."""
    ended, told = _forked(run, shim, folder)
    if ended != "done":
        raise UndisturbedError(f"a run without a fault is not done but {ended}: {told['error']}")
    load_posterior(folder)
    return told["calls"], told["found"]


def _is_one_of(folder: Path, known: Sequence[dict[str, str]]) -> bool:
    """Whether a folder holds one of these results, or a complete stage for the next run."""
    try:
        found = digest(folder)
    except (InputError, OSError):
        return (folder / ".partial" / "manifest.json").is_file()
    return any({**one, "files": ""} == {**found, "files": ""} for one in known)


def _differences(found: dict[str, str], sound: dict[str, str]) -> list[str]:
    return sorted(name for name in found.keys() | sound if found.get(name) != sound.get(name))


def digest(folder: Path) -> dict[str, str]:
    """Digests of all draws, scenes and names of files of a run, without times.

    Raises
    ------
    InputError
        A file is not the one that the run wrote.
    OSError
        A file is missing.
    """
    require_intact(folder / "posterior.nc")
    arrays: dict[str, str] = {}

    def note(name: str, item: h5py.Group | h5py.Dataset) -> None:
        if isinstance(item, h5py.Dataset):
            values = np.asarray(item[()])
            # Texts of any length are objects, whose bytes are addresses.
            content = repr(values.tolist()).encode() if values.dtype == object else values.tobytes()
            arrays[name] = hashlib.sha256(content).hexdigest()

    # Of h5py, which takes a tenth of the time that the program takes to read a posterior.
    with h5py.File(folder / "posterior.nc") as file:
        file.visititems(note)
    names = sorted(str(p.relative_to(folder)) for p in folder.rglob("*"))
    scenes = hashlib.sha256((folder / "scenes.json").read_bytes()).hexdigest()
    return {**arrays, "scenes": scenes, "files": json.dumps(names)}


def _prepared(people: int, seed: int = SEED) -> _Run:
    """A small run, with everything before its first write already done."""
    small_joint_problem(people)

    def run(folder: Path) -> None:
        # As in ``run --overwrite``, which continues from checkpoints of its own.
        with run_folder(folder, overwrite=True):
            posterior = small_posterior(
                people=people, seed=seed, checkpoints=folder / CHECKPOINTS, anew=True
            )
            write_run(folder, posterior, overwrite=True, resumed=True)

    def run_and_tell(folder: Path, report: int | None, finished: Callable[[], str]) -> int:
        try:
            run(folder)
            calls = finished()
            if report is not None:
                told = json.dumps({"found": digest(folder), "calls": calls}).encode()
                while told:
                    told = told[os.write(report, told) :]
        except BaseException as error:
            refused = isinstance(error, InputError)
            if report is not None:
                os.write(report, json.dumps({"error": f"{error!r:.2000}"}).encode())
            elif not refused:
                traceback.print_exc()
            return _REFUSED if refused else _UNEXPECTED
        return 0

    return run_and_tell


def _forked(
    run: _Run, shim: ctypes.CDLL, folder: Path, *, at: int = -1, kind: int = 0
) -> tuple[str, dict[str, Any]]:
    """Outcome of a run with a fault at call ``at``, and its results if there was no fault."""
    reader, writer = os.pipe()
    sys.stdout.flush()
    sys.stderr.flush()
    child = os.fork()
    if child == 0:
        os.close(reader)
        os.setpgid(0, 0)
        shim.fault_arm(os.fsencode(folder), ctypes.c_long(at), kind)

        def finished() -> str:
            calls: str = shim.fault_kinds()[: shim.fault_count()].decode()
            shim.fault_arm(b"", ctypes.c_long(-1), 0)
            return calls

        os._exit(run(folder, writer if at < 0 else None, finished))
    os.close(writer)
    deadline = time.monotonic() + _PATIENCE
    chunks: list[bytes] = []
    os.set_blocking(reader, False)
    while (ended := os.waitpid(child, os.WNOHANG))[0] == 0:
        if time.monotonic() > deadline:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            os.close(reader)
            return "hangs", {}
        _drain(reader, chunks)
        time.sleep(0.01)
    _drain(reader, chunks)
    os.close(reader)
    told = json.loads(b"".join(chunks)) if chunks else {}
    return _outcome(os.waitstatus_to_exitcode(ended[1])), told


def _drain(reader: int, chunks: list[bytes]) -> None:
    try:
        while chunk := os.read(reader, 1 << 16):
            chunks.append(chunk)
    except BlockingIOError:
        pass


def _outcome(code: int) -> str:
    if code == -signal.SIGKILL:
        return "killed"
    if code < 0:
        return f"crashed by signal {-code}"
    return {0: "done", _REFUSED: "refused in a sentence"}.get(code, "traceback")


def disk_section(told: dict[str, Any]) -> str:
    """A paragraph and a table of the results of :func:`disk_faults`."""
    counts = told["worlds"]["one person"]["calls"]
    calls = ", ".join(f"{n} {_CALLS[letter]}" for letter, n in sorted(counts.items()))
    ends = ("refused in a sentence", "killed", "done")
    rows, total = [], 0
    for name, world in told["worlds"].items():
        for kind in KINDS:
            found = {ended: n for of, ended, n in world["outcomes"] if of == kind}
            total += sum(found.values())
            cells = " | ".join(str(found.get(end, 0)) for end in ends)
            rows.append(f"| {name} | {kind} | {cells} |")
    return f"""A small run of one person changes files in its folder by {sum(counts.values())}
calls of its own, those of compiled writers included: {calls}. Faults are spread evenly over
them: the disk is full from there on, the call is refused, the process is killed before it, or in
the middle of a write. After each the same run is started again without a fault, and must leave the
draws, scenes and files of an undisturbed one, bit by bit. Where an earlier run was there, it or the
new one must be whole after the fault as well.

| run | fault | {" | ".join(ends)} |
|---|---|---|---|---|
{chr(10).join(rows)}

{total} faults, {len(told["wrong"])} of which ended otherwise, or went on to something else. A
refused call that is done without (a lock's name, a removal) lets the run end well.
"""


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as base:
        try:
            found = _inject(int(sys.argv[1]), Path(base))
        except UndisturbedError as error:
            found = {"failed": str(error)}
        print(json.dumps(found))
