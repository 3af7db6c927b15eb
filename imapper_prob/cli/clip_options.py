"""What a user may say about a clip on the command line."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from imapper_prob.inputs import ClipOptions
    from imapper_prob.models.scene import Clip

__all__ = ["clip_from", "clip_parser", "size_of"]


def clip_parser() -> argparse.ArgumentParser:
    """A parent parser with the options that say what keypoint files leave open."""
    parser = argparse.ArgumentParser(add_help=False)
    group = parser.add_argument_group("what the files of a clip do not say")
    group.add_argument(
        "--format", help="such as body_25, halpe_26, mediapipe; by content if left out"
    )
    group.add_argument("--size", type=size_of, metavar="WxH", help="of the image in pixels")
    group.add_argument("--fps", type=float, help="frames a second")
    group.add_argument("--camera", type=Path, metavar="FILE", help="intrinsics, TOML or JSON")
    group.add_argument("--focal", type=float, metavar="PIXELS", help="focal length")
    group.add_argument(
        "--pitch", type=float, metavar="DEGREES", help="of the camera; down is negative"
    )
    group.add_argument("--camera-height", type=float, metavar="METRES", help="above the floor")
    group.add_argument(
        "--confidence-map", metavar="MAP", help="a map's name, or knots such as 0:0,0.3:0.5,1:1"
    )
    group.add_argument("--people", type=int, metavar="N", help="actors, where files do not say")
    return parser


def size_of(text: str) -> tuple[int, int]:
    """Width and height out of ``1920x1080``."""
    match = re.fullmatch(r"(\d{1,5})[x×](\d{1,5})", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r} is no size such as 1920x1080")
    return int(match[1]), int(match[2])


def options_from(options: argparse.Namespace) -> ClipOptions:
    """What was said."""
    from imapper_prob.inputs import ClipOptions, read_camera

    return ClipOptions(
        format=options.format,
        camera=None if options.camera is None else read_camera(options.camera),
        focal=options.focal,
        pitch=options.pitch,
        height=options.camera_height,
        size=options.size,
        fps=options.fps,
        confidence=options.confidence_map,
        people=options.people,
    )


def clip_from(path: Path, options: argparse.Namespace) -> Clip:
    """The clip at ``path``, read as the options say."""
    from imapper_prob.api import load_clip

    return load_clip(path, options=options_from(options))
