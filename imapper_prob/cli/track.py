"""``track``: who is who among people that a detector saw frame by frame."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from imapper_prob.cli.clip_options import clip_from, clip_parser, refuse_to_replace
from imapper_prob.models.errors import InputError

__all__ = ["add_track_command"]

_DOTS_PER_INCH = 120


def add_track_command(
    commands: argparse._SubParsersAction[Any], shared: argparse.ArgumentParser
) -> None:
    """Add the command to a parser; ``shared`` holds options that all commands have."""
    track = commands.add_parser(
        "track", parents=[shared, clip_parser()], help="tell people apart, and write the clip"
    )
    track.add_argument("clip", type=Path, help="keypoints of several people, in any format")
    track.add_argument("-o", "--output", type=Path, required=True, metavar="CLIP.npz")
    track.add_argument("--picture", type=Path, metavar="PNG", help="draw the tracks")
    track.add_argument("--overwrite", action="store_true", help="replace an earlier clip file")
    track.set_defaults(execute=_track)


def _track(options: argparse.Namespace) -> None:
    from imapper_prob.cli.console import console
    from imapper_prob.figure_file import save_figure
    from imapper_prob.files import written_whole
    from imapper_prob.inputs import write_clip
    from imapper_prob.inputs.describe import clip_table

    refuse_to_replace(options.output, overwrite=options.overwrite)
    clip = clip_from(options.clip, options)
    try:
        write_clip(options.output, clip)
        if options.picture is not None:
            from imapper_prob.inputs.track_figure import track_figure

            with written_whole(options.picture) as beside:
                save_figure(track_figure(clip), beside, dpi=_DOTS_PER_INCH)
    except OSError as error:
        raise InputError(
            f"{options.output}: cannot be written ({error.strerror or error})"
        ) from error
    console().print(clip_table(clip))
