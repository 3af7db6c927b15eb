"""How do readers take damaged and hostile inputs?

Writes a section of ``docs/reference/robustness.md``.

    python -m lab.robustness [INPUTS] [--keep FILE]

tries INPUTS inputs, 150 if not given, for every reader and every kind of damage. Each must be read
or refused with an `InputError` within five seconds of processor time, and nothing may be written
outside its folder. With a file to keep results in, a stopped command continues with the next
reader. A line is printed for each reader, with its faults; the exit code is 1 if there are any.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import resource
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from imapper_prob.evaluate.tables import commit
from imapper_prob.files import written_whole
from lab.robustness import write_section
from lab.robustness.attack import MEMORY, PATIENCE, Outcomes, attack
from lab.robustness.inputs import READERS
from lab.robustness.runs import RUN_READERS

_INPUTS: Final = 150
_COSTLY: Final = frozenset(
    {
        "posterior.nc", "posterior.nc, reported", "scenes.json", "a run with its checksums",
        "a run to go on with", "checkpoint", "video",
    }
)  # fmt: skip
"""Readers that take nearly a second; a fifth as many inputs are tried of each kind."""
_INTRODUCTION: Final = """`python -m lab.robustness {count}` writes this section.

Every reader is given sound inputs that were then damaged, drawn from fixed seeds. An input must be
*read* (the damage was harmless) or *refused* with one sentence; anything else is a *fault*: a
traceback, a warning of the libraries underneath, the end of the process, more than {patience}
seconds of processor time, a file outside of the input's folder. Inputs are read in processes of
their own. Cells are read + refused, and faults where there are any.

"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Attack all readers, write the table, and return whether there were faults."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("inputs", type=int, nargs="?", default=_INPUTS, help="of each kind")
    parser.add_argument(
        "--keep", type=Path, metavar="FILE",
        help="what was found so far, and is not tried again (default: all is tried)",
    )  # fmt: skip
    options = parser.parse_args(arguments)
    inputs, kept = options.inputs, _kept(options.keep, options.inputs)
    for name, reader in (READERS | RUN_READERS).items():
        if name not in kept["readers"]:
            count = max(1, inputs // 5) if name in _COSTLY else inputs
            logging.disable(logging.WARNING)
            try:
                row = {kind: vars(found) for kind, found in attack(reader, inputs=count).items()}
            finally:
                logging.disable(logging.NOTSET)
            peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss // 1024
            kept["readers"][name] = row
            kept["peak"] = max(kept["peak"], peak)
            if options.keep is not None:
                with written_whole(options.keep) as beside:
                    beside.write_text(json.dumps(kept))
        faults = [fault for found in kept["readers"][name].values() for fault in found["faults"]]
        print(f"{name}: {len(faults)} faults {faults[:3]}", flush=True)
    table = {
        name: {kind: Outcomes(**{**found, "counts": Counter(found["counts"])})
               for kind, found in row.items()}
        for name, row in kept["readers"].items()
    }  # fmt: skip
    counts = sum((o.counts for row in table.values() for o in row.values()), Counter())
    text = _INTRODUCTION.format(count=inputs, patience=PATIENCE) + _table(table)
    text += (
        f"\n\n{counts.total()} inputs: {counts['read']} read, {counts['refused']} refused, "
        f"{counts['fault']} faults. No process took more than {kept['peak']} MB of memory.\n"
    )
    write_section("Damaged files", text)
    return os.EX_OK if not counts["fault"] and kept["peak"] < MEMORY else 1


def _kept(file: Path | None, inputs: int) -> dict[str, Any]:
    """Results of an earlier command with the same program and number of inputs."""
    of = {"commit": commit(), "inputs": inputs}
    if file is not None and file.exists():
        found: dict[str, Any] = json.loads(file.read_text())
        if found["of"] == of:
            return found
    return {"of": of, "readers": {}, "peak": 0}


def _table(table: dict[str, dict[str, Outcomes]]) -> str:
    kinds = list(dict.fromkeys(kind for row in table.values() for kind in row))
    lines = [
        "| reader | " + " | ".join(kinds) + " | slowest, s of processor time |",
        "|---" * (len(kinds) + 2) + "|",
    ]
    for name, row in table.items():
        cells = [str(row.get(kind, "–")) for kind in kinds]
        slowest = max(outcomes.slowest for outcomes in row.values())
        lines.append(f"| {name} | " + " | ".join(cells) + f" | {slowest:.1f} |")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
