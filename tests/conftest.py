"""What all tests share."""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import settings

# No window is ever opened, and the same examples are tried everywhere.
os.environ.setdefault("MPLBACKEND", "Agg")
# For the processes that run tests, and those that tests start: on two cores that both are busy,
# a second thread of a small product of matrices waits for its turn twenty times as long as it
# works.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.load_profile("repeatable")

ROOT = Path(__file__).parents[1]
CORPUS = ROOT.parent / "shared" / "i3db"
SCENES = ("Scene04", "Scene10", "Scene13", "Scene14")


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20190708)


@pytest.fixture(scope="session", autouse=True)
def _prepared_once() -> Iterator[None]:
    """Gains of the demo's scenelets take a second or two: a process of tests finds them once."""
    from imapper_prob.models.problem import Problem
    from imapper_prob.sampling import sample
    from imapper_prob.sampling.gains import Gains

    # With the problem itself, so that no other has its number.
    made: dict[int, tuple[Problem, Gains]] = {}
    find = sample.gains_of

    def gains_of(problem: Problem) -> Gains:
        if id(problem) not in made:
            made[id(problem)] = problem, find(problem)
        return made[id(problem)][1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sample, "gains_of", gains_of)
        yield


@pytest.fixture(scope="session")
def run_of_demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the short run in :mod:`tests.runs`, of which tests take a copy."""
    from imapper_prob.results.folders import write_run
    from tests.runs import posterior

    folder = tmp_path_factory.mktemp("demo") / "run"
    write_run(folder, posterior(), overwrite=False)
    return folder


@pytest.fixture(params=SCENES)
def i3db_scene(request: pytest.FixtureRequest) -> Path:
    """The folder of one scene of the benchmark, each in turn."""
    folder = CORPUS / str(request.param)
    if not folder.is_dir():
        pytest.skip(f"the i3DB scenes are not at {CORPUS}")
    return folder


DEMO = "the demo, solved and sampled"
APART = {"tests/lab/test_sbc.py"}
"""Files whose tests take minutes each and share little."""
COMPILING = {
    "kernels of moves": (
        "tests/sampling/test_crossover.py",
        "tests/sampling/test_reference.py",
        "tests/sampling/test_steps.py",
    ),
    "kernels of models": (
        "tests/models/test_posterior.py",
        "tests/models/test_incremental.py",
    ),
}
"""Files with whose tests two processes compile what all others need. Moves begin with kernels of
their own, until the other process has compiled what both need."""
FIRST = (
    *COMPILING,
    "tests/samplers/",
    "tests/scenelets/",
    "tests/lab/",
    "tests/test_docs.py",
    "notebooks/",
    DEMO,
    "tests/cli/",
    "tests/sampling/",
    "tests/solver/",
)
"""Scopes in order. After the compiling ones come those that need none of its kernels, then what
takes long, so that no process is left with it in the end."""


def scope_of(nodeid: str) -> str:
    """What is run by one process, because it shares what was compiled, solved or sampled."""
    file = nodeid.split("::", 1)[0]
    for scope, files in COMPILING.items():
        if file in files:
            return scope
    if file.startswith("notebooks/") and "out/notebooks/demo" in _text(file):
        return "notebooks/ that look at one run"
    if file in APART:
        return nodeid
    shares = any(word in _text(file) for word in ("from tests.runs import", "run_of_demo"))
    return DEMO if shares else file


@cache
def _text(file: str) -> str:
    path = ROOT / file
    return path.read_text(encoding="utf-8") if path.is_file() else ""


def _rank(nodeid: str) -> tuple[int, int]:
    """Place of a test's scope, and of its file in the scope."""
    scope, file = scope_of(nodeid), nodeid.split("::", 1)[0]
    place = next((n for n, name in enumerate(FIRST) if scope.startswith(name)), len(FIRST))
    return place, COMPILING[scope].index(file) if scope in COMPILING else 0


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: _rank(item.nodeid))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Hand out what belongs together as a whole, in the order above."""
    from xdist.scheduler import LoadScopeScheduling

    class ByWhatIsShared(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return scope_of(nodeid)

    config.option.loadscopereorder = False
    return ByWhatIsShared(config, log)
