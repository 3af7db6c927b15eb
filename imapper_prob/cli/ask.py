"""``ask``: condition a finished run on statements."""

from __future__ import annotations

import argparse
import os
import shlex
from pathlib import Path
from typing import Any

from imapper_prob.cli.clips import run_folder_of
from imapper_prob.cli.console import Stopped, console, print_lines, progress_bars
from imapper_prob.cli.parser import examples
from imapper_prob.models.errors import InputError

__all__ = ["add_ask_command"]


def add_ask_command(
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
    ask = commands.add_parser(
        "ask",
        parents=[shared],
        help="condition a finished run on what else is known",
        epilog=examples("ask out/demo --given given.toml -o out/told"),
    )
    ask.add_argument("folder", type=run_folder_of, metavar="DIR", help="folder of a finished run")
    ask.add_argument(
        "--given", type=Path, required=True, metavar="FILE", help="what is known, TOML"
    )
    ask.add_argument(
        "-o", "--output", type=Path, required=True, metavar="DIR2", help="folder of the new run"
    )
    ask.add_argument(
        "--library",
        metavar="NAMES",
        help="the run's library, where its file has moved (default: as its settings say)",
    )
    ask.add_argument(
        "--steps",
        type=int,
        metavar="N",
        help="steps of the chains if draws are resampled (default: a fourth of the run's)",
    )
    ask.add_argument(
        "--workers",
        type=int,
        default=os.cpu_count() or 1,
        metavar="N",
        help="processes of the chains; draws do not depend on them (default: one a core)",
    )
    ask.add_argument("--overwrite", action="store_true", help="replace an earlier run in DIR2")
    ask.set_defaults(execute=_ask)


def _ask(options: argparse.Namespace) -> None:
    from imapper_prob.clips.statements_file import check_file, read_statements
    from imapper_prob.results.changes import change_table, changes
    from imapper_prob.results.folders import run_folder, write_run
    from imapper_prob.results.load import load_posterior
    from imapper_prob.scenelets.library import load_library

    for name in ("workers", "steps"):
        value = getattr(options, name)
        if value is not None and value < 1:
            raise InputError(f"--{name} {value}: at least 1 is needed")
    if options.output.resolve() == options.folder.resolve():
        raise InputError(f"{options.output}: is the run that is asked; name another folder")
    statements = read_statements(options.given)
    before = load_posterior(options.folder)
    library = load_library(options.library or before.config.library)
    check_file(options.given, statements, before.clip, library)
    with run_folder(options.output, overwrite=options.overwrite), progress_bars() as progress:
        after = before.given(
            statements,
            library=library,
            steps=options.steps,
            workers=options.workers,
            progress=progress,
        )
        progress("writing", 0.0)
        write_run(options.output, after, overwrite=options.overwrite, before=before)
        progress("writing", 1.0)
    out = console()
    assert after.told is not None
    out.print(after.told.text)
    out.print(change_table(changes(before, after)))
    out.print(after.verdict)
    command = shlex.join(["imapper-prob", "view", str(options.output)])
    print_lines(f"Written to {options.output}; look at it with: {command}")
    if not after.samples.finished:
        chains, draws = after.samples.shape
        raise Stopped(
            f"{options.output} holds what there is, {draws} draws of each of {chains} chains",
            goes_on=False,
        )
