"""A run goes on after faults of the disk, wherever they strike."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from lab.faults import KINDS, compiler, preload

FAULTS = 8
"""Twice each kind; ``python -m lab.faults`` tries more."""


@pytest.mark.slow
@pytest.mark.skipif(compiler() is None, reason="faults are injected on Linux with a C compiler")
def test_a_run_goes_on_to_the_same_files_after_any_fault(tmp_path: Path) -> None:
    done = preload([str(FAULTS)], tmp_path)
    assert done.returncode == 0
    told = json.loads(done.stdout.splitlines()[-1])
    assert told["wrong"] == []
    assert {kind for kind, _, _ in told["outcomes"]} == set(KINDS)
    assert sum(count for *_, count in told["outcomes"]) == FAULTS
