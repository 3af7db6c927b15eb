"""The whole benchmark: every scene solved and sampled once, whatever interrupts it.

What is done lies in the suite's folder, one folder a scene; what is there is not done again.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from imapper_prob.api import sample
from imapper_prob.config import Config, to_toml
from imapper_prob.evaluate.parts import first_part
from imapper_prob.evaluate.prediction import Prediction, prediction_of_solved
from imapper_prob.evaluate.prediction_file import read_prediction, write_prediction
from imapper_prob.evaluate.provenance import commit
from imapper_prob.evaluate.solution_folder import SOLVER
from imapper_prob.files import written_whole
from imapper_prob.inputs import load_clip
from imapper_prob.inputs.json_fields import load_json
from imapper_prob.inputs.load_captures import captures_from
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip
from imapper_prob.models.scenelet import Library
from imapper_prob.output import CHECKPOINTS, run_folder, write_run
from imapper_prob.results.load import load_posterior
from imapper_prob.results.posterior import Posterior
from imapper_prob.results.solved import solved as put_together
from imapper_prob.sampling.cluster import Cluster
from imapper_prob.scenelets.build import build_library_from
from imapper_prob.scenelets.library import joined, load_library
from imapper_prob.staged.actors import solve_actors

__all__ = [
    "Task", "library_of", "prepare_suite", "sample_all", "sampled", "solve_all",
    "solved", "tasks_of",
]  # fmt: skip

Progress = Callable[[str, float], None]

_IDENTITY: Final = "suite.json"
"""File that says what the suite's results were made with."""


@dataclass(frozen=True)
class Task:
    """One scene of the benchmark, or the beginning of one.

    Parameters
    ----------
    scene : Path
        Its folder.
    output : Path
        Folder of its results.
    config : Config
        Settings, the library among them; constants are those of the other scenes.
    others : Path, optional
        Folder of scenes from whose truth scenelets are cut as well; this one is left out.
    part : float
        Of the clip's frames, from the first.
    """

    scene: Path
    output: Path
    config: Config
    others: Path | None = None
    part: float = 1.0

    @property
    def clip(self) -> Clip:
        """What is seen."""
        return first_part(load_clip(self.scene), self.part)

    @property
    def solution(self) -> Path:
        """File of what the solver found."""
        return self.output / f"solver{self._suffix}.json"

    @property
    def run(self) -> Path:
        """Folder of the posterior."""
        return self.output / f"run{self._suffix}"

    @property
    def is_sampled(self) -> bool:
        """Whether the posterior is there, and complete."""
        return (self.run / "posterior.nc").is_file() and not (self.run / CHECKPOINTS).exists()

    @property
    def _suffix(self) -> str:
        return "" if self.part == 1 else f"-{round(100 * self.part)}"


def tasks_of(
    scenes: Sequence[Path],
    output: Path,
    config: Config,
    *,
    others: Path | None = None,
    parts: Sequence[float] = (1.0,),
) -> list[Task]:
    """One task a scene and part, with constants estimated without that scene."""
    return [
        Task(scene, output / scene.name, config.without(scene.name), others, part)
        for part in parts
        for scene in scenes
    ]


def prepare_suite(output: Path, config: Config, *, others: Path | None) -> None:
    """Make the folder, or refuse one whose results are of other settings or another commit.

    Raises
    ------
    InputError
        If they are.
    """
    identity = {
        "commit": commit(),
        "config": to_toml(config),
        "constants": "of each scene estimated from the others",
        "scenelets of the other scenes": others is not None,
    }
    path = output / _IDENTITY
    if path.exists():
        before = load_json(path)
        other = [name for name, value in identity.items() if before.get(name) != value]
        if other:
            raise InputError(f"{output}: holds results of another {other[0]}; name another folder")
        return
    if output.exists() and (not output.is_dir() or any(output.iterdir())):
        raise InputError(f"{output}: is not empty and holds no suite; name another folder")
    output.mkdir(parents=True, exist_ok=True)
    with written_whole(path) as beside:
        beside.write_text(json.dumps(identity, indent=1) + "\n", encoding="utf-8")


def library_of(task: Task) -> Library:
    """The library of the settings, with real scenelets of all other scenes where asked for."""
    library = load_library(task.config.library)
    if task.others is None:
        return library
    captures = captures_from("i3db", task.others, leave_out=task.scene.name)
    real, _ = build_library_from(captures, name=f"i3db-without-{task.scene.name}")
    return joined([library, real])


def solve_all(
    tasks: Sequence[Task], executor: Executor, *, progress: Progress | None = None
) -> None:
    """Solve what is not solved yet, each task where the executor likes."""
    waiting = [task for task in tasks if not task.solution.is_file()]
    done = len(tasks) - len(waiting)
    running = [executor.submit(_solve, task) for task in waiting]
    try:
        for future in as_completed(running):
            future.result()
            done += 1
            if progress is not None:
                progress("staged solver", done / len(tasks))
    finally:
        for future in running:
            future.cancel()


def solved(task: Task) -> Prediction:
    """What the solver found."""
    return read_prediction(task.solution, task.clip)


def sample_all(
    tasks: Sequence[Task],
    *,
    workers: int,
    cluster: Cluster | None = None,
    progress: Progress | None = None,
) -> bool:
    """Sample what is not sampled yet, one task after the other, its chains side by side.

    Returns
    -------
    bool
        False if interrupted: what there is was kept, and the same call goes on from there.
    """
    for task in tasks:
        if task.is_sampled:
            continue
        with run_folder(task.run, overwrite=False):
            posterior = sample(
                task.clip,
                library_of(task),
                config=task.config,
                workers=workers,
                cluster=cluster,
                checkpoints=task.run / CHECKPOINTS,
                progress=_named(task, progress),
            )
            write_run(task.run, posterior, overwrite=False)
        if not posterior.samples.finished:
            return False
    return True


def sampled(tasks: Sequence[Task]) -> Iterator[tuple[Task, Posterior]]:
    """The posteriors that there are."""
    for task in tasks:
        if task.is_sampled:
            yield task, load_posterior(task.run)


def _solve(task: Task) -> None:
    clip = task.clip
    actors = solve_actors(clip, library_of(task), settings=task.config.settings)
    prediction = prediction_of_solved(put_together(clip, actors, count=1), name=SOLVER)
    task.output.mkdir(parents=True, exist_ok=True)
    write_prediction(task.solution, prediction, clip)


def _named(task: Task, progress: Progress | None) -> Progress | None:
    if progress is None:
        return None
    return lambda stage, part: progress(f"{task.scene.name}, {stage}", part)
