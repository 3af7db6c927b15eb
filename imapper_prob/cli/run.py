"""``demo``, ``run`` and ``info``: sample the scenes of a clip, write them and show them."""

from __future__ import annotations

import argparse
import json
import os
import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imapper_prob.cli.clips import (
    clip_from,
    clip_options_said,
    clip_parser,
    is_clip,
    is_run,
    is_video,
    run_folder_of,
)
from imapper_prob.cli.console import Stopped, print_lines, progress_bars
from imapper_prob.cli.parser import examples
from imapper_prob.config import Config, SampleSettings, read_config
from imapper_prob.models.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from imapper_prob.models.scene import Clip
    from imapper_prob.models.scenelet import Library
    from imapper_prob.models.statements import Statement
    from imapper_prob.results.posterior import Posterior
    from imapper_prob.sampling.blocks import Block, Limits
    from imapper_prob.uncertainty.checks import Check

__all__ = ["DEMO", "add_run_commands"]


def show_energy(folder: Path) -> None:
    """Print the energy terms of the first scene of a run; write ``energy.png`` and ``energy.json``.

    Raises
    ------
    InputError
        There is no run in the folder, or a file cannot be written.
    """
    from imapper_prob.cli.console import console
    from imapper_prob.files import disk_errors_named, written_whole
    from imapper_prob.plotting import save_figure
    from imapper_prob.results.figures import energy_figure
    from imapper_prob.results.load import load_posterior
    from imapper_prob.uncertainty.energy import (
        explain,
        object_worth_table,
        scenelet_table,
        term_table,
        write_energy,
    )

    posterior = load_posterior(folder)
    clip, source = posterior.clip, posterior.solution
    state = posterior.samples.states[posterior.scenes(1)[0].draw]
    explanation = explain(source.problem, state, source.library, clip=clip)
    out = console()
    for table in (term_table, scenelet_table, object_worth_table):
        out.print(table(explanation))
    digest = posterior.data.attrs["library_digest"]
    figure, document = folder / "energy.png", folder / "energy.json"
    with disk_errors_named(folder):
        with written_whole(figure) as beside:
            save_figure(energy_figure(explanation, title=clip.name), beside)
        write_energy(document, explanation, clip=clip.name, library_digest=digest)
    out.print(f"Written: {figure}, {document}")


# ------------------------------------------------------------------------------------------------
# ``demo``, ``run`` and ``info``.

DEMO = SampleSettings(steps=36_000, temperatures=5)
"""Settings of the demo, chosen by how its chains converge. Their barrier is 2.0, so 5 temperatures
are best; with these steps probabilities converge, in about a minute on two cores."""
_STEPS = SampleSettings().steps


def add_run_commands(
    commands: argparse._SubParsersAction[Any], shared: argparse.ArgumentParser
) -> None:
    """Add the three commands to a parser.

    Parameters
    ----------
    commands : argparse._SubParsersAction
        The program's subparsers.
    shared : argparse.ArgumentParser
        Options that all commands have.
    """
    sampling = _sampling_options()
    answer = argparse.ArgumentParser(add_help=False)
    answer.add_argument(
        "--json", action="store_true", help="print the result as one JSON document, and no table"
    )

    demo = commands.add_parser(
        "demo",
        parents=[shared, answer, sampling],
        help="simulate a clip and sample its scenes",
        epilog=examples("demo -o out/demo", "demo -o out/demo --until good --minutes 5"),
    )
    demo.set_defaults(config=None, library=None, given=None, execute=_demo)

    clips = clip_parser()
    run = commands.add_parser(
        "run",
        parents=[shared, answer, sampling, clips],
        help="sample scenes of a clip",
        epilog=examples(
            "run clip.mp4 -o out/clip",
            "run keypoints/ -o out/clip --size 1920x1080 --fps 10",
            "run i3db/Scene04 -o out/Scene04 --until good --minutes 20",
            "run clip.npz -o out/clip --json > result.json",
            "run monday.mp4 tuesday.mp4 --same-room -o out/room",
        ),
    )
    run.add_argument(
        "clips",
        type=Path,
        nargs="+",
        metavar="CLIP",
        help="clip file, keypoints, i3DB scene or video; several with --same-room",
    )
    run.add_argument(
        "--same-room",
        action="store_true",
        help="the clips are takes of one room by one camera that does not move",
    )
    run.add_argument(
        "--config",
        type=Path,
        metavar="FILE",
        help="settings, TOML, such as an earlier config.toml (default: those of the program)",
    )
    run.add_argument(
        "--library",
        metavar="NAMES",
        help="'built-in', a library file (.npz), or several joined by commas (default: built-in)",
    )
    run.add_argument(
        "--given",
        type=Path,
        metavar="FILE",
        help="what is known besides the clip, TOML: objects, camera, walls (default: nothing)",
    )
    run.set_defaults(execute=_run)

    info = commands.add_parser(
        "info",
        parents=[shared, answer, clips],
        help="print the result of a run again, or what a clip holds",
        epilog=examples("info out/demo", "info out/demo --energy", "info clip.npz"),
    )
    info.add_argument(
        "folder", type=run_folder_of, metavar="DIR_OR_CLIP", help="folder of a run, or a clip"
    )
    info.add_argument(
        "--energy",
        action="store_true",
        help="why this scene: by term, frame and object; writes DIR/energy.png and energy.json",
    )
    info.set_defaults(execute=_info)


def _sampling_options() -> argparse.ArgumentParser:
    """Parser of the options that ``demo`` and ``run`` share."""
    sampling = argparse.ArgumentParser(add_help=False)
    sampling.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="DIR",
        help="folder of the run; created if needed",
    )
    sampling.add_argument(
        "--seed", type=int, metavar="N", help="all randomness comes from it (default: 0)"
    )
    sampling.add_argument(
        "--steps",
        type=int,
        metavar="N",
        help="steps of each chain at each temperature; more than a finished run in DIR has: go on "
        f"(default: {_STEPS}, of demo {DEMO.steps})",
    )
    sampling.add_argument(
        "--minutes",
        type=float,
        metavar="M",
        help="sample for so long, after solving, in blocks of steps; on a finished run in DIR: go "
        "on for so long (default: no limit)",
    )
    sampling.add_argument(
        "--until",
        choices=("good",),
        help="sample in blocks until the chains have converged, for an hour or --minutes at most "
        "(default: --steps alone decide)",
    )
    sampling.add_argument(
        "--preset",
        choices=("default", "paper"),
        help="log-posterior: that of the program, or the published energy in place of the "
        "likelihood (default: default)",
    )
    sampling.add_argument(
        "--workers",
        type=int,
        default=os.cpu_count() or 1,
        metavar="N",
        help="processes; draws do not depend on them (default: one a core)",
    )
    sampling.add_argument(
        "--cluster",
        metavar="ADDRESS",
        help="run the chains on the workers of a dask scheduler, such as tcp://host:8786; they "
        "must see DIR under the same path (default: run them here)",
    )
    sampling.add_argument(
        "--overwrite", action="store_true", help="replace an earlier run in DIR, finished or not"
    )
    return sampling


def _config(
    options: argparse.Namespace, base: Config | None = None, *, own: SampleSettings | None = None
) -> Config:
    """Settings: ``base``, or the defaults with the command's ``own``; then the file and options."""
    config = base or Config(sample=own or SampleSettings())
    if options.config is not None:
        config = read_config(options.config)
    if options.steps is not None and base is None:
        asked = replace(config.sample, steps=options.steps, draws=1, last_step=0)
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
    from imapper_prob.api import demo_clip

    _begun_or_gone_on_with(options, lambda _: demo_clip(), own=DEMO)


def _run(options: argparse.Namespace) -> None:
    from imapper_prob.clips.takes import same_room

    clips = options.clips
    if len(clips) > 1 and not options.same_room:
        raise InputError(
            f"{len(clips)} clips: takes of one room need --same-room; clips of different rooms "
            "are runs of their own"
        )
    if options.same_room and len(clips) == 1:
        raise InputError("--same-room: several takes are needed, and there is one clip")
    # With several takes a recording shows no pictures, because their frames overlap in time.
    video = clips[0] if len(clips) == 1 and is_video(clips[0]) else None
    _begun_or_gone_on_with(
        options,
        lambda library: same_room([clip_from(path, options, library) for path in clips]),
        video=video,
    )


def _begun_or_gone_on_with(
    options: argparse.Namespace,
    read_clip: Callable[[Library], Clip],
    *,
    own: SampleSettings | None = None,
    video: Path | None = None,
) -> None:
    """Sample a clip into a folder, or continue the run that exists there."""
    from imapper_prob.cli.going_on import config_to_go_on, nothing_to_do, require_same_input
    from imapper_prob.clips.statements_file import check_file, read_statements
    from imapper_prob.models.statements import to_json
    from imapper_prob.results.folders import earlier_run, restore_chains, run_folder
    from imapper_prob.sampling.blocks import Limits
    from imapper_prob.scenelets.library import load_library
    from imapper_prob.uncertainty.tree import clip_digest

    if options.workers < 1:
        raise InputError(f"--workers {options.workers}: at least 1 is needed")
    limits = Limits(options.minutes, options.until)
    folder, given = options.output, () if options.given is None else read_statements(options.given)
    with run_folder(folder, overwrite=options.overwrite, goes_on=True):
        earlier = None if options.overwrite else earlier_run(folder)
        if earlier is None:
            config = _config(options, own=own)
        else:
            asked = _config(options, earlier.config)
            config = config_to_go_on(earlier, asked, steps=options.steps, limits=limits)
            if nothing_to_do(earlier, limits):
                if options.json:
                    _print_json(folder)
                else:
                    print_lines(f"{folder}: {earlier.verdict} Nothing is left to do.")
                return
        library = load_library(config.library)
        clip = read_clip(library)
        if given:
            check_file(options.given, given, clip, library)
        if earlier is not None:
            said = to_json(given) if given else ""
            require_same_input(earlier, clip_digest(clip), library.digest, said)
            restore_chains(folder, chains=config.sample.chains)
        _sample(options, clip, library, config, given=given, limits=limits, video=video)


def _sample(
    options: argparse.Namespace,
    clip: Clip,
    library: Library,
    config: Config,
    *,
    given: Sequence[Statement],
    limits: Limits,
    video: Path | None,
) -> None:
    import imapper_prob
    from imapper_prob.cli.going_on import how_to_go_on, words_of_block
    from imapper_prob.recording.video import read_video
    from imapper_prob.results.folders import CHECKPOINTS, write_run
    from imapper_prob.sampling.cluster import connected

    blocks: list[Block] = []
    with connected(options.cluster) as cluster, progress_bars() as progress:

        def hear(block: Block) -> None:
            blocks.append(block)
            if limits.any:
                progress.say(words_of_block(len(blocks), block))

        posterior = imapper_prob.sample(
            clip,
            library,
            given=given,
            config=config,
            workers=options.workers,
            cluster=cluster,
            checkpoints=options.output / CHECKPOINTS,
            anew=options.overwrite,
            minutes=limits.minutes,
            until=limits.until,
            progress=progress,
            on_block=hear,
        )
        progress("writing", 0.0)
        pictures = None if video is None else read_video(video, clip, rate=options.fps)
        write_run(
            options.output,
            posterior,
            overwrite=options.overwrite,
            resumed=True,
            video=pictures,
        )
        progress("writing", 1.0)
    if options.json:
        _print_json(options.output)
    else:
        _show(posterior, options.output)
    if not posterior.samples.finished:
        chains, draws = posterior.samples.shape
        raise Stopped(
            f"{options.output} holds what there is, {draws} draws of each of {chains} chains"
        )
    if blocks and not blocks[-1].verdict.good and not options.json:
        print_lines(how_to_go_on(blocks[-1], options))


def _show(posterior: Posterior, folder: Path) -> None:
    from imapper_prob.cli.console import console
    from imapper_prob.results.report_text import sides_of
    from imapper_prob.sampling.ensembles import describe_refinement
    from imapper_prob.uncertainty.summary import (
        check_table,
        object_rows,
        object_table,
        scene_table,
    )

    out = console()
    _show_alarms(posterior.checks)
    out.print(scene_table(posterior.scenes()))
    out.print(object_table(object_rows(posterior.summary()), posterior.clip.truth))
    out.print(check_table(posterior.checks))
    for sentence in sides_of(posterior.clip, posterior.sides_flipped):
        out.print(sentence)
    out.print(posterior.chain_verdict)
    if posterior.told is not None:
        out.print(posterior.told.text)
    out.print(describe_refinement(posterior.samples.walked))
    if not posterior.samples.finished:
        out.print("Interrupted: these are the draws that there were.")
    command = shlex.join(["imapper-prob", "view", str(folder)])
    print_lines(f"Written to {folder}; look at it with: {command}")


def _print_json(folder: Path) -> None:
    """Print ``scenes.json`` of a run and attributes of its posterior file as one JSON document."""
    from imapper_prob.results.scenes_file import read_scenes
    from imapper_prob.uncertainty.checks import alarms, from_json
    from imapper_prob.uncertainty.tree import read_attributes

    read_scenes(folder / "scenes.json")  # checks that it is complete and of this version
    said = read_attributes(folder / "posterior.nc")
    run = {
        "folder": str(folder),
        "clip": str(said["clip"]),
        "program": str(said["program"]),
        "good": bool(said["verdict_good"]) and not alarms(from_json(str(said["checks"]))),
        "verdict": str(said["verdict"]),
    }
    scenes = json.loads((folder / "scenes.json").read_text(encoding="utf-8"))
    sys.stdout.write(json.dumps({"run": run, **scenes}, indent=1, ensure_ascii=False) + "\n")


def _show_alarms(checks: Iterable[Check]) -> None:
    """Print the checks that make the whole result doubtful, before the result."""
    from imapper_prob.cli.console import console
    from imapper_prob.uncertainty.checks import alarms

    for sentence in alarms(checks):
        console().print(sentence, style="bold red")


def _info(options: argparse.Namespace) -> None:
    from imapper_prob.results.folders import CHECKPOINTS

    if options.energy and options.json:
        raise InputError("--energy prints a table, and --json one document; choose one")
    if not options.folder.exists():
        raise InputError(f"{options.folder}: no such file or folder")
    if is_clip(options.folder):
        for name in ("json", "energy"):
            if getattr(options, name):
                raise InputError(f"{options.folder}: is a clip; --{name} is for a run")
        _show_clip(options)
        return
    if (options.folder / CHECKPOINTS).is_dir() and not is_run(options.folder):
        raise InputError(
            f"{options.folder}: holds an unfinished run; give the command of the run again to go on"
        )
    if not is_run(options.folder):
        raise InputError(f"{options.folder}: is neither the folder of a run nor a clip")
    for name in clip_options_said(options):
        raise InputError(f"{options.folder}: is a run; --{name} is for a clip")
    if options.json:
        _print_json(options.folder)
    else:
        _show_run(options)


def _show_clip(options: argparse.Namespace) -> None:
    from imapper_prob.cli.console import console
    from imapper_prob.clips.load import clip_table
    from imapper_prob.solver.detections import elsewhere_frames
    from imapper_prob.uncertainty.checks import elsewhere

    clip = clip_from(options.folder, options)
    console().print(clip_table(clip))
    console().print(elsewhere(clip, elsewhere_frames(clip)).sentence)


def _show_run(options: argparse.Namespace) -> None:
    from imapper_prob.cli.console import console
    from imapper_prob.results.scenes_file import read_objects, read_scenes
    from imapper_prob.uncertainty.checks import from_json
    from imapper_prob.uncertainty.summary import check_table, object_table, scene_table
    from imapper_prob.uncertainty.tree import read_attributes

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
    found = read_objects(folder / "scenes.json")
    if found:
        out.print(object_table(found))
    out.print(check_table(checks))
    out.print(attributes["verdict"])
    out.print(attributes["ensembles"])
    if options.energy:
        show_energy(folder)
