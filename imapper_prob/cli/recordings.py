"""``record`` and ``view``: the recording of a finished run, made again and opened."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from imapper_prob.models.errors import InputError

__all__ = ["add_recording_commands", "open_viewer"]

_NAME = "recording.rrd"
_OWN_MACHINE = "127.0.0.1"
"""Address on which the viewer listens for more to show: from nowhere else."""
_PATIENCE = 3.0
"""Seconds within which a viewer ends that finds no screen."""
_RUN = "import sys; from rerun_cli.__main__ import main; sys.exit(main())"
"""The viewer that came with the package, whether or not ``rerun`` is on the path."""


def add_recording_commands(
    commands: argparse._SubParsersAction[Any], shared: argparse.ArgumentParser
) -> None:
    """Add the two commands to a parser; ``shared`` holds options that all commands have."""
    record = commands.add_parser(
        "record", parents=[shared], help="make the recording of a run again, from posterior.nc"
    )
    record.add_argument("folder", type=Path, metavar="DIR")
    record.add_argument("-o", "--output", type=Path, help=f"instead of DIR/{_NAME}")
    record.add_argument(
        "--video",
        type=Path,
        metavar="PATH",
        help="show the clip's pictures: a folder of them, named by frame number, or a video file",
    )
    record.set_defaults(execute=_record)

    view = commands.add_parser(
        "view", parents=[shared], help="open the recording of a run in the viewer"
    )
    view.add_argument("folder", type=Path, metavar="DIR", help="of a run, or an .rrd file")
    view.set_defaults(execute=_view)


def _record(options: argparse.Namespace) -> None:
    from imapper_prob.cli.console import console

    output = options.output or options.folder / _NAME
    _write(options.folder, output, options.video)
    console().print(f"Written: {output}")


def _write(folder: Path, output: Path, video: Path | None) -> None:
    from imapper_prob.results.load import load_posterior

    posterior = load_posterior(folder)
    try:
        posterior.record(output, video=video)
    except OSError as error:
        raise InputError(f"{output}: cannot be written ({error.strerror or error})") from error


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
    """Open a recording in a viewer that outlives this program.

    Raises
    ------
    InputError
        If there is no screen to open it on, or the viewer ends at once.
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
