"""Does a run survive it that a write, a flush or a renaming fails, and can it be gone on with?

    python -m lab.faults [FAULTS]

makes so many faults, 200 if not given, spread evenly over all calls by which a small run changes
files in its folder, of four kinds in turn: the disk is full from then on, the call is refused, the
process is killed before it, or in the middle of a write. After each the same run is started again
without a fault. It must end well, with the draws and the files of a run that nobody disturbed, and
the faulty one in a sentence. Printed are the cases that ended otherwise; a section of
``docs/reference/robustness.md`` is written.

Linux with a C compiler: ``faults.c`` is loaded before the C library, so that writers that are no
Python are heard as well. Each case is a fork of one process that has solved the clip.
"""

from __future__ import annotations

import argparse
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

import numpy as np

from lab.robustness import write_section

__all__ = ["KINDS", "compiler", "preload"]

KINDS: Final = ("disk full", "refused", "killed", "killed in a write")
_FAULTS: Final = 200
_PATIENCE: Final = 300
"""Seconds until a run counts as hanging; the machine may be busy."""
_SHIM: Final = "IMAPPER_PROB_FAULTS"
"""Environment variable with the path of the compiled ``faults.c``."""
_CALLS: Final = {
    "m": "folders made", "o": "files opened", "r": "renamings", "s": "flushes", "u": "removals",
    "w": "writes",
}  # fmt: skip
_REFUSED, _UNEXPECTED = 3, 4
"""Exit codes of a run that ended in a sentence, and in a traceback."""


_Run = Callable[[Path, int | None, Callable[[], Any]], int]
"""Folder, file descriptor for what is found, and what to call when it is done; an exit code."""


@dataclass
class Tally:
    """What became of the faults.

    Parameters
    ----------
    calls : Counter
        Calls of an undisturbed run by kind, see ``faults.c``.
    outcomes : Counter
        Of (kind of fault, how the faulty run ended).
    wrong : list of str
        Cases that ended otherwise than they must.
    """

    calls: Counter[str]
    outcomes: Counter[tuple[str, str]]
    wrong: list[str]


def compiler() -> str | None:
    """A C compiler, where there is one and faults can be injected."""
    return shutil.which("cc") if sys.platform.startswith("linux") else None


def preload(arguments: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run this module with ``arguments`` and with ``faults.c`` compiled into ``folder``."""
    shim = folder / "faults.so"
    source = Path(__file__).with_name("faults.c")
    command = [str(compiler()), "-O1", "-shared", "-fPIC", "-o", str(shim), str(source), "-ldl"]
    subprocess.run(command, check=True)
    environment = {"LD_PRELOAD": str(shim), _SHIM: str(shim)}
    return subprocess.run(
        [sys.executable, "-m", "lab.faults", *arguments],
        env={**os.environ, **environment}, check=False, text=True, stdout=subprocess.PIPE,
    )  # fmt: skip


def _inject(faults: int, base: Path) -> Tally:
    """Faults spread over all calls of a run; only in a process of :func:`preload`."""
    run, shim = _prepared(), ctypes.CDLL(os.environ[_SHIM])
    shim.fault_kinds.restype = ctypes.c_char_p

    def forked(folder: Path, *, at: int = -1, kind: int = 0) -> tuple[str, dict[str, Any]]:
        return _forked(run, shim, folder, at=at, kind=kind)

    ended, sound = forked(base / "undisturbed")
    assert ended == "done", ended
    calls = sound.pop("calls")
    tally = Tally(Counter(calls), Counter(), [])
    for case, at in enumerate(np.linspace(0, len(calls) - 1, faults).round().astype(int).tolist()):
        kind, folder = case % len(KINDS), base / "out"
        ended, _ = forked(folder, at=at, kind=kind)
        tally.outcomes[KINDS[kind], ended] += 1
        resumed, found = forked(folder)
        found.pop("calls", None)
        place = f"{KINDS[kind]} at call {at} ({calls[at]})"
        if ended not in ("done", "refused in a sentence", "killed"):
            tally.wrong.append(f"{place}: {ended}")
        if resumed != "done" or found != sound:
            tally.wrong.append(f"{place}: gone on with: {resumed}, {_differences(found, sound)}")
        shutil.rmtree(folder, ignore_errors=True)
        print(f"{case + 1} {place}: {ended}, {len(tally.wrong)} wrong", file=sys.stderr, flush=True)
    return tally


def _differences(found: dict[str, Any], sound: dict[str, Any]) -> list[str]:
    return sorted(name for name in found.keys() | sound if found.get(name) != sound.get(name))


def _prepared() -> _Run:
    """A small run, of which all that comes before the first write is done."""
    import rerun  # noqa: F401  here, so that no fork has to load it

    from imapper_prob.models.errors import InputError
    from imapper_prob.results.folders import CHECKPOINTS, run_folder, write_run
    from imapper_prob.results.posterior import load_posterior
    from lab.robustness.runs import small_posterior, small_solution

    small_solution()

    def run(folder: Path) -> None:
        # What the command line does; a run that is there is not made again.
        with run_folder(folder, overwrite=True):
            if (folder / "posterior.nc").exists() and not (folder / CHECKPOINTS).exists():
                return
            posterior = small_posterior(checkpoints=folder / CHECKPOINTS)
            write_run(folder, posterior, overwrite=True)

    def digest(folder: Path) -> dict[str, str]:
        """Of all draws, scenes and files, times left out."""
        tree = load_posterior(folder).data
        arrays = {
            f"{group}/{name}": hashlib.sha256(values.to_numpy().tobytes()).hexdigest()
            for group in tree.groups
            for name, values in tree[group].data_vars.items()
        }
        names = sorted(str(p.relative_to(folder)) for p in folder.rglob("*"))
        scenes = hashlib.sha256((folder / "scenes.json").read_bytes()).hexdigest()
        return {**arrays, "scenes": scenes, "files": json.dumps(names)}

    def run_and_tell(folder: Path, report: int | None, finished: Callable[[], Any]) -> int:
        try:
            run(folder)
            calls = finished()
            if report is not None:
                os.write(report, json.dumps({**digest(folder), "calls": calls}).encode())
        except InputError:
            return _REFUSED
        except BaseException:
            traceback.print_exc()
            return _UNEXPECTED
        return 0

    return run_and_tell


def _forked(
    run: _Run, shim: ctypes.CDLL, folder: Path, *, at: int, kind: int
) -> tuple[str, dict[str, Any]]:
    """How a run ended that has a fault at call ``at``, and what it left if there was none."""
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


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the faults, write the section, and say whether all ended well."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("faults", type=int, nargs="?", default=_FAULTS)
    faults = parser.parse_args(arguments).faults
    if _SHIM in os.environ:
        with tempfile.TemporaryDirectory() as base:
            tally = _inject(faults, Path(base))
        outcomes = [[*key, n] for key, n in tally.outcomes.items()]
        print(json.dumps({"calls": tally.calls, "outcomes": outcomes, "wrong": tally.wrong}))
        return os.EX_OK
    with tempfile.TemporaryDirectory() as folder:
        done = preload([str(faults)], Path(folder))
    told = json.loads(done.stdout.splitlines()[-1])
    for case in told["wrong"]:
        print(case)
    write_section("Faults of the disk", _section(faults, told))
    return int(bool(told["wrong"]))


def _section(faults: int, told: dict[str, Any]) -> str:
    rows = "\n".join(f"| {kind} | {ended} | {n} |" for kind, ended, n in sorted(told["outcomes"]))
    calls = ", ".join(f"{n} {_CALLS[letter]}" for letter, n in sorted(told["calls"].items()))
    return f"""`python -m lab.faults {faults}` writes this section.

An undisturbed small run changes files in its folder by {sum(told["calls"].values())} calls:
{calls}. {faults} faults are spread evenly over them. After each the same run is started again
without a fault, and must leave the draws, scenes and files of the undisturbed one, bit by bit.

| fault | the run with it | cases |
|---|---|---|
{rows}

{faults} faults, {len(told["wrong"])} of which ended otherwise than in a sentence or by the kill, or
went on to something else. A refused call that is done without (a lock's name, a removal) lets the
run end well.
"""


if __name__ == "__main__":
    sys.exit(main())
