"""Damaged and hostile files of the program's own: all that a run's folder holds, and more.

As :mod:`lab.robustness.inputs`. Checksums are left out or made to fit, so that damage reaches
what stands behind them.
"""

from __future__ import annotations

import io
import os
import shutil
import tempfile
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from imapper_prob.api import demo_clip
from imapper_prob.cli import main
from imapper_prob.clips.load import read_marks
from imapper_prob.config import Config, SampleSettings, read_config, to_toml
from imapper_prob.evaluate.prediction import (
    SOLVER,
    prediction_of_state,
    read_prediction,
    read_solution_folder,
    write_prediction,
)
from imapper_prob.evaluate.suite import first_part
from imapper_prob.models.errors import InputError
from imapper_prob.models.scenelet import Library
from imapper_prob.results.folders import write_run, write_solution_folder
from imapper_prob.results.posterior import Posterior, load_posterior
from imapper_prob.results.report import report
from imapper_prob.samplers.checkpoint import Checkpointer, CheckpointError
from imapper_prob.sampling.chain import run_chain, starts_of
from imapper_prob.sampling.checkpoints import identity_of
from imapper_prob.sampling.sample import sample_scenes, setup_of
from imapper_prob.scenelets.library import load_library, read_library, save_library
from imapper_prob.solver.actors import solved
from imapper_prob.solver.solver import Solution, solve
from lab.robustness.inputs import Reader
from tests.clips import bodies

__all__ = [
    "CONFIG",
    "RUN_READERS",
    "SEED",
    "small_library",
    "small_posterior",
    "small_solution",
]


SEED: Final = 3
CONFIG: Final = Config(
    seed=SEED,
    sample=SampleSettings(
        chains=2, steps=60, temperatures=2, draws=4, ensemble_layouts=1, ensembles=2,
        ensemble_steps=2,
    ),
)  # fmt: skip
"""Far too short to be good; every file has something in it."""


def small_library() -> Library:
    """Somebody who sits at a table, and a few who walk."""
    names = ("sit-couch-table-003", "walk")
    return Library("part", tuple(s for s in load_library() if s.name.startswith(names))[:20])


@cache
def small_solution() -> Solution:
    """Five seconds of the demo, solved."""
    return solve(first_part(demo_clip(), 0.4), small_library())


def small_posterior(*, checkpoints: Path | None = None) -> Posterior:
    """Its draws."""
    samples = sample_scenes(
        small_solution(),
        CONFIG.sample,
        seed=np.random.SeedSequence(SEED),
        checkpoints=checkpoints,
    )
    return Posterior(small_solution(), samples, CONFIG)


def _write_small_run(folder: Path) -> None:
    """The folder of a run."""
    write_run(folder, small_posterior(), overwrite=False)


@cache
def _whole_run() -> Path:
    """A run's folder, made once and removed with the process."""
    folder = Path(tempfile.mkdtemp(prefix="hostile-"))
    _write_small_run(folder / "run")
    return folder / "run"


def _run_with(*names: str) -> Callable[[Path], Path]:
    """Some files of a run, all where none is named."""

    def write(folder: Path) -> Path:
        for path in _whole_run().iterdir():
            if path.is_file() and (not names or path.name in names):
                shutil.copy(path, folder)
        return folder

    return write


def _summarised(folder: Path) -> Any:
    posterior = load_posterior(folder)
    posterior.scenes()
    posterior.clusters()
    posterior.occupancy()
    return posterior.verdict, posterior.estimate


def _reported(folder: Path) -> Any:
    return report(load_posterior(folder))


def _shown(folder: Path) -> None:
    with open(os.devnull, "w") as nowhere, redirect_stdout(nowhere):
        said = io.StringIO()
        with redirect_stderr(said):
            code = main(["info", str(folder)])
    if code:
        raise InputError(said.getvalue())


def _configured(folder: Path) -> Path:
    (folder / "config.toml").write_text(to_toml(CONFIG), encoding="utf-8")
    return folder / "config.toml"


def _chain(path: Path) -> Any:
    """Chain 0 of the small run, which goes on from a checkpoint if there is one."""
    solution, settings = small_solution(), CONFIG.sample
    setup, starts = setup_of(solution, settings), _starts()
    identity = identity_of(
        setup.problem, setup.candidates, starts, settings, np.random.SeedSequence(1)
    )
    keeper = Checkpointer(path, identity=identity, every_seconds=0.0)
    stop_at = 0.5 if not path.exists() else 2.0

    def unfinished(part: object = None, /) -> bool:
        return not (isinstance(part, float) and part >= stop_at)

    try:
        return run_chain(setup, starts[0], np.random.default_rng(1), unfinished, keeper)
    except CheckpointError as error:
        raise InputError(str(error)) from error


@cache
def _starts() -> Any:
    from imapper_prob.sampling.actors import join_actors

    return starts_of(join_actors([small_solution()]), CONFIG.sample.chains)


def _checkpoint(folder: Path) -> Path:
    _chain(folder / "chain-0.npz")
    return folder / "chain-0.npz"


def _solution(folder: Path) -> Path:
    solution = small_solution()
    write_solution_folder(
        folder / "out", solved(solution.clip, [solution]), CONFIG, overwrite=False
    )
    (folder / "out" / "manifest.json").unlink()
    return folder / "out"


def _prediction(folder: Path) -> Path:
    solution = small_solution()
    prediction = prediction_of_state(solution, solution.states[0], name=SOLVER)
    write_prediction(folder / "p.json", prediction, solution.clip)
    return folder / "p.json"


def _library(folder: Path) -> Path:
    save_library(small_library(), folder / "part.npz")
    return folder / "part.npz"


def _marks(folder: Path) -> Path:
    marks = [{"frame": 3, "actor": "b", "at": [100.0, 200.0]}]
    return bodies.write_json(folder / "marks.json", {"actors": ["a", "b"], "marks": marks})


RUN_READERS: Final[dict[str, Reader]] = {
    "posterior.nc": Reader(_run_with("posterior.nc"), _summarised),
    "posterior.nc, reported": Reader(_run_with("posterior.nc"), _reported),
    "scenes.json": Reader(_run_with("scenes.json", "posterior.nc"), _shown),
    "a run with its checksums": Reader(_run_with(), _shown),
    "config.toml": Reader(_configured, read_config),
    "checkpoint": Reader(_checkpoint, _chain),
    "solution": Reader(_solution, lambda path: read_solution_folder(path, small_solution().clip)),
    "prediction": Reader(_prediction, lambda path: read_prediction(path, small_solution().clip)),
    "library (.npz)": Reader(_library, read_library),
    "marks": Reader(_marks, read_marks),
}
"""Readers of what the program wrote itself."""
