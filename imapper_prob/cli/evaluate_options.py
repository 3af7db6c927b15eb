"""Options of ``evaluate``, separate from its work so that ``--help`` starts quickly."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

from imapper_prob.cli.clips import run_folder_of
from imapper_prob.cli.parser import examples

__all__ = ["add_evaluate_command"]


def add_evaluate_command(
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
    command = commands.add_parser(
        "evaluate",
        parents=[shared],
        help="score results against the truth",
        epilog=examples(
            "evaluate out/Scene04 --truth i3db/Scene04", "evaluate --suite i3db/ -o out/benchmark"
        ),
    )
    command.add_argument(
        "results",
        type=run_folder_of,
        nargs="*",
        metavar="RUN",
        help="folders of `run` or `solve`, or prediction files (.json) of any method",
    )
    command.add_argument(
        "--truth",
        type=Path,
        metavar="SCENE",
        help="i3DB scene with its gt/, or a clip file with its truth (default: the run's own)",
    )
    command.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="DIR",
        help="folder of evaluation.json and pictures (default: that of the run; a prediction file "
        "needs one)",
    )
    suite = command.add_argument_group("the whole benchmark")
    suite.add_argument(
        "--suite", type=Path, metavar="DIR", help="all i3DB scenes in a folder (default: RUN alone)"
    )
    suite.add_argument(
        "--exploration",
        action="store_true",
        help="also score the first quarter, half and three quarters of each clip",
    )
    suite.add_argument("--solver-only", action="store_true", help="no chains: some minutes")
    suite.add_argument(
        "--config",
        type=Path,
        metavar="FILE",
        help="settings, TOML (default: those of the program)",
    )
    suite.add_argument(
        "--leave-one-out",
        action="store_true",
        help="add scenelets cut from the truth of the other scenes",
    )
    suite.add_argument(
        "--predictions",
        type=Path,
        metavar="DIR",
        help="prediction files of other methods, one folder a scene (default: none)",
    )
    suite.add_argument(
        "--detections",
        type=Path,
        metavar="DIR",
        help="COCO results of region detectors (NAME.json), one folder a scene (default: none)",
    )
    suite.add_argument(
        "--depths",
        type=Path,
        metavar="DIR",
        help="depth maps of monocular estimators (NAME.npz), one folder a scene (default: none)",
    )
    suite.add_argument(
        "--workers",
        type=int,
        default=os.cpu_count() or 1,
        metavar="N",
        help="processes (default: one a core)",
    )
    suite.add_argument(
        "--cluster",
        metavar="ADDRESS",
        help="run on the workers of a dask scheduler (default: run here)",
    )
    command.set_defaults(execute=_evaluate)


def _evaluate(options: argparse.Namespace) -> None:
    from imapper_prob.cli.evaluate import evaluate_results

    evaluate_results(options)
