"""``demo``, ``run`` and ``info``: scenes of a clip, sampled, written and shown again."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imapper_prob.cli.clip_options import clip_from, clip_parser, is_clip, is_video
from imapper_prob.cli.energy import show_energy
from imapper_prob.cli.interruption import Stopped
from imapper_prob.cli.progress import progress_bars
from imapper_prob.models.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from imapper_prob.config import Config
    from imapper_prob.models.scene import Clip
    from imapper_prob.results.checks import Check
    from imapper_prob.results.posterior import Posterior

__all__ = ["add_run_commands"]

_DEMO_STEPS = 6000
"""Steps of a demo chain at each temperature: what fits, with all else, within a minute on two
cores."""


def add_run_commands(
    commands: argparse._SubParsersAction[Any], shared: argparse.ArgumentParser
) -> None:
    """Add the three commands to a parser; ``shared`` holds options that all commands have."""
    sampling = argparse.ArgumentParser(add_help=False)
    sampling.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    sampling.add_argument("--seed", type=int, help="all randomness comes from it")
    sampling.add_argument("--steps", type=int, help="steps of each chain at each temperature")
    sampling.add_argument(
        "--preset",
        choices=("default", "paper"),
        help="what a scene costs: ours, or the published energy in place of the likelihood",
    )
    sampling.add_argument(
        "--workers", type=int, default=os.cpu_count() or 1, help="processes; draws do not change"
    )
    sampling.add_argument(
        "--cluster",
        metavar="ADDRESS",
        help="run the chains on the workers of a dask scheduler, such as tcp://host:8786; they "
        "must see DIR under the same path",
    )
    sampling.add_argument(
        "--overwrite", action="store_true", help="replace an earlier run in DIR, finished or not"
    )

    demo = commands.add_parser(
        "demo", parents=[shared, sampling], help="simulate a clip and sample its scenes"
    )
    demo.set_defaults(config=None, library=None, execute=_demo)

    clips = clip_parser()
    run = commands.add_parser(
        "run", parents=[shared, sampling, clips], help="sample scenes of a clip"
    )
    run.add_argument("clip", type=Path, help="clip file, keypoints, i3DB scene or video")
    run.add_argument("--config", type=Path, help="settings (TOML), such as an earlier config.toml")
    run.add_argument(
        "--library", help="'built-in', a library file (.npz), or several joined by commas"
    )
    run.set_defaults(execute=_run)

    info = commands.add_parser(
        "info",
        parents=[shared, clips],
        help="print the result of a run again, or what a clip holds",
    )
    info.add_argument("folder", type=Path, metavar="DIR_OR_CLIP")
    info.add_argument(
        "--energy",
        action="store_true",
        help="why this scene: by term, frame and object; writes DIR/energy.png and energy.json",
    )
    info.set_defaults(execute=_info)


def _config(options: argparse.Namespace, *, steps: int | None = None) -> Config:
    """Defaults, then the file, then what the command line says."""
    from dataclasses import replace

    from imapper_prob.config import Config, read_config

    config = Config() if options.config is None else read_config(options.config)
    steps = options.steps if options.steps is not None else steps
    if steps is not None:
        asked = replace(config.sample, steps=steps, draws=1)
        kept = min(config.sample.draws, asked.most_draws)
        config = replace(config, sample=replace(asked, draws=kept))
    if options.seed is not None:
        config = replace(config, seed=options.seed)
    if options.preset is not None:
        config = replace(config, model=replace(config.model, energy=options.preset))
    if options.library is not None:
        config = replace(config, library=options.library)
    return config


def _demo(options: argparse.Namespace) -> None:
    from imapper_prob.demo import demo_clip
    from imapper_prob.output import run_folder

    with run_folder(options.output, overwrite=options.overwrite):
        _sample(options, demo_clip(), _config(options, steps=_DEMO_STEPS))


def _run(options: argparse.Namespace) -> None:
    from imapper_prob.output import run_folder

    video = options.clip if is_video(options.clip) else None
    with run_folder(options.output, overwrite=options.overwrite):
        _sample(options, clip_from(options.clip, options), _config(options), video=video)


def _sample(
    options: argparse.Namespace, clip: Clip, config: Config, *, video: Path | None = None
) -> None:
    import imapper_prob
    from imapper_prob.output import CHECKPOINTS, write_run
    from imapper_prob.sampling.cluster import connected
    from imapper_prob.scenelets.library import load_library

    if options.workers < 1:
        raise InputError(f"--workers {options.workers}: at least 1 is needed")
    library = load_library(config.library)
    with connected(options.cluster) as cluster, progress_bars() as progress:
        posterior = imapper_prob.sample(
            clip,
            library,
            config=config,
            workers=options.workers,
            cluster=cluster,
            checkpoints=options.output / CHECKPOINTS,
            anew=options.overwrite,
            progress=progress,
        )
        progress("writing", 0.0)
        write_run(options.output, posterior, overwrite=options.overwrite, video=video)
        progress("writing", 1.0)
    _show(posterior, options.output)
    if not posterior.samples.finished:
        raise Stopped


def _show(posterior: Posterior, folder: Path) -> None:
    from imapper_prob.cli.console import console
    from imapper_prob.results.report.words import sides_of
    from imapper_prob.results.summary import check_table, object_table, scene_table
    from imapper_prob.sampling.agreement import describe_agreement

    out = console()
    scenes = posterior.scenes()
    _show_alarms(posterior.checks)
    out.print(scene_table(scenes))
    out.print(object_table(scenes[0], posterior.clip.truth))
    out.print(check_table(posterior.checks))
    for sentence in sides_of(posterior.clip, posterior.sides_swapped):
        out.print(sentence)
    out.print(posterior.chain_verdict)
    out.print(describe_agreement(posterior.samples.agreements))
    if not posterior.samples.finished:
        out.print("Interrupted: these are the draws that there were.")
    out.print(f"Written to {folder}; look at it with: imapper-prob view {folder}")


def _show_alarms(checks: Iterable[Check]) -> None:
    """What speaks against the whole result, before anything else is said of it."""
    from imapper_prob.cli.console import console
    from imapper_prob.results.checks import alarms

    for sentence in alarms(checks):
        console().print(sentence, style="bold red")


def _info(options: argparse.Namespace) -> None:
    if is_clip(options.folder):
        _show_clip(options)
    else:
        _show_run(options)


def _show_clip(options: argparse.Namespace) -> None:
    from imapper_prob.cli.console import console
    from imapper_prob.inputs.describe import clip_table
    from imapper_prob.results.checks import elsewhere

    clip = clip_from(options.folder, options)
    console().print(clip_table(clip))
    console().print(elsewhere(clip).sentence)


def _show_run(options: argparse.Namespace) -> None:
    from imapper_prob.cli.console import console
    from imapper_prob.results.checks import from_json
    from imapper_prob.results.export import read_scenes
    from imapper_prob.results.summary import check_table, object_table, scene_table
    from imapper_prob.results.tree import read_attributes

    folder = options.folder
    scenes = read_scenes(folder / "scenes.json")
    if not scenes:
        raise InputError(f"{folder / 'scenes.json'}: holds no scene")
    attributes = read_attributes(folder / "posterior.nc")
    out = console()
    checks = from_json(str(attributes.get("checks", "[]")))
    out.print(f"{attributes['clip']} ({attributes['program']})")
    _show_alarms(checks)
    out.print(scene_table(scenes))
    out.print(object_table(scenes[0]))
    out.print(check_table(checks))
    out.print(attributes["verdict"])
    out.print(attributes["agreement"])
    if options.energy:
        show_energy(folder)
