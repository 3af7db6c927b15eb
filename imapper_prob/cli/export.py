"""``export``, ``report``, ``record`` and ``view``: write or open other forms of a finished run."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from imapper_prob.cli.clips import run_folder_of
from imapper_prob.cli.parser import examples
from imapper_prob.files import disk_errors_named
from imapper_prob.models.errors import InputError

__all__ = ["add_export_commands", "add_recording_commands", "open_viewer"]


def add_export_commands(
    commands: argparse._SubParsersAction[Any], shared: argparse.ArgumentParser
) -> None:
    """Add the commands to a parser.

    Parameters
    ----------
    commands : argparse._SubParsersAction
        The program's subparsers.
    shared : argparse.ArgumentParser
        Options that all commands have.
    """
    export = commands.add_parser(
        "export",
        parents=[shared],
        help="write a scene of a run in another format",
        epilog=examples(
            "export out/demo --format glb -o scene.glb",
            "export out/demo --format json --samples 100 -o draws.json",
            "export out/demo --format glb --scene 2 -o second.glb",
        ),
    )
    export.add_argument("folder", type=run_folder_of, metavar="DIR", help="folder of a run")
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
        help="which scene, 1 being the most probable (default: that of least expected loss, with "
        "what is there with more than even odds, at its mean place, and the mean motion)",
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
        "report",
        parents=[shared],
        help="write the report of a run again: DIR/report.html",
        epilog=examples("report out/demo"),
    )
    report.add_argument("folder", type=run_folder_of, metavar="DIR", help="folder of a run")
    report.set_defaults(execute=_report)


def _export(options: argparse.Namespace) -> None:
    from imapper_prob.cli.console import console
    from imapper_prob.files import require_output
    from imapper_prob.results.exports import write_i3db, write_json
    from imapper_prob.results.glb import write_glb
    from imapper_prob.results.load import load_posterior

    if options.samples < 0:
        raise InputError(f"--samples {options.samples}: at least 0 are needed")
    if options.samples and options.format != "json":
        raise InputError("--samples is of use with --format json only")
    out: Path = options.output
    if options.format != "i3db":
        require_output(out, f".{options.format}")
        if not out.parent.is_dir():
            raise InputError(f"{out}: there is no folder {out.parent}")
    posterior = load_posterior(options.folder)
    weighted = None if options.scene is None else posterior.scene(options.scene)
    scene = posterior.estimate if weighted is None else weighted.scene
    with disk_errors_named(out):
        if options.format == "json":
            write_json(out, posterior, scene=options.scene, samples=options.samples)
        elif options.format == "glb":
            write_glb(out, weighted or scene, posterior.clip)
        else:
            write_i3db(out, scene, posterior.clip)
    console().print(f"Written: {out}")


def _report(options: argparse.Namespace) -> None:
    from imapper_prob.cli.console import console
    from imapper_prob.results.load import load_posterior
    from imapper_prob.results.report import write_report

    posterior = load_posterior(options.folder)
    path = options.folder / "report.html"
    with disk_errors_named(path):
        write_report(path, posterior)
    console().print(f"Written: {path}")


# ------------------------------------------------------------------------------------------------
# ``record`` and ``view``: write the recording of a finished run again, and open it.

_NAME = "recording.rrd"
_OWN_MACHINE = "127.0.0.1"
"""Address on which the viewer listens for data: only this machine."""
_PATIENCE = 3.0
"""Seconds within which a viewer without a display ends."""
_RUN = "import sys; from rerun_cli.__main__ import main; sys.exit(main())"
"""Command of the viewer in the package, independent of whether ``rerun`` is on the path."""


def add_recording_commands(
    commands: argparse._SubParsersAction[Any], shared: argparse.ArgumentParser
) -> None:
    """Add the two commands to a parser.

    Parameters
    ----------
    commands : argparse._SubParsersAction
        The program's subparsers.
    shared : argparse.ArgumentParser
        Options that all commands have.
    """
    record = commands.add_parser(
        "record",
        parents=[shared],
        help="make the recording of a run again, from posterior.nc",
        epilog=examples("record out/clip --video clip.mp4"),
    )
    record.add_argument("folder", type=run_folder_of, metavar="DIR", help="folder of a run")
    record.add_argument(
        "-o", "--output", type=Path, metavar="FILE.rrd", help=f"(default: DIR/{_NAME})"
    )
    record.add_argument(
        "--video",
        type=Path,
        metavar="PATH",
        help="show the clip's pictures: a folder of them, named by frame number, or a video "
        "whose start is frame 0 (default: no pictures)",
    )
    record.set_defaults(execute=_record)

    view = commands.add_parser(
        "view",
        parents=[shared],
        help="open the recording of a run in the viewer",
        epilog=examples("view out/demo"),
    )
    view.add_argument(
        "folder", type=run_folder_of, metavar="DIR", help="folder of a run, or an .rrd file"
    )
    view.set_defaults(execute=_view)


def _record(options: argparse.Namespace) -> None:
    from imapper_prob.cli.console import console
    from imapper_prob.files import require_output

    output = options.output or options.folder / _NAME
    require_output(output, ".rrd", of_run=_NAME)
    if not output.parent.is_dir():
        raise InputError(f"{output}: there is no folder {output.parent}")
    _write(options.folder, output, options.video)
    console().print(f"Written: {output}")


def _write(folder: Path, output: Path, video: Path | None) -> None:
    from imapper_prob.results.load import load_posterior

    posterior = load_posterior(folder)
    with disk_errors_named(output):
        posterior.record(output, video=video)


def _view(options: argparse.Namespace) -> None:
    recording = options.folder
    if recording.suffix != ".rrd":
        recording = options.folder / _NAME
        if not recording.is_file():
            _write(options.folder, recording, None)
    if not recording.is_file():
        raise InputError(f"{recording}: no such recording")
    open_viewer(recording)


def open_viewer(recording: Path) -> None:
    """Open a recording in a viewer that keeps running after this program ends.

    Parameters
    ----------
    recording : Path
        An ``.rrd`` file.

    Raises
    ------
    InputError
        There is no display, or the viewer ends at once.
    """
    displays = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")
    if sys.platform.startswith("linux") and not any(os.environ.get(d) for d in displays):
        raise InputError(
            f"{recording}: there is no screen here to show it on; copy the file to a machine with "
            "one, and open it there with: rerun recording.rrd"
        )
    viewer = subprocess.Popen(
        [sys.executable, "-c", _RUN, "--bind", _OWN_MACHINE, str(recording.absolute())],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    with suppress(subprocess.TimeoutExpired):
        if viewer.wait(_PATIENCE) != 0:
            raise InputError(
                f"{recording}: the viewer cannot show it on this screen; open it with: rerun "
                f"{recording}"
            )
