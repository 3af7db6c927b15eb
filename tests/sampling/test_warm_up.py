"""Kernels of chains are compiled by a second process, which never outlives the first."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numba
import pytest

from imapper_prob.sampling import warm_up
from imapper_prob.sampling.actors import join_actors
from imapper_prob.sampling.warm_up import kernels_compiled_meanwhile, small_problem
from tests.runs import posterior, solution

ROOT = Path(__file__).parents[2]
COMMAND = [sys.executable, "-m", warm_up.__name__]


def refuse(*_: object, **__: object) -> None:
    raise AssertionError("a process was started")


@pytest.mark.parametrize(("wanted", "there"), [(False, False), (True, True)])
def test_no_process_runs_without_need(
    monkeypatch: pytest.MonkeyPatch, wanted: bool, there: bool
) -> None:
    monkeypatch.setattr(warm_up, "_are_compiled", lambda: there)
    monkeypatch.setattr(subprocess, "Popen", refuse)
    with kernels_compiled_meanwhile(wanted=wanted):
        pass


def test_what_is_on_disk_is_known(tmp_path: Path) -> None:
    posterior()
    assert warm_up._are_compiled()
    program = f"import sys, {warm_up.__name__} as w; sys.exit(w._are_compiled())"
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=ROOT,
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
        check=False,
    )
    assert done.returncode == 0


def test_it_is_waited_for_and_ends_with_a_block_that_fails(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    started: list[Any] = []

    class Noted(subprocess.Popen):  # type: ignore[type-arg]
        def __init__(self, command: list[str], **options: Any) -> None:
            assert command == COMMAND
            # The block of the first ends before it, and the second would never end.
            line = "import time; time.sleep(1)" if not started else "input()"
            super().__init__([sys.executable, "-c", line], **options)
            started.append(self)

    monkeypatch.setattr(warm_up, "_are_compiled", lambda: False)
    monkeypatch.setattr(subprocess, "Popen", Noted)
    told: list[str] = []
    with kernels_compiled_meanwhile(wanted=True, progress=lambda stage, _: told.append(stage)):
        assert started[0].poll() is None
    assert started[0].returncode == 0
    assert told == ["compiling, once"]
    with pytest.raises(ValueError, match="no scene"), kernels_compiled_meanwhile(wanted=True):
        raise ValueError("no scene")
    assert started[1].returncode == -9


def test_the_process_ends_with_its_parent() -> None:
    """Whose end closes the pipe, however it ends."""
    with subprocess.Popen(COMMAND, stdin=subprocess.PIPE, cwd=ROOT) as other:
        assert other.stdin is not None
        other.stdin.close()
        assert other.wait(120) == 1


def test_the_process_ends_well_before_its_parent() -> None:
    program = f"import {warm_up.__name__} as w; w.compile_kernels = lambda: None; w.main()"
    with subprocess.Popen(
        [sys.executable, "-c", program], stdin=subprocess.PIPE, stderr=subprocess.PIPE, cwd=ROOT
    ) as other:
        assert other.wait(120) == 0
        assert other.stderr is not None
        assert other.stderr.read() == b""


def test_kernels_are_compiled_for_the_arrays_of_a_solved_clip() -> None:
    small, solved = small_problem(), join_actors([solution()])
    for one, other in (
        (small.problem._asdict(), solved.problem._asdict()),
        ({"distances": small.distances}, {"distances": solved.distances}),
    ):
        assert {n: numba.typeof(v) for n, v in one.items()} == {
            n: numba.typeof(v) for n, v in other.items()
        }


_SEEN = """
import sys
from dataclasses import replace
import numpy as np
from numba.core.caching import FunctionCache
from imapper_prob.sampling.sample import sample_scenes
from imapper_prob.sampling.warm_up import compile_kernels
from tests.runs import BRIEF, small_posterior, small_solution

small_solution()
compile_kernels()
names, load = set(), FunctionCache.load_overload

def noted(self, sig, target):
    names.add(self._name)
    return load(self, sig, target)

FunctionCache.load_overload = noted
small_posterior()
# Long enough for an ascent.
long = replace(BRIEF.sample, steps=20_000)
sample_scenes(small_solution(), long, seed=np.random.SeedSequence(0))
sys.stdout.write(" ".join(sorted(names)))
"""


@pytest.mark.slow
def test_chains_call_kernels_as_they_were_compiled() -> None:
    """A kernel is looked for on disk once a process and once for each kind of its arguments."""
    done = subprocess.run(
        [sys.executable, "-c", _SEEN], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout == ""
