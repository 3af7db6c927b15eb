"""Read sound inputs after repeated damage, in processes of their own."""

from __future__ import annotations

import gc
import json
import os
import select
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from imapper_prob.models.errors import InputError
from lab.robustness.inputs import Damage, Reader, kinds_of

__all__ = ["MEMORY", "PATIENCE", "Outcomes", "attack"]

_SLOW: Final = frozenset({"a million frames", "hostile archive", "nested deeply"})
"""Kinds with large inputs; a tenth as many are tried."""
PATIENCE: Final = 5
"""Seconds of processor time after which an input counts as a hang."""
MEMORY: Final = 2000
"""Megabytes of memory that reading may take."""
_SILENCE: Final = 600.0
"""Wall-clock seconds after which a process counts as hanging in compiled code. A hostile archive
takes three seconds of processor time to make, and the machine may be busy."""


class _Hang(BaseException):
    """An input took too long. It is not an `Exception`, so that no reader catches it as its own."""


@dataclass
class Outcomes:
    """Outcomes of the inputs of one reader and kind.

    Parameters
    ----------
    counts : Counter
        ``read``, ``refused`` and ``fault``.
    faults : list of str
        Seed and error of each.
    slowest : float
        Seconds.
    """

    counts: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    slowest: float = 0.0

    def __str__(self) -> str:
        text = f"{self.counts['read']} + {self.counts['refused']}"
        return f"{text}, **{self.counts['fault']} faults**" if self.counts["fault"] else text


Attempt = tuple[str, int]
"""Kind of damage and seed."""


def attack(reader: Reader, *, inputs: int, only: str | None = None) -> dict[str, Outcomes]:
    """Damage a sound input repeatedly, and read it in a process of its own.

    Parameters
    ----------
    reader : Reader
    inputs : int
        Number of inputs of each kind of damage.
    only : str, optional
        A single kind to try.
    """
    with tempfile.TemporaryDirectory() as base:
        room = Path(base) / "deep" / "inside" / "input"
        room.mkdir(parents=True)
        path = reader.write(room)
        reader.read(path)  # sound inputs must be read
        sound = {file: file.read_bytes() for file in room.rglob("*") if file.is_file()}
        before = set(Path(base).rglob("*"))
        kinds = {kind: c for kind, c in kinds_of(room).items() if only in (None, kind)}
        attempts = [
            (kind, seed)
            for kind in kinds
            for seed in range(max(1, inputs // 10) if kind in _SLOW else inputs)
        ]
        result = _outcomes(reader, path, room, attempts, _Damages(kinds, sound))
        if set(Path(base).rglob("*")) != before:
            last = result[attempts[-1][0]]
            last.counts["fault"] += 1
            last.faults.append("files were left behind, by this kind or one before")
    return result


@dataclass(frozen=True)
class _Damages:
    """What may be damaged of an input: files and kinds of damage, and the sound content."""

    kinds: Mapping[str, list[tuple[Path, Damage]]]
    sound: Mapping[Path, bytes]

    def mend(self) -> None:
        """Write the sound content of all files."""
        for file, content in self.sound.items():
            file.write_bytes(content)

    @contextmanager
    def damaged(self, attempt: Attempt) -> Iterator[str]:
        """Damage one file inside the context, and yield its name."""
        kind, seed = attempt
        rng = np.random.default_rng(seed)
        file, damage = self.kinds[kind][rng.integers(len(self.kinds[kind]))]
        file.write_bytes(damage(self.sound[file], rng))
        yield file.name
        file.write_bytes(self.sound[file])


def _outcomes(
    reader: Reader, path: Path, room: Path, attempts: Sequence[Attempt], damages: _Damages
) -> dict[str, Outcomes]:
    """Outcomes by kind of attempts that a child makes in order; if it dies, another continues."""
    found = {kind: Outcomes() for kind, _ in attempts}
    done = 0
    while done < len(attempts):
        lines, end = _children_lines(reader, path, room, attempts[done:], damages)
        for (kind, _), (outcome, seconds, words) in zip(attempts[done:], lines, strict=False):
            own = found[kind]
            own.counts[outcome] += 1
            own.slowest = max(own.slowest, seconds)
            if outcome == "fault":
                own.faults.append(words)
        done += len(lines)
        if done < len(attempts):
            kind, seed = attempts[done]
            found[kind].counts["fault"] += 1
            found[kind].faults.append(f"seed {seed}: the process {end}")
            done += 1
    return found


def _children_lines(
    reader: Reader, path: Path, room: Path, attempts: Sequence[Attempt], damages: _Damages
) -> tuple[list[Any], str]:
    """Reports of a child for each attempt, and how the child ended."""
    source, sink = os.pipe()
    sys.stdout.flush()
    sys.stderr.flush()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # on forks beside waiting threads
        child = os.fork()
    if child == 0:
        os.close(source)
        gc.freeze()  # what the parent has is neither collected nor copied
        with os.fdopen(sink, "w") as file:
            sys.dont_write_bytecode = True  # late imports must not count as writes
            written = _written_elsewhere(room)
            damages.mend()  # a child that died may have left a file damaged
            for attempt in attempts:
                with damages.damaged(attempt) as name:
                    told = _read(reader, path, f"seed {attempt[1]}, {name}")
                if written:
                    told = "fault", told[1], f"seed {attempt[1]}, {name}: wrote {written.pop()}"
                file.write(json.dumps(told) + "\n")
                file.flush()
        os._exit(0)
    os.close(sink)
    received = b""
    end = "ended early"
    while ready := select.select([source], [], [], _SILENCE)[0]:
        chunk = os.read(ready[0], 1 << 16)
        if not chunk:
            break
        received += chunk
    else:
        os.kill(child, signal.SIGKILL)
        end = "hangs"
    os.close(source)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if status < 0 and end != "hangs":
        end = f"crashed by signal {-status}"
    complete = received[: received.rfind(b"\n") + 1]
    return [json.loads(line) for line in complete.splitlines()], end


def _read(reader: Reader, path: Path, place: str) -> tuple[str, float, str]:
    """Outcome, seconds of processor time, and the error of a fault."""
    start, words = time.process_time(), ""
    try:
        with _patience(), warnings.catch_warnings():
            warnings.simplefilter("error")
            reader.read(path)
        outcome = "read"
    except InputError:
        outcome = "refused"
    except (Exception, _Hang) as error:
        outcome, words = "fault", f"{place}: {error!r:.300}"
    return outcome, time.process_time() - start, words


_WRITES: Final = frozenset(
    {"os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.symlink", "os.link"}
)

_TO_ANOTHER: Final = ("os.rename", "os.symlink", "os.link")


def _written_elsewhere(room: Path) -> list[str]:
    """A list to which each path outside a folder is added that this process writes to from now on.

    Temporary files of libraries are ignored, because they are removed in the end.
    """
    found: list[str] = []
    inside = (str(room), tempfile.gettempdir() + "/tmp", os.devnull)

    def hear(event: str, values: tuple[Any, ...]) -> None:
        if event == "open":
            named, flags = values[0], values[2] or 0
            if not flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT) or isinstance(named, int):
                return
        elif event in _WRITES and values[-1] == -1:  # not relative to an open folder
            named = values[1] if event in _TO_ANOTHER else values[0]
        else:
            return
        if isinstance(named, str | bytes | os.PathLike):
            path = os.path.realpath(os.fsdecode(named))
            if not path.startswith(inside):
                found.append(path)

    sys.addaudithook(hear)
    return found


@contextmanager
def _patience() -> Iterator[None]:
    def ring(number: int, frame: Any) -> None:
        raise _Hang

    # Processor time, because other programs may keep the machine busy.
    earlier = signal.signal(signal.SIGPROF, ring)
    signal.setitimer(signal.ITIMER_PROF, PATIENCE)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, earlier)
