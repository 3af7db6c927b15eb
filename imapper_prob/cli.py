"""The command line: ``imapper-prob demo | run | info``."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import imapper_prob
from imapper_prob.models.errors import InputError

if TYPE_CHECKING:
    from imapper_prob.config import Config
    from imapper_prob.models.scene import Clip
    from imapper_prob.results.posterior import Posterior

__all__ = ["main"]

_DEMO_STEPS = 24000
"""Steps of a demo chain: what fits, with all else, well within a minute on two cores."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Returns
    -------
    int
        0, or 2 where the input or the arguments cannot be used.
    """
    options = _parser().parse_args(arguments)
    try:
        command = {"demo": _demo, "run": _run, "info": _info}[options.command]
        command(options)
    except InputError as error:
        if options.debug:
            raise
        sys.stderr.write(f"imapper-prob: {error}\n")
        return 2
    except KeyboardInterrupt:
        sys.stderr.write("imapper-prob: interrupted; nothing was written\n")
        return 130
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="imapper-prob",
        description="Furniture and motion of a half-hidden person, from 2D joints, as a posterior.",
    )
    parser.add_argument("--version", action="version", version=imapper_prob.__version__)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    shared = argparse.ArgumentParser(add_help=False)
    shared.add_argument("--debug", action="store_true", help="show tracebacks")
    sampling = argparse.ArgumentParser(add_help=False)
    sampling.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    sampling.add_argument("--seed", type=int, help="all randomness comes from it")
    sampling.add_argument("--steps", type=int, help="steps of each chain")
    sampling.add_argument(
        "--workers", type=int, default=os.cpu_count() or 1, help="processes; draws do not change"
    )
    sampling.add_argument("--overwrite", action="store_true", help="replace an earlier run in DIR")
    demo = commands.add_parser(
        "demo", parents=[shared, sampling], help="simulate a clip and sample its scenes"
    )
    demo.set_defaults(config=None, library=None)
    run = commands.add_parser("run", parents=[shared, sampling], help="sample scenes of a clip")
    run.add_argument("clip", type=Path, help="i3DB scene folder or .npz clip file")
    run.add_argument("--config", type=Path, help="settings (TOML), such as an earlier config.toml")
    run.add_argument("--library", help="'built-in' or a library file (.npz)")
    info = commands.add_parser("info", parents=[shared], help="print the result of a run again")
    info.add_argument("folder", type=Path, metavar="DIR")
    return parser


def _config(options: argparse.Namespace, *, steps: int | None = None) -> Config:
    """Defaults, then the file, then what the command line says."""
    from dataclasses import replace

    from imapper_prob.config import Config, read_config

    config = Config() if options.config is None else read_config(options.config)
    steps = options.steps if options.steps is not None else steps
    if steps is not None:
        kept = max(1, min(config.sample.draws, int(steps * (1 - config.sample.burn_in))))
        config = replace(config, sample=replace(config.sample, steps=steps, draws=kept))
    if options.seed is not None:
        config = replace(config, seed=options.seed)
    if options.library is not None:
        config = replace(config, library=options.library)
    return config


def _demo(options: argparse.Namespace) -> None:
    from imapper_prob.demo import demo_clip
    from imapper_prob.output import check_folder

    check_folder(options.output, overwrite=options.overwrite)
    _sample(options, demo_clip(), _config(options, steps=_DEMO_STEPS))


def _run(options: argparse.Namespace) -> None:
    from imapper_prob.inputs import load_clip
    from imapper_prob.output import check_folder

    check_folder(options.output, overwrite=options.overwrite)
    _sample(options, load_clip(options.clip), _config(options))


def _sample(options: argparse.Namespace, clip: Clip, config: Config) -> None:
    from imapper_prob.output import write_run
    from imapper_prob.scenelets.library import load_library

    if options.workers < 1:
        raise InputError(f"--workers {options.workers}: at least 1 is needed")
    library = load_library(config.library)
    with _progress() as progress:
        posterior = imapper_prob.sample(
            clip, library, config=config, workers=options.workers, progress=progress
        )
        progress("writing", 0.0)
        write_run(options.output, posterior, overwrite=options.overwrite)
        progress("writing", 1.0)
    _show(posterior, options.output)


@contextmanager
def _progress() -> Iterator[imapper_prob.api.Progress]:
    """One line a stage: what, how much of it, how long it took and will take."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TaskID,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    bars = Progress(
        TextColumn("{task.description:<24}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f}%"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=Console(stderr=True),
    )
    tasks: dict[str, TaskID] = {}

    def report(stage: str, part: float) -> None:
        if stage not in tasks:
            for earlier in tasks.values():
                bars.update(earlier, completed=1.0)
            tasks[stage] = bars.add_task(stage, total=1.0)
        bars.update(tasks[stage], completed=part)

    with bars:
        yield report


def _show(posterior: Posterior, folder: Path) -> None:
    from rich.console import Console

    from imapper_prob.results.summary import layout_table, object_table

    console = Console()
    scenes = posterior.scenes()
    console.print(layout_table(scenes))
    console.print(object_table(scenes[0], posterior.clip.truth))
    console.print(posterior.samples.verdict.text)
    if not posterior.samples.finished:
        console.print("Interrupted: these are the draws that there were.")
    console.print(f"Written to {folder}; look at it with: rerun {folder / 'recording.rrd'}")


def _info(options: argparse.Namespace) -> None:
    from rich.console import Console

    from imapper_prob.results.export import read_scenes
    from imapper_prob.results.summary import layout_table, object_table
    from imapper_prob.results.tree import read_attributes

    folder = options.folder
    scenes = read_scenes(folder / "scenes.json")
    attributes = read_attributes(folder / "posterior.nc")
    console = Console()
    console.print(f"{attributes['clip']} ({attributes['program']})")
    console.print(layout_table(scenes))
    console.print(object_table(scenes[0]))
    console.print(attributes["verdict"])


if __name__ == "__main__":
    sys.exit(main())
