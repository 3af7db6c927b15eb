"""``export`` and ``report``: a run in other people's formats, and for their eyes."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from imapper_prob.models.errors import InputError

__all__ = ["add_export_commands"]


def add_export_commands(
    commands: argparse._SubParsersAction[Any], shared: argparse.ArgumentParser
) -> None:
    """Add the commands to a parser; ``shared`` holds options that all commands have."""
    export = commands.add_parser(
        "export", parents=[shared], help="write a scene of a run in another format"
    )
    export.add_argument("folder", type=Path, metavar="DIR")
    export.add_argument(
        "--format",
        choices=("glb", "json", "i3db"),
        required=True,
        help="glb: a model that 3D programs open; json: joints and boxes in the frame of the "
        "camera; i3db: the files of that benchmark",
    )
    export.add_argument(
        "-o", "--output", type=Path, required=True, metavar="OUT",
        help="a file, replaced if it is there; with i3db a new folder",
    )  # fmt: skip
    export.add_argument(
        "--scene",
        type=int,
        metavar="N",
        help="which scene, 1 being the most probable; if left out, that of least expected loss: "
        "what is there with more than even odds, at its mean place, and the mean motion",
    )
    export.add_argument(
        "--samples",
        type=int,
        default=0,
        metavar="N",
        help="with json: N draws of the posterior too",
    )
    export.set_defaults(execute=_export)

    report = commands.add_parser(
        "report", parents=[shared], help="write the report of a run again: DIR/report.html"
    )
    report.add_argument("folder", type=Path, metavar="DIR")
    report.set_defaults(execute=_report)


def _export(options: argparse.Namespace) -> None:
    from imapper_prob.cli.console import console
    from imapper_prob.results.export_glb import write_glb
    from imapper_prob.results.export_i3db import write_i3db
    from imapper_prob.results.export_json import write_json
    from imapper_prob.results.load import load_posterior

    if options.samples and options.format != "json":
        raise InputError("--samples is of use with --format json only")
    out: Path = options.output
    if options.format != "i3db" and out.is_dir():
        raise InputError(f"{out}: is a folder; name a file")
    posterior = load_posterior(options.folder)
    named = options.scene is not None
    scene = posterior.scene(options.scene).scene if named else posterior.estimate
    try:
        if options.format == "json":
            write_json(out, posterior, scene=options.scene, samples=options.samples)
        elif options.format == "glb":
            write_glb(out, scene, posterior.clip)
        else:
            write_i3db(out, scene, posterior.clip)
    except OSError as error:
        raise InputError(f"{out}: cannot be written ({error.strerror or error})") from error
    console().print(f"Written: {out}")


def _report(options: argparse.Namespace) -> None:
    from imapper_prob.cli.console import console
    from imapper_prob.results.load import load_posterior
    from imapper_prob.results.report.write import write_report

    posterior = load_posterior(options.folder)
    path = options.folder / "report.html"
    try:
        write_report(path, posterior)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from error
    console().print(f"Written: {path}")
