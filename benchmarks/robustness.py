"""How the readers take damaged and hostile inputs; writes a section of ``docs/robustness.md``.

``python -m benchmarks.robustness [INPUTS_A_KIND]``: for every reader and every kind of damage so
many inputs, 200 if not given. Each must be read or refused with an `InputError`, within ten
seconds of processor time, whatever is in it, and nothing must appear outside of its folder.
"""

from __future__ import annotations

import json
import logging
import os
import resource
import select
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.hostile_inputs import READERS, Damage, Reader, kinds_of
from benchmarks.hostile_runs import RUN_READERS
from benchmarks.robustness_page import write_section
from imapper_prob.models.errors import InputError

__all__ = ["Outcomes", "attack"]

_INPUTS: Final = 200
_SLOW: Final = frozenset({"a million frames", "hostile archive", "nested deeply"})
"""Kinds whose inputs are large: a tenth as many are tried."""
_COSTLY: Final = frozenset(
    {
        "posterior.nc", "posterior.nc, reported", "scenes.json", "a run with its checksums",
        "checkpoint", "video",
    }
)  # fmt: skip
"""Readers that take the better part of a second: a tenth as many are tried of each kind."""
_PATIENCE: Final = 5
"""Seconds of processor time until an input counts as a hang."""
_SILENCE: Final = 120.0
"""Seconds by the clock until a process counts as hanging that compiled code keeps."""
_INTRODUCTION: Final = """`python -m benchmarks.robustness {count}` writes this section.

Every reader is given sound inputs that were then damaged, drawn from fixed seeds. An input must be
*read* (the damage was harmless) or *refused* with one sentence; anything else is a *fault*: a
traceback, a warning of the libraries underneath, the end of the process, more than {patience}
seconds of processor time, a file outside of the input's folder. Inputs are read in processes of
their own. Cells are read + refused, and faults where there are any.

"""


class _Hang(BaseException):
    """An input took too long. No reader may catch this as one of its own errors."""


@dataclass
class Outcomes:
    """What became of the inputs of one reader and kind.

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


Spoiled = Callable[[int], AbstractContextManager[str]]


def attack(reader: Reader, *, inputs: int, only: str | None = None) -> dict[str, Outcomes]:
    """Damage a sound input again and again, and read it in a process of its own.

    Parameters
    ----------
    reader : Reader
    inputs : int
        How many of each kind of damage.
    only : str, optional
        One kind.
    """
    with tempfile.TemporaryDirectory() as base:
        room = Path(base) / "deep" / "inside" / "input"
        room.mkdir(parents=True)
        path = reader.write(room)
        reader.read(path)  # sound inputs are read
        sound = {file: file.read_bytes() for file in room.rglob("*") if file.is_file()}
        before = set(Path(base).rglob("*"))
        result = {}
        for kind, choices in kinds_of(room).items():
            if only is not None and kind != only:
                continue
            count = max(1, inputs // 10) if kind in _SLOW else inputs
            result[kind] = _outcomes(reader, path, count, partial(_spoiled, choices, sound))
            for file, content in sound.items():  # a child may have ended with one spoiled
                file.write_bytes(content)
            if set(Path(base).rglob("*")) != before:
                result[kind].counts["fault"] += 1
                result[kind].faults.append("left files behind")
    return result


@contextmanager
def _spoiled(
    choices: list[tuple[Path, Damage]], sound: dict[Path, bytes], seed: int
) -> Iterator[str]:
    """Damage one file for a while; its name."""
    rng = np.random.default_rng(seed)
    file, damage = choices[rng.integers(len(choices))]
    file.write_bytes(damage(sound[file], rng))
    yield file.name
    file.write_bytes(sound[file])


def _outcomes(reader: Reader, path: Path, count: int, spoiled: Spoiled) -> Outcomes:
    """Of seeds from 0, read one after the other by a child; another goes on where one dies."""
    found = Outcomes()
    done = 0
    while done < count:
        lines, end = _children_lines(reader, path, range(done, count), spoiled)
        for line in lines:
            outcome, seconds, words = line
            found.counts[outcome] += 1
            found.slowest = max(found.slowest, seconds)
            if outcome == "fault":
                found.faults.append(words)
        done += len(lines)
        if done < count:
            found.counts["fault"] += 1
            found.faults.append(f"seed {done}: the process {end}")
            done += 1
    return found


def _children_lines(
    reader: Reader, path: Path, seeds: range, spoiled: Spoiled
) -> tuple[list[Any], str]:
    """What a child says of each seed, and how it ended."""
    source, sink = os.pipe()
    sys.stdout.flush()
    sys.stderr.flush()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of forks beside threads that wait
        child = os.fork()
    if child == 0:
        os.close(source)
        with os.fdopen(sink, "w") as file:
            for seed in seeds:
                with spoiled(seed) as name:
                    told = _read(reader, path, f"seed {seed}, {name}")
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


@contextmanager
def _patience() -> Iterator[None]:
    def ring(number: int, frame: Any) -> None:
        raise _Hang

    # Processor time: other programs may keep the machine busy.
    earlier = signal.signal(signal.SIGPROF, ring)
    signal.setitimer(signal.ITIMER_PROF, _PATIENCE)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, earlier)


def main() -> int:
    """Attack all readers, write the table, and say how many faults there were."""
    logging.disable(logging.WARNING)
    inputs = int(sys.argv[1]) if len(sys.argv) > 1 else _INPUTS
    table = {}
    for name, reader in (READERS | RUN_READERS).items():
        table[name] = attack(reader, inputs=max(1, inputs // 10) if name in _COSTLY else inputs)
        faults = [fault for outcomes in table[name].values() for fault in outcomes.faults]
        sys.stdout.write(f"{name}: {len(faults)} faults {faults[:3]}\n")
    counts = sum((o.counts for row in table.values() for o in row.values()), Counter())
    kinds = list(dict.fromkeys(kind for row in table.values() for kind in row))
    lines = [
        "| reader | " + " | ".join(kinds) + " | slowest, s of processor time |",
        "|---" * (len(kinds) + 2) + "|",
    ]
    for name, row in table.items():
        cells = [str(row.get(kind, "–")) for kind in kinds]
        slowest = max(outcomes.slowest for outcomes in row.values())
        lines.append(f"| {name} | " + " | ".join(cells) + f" | {slowest:.1f} |")
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    text = _INTRODUCTION.format(count=inputs, patience=_PATIENCE) + "\n".join(lines)
    text += (
        f"\n\n{counts.total()} inputs: {counts['read']} read, {counts['refused']} refused, "
        f"{counts['fault']} faults. No process took more than {peak:.0f} MB of memory.\n"
    )
    write_section("Damaged files", text)
    return os.EX_OK if not counts["fault"] else 1


if __name__ == "__main__":
    sys.exit(main())
