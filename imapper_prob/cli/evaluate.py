"""``evaluate``: results held against the truth, and the whole benchmark."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imapper_prob.cli.progress import progress_bars
from imapper_prob.models.errors import InputError

if TYPE_CHECKING:
    from imapper_prob.evaluate.score import Score

__all__ = ["add_evaluate_command"]


def add_evaluate_command(
    commands: argparse._SubParsersAction[Any], shared: argparse.ArgumentParser
) -> None:
    """Add the command to a parser; ``shared`` holds options that all commands have."""
    command = commands.add_parser(
        "evaluate", parents=[shared], help="hold results against a known truth"
    )
    command.add_argument("--suite", type=Path, metavar="DIR", help="all i3DB scenes in a folder")
    command.add_argument("-o", "--output", type=Path, metavar="DIR")
    command.add_argument(
        "--solver-only", action="store_true", help="with --suite: no chains, some minutes"
    )
    command.add_argument("--config", type=Path, help="with --suite: settings (TOML)")
    command.add_argument(
        "--leave-one-out",
        action="store_true",
        help="with --suite: add scenelets cut from the truth of the other scenes",
    )
    command.add_argument(
        "--workers", type=int, default=os.cpu_count() or 1, help="with --suite: processes"
    )
    command.set_defaults(execute=_evaluate)


def _evaluate(options: argparse.Namespace) -> None:
    if options.suite is None:
        raise InputError("name a folder of scenes with --suite")
    if options.output is None:
        raise InputError("--suite needs a folder for its results, -o DIR")
    _suite(options)


def _suite(options: argparse.Namespace) -> None:
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor

    from imapper_prob.config import Config, read_config
    from imapper_prob.evaluate.scenes import known_scene, scenes_with_truth
    from imapper_prob.evaluate.score import score
    from imapper_prob.evaluate.suite import solve_all, solved, tasks_of

    config = Config() if options.config is None else read_config(options.config)
    scenes = scenes_with_truth(options.suite)
    others = options.suite if options.leave_one_out else None
    tasks = tasks_of(scenes, options.output, config, others=others)
    spawned = multiprocessing.get_context("spawn")
    with (
        ProcessPoolExecutor(options.workers, mp_context=spawned) as executor,
        progress_bars() as progress,
    ):
        solve_all(tasks, executor, progress=progress)
    scores: dict[str, list[Score]] = {}
    for scene, found in zip(scenes, solved(tasks), strict=True):
        known = known_scene(scene)
        for prediction in (found, *known.others):
            scores.setdefault(prediction.name, []).append(score(prediction, known.truth))
    _show(scores)


def _show(scores: dict[str, list[Score]]) -> None:
    from rich.console import Console

    from imapper_prob.evaluate.score import summarise
    from imapper_prob.evaluate.tables import object_rows, pair_rows, pose_rows, screen_table

    console = Console()
    one_by_one = [summarise([s]) for found in scores.values() for s in found]
    together = [summarise(found) for found in scores.values()]
    for title, summaries in (("scene by scene", one_by_one), ("all scenes", together)):
        if title == "all scenes" and len(together) == len(one_by_one):
            continue
        console.print(screen_table(object_rows(summaries), title=f"Objects, {title}"))
        console.print(
            screen_table(
                pose_rows(summaries), title=f"Joints, {title}: world cm / local cm / pixels"
            )
        )
    first = next(iter(scores.values()))
    console.print(screen_table(pair_rows(first), title="Objects one by one"))
