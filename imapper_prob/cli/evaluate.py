"""``evaluate``: results held against the truth, and the whole benchmark."""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imapper_prob.models.errors import InputError

if TYPE_CHECKING:
    from imapper_prob.evaluate.evaluation import Evaluation
    from imapper_prob.evaluate.posterior_score import PosteriorScore
    from imapper_prob.evaluate.prediction import Prediction
    from imapper_prob.evaluate.scenes import KnownScene

__all__ = ["add_evaluate_command"]

_DOTS_PER_INCH = 150


def add_evaluate_command(
    commands: argparse._SubParsersAction[Any], shared: argparse.ArgumentParser
) -> None:
    """Add the command to a parser; ``shared`` holds options that all commands have."""
    command = commands.add_parser(
        "evaluate", parents=[shared], help="hold results against a known truth"
    )
    command.add_argument(
        "results",
        type=Path,
        nargs="*",
        metavar="RUN",
        help="folders of `run` or `solve`, or prediction files (.json) of any method",
    )
    command.add_argument(
        "--truth",
        type=Path,
        metavar="SCENE",
        help="i3DB scene with its gt/, or a clip file with its truth; if not given, the run's own",
    )
    command.add_argument(
        "-o", "--output", type=Path, metavar="DIR", help="of evaluation.json and pictures"
    )
    suite = command.add_argument_group("the whole benchmark")
    suite.add_argument("--suite", type=Path, metavar="DIR", help="all i3DB scenes in a folder")
    suite.add_argument(
        "--exploration", action="store_true", help="also a quarter, a half and more of each clip"
    )
    suite.add_argument("--solver-only", action="store_true", help="no chains: some minutes")
    suite.add_argument("--config", type=Path, help="settings (TOML)")
    suite.add_argument(
        "--leave-one-out",
        action="store_true",
        help="add scenelets cut from the truth of the other scenes",
    )
    suite.add_argument(
        "--predictions",
        type=Path,
        metavar="DIR",
        help="prediction files of other methods, one folder a scene",
    )
    suite.add_argument(
        "--detections",
        type=Path,
        metavar="DIR",
        help="COCO results of region detectors (NAME.json), one folder a scene",
    )
    suite.add_argument(
        "--depths",
        type=Path,
        metavar="DIR",
        help="depth maps of monocular estimators (NAME.npz), one folder a scene",
    )
    suite.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes")
    suite.add_argument("--cluster", metavar="ADDRESS", help="workers of a dask scheduler instead")
    command.set_defaults(execute=_evaluate)


def _evaluate(options: argparse.Namespace) -> None:
    if (options.suite is None) == (not options.results):
        raise InputError("name either results, or a folder of scenes with --suite")
    if options.suite is None:
        _runs(options)
    elif options.output is None:
        raise InputError("--suite needs a folder for its results, -o DIR")
    else:
        _suite(options)


def _runs(options: argparse.Namespace) -> None:
    from imapper_prob.evaluate.evaluation import evaluate
    from imapper_prob.evaluate.figures import coverage_figure, top_view_figure

    output = options.output or options.results[0]
    if output.is_file():
        raise InputError("name a folder for evaluation.json and pictures with -o DIR")
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


def _read(
    options: argparse.Namespace,
) -> tuple[KnownScene, list[Prediction], list[PosteriorScore]]:
    """The truth, and what every result says; names are told apart by their folders."""
    from dataclasses import replace

    from imapper_prob.evaluate.posterior_score import posterior_predictions, score_posterior
    from imapper_prob.evaluate.prediction_file import read_prediction
    from imapper_prob.evaluate.scenes import known_clip, known_scene
    from imapper_prob.evaluate.solution_folder import is_solution, read_solution_folder
    from imapper_prob.results.load import load_posterior

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
            found = tuple(replace(p, name=f"{path.name}: {p.name}") for p in found)
        predictions += found
    assert known is not None  # there is at least one result, and each needs a truth
    return known, predictions, posteriors


def _suite(options: argparse.Namespace) -> None:
    from imapper_prob.cli.suite import run_suite

    command = _command()
    found = run_suite(options)
    _show(found.evaluation, found.ours, found.theirs)
    _write(options.output, found.evaluation, found.ours, found.theirs, found.figures)
    try:
        found.write_page(options.output, command)
    except OSError as error:
        raise InputError(f"{options.output}: cannot be written ({error.strerror})") from error


def _command() -> str:
    return shlex.join(["imapper-prob", *sys.argv[1:]])


def _show(evaluation: Evaluation, ours: list[str], theirs: list[str]) -> None:
    from imapper_prob.cli.console import console
    from imapper_prob.evaluate.evaluation import posterior_coverage
    from imapper_prob.evaluate.tables import (
        coverage_rows,
        difference_rows,
        object_rows,
        pose_rows,
        posterior_rows,
        screen_table,
    )

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
    from imapper_prob.evaluate.evaluation import write_evaluation
    from imapper_prob.evaluate.provenance import made_by
    from imapper_prob.figure_file import save_figure
    from imapper_prob.files import written_whole

    try:
        folder.mkdir(parents=True, exist_ok=True)
        differences = evaluation.differences(ours, theirs)
        made = made_by(_command())
        write_evaluation(folder / "evaluation.json", evaluation, differences, made)
        for name, figure in figures.items():
            with written_whole(folder / name) as beside:
                save_figure(figure, beside, dpi=_DOTS_PER_INCH)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error})") from error
