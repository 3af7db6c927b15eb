"""The benchmark: every scene is solved, sampled and scored once.

Results are in the suite's folder, one folder a scene. Existing results are not computed again, so
an interrupted benchmark can be continued.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from imapper_prob.api import sample
from imapper_prob.clips.load import load_clip, window
from imapper_prob.clips.parsing import load_json
from imapper_prob.config import Config, to_toml
from imapper_prob.evaluate.prediction import (
    SOLVER,
    Prediction,
    prediction_of_solved,
    read_prediction,
    write_prediction,
)
from imapper_prob.evaluate.probability import LIKELY, MOST_PROBABLE, PosteriorScore
from imapper_prob.evaluate.regions import Coverage, coverage
from imapper_prob.evaluate.score import (
    Difference,
    Score,
    Summary,
    paired_difference,
    score,
    summarise,
)
from imapper_prob.evaluate.tables import as_json, commit
from imapper_prob.evaluate.truth import TruthInView
from imapper_prob.files import without_nan, written_whole
from imapper_prob.memory import require_feasible
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip
from imapper_prob.models.scenelet import Library
from imapper_prob.progress import Progress
from imapper_prob.results.folders import CHECKPOINTS, run_folder, write_run
from imapper_prob.results.load import load_posterior
from imapper_prob.results.posterior import Posterior
from imapper_prob.sampling.cluster import Cluster
from imapper_prob.scenelets.build import build_library_from, captures_from
from imapper_prob.scenelets.library import joined, load_library
from imapper_prob.solver.actors import solve_actors
from imapper_prob.solver.actors import solved as put_together

__all__ = [
    "OUR_METHODS",
    "PARTS",
    "Evaluation",
    "Task",
    "evaluate",
    "first_part",
    "library_of",
    "posterior_coverage",
    "prepare_suite",
    "require_different_names",
    "sample_all",
    "sampled",
    "solve_all",
    "solved",
    "tasks_of",
    "truth_of_part",
    "write_evaluation",
]

PARTS: Final = (0.25, 0.5, 0.75, 1.0)
"""Fractions of a clip's frames."""


def first_part(clip: Clip, part: float) -> Clip:
    """The first frames of a clip, without ground truth (see :func:`truth_of_part`).

    Parameters
    ----------
    clip : Clip
    part : float
        Fraction of its frames.

    Returns
    -------
    Clip
    """
    if part == 1:
        return clip
    count = _count(clip.n_frames, part)
    first = int(clip.frame_ids[0])
    return replace(window(clip, first, first + count - 1), truth=None)


def truth_of_part(truth: TruthInView, part: float) -> TruthInView:
    """The ground truth of the first frames; it still has all objects of the whole clip.

    Parameters
    ----------
    truth : TruthInView
    part : float
        Fraction of the frames.

    Returns
    -------
    TruthInView
    """
    frames = len(truth.frame_ids)
    count = _count(frames, part)
    rows = np.arange(len(truth.joints)).reshape(-1, frames)[:, :count].ravel()
    return replace(
        truth,
        frame_ids=truth.frame_ids[:count],
        joints=truth.joints[rows],
        pixels=truth.pixels[rows],
        hidden=truth.hidden[rows],
        actions=tuple(truth.actions[row] for row in rows.tolist()) if truth.actions else (),
    )


def _count(frames: int, part: float) -> int:
    return max(1, round(part * frames))


# ------------------------------------------------------------------------------------------------
# Evaluations.

_BOOTSTRAP_SEED: Final = 8
"""Fixed, so that the same results have the same intervals; any number would do."""
_FORMAT: Final = "imapper-prob evaluation"
_VERSION: Final = 2
"""Version of the file's format."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Scores by method, this program's methods first.

    Parameters
    ----------
    scores : dict of str to list of Score
        For each method, one score a clip.
    posteriors : list of PosteriorScore
        One for each sampled run.
    """

    scores: dict[str, list[Score]]
    posteriors: list[PosteriorScore]

    @property
    def summaries(self) -> list[Summary]:
        """Summary of each method over all its clips."""
        return [summarise(found) for found in self.scores.values()]

    @property
    def one_by_one(self) -> list[Summary]:
        """Summary of each method on each clip."""
        clips = dict.fromkeys(s.clip for found in self.scores.values() for s in found)
        return [
            summarise([s])
            for clip in clips
            for found in self.scores.values()
            for s in found
            if s.clip == clip
        ]

    def differences(self, ours: Iterable[str], theirs: Iterable[str]) -> list[Difference]:
        """Differences of each of our methods minus each of theirs that predicts furniture.

        Parameters
        ----------
        ours, theirs : iterable of str
            Names of methods.

        Returns
        -------
        list of Difference
        """
        rng = np.random.default_rng(_BOOTSTRAP_SEED)
        others = [
            name for name in theirs if any(s.objects.predicted for s in self.scores.get(name, []))
        ]
        return [
            paired_difference(self.scores[one], self.scores[other], rng)
            for one in ours
            for other in others
            if one != other
        ]


OUR_METHODS: Final = (SOLVER, MOST_PROBABLE, LIKELY)
"""Names of the methods that a suite computes."""


def require_different_names(clip: str, names: Sequence[str]) -> None:
    """Refuse two predictions of one name.

    Parameters
    ----------
    clip : str
        Name of the clip that they are of.
    names : sequence of str

    Raises
    ------
    InputError
    """
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{name}: two results for {clip} are called so")


def evaluate(
    answers: Iterable[tuple[TruthInView, Sequence[Prediction]]],
    posteriors: Iterable[PosteriorScore] = (),
) -> Evaluation:
    """Score every prediction on every clip.

    Parameters
    ----------
    answers : iterable of (TruthInView, sequence of Prediction)
        Truth and predictions of each clip.
    posteriors : iterable of PosteriorScore

    Returns
    -------
    Evaluation

    Raises
    ------
    InputError
        The frames of a prediction differ from those of the truth, or two predictions of a clip have
        one name.
    """
    scores: dict[str, list[Score]] = {}
    for truth, predictions in answers:
        require_different_names(truth.name, [p.name for p in predictions])
        for prediction in predictions:
            scores.setdefault(prediction.name, []).append(score(prediction, truth))
    return Evaluation(scores, list(posteriors))


def posterior_coverage(posteriors: Sequence[PosteriorScore]) -> dict[str, tuple[Coverage, ...]]:
    """Coverage of objects, pelvis and joints, pooled over clips.

    Parameters
    ----------
    posteriors : sequence of PosteriorScore

    Returns
    -------
    dict of str to tuple of Coverage
    """
    return {
        name: coverage(
            [getattr(p, ranks) for p in posteriors],
            [p.inside[ranks] for p in posteriors if ranks in p.inside],
        )
        for name, ranks in (
            ("object centres", "object_ranks"),
            ("pelvis", "pelvis_ranks"),
            ("joints", "joint_ranks"),
            ("hidden joints", "hidden_ranks"),
            ("joints, given the clip's size", "sized_ranks"),
        )
    }


def write_evaluation(
    path: Path, evaluation: Evaluation, differences: Sequence[Difference], made_by: dict[str, str]
) -> None:
    """Write ``evaluation.json``.

    Parameters
    ----------
    path : Path
    evaluation : Evaluation
    differences : sequence of Difference
    made_by : dict of str to str
        Commit, command, settings.
    """
    document: dict[str, Any] = {
        "format": _FORMAT,
        "version": _VERSION,
        **made_by,
        "methods": [as_json(found, summarise(found)) for found in evaluation.scores.values()],
        "scene_by_scene": [asdict(s) for s in evaluation.one_by_one],
        "differences_cm": [asdict(d) for d in differences],
        "posteriors": [_plain(p) for p in evaluation.posteriors],
    }
    if evaluation.posteriors:
        document["coverage"] = {
            name: [asdict(c) for c in found]
            for name, found in posterior_coverage(evaluation.posteriors).items()
        }
    text = json.dumps(without_nan(document), indent=1, allow_nan=False, ensure_ascii=False)
    with written_whole(path) as beside:
        beside.write_text(text + "\n", encoding="utf-8")


def _plain(posterior: PosteriorScore) -> dict[str, Any]:
    """Scores of a posterior for JSON; ranks of joints become histograms of ten bins."""
    values = dict(vars(posterior))
    values["object_ranks"] = posterior.object_ranks.tolist()
    values["labels"] = vars(posterior.labels)
    for name in (*values.pop("inside"), "distance_ranks"):
        counts, _ = np.histogram(values[name], bins=10, range=(0, 1))
        values[name] = counts.tolist()
    return values


# ------------------------------------------------------------------------------------------------
# The benchmark.

_IDENTITY: Final = "suite.json"
"""File that records commit and settings of the suite's results."""


@dataclass(frozen=True)
class Task:
    """One scene of the benchmark, or its first part.

    Parameters
    ----------
    scene : Path
        Folder of the scene.
    output : Path
        Folder of its results.
    config : Config
        Settings, including the library; constants are estimated from the other scenes.
    others : Path, optional
        Folder of scenes from whose truth more scenelets are cut; this scene is left out.
    part : float
        Fraction of the clip's frames, from the first.
    """

    scene: Path
    output: Path
    config: Config
    others: Path | None = None
    part: float = 1.0

    @property
    def clip(self) -> Clip:
        """The clip, or its first part."""
        return first_part(load_clip(self.scene), self.part)

    @property
    def solution(self) -> Path:
        """File of the solver's result."""
        return self.output / f"solver{self._suffix}.json"

    @property
    def run(self) -> Path:
        """Folder of the posterior."""
        return self.output / f"run{self._suffix}"

    @property
    def is_sampled(self) -> bool:
        """Whether the posterior exists and is complete."""
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
    """One task for each scene and part, with constants estimated without that scene.

    Parameters
    ----------
    scenes : sequence of Path
        Folders of i3DB scenes.
    output : Path
        Folder of the suite.
    config : Config
    others : Path, optional
        Folder of scenes from which real scenelets are made.
    parts : sequence of float
        Fractions of the frames.

    Returns
    -------
    list of Task
    """
    return [
        Task(scene, output / scene.name, config.without(scene.name), others, part)
        for part in parts
        for scene in scenes
    ]


def prepare_suite(output: Path, config: Config, *, others: Path | None) -> None:
    """Make the suite's folder, or refuse one with results of other settings or commits.

    Parameters
    ----------
    output : Path
    config : Config
    others : Path, optional
        Folder of scenes from which real scenelets are made.

    Raises
    ------
    InputError
        The folder holds such results.
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
    """The library of the settings, with real scenelets of all other scenes if requested.

    Parameters
    ----------
    task : Task

    Returns
    -------
    Library
    """
    library = load_library(task.config.library)
    if task.others is None:
        return library
    captures = captures_from("i3db", task.others, leave_out=task.scene.name)
    real, _ = build_library_from(captures, name=f"i3db-without-{task.scene.name}")
    return joined([library, real])


def solve_all(
    tasks: Sequence[Task], executor: Executor, *, progress: Progress | None = None
) -> None:
    """Solve the tasks without a solution, in the executor.

    Parameters
    ----------
    tasks : sequence of Task
    executor : concurrent.futures.Executor
    progress : callable, optional
        Called with the name of a stage and the fraction of it that is done.
    """
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
    """Read the solver's result of a task.

    Parameters
    ----------
    task : Task

    Returns
    -------
    Prediction
    """
    return read_prediction(task.solution, task.clip)


def sample_all(
    tasks: Sequence[Task],
    *,
    workers: int,
    cluster: Cluster | None = None,
    progress: Progress | None = None,
) -> bool:
    """Sample the tasks without a posterior, one after the other, with parallel chains.

    Parameters
    ----------
    tasks : sequence of Task
    workers : int
        Number of processes.
    cluster : Cluster, optional
    progress : callable, optional
        Called with the name of a stage and the fraction of it that is done.

    Returns
    -------
    bool
        False if interrupted; results so far are kept, and the same call continues.
    """
    for task in tasks:
        if task.is_sampled:
            continue
        with run_folder(task.run, overwrite=False, resumes=True):
            posterior = sample(
                task.clip,
                library_of(task),
                config=task.config,
                workers=workers,
                cluster=cluster,
                checkpoints=task.run / CHECKPOINTS,
                progress=_named(task, progress),
            )
            write_run(task.run, posterior, overwrite=False, resumed=True)
        if not posterior.samples.finished:
            return False
    return True


def sampled(tasks: Sequence[Task]) -> Iterator[tuple[Task, Posterior]]:
    """The existing posteriors of some tasks.

    Parameters
    ----------
    tasks : sequence of Task

    Yields
    ------
    task : Task
    posterior : Posterior
    """
    for task in tasks:
        if task.is_sampled:
            yield task, load_posterior(task.run)


def _solve(task: Task) -> None:
    clip = task.clip
    library = library_of(task)
    require_feasible(clip, library)
    actors = solve_actors(clip, library, settings=task.config.settings)
    prediction = prediction_of_solved(put_together(clip, actors, count=1), name=SOLVER)
    task.output.mkdir(parents=True, exist_ok=True)
    write_prediction(task.solution, prediction, clip)


def _named(task: Task, progress: Progress | None) -> Progress | None:
    if progress is None:
        return None
    return lambda stage, part: progress(f"{task.scene.name}, {stage}", part)
