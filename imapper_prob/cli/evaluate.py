"""``evaluate``: compare results with the ground truth, and run the benchmark."""

from __future__ import annotations

import argparse
import logging
import multiprocessing
import os
import shlex
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from imapper_prob.cli.console import Stopped, console, progress_bars
from imapper_prob.config import Config, read_config
from imapper_prob.evaluate.prediction import (
    Prediction,
    is_solution,
    read_prediction,
    read_solution_folder,
)
from imapper_prob.evaluate.probability import PosteriorScore, posterior_predictions, score_posterior
from imapper_prob.evaluate.published import (
    OnClip,
    count_detected,
    depth_errors,
    read_depths,
    read_regions,
)
from imapper_prob.evaluate.report import (
    Exploration,
    benchmark_page,
    exploration_figure,
    write_page,
)
from imapper_prob.evaluate.score import KnownScene, known_clip, known_scene, scenes_with_truth
from imapper_prob.evaluate.suite import (
    OUR_METHODS,
    PARTS,
    Evaluation,
    Task,
    evaluate,
    posterior_coverage,
    prepare_suite,
    require_different_names,
    sample_all,
    sampled,
    solve_all,
    solved,
    tasks_of,
    truth_of_part,
    write_evaluation,
)
from imapper_prob.evaluate.tables import (
    coverage_figure,
    coverage_rows,
    difference_rows,
    made_by,
    object_rows,
    pose_rows,
    posterior_rows,
    screen_table,
    top_view_figure,
)
from imapper_prob.evaluate.truth import TruthInView
from imapper_prob.files import disk_errors_named, require_writable, written_whole
from imapper_prob.models.errors import InputError
from imapper_prob.plotting import save_figure
from imapper_prob.results.load import load_posterior
from imapper_prob.sampling.cluster import Cluster, connected, executor_of

__all__ = ["evaluate_results"]

_log = logging.getLogger(__name__)


def evaluate_results(options: argparse.Namespace) -> None:
    """Run the command with parsed options.

    Parameters
    ----------
    options : argparse.Namespace
        See `imapper_prob.cli.evaluate_options`.

    Raises
    ------
    InputError
        Options contradict each other, or results or truths cannot be read.
    """
    if (options.suite is None) == (not options.results):
        raise InputError("name either results, or a folder of scenes with --suite")
    if options.suite is None:
        _require_no_options_of_suite(options)
        _runs(options)
    elif options.truth is not None:
        raise InputError("--truth works with results only; scenes of --suite have their own")
    elif options.output is None:
        raise InputError("--suite needs a folder for its results, -o DIR")
    else:
        _suite(options)


def _require_no_options_of_suite(options: argparse.Namespace) -> None:
    """Refuse options that have no effect without ``--suite``."""
    of_suite = (
        "exploration", "solver_only", "config", "leave_one_out", "predictions", "detections",
        "depths", "cluster",
    )  # fmt: skip
    for name in of_suite:
        if getattr(options, name):
            option = name.replace("_", "-")
            raise InputError(f"--{option} works with --suite DIR only; leave it out for results")


def _runs(options: argparse.Namespace) -> None:
    _require_different(options.results)
    output = options.output or options.results[0]
    if output.is_file():
        raise InputError(
            f"{output}: is a file; name a folder for evaluation.json and pictures with -o DIR"
        )
    require_writable(output)
    known, predictions, posteriors = _read(options)
    everything = (*predictions, *known.others)
    evaluation = evaluate([(known.truth, everything)], posteriors)
    ours = [p.name for p in predictions]
    theirs = [p.name for p in known.others]
    _show(evaluation, ours, theirs)
    figures = {"evaluation.png": top_view_figure(known.truth, everything)}
    if posteriors:
        figures["coverage.png"] = coverage_figure(posteriors)
    _write(output, evaluation, ours, theirs, figures)


def _require_different(results: Sequence[Path]) -> None:
    """Refuse a file or folder that is named twice."""
    places = [os.path.realpath(path) for path in results]
    for path, place in zip(results, places, strict=True):
        if places.count(place) > 1:
            raise InputError(f"{path}: is named twice; name each result once")


def _read(
    options: argparse.Namespace,
) -> tuple[KnownScene, list[Prediction], list[PosteriorScore]]:
    """The truth, and all results; methods are named after their folders."""
    known = None if options.truth is None else known_scene(options.truth)
    predictions: list[Prediction] = []
    posteriors: list[PosteriorScore] = []
    for path in options.results:
        if path.is_file() or is_solution(path):
            if known is None:
                raise InputError(f"{path}: name the scene that it is of with --truth")
            read = read_prediction if path.is_file() else read_solution_folder
            found: tuple[Prediction, ...] = (read(path, known.clip),)
        else:
            posterior = load_posterior(path)
            known = known or known_clip(posterior.clip)
            posteriors.append(score_posterior(posterior, known.truth, name=path.name))
            found = posterior_predictions(posterior)
        if len(options.results) > 1:
            alike = [other for other in options.results if other.name == path.name]
            called = path.name if len(alike) == 1 else str(path)
            found = tuple(replace(p, name=f"{called}: {p.name}") for p in found)
        predictions += found
    assert known is not None  # there is at least one result, and each needs a truth
    return known, predictions, posteriors


def _suite(options: argparse.Namespace) -> None:
    command = _command()
    found = run_suite(options)
    _show(found.evaluation, found.ours, found.theirs)
    _write(options.output, found.evaluation, found.ours, found.theirs, found.figures)
    with disk_errors_named(options.output):
        found.write_page(options.output, command)


def _command() -> str:
    return shlex.join(["imapper-prob", *sys.argv[1:]])


def _show(evaluation: Evaluation, ours: list[str], theirs: list[str]) -> None:
    out = console()
    single = len(evaluation.one_by_one) == len(evaluation.summaries)
    for title, summaries in (
        ("", evaluation.summaries),
        (", scene by scene", [] if single else evaluation.one_by_one),
    ):
        if summaries:
            out.print(screen_table(object_rows(summaries), title=f"Furniture{title}"))
            poses = f"Joints{title}: world cm / local cm / pixels"
            out.print(screen_table(pose_rows(summaries), title=poses))
    differences = evaluation.differences(ours, theirs)
    if differences:
        title = "Differences object by object, a miss counting as a metre"
        out.print(screen_table(difference_rows(differences), title=title))
    if evaluation.posteriors:
        out.print(screen_table(posterior_rows(evaluation.posteriors), title="Posterior"))
        found = coverage_rows(posterior_coverage(evaluation.posteriors))
        out.print(screen_table(found, title="Do regions hold the truth?"))


def _write(
    folder: Path,
    evaluation: Evaluation,
    ours: list[str],
    theirs: list[str],
    figures: dict[str, Any],
) -> None:
    with disk_errors_named(folder):
        folder.mkdir(parents=True, exist_ok=True)
        differences = evaluation.differences(ours, theirs)
        made = made_by(_command())
        write_evaluation(folder / "evaluation.json", evaluation, differences, made)
        for name, figure in figures.items():
            with written_whole(folder / name) as beside:
                save_figure(figure, beside)


# ------------------------------------------------------------------------------------------------
# ``evaluate --suite``: compute what is missing, and score everything.


@dataclass(frozen=True, eq=False)
class SuiteResult:
    """The scores of a benchmark suite.

    Parameters
    ----------
    evaluation : Evaluation
    ours, theirs : list of str
        Names of methods.
    figures : dict of str to Figure
        By file name.
    clips : dict of str to OnClip
        For the paper's tables.
    explored : list of Exploration
    """

    evaluation: Evaluation
    ours: list[str]
    theirs: list[str]
    figures: dict[str, Figure]
    explored: list[Exploration]
    clips: dict[str, OnClip]

    def write_page(self, folder: Path, command: str) -> None:
        """Write ``benchmark.md`` beside the figures."""
        text = benchmark_page(
            self.evaluation,
            ours=self.ours,
            theirs=self.theirs,
            made_by=made_by(command),
            clips=self.clips,
            explored=self.explored,
            pictures=list(self.figures),
        )
        write_page(folder / "benchmark.md", text)


def run_suite(options: argparse.Namespace) -> SuiteResult:
    """Solve, sample and score all scenes; existing results are not computed again.

    Raises
    ------
    InputError
        There are no scenes, or the folder holds results of other settings.
    Stopped
        Sampling was interrupted.
    """
    config = Config() if options.config is None else read_config(options.config)
    scenes = scenes_with_truth(options.suite)
    _require_files_of_methods(options, scenes)
    known = {scene.name: known_scene(scene) for scene in scenes}
    methods = {name: _of_methods(scene, options) for name, scene in known.items()}
    others = scenes[0].parent if options.leave_one_out else None
    prepare_suite(options.output, config, others=others)
    parts = PARTS if options.exploration else PARTS[-1:]
    tasks = tasks_of(scenes, options.output, config, others=others, parts=parts)
    with connected(options.cluster) as cluster, progress_bars() as progress:
        with _executor(cluster, options.workers) as executor:
            solve_all(tasks, executor, progress=progress)
        if not options.solver_only and not sample_all(
            tasks, workers=options.workers, cluster=cluster, progress=progress
        ):
            raise Stopped("what there is was kept")
    return _scored(tasks, known, methods, parts)


_FILES_OF_METHODS = {"predictions": "*.json", "detections": "*.json", "depths": "*.npz"}
"""Options that name a folder with one folder a scene, and the files in these."""


def _require_files_of_methods(options: argparse.Namespace, scenes: Sequence[Path]) -> None:
    """Refuse a folder of other methods without a file for any scene; warn of what is not read."""
    names = [scene.name for scene in scenes]
    for name, pattern in _FILES_OF_METHODS.items():
        folder = getattr(options, name)
        if folder is None:
            continue
        filled = sorted({path.parent.name for path in folder.glob(f"*/{pattern}")})
        if not set(filled).intersection(names):
            raise InputError(
                f"--{name} {folder}: has no file of any scene; expected such as "
                f"{folder / names[0] / pattern.replace('*', 'NAME')}"
            )
        unknown = [other for other in filled if other not in names]
        if unknown:
            _log.warning(
                "--%s %s: %s not read, because no scene with truth in %s has this name; scenes "
                "are %s",
                name,
                folder,
                ", ".join(unknown),
                options.suite,
                ", ".join(names),
            )


@contextmanager
def _executor(cluster: Cluster | None, workers: int) -> Iterator[Executor]:
    if workers < 1:
        raise InputError(f"--workers {workers}: at least 1 is needed")
    with executor_of(cluster) as elsewhere:
        if elsewhere is not None:
            yield elsewhere
            return
        spawned = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(workers, mp_context=spawned) as executor:
            yield executor


def _scored(
    tasks: Sequence[Task],
    known: dict[str, KnownScene],
    methods: dict[str, _OfMethods],
    parts: Sequence[float],
) -> SuiteResult:
    explored = []
    for part in parts:
        of_part = [task for task in tasks if task.part == part]
        answers, posteriors = _answers(of_part, known)
        spread = [p.expected - p.energy for p in posteriors]
        summaries = evaluate(answers).summaries
        explored.append(
            Exploration(part, summaries, float(np.mean(spread)) if spread else float("nan"))
        )
    # The last part is the whole clip, the only one that other methods have results for.
    ours = list(dict.fromkeys(p.name for _, found in answers for p in found))
    whole = [(truth, (*found, *methods[truth.name].predictions)) for truth, found in answers]
    evaluation = evaluate(whole, posteriors)
    figures = {f"{truth.name}.png": top_view_figure(truth, found) for truth, found in whole}
    if posteriors:
        figures["coverage.png"] = coverage_figure(posteriors)
    theirs = [name for name in evaluation.scores if name not in ours]
    clips = {
        truth.name: OnClip(
            truth,
            {name: s for name, found in evaluation.scores.items() for s in found
             if s.clip == truth.name},
            methods[truth.name].regions,
            methods[truth.name].depths,
        )
        for truth, _ in whole
    }  # fmt: skip
    explored = explored if len(parts) > 1 else []
    if explored:
        figures["exploration.png"] = exploration_figure(explored)
    return SuiteResult(evaluation, ours, theirs, figures, explored, clips)


@dataclass(frozen=True, eq=False)
class _OfMethods:
    """Results of other methods for a scene.

    Parameters
    ----------
    predictions : tuple of Prediction
        Of the authors, the baselines, and files.
    regions : dict of str to int
        Number of objects that each region detector finds.
    depths : dict of str to array
        Errors of each depth estimator, metres.
    """

    predictions: tuple[Prediction, ...]
    regions: dict[str, int]
    depths: dict[str, NDArray[np.float64]]


def _of_methods(known: KnownScene, options: argparse.Namespace) -> _OfMethods:
    """Results of other methods, from files in one folder a scene."""
    camera, name = known.clip.camera, known.clip.name
    predictions, regions, depths = known.others, {}, {}
    if options.predictions is not None:
        files = sorted((options.predictions / name).glob("*.json"))
        predictions = (*predictions, *(read_prediction(file, known.clip) for file in files))
        require_different_names(name, [*OUR_METHODS, *(p.name for p in predictions)])
    if options.detections is not None:
        for path in sorted((options.detections / name).glob("*.json")):
            found = read_regions(path, known.clip)
            regions[path.stem] = count_detected(found, known.truth, camera)
    if options.depths is not None:
        for path in sorted((options.depths / name).glob("*.npz")):
            depths[path.stem] = depth_errors(read_depths(path, known.clip), known.truth, camera)
    return _OfMethods(predictions, regions, depths)


def _answers(
    tasks: Sequence[Task], known: dict[str, KnownScene]
) -> tuple[list[tuple[TruthInView, list[Prediction]]], list[PosteriorScore]]:
    """Predictions of the solver and, if sampled, of the posterior; and scores of the posteriors."""
    posteriors = dict(sampled(tasks))
    answers, scores = [], []
    for task in tasks:
        truth = truth_of_part(known[task.scene.name].truth, task.part)
        found = [solved(task)]
        if task in posteriors:
            found += posterior_predictions(posteriors[task])
            scores.append(score_posterior(posteriors[task], truth, name=task.run.name))
        answers.append((truth, found))
    return answers, scores
