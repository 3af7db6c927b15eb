"""Damaged and hostile files of the program's own formats, including a run's whole folder.

See :mod:`lab.robustness.inputs`. Checksums are left out or made to match, so that damage reaches
the readers behind them.
"""

from __future__ import annotations

import io
import json
import os
import shutil
import tempfile
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
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
    read_prediction,
    read_solution_folder,
    write_prediction,
)
from imapper_prob.evaluate.suite import first_part
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.scenelet import Library
from imapper_prob.results.folders import (
    CHECKPOINTS,
    earlier_run,
    restore_chains,
    run_folder,
    write_run,
    write_solution_folder,
)
from imapper_prob.results.load import load_posterior
from imapper_prob.results.posterior import Posterior
from imapper_prob.results.report import report, write_report
from imapper_prob.samplers.checkpoint import Checkpointer, CheckpointError
from imapper_prob.sampling.actors import JointProblem, join_actors
from imapper_prob.sampling.chain import run_chain, starts_of
from imapper_prob.sampling.checkpoints import identity_of
from imapper_prob.sampling.sample import sample_scenes, setup_of
from imapper_prob.scenelets.library import load_library, read_library, save_library
from imapper_prob.solver.actors import solve_actors, solved
from imapper_prob.solver.solver import Solution, solve
from imapper_prob.uncertainty.tree import write_tree
from lab.ablation import prediction_of_state
from lab.robustness.inputs import Reader
from tests.clips import bodies

__all__ = [
    "CONFIG",
    "RUN_READERS",
    "SEED",
    "small_clip",
    "small_joint_problem",
    "small_library",
    "small_posterior",
    "small_solution",
    "warm_up",
]


SEED: Final = 3
CONFIG: Final = Config(
    seed=SEED,
    sample=SampleSettings(
        chains=2, steps=60, temperatures=2, draws=4, ensemble_steps=2,
    ),
)  # fmt: skip
"""Much too short to converge, but every file has content."""


def small_library() -> Library:
    """A library with sitting at a table, and with some walks."""
    names = ("sit-couch-table-003", "walk")
    return Library("part", tuple(s for s in load_library() if s.name.startswith(names))[:20])


def small_clip(people: int = 1) -> Clip:
    """Five seconds of the demo; other people repeat its person's motion later, or backwards."""
    demo = demo_clip()
    first = first_part(demo, 0.4)
    n = first.n_frames
    rows = (np.arange(n), np.arange(n) + n, np.arange(n)[::-1])
    tracks = (_at(demo.tracks[0], rows[person], "ABC"[person]) for person in range(people))
    return first if people == 1 else replace(first, tracks=tuple(tracks), truth=None)


def _at(track: Track, rows: np.ndarray, name: str) -> Track:
    arrays = ("keypoints", "confidences", "poses", "interpolated")
    return replace(track, name=name, **{field: getattr(track, field)[rows] for field in arrays})


@cache
def small_solution() -> Solution:
    """Solution of the clip of one person."""
    return solve(small_clip(), small_library())


@cache
def small_joint_problem(people: int) -> Solution | JointProblem:
    """Solution of a clip with several people."""
    if people == 1:
        return small_solution()
    return join_actors(solve_actors(small_clip(people), small_library()))


def small_posterior(
    *, people: int = 1, seed: int = SEED, checkpoints: Path | None = None, anew: bool = False
) -> Posterior:
    """Posterior of a small clip."""
    source = small_joint_problem(people)
    samples = sample_scenes(
        source, CONFIG.sample, seed=np.random.SeedSequence(seed), checkpoints=checkpoints, anew=anew
    )
    return Posterior(source, samples, CONFIG)


def warm_up() -> None:
    """Load what a small run needs before this process forks; leaves no threads."""
    posterior = small_posterior()
    with tempfile.TemporaryDirectory() as folder:
        write_report(Path(folder) / "report.html", posterior)
        write_tree(Path(folder) / "posterior.nc", posterior.data)


def _write_small_run(folder: Path) -> None:
    """Write the folder of a run, including what its chains need to continue."""
    posterior = small_posterior(checkpoints=folder / CHECKPOINTS)
    write_run(folder, posterior, overwrite=False, resumed=True)


@cache
def _whole_run() -> Path:
    """Folder of a run, made once and removed with the process."""
    folder = Path(tempfile.mkdtemp(prefix="hostile-"))
    _write_small_run(folder / "run")
    return folder / "run"


def _run_with(*names: str) -> Callable[[Path], Path]:
    """Copy some files of a run, or all if none is named."""

    def write(folder: Path) -> Path:
        if not names:
            return Path(shutil.copytree(_whole_run(), folder, dirs_exist_ok=True))
        for name in names:
            shutil.copy(_whole_run() / name, folder)
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


def _gone_on_with(folder: Path) -> None:
    """What a command does with a finished run, up to the continuation of its chains."""
    try:
        if earlier_run(folder) is not None:
            restore_chains(folder, chains=CONFIG.sample.chains)
    finally:
        shutil.rmtree(folder / CHECKPOINTS, ignore_errors=True)


def _put_in_place(folder: Path) -> None:
    """What the next command does after one was killed while it published files."""
    stage = folder / ".partial"
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    try:
        with run_folder(folder, overwrite=True):
            pass
    finally:
        shutil.rmtree(folder)
        stage.mkdir(parents=True)
        for path, content in before.items():
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(content)


def _killed_when_complete(folder: Path) -> Path:
    (folder / "out" / ".partial").mkdir(parents=True)
    for name in ("manifest.json", "scenes.json", "config.toml"):
        shutil.copy(_whole_run() / name, folder / "out" / ".partial")
    manifest = folder / "out" / ".partial" / "manifest.json"
    document = json.loads(manifest.read_text())
    kept = {name: document["files"][name] for name in ("scenes.json", "config.toml")}
    manifest.write_text(json.dumps({**document, "files": kept}))
    return folder / "out"


def _configured(folder: Path) -> Path:
    (folder / "config.toml").write_text(to_toml(CONFIG), encoding="utf-8")
    return folder / "config.toml"


def _chain(path: Path) -> Any:
    """Chain 0 of the small run, continued from a checkpoint if there is one."""
    solution, settings = small_solution(), CONFIG.sample
    setup, starts = setup_of(solution, settings), _starts()
    identity = identity_of(setup.problem, starts, settings, np.random.SeedSequence(1))
    checkpointer = Checkpointer(path, identity=identity, every_seconds=0.0)
    stop_at = 0.5 if not path.exists() else 2.0

    def unfinished(part: object = None, /) -> bool:
        return not (isinstance(part, float) and part >= stop_at)

    try:
        return run_chain(setup, starts[0], np.random.default_rng(1), unfinished, checkpointer)
    except CheckpointError as error:
        raise InputError(str(error)) from error


@cache
def _starts() -> Any:
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
    "a run to go on with": Reader(_run_with(), _gone_on_with),
    "a run being put in place": Reader(_killed_when_complete, _put_in_place),
    "config.toml": Reader(_configured, read_config),
    "checkpoint": Reader(_checkpoint, _chain),
    "solution": Reader(_solution, lambda path: read_solution_folder(path, small_solution().clip)),
    "prediction": Reader(_prediction, lambda path: read_prediction(path, small_solution().clip)),
    "library (.npz)": Reader(_library, read_library),
    "marks": Reader(_marks, read_marks),
}
"""Readers of the program's own files."""
