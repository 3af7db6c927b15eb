"""Is anything lost when the disk fails, a process is killed, or somebody stops a run?

    python -m lab.faults [--faults N] [--kills N] [--interrupts N]

runs one small command repeatedly. N disk faults are spread over all its calls that change files,
for one, two and three people and over an earlier run; it is killed N times while its chains run,
with one process and with two; and it is interrupted N times in every stage. After each case the
same run is started again without a fault. It must succeed, with the draws and files of an
undisturbed run, and the faulty run must end with a one-sentence error. The command prints the cases
that ended otherwise and writes two sections of ``docs/reference/robustness.md``. It takes about an
hour on one core, and needs Linux with a C compiler.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from typing import Final

from lab.faults.disk import UndisturbedError, disk_faults, disk_section
from lab.faults.stops import stop_runs, stops_section
from lab.robustness import write_section

_FAULTS: Final = 204
_KILLS: Final = 20
_INTERRUPTS: Final = 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the faults, and return 0 if all cases ended well, 1 if not, 2 if none could be tried."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--faults", type=int, default=_FAULTS, help="of the disk; 0: none")
    parser.add_argument("--kills", type=int, default=_KILLS, help="for each number of processes")
    parser.add_argument("--interrupts", type=int, default=_INTERRUPTS, help="in each stage")
    options = parser.parse_args(arguments)
    try:
        wrong = _measured(options)
    except UndisturbedError as error:
        print(f"lab.faults: {error}", file=sys.stderr)
        return 2
    for case in wrong:
        print(case)
    return int(bool(wrong))


def _measured(options: argparse.Namespace) -> list[str]:
    """Write the sections, and return the cases that ended otherwise than they may."""
    wrong: list[str] = []
    if options.faults:
        begun = time.monotonic()
        told = disk_faults(options.faults)
        wrong += told["wrong"]
        text = f"`python -m lab.faults` writes this section, in {_minutes(begun)} minutes."
        write_section("Faults of the disk", f"{text}\n\n{disk_section(told)}")
    if options.kills or options.interrupts:
        begun = time.monotonic()
        told = stop_runs(options.kills, options.interrupts)
        wrong += told["wrong"]
        text = f"`python -m lab.faults` writes this section, in {_minutes(begun)} minutes."
        write_section("Runs that are stopped", f"{text}\n\n{stops_section(told)}")
    return wrong


def _minutes(begun: float) -> int:
    return round((time.monotonic() - begun) / 60)


if __name__ == "__main__":
    sys.exit(main())
