"""``solve``: the deterministic scenes of a clip, and the stages of the solver."""

from __future__ import annotations

import argparse
import shlex
import time
from pathlib import Path
from typing import Any

from imapper_prob.cli.clips import clip_from, clip_parser
from imapper_prob.cli.console import print_lines, progress_bars
from imapper_prob.cli.parser import examples
from imapper_prob.progress import Progress

__all__ = ["StageClock", "add_solve_command"]


def add_solve_command(
    commands: argparse._SubParsersAction[Any], shared: argparse.ArgumentParser
) -> None:
    """Add the command to a parser.

    Parameters
    ----------
    commands : argparse._SubParsersAction
        The program's subparsers.
    shared : argparse.ArgumentParser
        Options that all commands have.
    """
    solve = commands.add_parser(
        "solve",
        parents=[shared, clip_parser()],
        help="the staged solver alone: best scene and its stages",
        epilog=examples("solve clip.npz -o out/solved", "solve i3db/Scene04 -o out/Scene04"),
    )
    solve.add_argument("clip", type=Path, help="clip file, keypoints, i3DB scene or video")
    solve.add_argument(
        "-o", "--output", type=Path, required=True, metavar="DIR", help="folder to write; made"
    )
    solve.add_argument(
        "--config",
        type=Path,
        metavar="FILE",
        help="settings, TOML, such as an earlier config.toml (default: those of the program)",
    )
    solve.add_argument(
        "--library",
        metavar="NAMES",
        help="'built-in', a library file (.npz), or several joined by commas (default: built-in)",
    )
    solve.add_argument(
        "--preset",
        choices=("default", "paper"),
        help="what a scene costs, as in run (default: default)",
    )
    solve.add_argument(
        "--overwrite", action="store_true", help="replace an earlier solution in DIR"
    )
    solve.set_defaults(execute=_solve)


class StageClock:
    """Measure the duration of each stage from its progress reports.

    A stage lasts from the report before its first one to its last one.

    Parameters
    ----------
    report : callable
        Called with the name of a stage and the fraction of it that is done.
    """

    def __init__(self, report: Progress) -> None:
        self._report = report
        self._last = time.perf_counter()
        self._seconds: dict[str, float] = {}

    def __call__(self, stage: str, part: float) -> None:
        """Report progress, and add the time since the last report to the stage.

        Parameters
        ----------
        stage : str
        part : float
            0–1.
        """
        now = time.perf_counter()
        self._seconds[stage] = self._seconds.get(stage, 0.0) + now - self._last
        self._last = now
        self._report(stage, part)

    @property
    def times(self) -> list[tuple[str, float]]:
        """Stages in order, with their duration in seconds."""
        return list(self._seconds.items())


def _solve(options: argparse.Namespace) -> None:
    from dataclasses import replace

    from imapper_prob.cli.console import console
    from imapper_prob.config import Config, read_config
    from imapper_prob.memory import require_feasible
    from imapper_prob.results.folders import solution_folder, write_solution_folder
    from imapper_prob.results.solution import (
        furniture_table,
        maxima_table,
        scenes_table,
        stage_table,
    )
    from imapper_prob.scenelets.library import load_library
    from imapper_prob.solver.actors import solve_actors, solved

    config = Config() if options.config is None else read_config(options.config)
    if options.library is not None:
        config = replace(config, library=options.library)
    if options.preset is not None:
        config = replace(config, model=replace(config.model, energy=options.preset))
    with solution_folder(options.output, overwrite=options.overwrite):
        library = load_library(config.library)
        clip = clip_from(options.clip, options, library)
        with progress_bars() as progress:
            clock = StageClock(progress)
            require_feasible(clip, library)
            actors = solve_actors(clip, library, settings=config.settings, progress=clock)
            solution = solved(clip, actors)
            clock("diverse scenes", 1.0)
            write_solution_folder(options.output, solution, config, overwrite=options.overwrite)
            clock("writing", 1.0)
    out = console()
    out.print(stage_table(solution, clock.times))
    out.print(maxima_table(solution))
    out.print(scenes_table(solution))
    out.print(furniture_table(solution))
    command = shlex.join(["rerun", str(options.output / "stages.rrd")])
    print_lines(f"Written to {options.output}; the stages: {command}")
