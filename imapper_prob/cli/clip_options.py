"""What a user may say about a clip on the command line."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING

from imapper_prob.cli.progress import progress_bars
from imapper_prob.models.errors import InputError

if TYPE_CHECKING:
    from imapper_prob.inputs import ClipOptions
    from imapper_prob.models.scene import Clip

__all__ = [
    "clip_from", "clip_options", "clip_parser", "is_clip", "is_video", "refuse_to_replace",
    "size_of",
]  # fmt: skip

_VIDEOS = (".avi", ".m4v", ".mkv", ".mov", ".mp4", ".mpg", ".webm")


def clip_parser(*, files: bool = True) -> argparse.ArgumentParser:
    """A parent parser with the options that say what keypoint files leave open.

    Without ``files``, those that a video answers itself are left out.
    """
    parser = argparse.ArgumentParser(add_help=False)
    group = parser.add_argument_group("what the files of a clip do not say")
    add = group.add_argument
    add("--camera", type=Path, metavar="FILE", help="intrinsics, TOML or JSON")
    add("--focal", type=float, metavar="PIXELS", help="focal length")
    add("--focal-spread", type=float, metavar="PART", help="of it that it may be wrong by")
    add("--pitch", type=float, metavar="DEGREES", help="of the camera; down is negative")
    add("--camera-height", type=float, metavar="METRES", help="above the floor")
    add("--confidence-map", metavar="MAP", help="its name, or knots such as 0:0,0.3:0.5,1:1")
    add("--fps", type=float, help="frames a second")
    if files:
        add("--format", help="such as body_25, halpe_26, mediapipe; by content if left out")
        add("--size", type=size_of, metavar="WxH", help="of the image in pixels")
        add("--people", type=int, metavar="N", help="actors, where files do not say")
        add("--frames", type=_span, metavar="FIRST:LAST", help="these alone, by their numbers")
        add("--marks", type=Path, metavar="FILE", help="who is who in some frames, JSON")
        choices = ("default", "paper")
        add(
            "--tracker",
            choices=choices,
            default="default",
            help="costs by which people are told apart",
        )
    return parser


def size_of(text: str) -> tuple[int, int]:
    """Width and height out of ``1920x1080``."""
    match = re.fullmatch(r"(\d{1,5})[x×](\d{1,5})", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r} is no size such as 1920x1080")
    return int(match[1]), int(match[2])


def _span(text: str) -> tuple[int, int]:
    """First and last frame out of ``100:350``."""
    match = re.fullmatch(r"(-?\d{1,15}):(-?\d{1,15})", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r} are no frames such as 100:350")
    return int(match[1]), int(match[2])


def clip_options(options: argparse.Namespace) -> ClipOptions:
    """What was said."""
    from imapper_prob.inputs import ClipOptions, read_camera, read_marks

    marks = getattr(options, "marks", None)
    return ClipOptions(
        format=getattr(options, "format", None),
        camera=None if options.camera is None else read_camera(options.camera),
        focal=options.focal,
        focal_spread=options.focal_spread,
        pitch=options.pitch,
        height=options.camera_height,
        size=getattr(options, "size", None),
        fps=options.fps,
        confidence=options.confidence_map,
        people=getattr(options, "people", None),
        marks=None if marks is None else read_marks(marks),
        tracker=getattr(options, "tracker", "default"),
    )


def refuse_to_replace(output: Path, *, overwrite: bool) -> None:
    """Whether a clip file may be written there, before anything is computed for it.

    Raises
    ------
    InputError
        It is none by its name, or there is one already.
    """
    if output.suffix != ".npz":
        raise InputError(f"{output}: a clip file's name ends in .npz")
    if output.exists() and not overwrite:
        raise InputError(f"{output} exists; name another file, or say --overwrite")
    if not output.parent.is_dir():
        raise InputError(f"{output}: there is no folder {output.parent}")


def is_clip(path: Path) -> bool:
    """Whether a path is a clip rather than the folder of a run: a file, or keypoints."""
    return path.is_file() or (path.is_dir() and any(path.glob("*.json")) and not _is_run(path))


def _is_run(path: Path) -> bool:
    return (path / "scenes.json").exists() or (path / "posterior.nc").exists()


def is_video(path: Path) -> bool:
    """Whether a path is a video by its name."""
    return path.suffix.lower() in _VIDEOS


def clip_from(path: Path, options: argparse.Namespace) -> Clip:
    """The clip at ``path``, read as the options say; in a video its joints are found first."""
    said = clip_options(options)
    if is_video(path):
        from imapper_prob.detect import detect
        from imapper_prob.inputs.window import window

        with progress_bars() as progress:
            clip = detect(path, options=said, progress=progress)
        return clip if options.frames is None else window(clip, *options.frames)
    from imapper_prob.inputs import load_clip
    from imapper_prob.lifting import lift_clip

    return load_clip(path, options=said, lift=lift_clip, frames=options.frames)
