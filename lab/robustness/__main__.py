"""How do readers take damaged and hostile inputs?

Writes a section of ``docs/reference/robustness.md``.

    python -m lab.robustness [INPUTS]

tries for every reader and every kind of damage so many inputs, 200 if not given. Each must be read
or refused with an `InputError`, within five seconds of processor time, whatever is in it, and
nothing must appear outside of its folder. Printed is a line a reader, with its faults; the exit
code is 1 if there are any.
"""

from __future__ import annotations

import argparse
import logging
import os
import resource
import sys
from collections import Counter
from collections.abc import Sequence
from typing import Final

from lab.robustness import write_section
from lab.robustness.attack import PATIENCE, attack
from lab.robustness.inputs import READERS
from lab.robustness.runs import RUN_READERS

_INPUTS: Final = 200
_COSTLY: Final = frozenset(
    {
        "posterior.nc", "posterior.nc, reported", "scenes.json", "a run with its checksums",
        "checkpoint", "video",
    }
)  # fmt: skip
"""Readers that take the better part of a second: a tenth as many are tried of each kind."""
_INTRODUCTION: Final = """`python -m lab.robustness {count}` writes this section.

Every reader is given sound inputs that were then damaged, drawn from fixed seeds. An input must be
*read* (the damage was harmless) or *refused* with one sentence; anything else is a *fault*: a
traceback, a warning of the libraries underneath, the end of the process, more than {patience}
seconds of processor time, a file outside of the input's folder. Inputs are read in processes of
their own. Cells are read + refused, and faults where there are any.

"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Attack all readers, write the table, and say how many faults there were."""
    logging.disable(logging.WARNING)
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("inputs", type=int, nargs="?", default=_INPUTS, help="of each kind")
    inputs = parser.parse_args(arguments).inputs
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
    text = _INTRODUCTION.format(count=inputs, patience=PATIENCE) + "\n".join(lines)
    text += (
        f"\n\n{counts.total()} inputs: {counts['read']} read, {counts['refused']} refused, "
        f"{counts['fault']} faults. No process took more than {peak:.0f} MB of memory.\n"
    )
    write_section("Damaged files", text)
    return os.EX_OK if not counts["fault"] else 1


if __name__ == "__main__":
    sys.exit(main())
