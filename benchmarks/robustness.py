"""How the readers take damaged and hostile inputs; writes ``docs/robustness.md``.

``python -m benchmarks.robustness [INPUTS_A_KIND]``: for every reader and every kind of damage so
many inputs, 200 if not given. Each must be read or refused with an `InputError`, within ten
seconds of processor time, whatever is in it, and nothing must appear outside of its folder.
"""

from __future__ import annotations

import logging
import os
import resource
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.hostile_inputs import READERS, Reader, kinds_of
from imapper_prob.models.errors import InputError

__all__ = ["Outcomes", "attack"]

DOCUMENT: Final = Path(__file__).parents[1] / "docs" / "robustness.md"
_INPUTS: Final = 200
_SLOW: Final = frozenset({"a million frames", "hostile archive", "nested deeply"})
"""Kinds whose inputs are large: a tenth as many are tried."""
_PATIENCE: Final = 10
"""Seconds of processor time until an input counts as a hang."""
_INTRODUCTION: Final = """# Damaged and hostile inputs

Written by `python -m benchmarks.robustness {count}`; do not edit.

Every reader is given sound inputs that were then damaged, drawn from fixed seeds. An input must be
*read* (the damage was harmless) or *refused* with one sentence; anything else is a *fault*: a
traceback, a warning of the libraries underneath, more than {patience} seconds of processor time, a
file outside of the input's folder. Cells are read + refused, and faults where there are any.

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


def attack(reader: Reader, *, inputs: int, only: str | None = None) -> dict[str, Outcomes]:
    """Damage a sound input again and again, and read it.

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
            outcomes = result[kind] = Outcomes()
            for seed in range(max(1, inputs // 10) if kind in _SLOW else inputs):
                rng = np.random.default_rng(seed)
                file, damage = choices[rng.integers(len(choices))]
                file.write_bytes(damage(sound[file], rng))
                _read(reader, path, outcomes, f"seed {seed}, {file.name}")
                file.write_bytes(sound[file])
            if set(Path(base).rglob("*")) != before:
                outcomes.counts["fault"] += 1
                outcomes.faults.append("left files behind")
    return result


def _read(reader: Reader, path: Path, outcomes: Outcomes, place: str) -> None:
    start = time.process_time()
    try:
        with _patience(), warnings.catch_warnings():
            warnings.simplefilter("error")
            reader.read(path)
        outcomes.counts["read"] += 1
    except InputError:
        outcomes.counts["refused"] += 1
    except (Exception, _Hang) as error:
        outcomes.counts["fault"] += 1
        outcomes.faults.append(f"{place}: {error!r}")
    outcomes.slowest = max(outcomes.slowest, time.process_time() - start)


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
    for name, reader in READERS.items():
        table[name] = attack(reader, inputs=inputs)
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
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    text = _INTRODUCTION.format(count=inputs, patience=_PATIENCE) + "\n".join(lines)
    text += (
        f"\n\n{counts.total()} inputs: {counts['read']} read, {counts['refused']} refused, "
        f"{counts['fault']} faults. The process never took more than {peak:.0f} MB of memory.\n"
    )
    DOCUMENT.write_text(text + _LIMITS, encoding="utf-8")
    return os.EX_OK if not counts["fault"] else 1


_LIMITS: Final = """
## Limits

| what | at most | why |
|---|---|---|
| a JSON or TRC file | 128 MB | an hour of one person at 30 frames a second |
| an `.npz`, unpacked | 512 MB | a hundred times the longest clip |
| frames of a clip | 36,000 | twenty minutes at 30 a second; more is a damaged number |
| frames of a capture | 432,000 | an hour at 120 a second |
| people in a frame | 64 | a crowd |
| a video frame | 8,192 pixels a side | a damaged header |

Archives are never unpickled and never unpacked to disk; their members' sizes and the shapes that
arrays claim are looked at before anything is read.
"""

if __name__ == "__main__":
    sys.exit(main())
