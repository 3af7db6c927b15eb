"""A run goes on after faults of the disk, kills and interrupts, wherever they strike."""

from __future__ import annotations

import pytest

from lab.faults.disk import KINDS, WORLDS, compiler, disk_faults, disk_section
from lab.faults.stops import stop_runs, stops_section

FAULTS = 14
"""``python -m lab.faults`` tries more."""


@pytest.mark.slow
@pytest.mark.skipif(compiler() is None, reason="faults are injected on Linux with a C compiler")
def test_a_run_goes_on_to_the_same_files_after_any_fault_of_the_disk() -> None:
    told = disk_faults(FAULTS)
    assert told["wrong"] == []
    assert told["worlds"].keys() == WORLDS.keys()
    assert {k for world in told["worlds"].values() for k, *_ in world["outcomes"]} == set(KINDS)
    assert f"{FAULTS} faults, 0 of which" in disk_section(told)


@pytest.mark.slow
def test_a_run_goes_on_to_the_same_files_after_kills_and_interrupts() -> None:
    told = stop_runs(2, 0)
    assert told["wrong"] == []
    assert {how for _, _, how, *_ in told["outcomes"]} >= {"kill -9", "Ctrl-C"}
    assert "0 of which ended otherwise" in stops_section(told)
