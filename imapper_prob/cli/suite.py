"""``evaluate --suite``: run what is missing, score what is there."""

from __future__ import annotations

import argparse
import multiprocessing
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from imapper_prob.cli.progress import progress_bars
from imapper_prob.config import Config, read_config
from imapper_prob.evaluate.evaluation import Evaluation, evaluate
from imapper_prob.evaluate.figures import coverage_figure, top_view_figure
from imapper_prob.evaluate.parts import PARTS, truth_of_part
from imapper_prob.evaluate.posterior_score import (
    PosteriorScore,
    posterior_predictions,
    score_posterior,
)
from imapper_prob.evaluate.prediction import Prediction
from imapper_prob.evaluate.prediction_file import read_prediction
from imapper_prob.evaluate.provenance import made_by
from imapper_prob.evaluate.published import OnClip
from imapper_prob.evaluate.regions import (
    count_detected,
    depth_errors,
    read_depths,
    read_regions,
)
from imapper_prob.evaluate.report import Exploration, benchmark_page, write_page
from imapper_prob.evaluate.scenes import KnownScene, known_scene, scenes_with_truth
from imapper_prob.evaluate.suite import (
    Task,
    prepare_suite,
    sample_all,
    sampled,
    solve_all,
    solved,
    tasks_of,
)
from imapper_prob.evaluate.truth import TruthInView
from imapper_prob.models.errors import InputError
from imapper_prob.sampling.cluster import Cluster, connected, executor_of

__all__ = ["SuiteResult", "run_suite"]


@dataclass(frozen=True, eq=False)
class SuiteResult:
    """The scores of a suite.

    Parameters
    ----------
    evaluation : Evaluation
    ours, theirs : list of str
        Names of methods.
    figures : dict of str to Figure
        By the name of their file.
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
    """Solve, sample and score all scenes; what is done already is not done again.

    Raises
    ------
    InputError
        If there are no scenes, or the folder holds results of other settings, or sampling was
        interrupted.
    """
    config = Config() if options.config is None else read_config(options.config)
    scenes = scenes_with_truth(options.suite)
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
            raise InputError("interrupted: what there is was kept, the same command goes on")
    known = {scene.name: known_scene(scene) for scene in scenes}
    return _scored(tasks, known, parts, options)


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
    parts: Sequence[float],
    options: argparse.Namespace,
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
    # The last part is the whole: others have results for that alone.
    ours = list(dict.fromkeys(p.name for _, found in answers for p in found))
    whole = [
        (truth, (*found, *_others(known[truth.name], options.predictions)))
        for truth, found in answers
    ]
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
            *_in_the_image(known[truth.name], options),
        )
        for truth, _ in whole
    }  # fmt: skip
    explored = explored if len(parts) > 1 else []
    return SuiteResult(evaluation, ours, theirs, figures, explored, clips)


def _in_the_image(
    known: KnownScene, options: argparse.Namespace
) -> tuple[dict[str, int], dict[str, NDArray[np.float64]]]:
    """What region detectors and depth estimators left in files, one folder a scene."""
    camera, name = known.clip.camera, known.clip.name
    regions, depths = {}, {}
    if options.detections is not None:
        for path in sorted((options.detections / name).glob("*.json")):
            found = read_regions(path, known.clip)
            regions[path.stem] = count_detected(found, known.truth, camera)
    if options.depths is not None:
        for path in sorted((options.depths / name).glob("*.npz")):
            depths[path.stem] = depth_errors(read_depths(path, known.clip), known.truth, camera)
    return regions, depths


def _answers(
    tasks: Sequence[Task], known: dict[str, KnownScene]
) -> tuple[list[tuple[TruthInView, list[Prediction]]], list[PosteriorScore]]:
    """What the solver found and, where there are chains, what they say."""
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


def _others(known: KnownScene, predictions: Path | None) -> tuple[Prediction, ...]:
    """The authors, the baselines, and what other methods left in files."""
    if predictions is None:
        return known.others
    files = sorted((predictions / known.clip.name).glob("*.json"))
    return (*known.others, *(read_prediction(file, known.clip) for file in files))
