"""A run goes on after faults of the disk, kills and interrupts, wherever they strike."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from imapper_prob.models.errors import InputError
from lab.faults import __main__ as command
from lab.faults import disk, stops
from lab.faults.disk import (
    KINDS,
    WORLDS,
    UndisturbedError,
    compiler,
    disk_faults,
    disk_section,
)
from lab.faults.stops import stop_runs, stops_section

FAULTS = 14
"""``python -m lab.faults`` tries more."""


class NoShim:
    """Stands for the compiled ``faults.c``."""

    def fault_arm(self, *_: object) -> None:
        pass


def test_a_run_that_fails_without_a_fault_is_told_with_its_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(**_: object) -> None:
        raise InputError("the library is gone")

    monkeypatch.setattr(disk, "small_joint_problem", lambda _: None)
    monkeypatch.setattr(disk, "small_posterior", refuse)
    shim: Any = NoShim()
    with pytest.raises(UndisturbedError, match="refused in a sentence: InputError"):
        disk._undisturbed(disk._prepared(1), shim, tmp_path / "out")


def test_a_run_that_fails_without_a_stop_is_told_with_its_reason(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(stops, "warm_up", lambda: None)
    monkeypatch.setattr(stops, "_forked", lambda *_: ("refused", "the library is gone", []))
    assert command.main(["--faults", "0"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert said.startswith("lab.faults: ")
    assert said.endswith("that nobody stops is not done but refused: the library is gone\n")


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
