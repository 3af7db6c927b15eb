"""``detect``: joints of the person in a video, as a clip file."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imapper_prob.cli.clip_options import clip_options, clip_parser, refuse_to_replace
from imapper_prob.cli.progress import progress_bars
from imapper_prob.models.errors import InputError

if TYPE_CHECKING:
    from imapper_prob.models.scene import Clip

__all__ = ["add_detect_command"]


def add_detect_command(
    commands: argparse._SubParsersAction[Any], shared: argparse.ArgumentParser
) -> None:
    """Add the command to a parser; ``shared`` holds options that all commands have."""
    detect = commands.add_parser(
        "detect",
        parents=[shared, clip_parser(files=False)],
        help="find the joints of the person in a video",
    )
    detect.add_argument("video", type=Path)
    detect.add_argument("-o", "--output", type=Path, required=True, metavar="CLIP.npz")
    detect.add_argument("--start", type=float, default=0.0, metavar="SECONDS")
    detect.add_argument("--end", type=float, metavar="SECONDS")
    detect.add_argument("--step", type=int, help="take every n-th frame; ten a second if left out")
    detect.add_argument("--picture", type=Path, metavar="PNG", help="frames with their joints")
    detect.add_argument("--overwrite", action="store_true", help="replace an earlier clip file")
    detect.set_defaults(execute=_detect)


def _detect(options: argparse.Namespace) -> None:
    from imapper_prob.cli.console import console
    from imapper_prob.detect import detect
    from imapper_prob.inputs import write_clip
    from imapper_prob.inputs.describe import clip_table

    output: Path = options.output
    refuse_to_replace(output, overwrite=options.overwrite)
    with progress_bars() as progress:
        clip = detect(
            options.video,
            options=clip_options(options),
            start=options.start,
            end=options.end,
            step=options.step,
            progress=progress,
        )
    try:
        write_clip(output, clip)
        if options.picture is not None:
            _draw(options, clip)
    except OSError as error:
        raise InputError(f"{output}: cannot be written ({error.strerror or error})") from error
    out = console()
    out.print(clip_table(clip))
    out.print(f"Written to {output}; go on with: imapper-prob run {output} -o DIR")


def _draw(options: argparse.Namespace, clip: Clip) -> None:
    from imapper_prob.detect.contact_sheet import contact_sheet
    from imapper_prob.detect.detect import usual_step
    from imapper_prob.detect.video import open_video
    from imapper_prob.files import written_whole

    video = open_video(options.video)
    fps = options.fps or video.fps
    step = options.step or usual_step(fps)
    sheet = contact_sheet(video, clip, first=round(options.start * fps), step=step)
    with written_whole(options.picture) as beside:
        sheet.save(beside)
