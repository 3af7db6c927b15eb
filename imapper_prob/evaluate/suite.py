"""The whole benchmark: every scene solved or sampled once, whatever interrupts it.

What is done lies in the suite's folder, one file or run a scene; what is there is not done again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from imapper_prob.config import Config
from imapper_prob.evaluate.prediction import Prediction, prediction_of_state
from imapper_prob.evaluate.prediction_file import read_prediction, write_prediction
from imapper_prob.inputs import load_clip
from imapper_prob.inputs.load_captures import captures_from
from imapper_prob.models.scenelet import Library
from imapper_prob.scenelets.build import build_library_from
from imapper_prob.scenelets.library import joined, load_library
from imapper_prob.staged.solver import solve

__all__ = ["SOLVER", "Task", "library_of", "solve_all", "solved", "tasks_of"]

Progress = Callable[[str, float], None]

SOLVER: Final = "staged solver"
"""Heads the row of the deterministic solution."""
_SOLVED: Final = "solver.json"


@dataclass(frozen=True)
class Task:
    """One scene of the benchmark.

    Parameters
    ----------
    scene : Path
        Its folder.
    output : Path
        Folder of its results.
    config : Config
        Settings, the library among them.
    others : Path, optional
        Folder of scenes from whose truth scenelets are cut as well; this one is left out.
    """

    scene: Path
    output: Path
    config: Config
    others: Path | None = None


def tasks_of(
    scenes: Sequence[Path], output: Path, config: Config, *, others: Path | None = None
) -> list[Task]:
    """One task a scene."""
    return [Task(scene, output / scene.name, config, others) for scene in scenes]


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
    """Solve the scenes that are not solved yet, each where the executor likes."""
    waiting = [t for t in tasks if not (t.output / _SOLVED).is_file()]
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


def solved(tasks: Sequence[Task]) -> Iterator[Prediction]:
    """What the solver found, scene by scene."""
    for task in tasks:
        yield read_prediction(task.output / _SOLVED, load_clip(task.scene))


def _solve(task: Task) -> None:
    clip = load_clip(task.scene)
    solution = solve(clip, library_of(task), settings=task.config.model)
    prediction = prediction_of_state(solution, solution.states[0], name=SOLVER)
    task.output.mkdir(parents=True, exist_ok=True)
    write_prediction(task.output / _SOLVED, prediction, clip)
