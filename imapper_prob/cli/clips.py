"""``detect`` and ``track``, and the options that describe a clip."""

from __future__ import annotations

import argparse
import re
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from imapper_prob.cli.console import print_lines, progress_bars
from imapper_prob.cli.parser import examples
from imapper_prob.files import (
    disk_errors_named,
    require_output,
    require_writable,
    written_whole,
)
from imapper_prob.models.errors import InputError

if TYPE_CHECKING:
    from imapper_prob.clips.load import ClipOptions
    from imapper_prob.models.scene import Clip
    from imapper_prob.models.scenelet import Library

__all__ = [
    "add_detect_command",
    "add_track_command",
    "clip_from",
    "clip_options_said",
    "clip_parser",
    "is_clip",
    "is_run",
    "is_video",
    "run_folder_of",
    "size_of",
]

_VIDEOS = (".avi", ".m4v", ".mkv", ".mov", ".mp4", ".mpg", ".webm")


def clip_parser(*, files: bool = True) -> argparse.ArgumentParser:
    """A parent parser with options for what keypoint files do not state.

    Parameters
    ----------
    files : bool
        Whether to include options that a video makes unnecessary.

    Returns
    -------
    argparse.ArgumentParser
        Without help of its own, to be used in ``parents``.
    """
    parser = argparse.ArgumentParser(add_help=False)
    group = parser.add_argument_group("what the files of a clip do not state")
    add = group.add_argument
    add("--camera", type=Path, metavar="FILE", help="intrinsics, TOML or JSON (default: none)")
    add(
        "--focal",
        type=float,
        metavar="PIXELS",
        help="focal length (default: of the file; else the longer side of the image)",
    )
    add(
        "--focal-spread",
        type=float,
        metavar="PART",
        help="relative standard deviation of the focal length (default: by its source)",
    )
    add(
        "--pitch",
        type=float,
        metavar="DEGREES",
        help="expected pitch of the camera, the mean of its prior; down is negative (default: 0)",
    )
    add(
        "--camera-height",
        type=float,
        metavar="METRES",
        help="expected height above the floor, the mean of its prior (default: 1.5)",
    )
    add(
        "--confidence-map",
        metavar="MAP",
        help="map of confidences: its name, or knots such as 0:0,0.3:0.5,1:1 (default: by format)",
    )
    add(
        "--fps",
        type=float,
        metavar="N",
        help="frames a second of the input as it is stored; drops none (default: of the file; "
        "else 30)",
    )
    if files:
        add("--format", metavar="NAME", help="such as body_25, halpe_26 (default: by content)")
        add(
            "--size",
            type=size_of,
            metavar="WxH",
            help="of the image in pixels (default: of the file)",
        )
        add(
            "--people",
            type=int,
            metavar="N",
            help="actors, where files do not say (default: found from the clip)",
        )
        add(
            "--frames",
            type=_span,
            metavar="FIRST:LAST",
            help="these alone, by their numbers (default: all)",
        )
        add(
            "--marks",
            type=Path,
            metavar="FILE",
            help="who is who in some frames, JSON (default: none)",
        )
        choices = ("default", "paper")
        add(
            "--tracker",
            choices=choices,
            default="default",
            help="costs by which people are told apart",
        )
    return parser


def size_of(text: str) -> tuple[int, int]:
    """Parse width and height, as in ``1920x1080``.

    Parameters
    ----------
    text : str
        Argument of the command line.

    Returns
    -------
    tuple of int
        Pixels.

    Raises
    ------
    argparse.ArgumentTypeError
        The text is not a size.
    """
    match = re.fullmatch(r"(\d{1,5})[x×](\d{1,5})", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r} is no size such as 1920x1080")
    return int(match[1]), int(match[2])


def _span(text: str) -> tuple[int, int]:
    """Parse first and last frame, as in ``100:350``."""
    match = re.fullmatch(r"(-?\d{1,15}):(-?\d{1,15})", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r} are no frames such as 100:350")
    return int(match[1]), int(match[2])


def clip_options(options: argparse.Namespace) -> ClipOptions:
    """Clip options from parsed arguments."""
    from imapper_prob.clips.load import ClipOptions, read_camera, read_marks

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


def clip_options_said(options: argparse.Namespace) -> list[str]:
    """Names of the options of a clip that differ from their defaults.

    Parameters
    ----------
    options : argparse.Namespace
        Options of `clip_parser`, among others.

    Returns
    -------
    list of str
        Without the dashes before them.
    """
    actions = [a for a in clip_parser()._actions if getattr(options, a.dest) != a.default]
    return [action.option_strings[0].removeprefix("--") for action in actions]


_PICTURES: Final = (".png", ".jpg", ".jpeg")


def _require_new_files(options: argparse.Namespace) -> None:
    """Check that the clip file and the picture may be written, before anything is computed."""
    output, picture = options.output, options.picture
    require_output(output, ".npz")
    if picture is not None and picture.suffix.lower() not in _PICTURES:
        raise InputError(f"{picture}: a picture's name ends in {', '.join(_PICTURES)}")
    for path in (output, picture):
        if path is None:
            continue
        if path.is_dir():
            raise InputError(f"{path}: is a folder; name a file")
        if path.exists() and not options.overwrite:
            raise InputError(f"{path} exists; name another file, or say --overwrite")
        if not path.parent.is_dir():
            raise InputError(f"{path}: there is no folder {path.parent}")
        require_writable(path.parent)


def is_clip(path: Path) -> bool:
    """Whether a path is a clip (a file, or a folder of keypoints) and not the folder of a run.

    Parameters
    ----------
    path : Path

    Returns
    -------
    bool
    """
    return path.is_file() or (path.is_dir() and any(path.glob("*.json")) and not is_run(path))


def run_folder_of(text: str) -> Path:
    """Folder of a run; ``DIR/posterior.nc`` stands for ``DIR``.

    Parameters
    ----------
    text : str
        Argument of the command line.

    Returns
    -------
    Path
    """
    path = Path(text)
    return path.parent if path.name == "posterior.nc" else path


def is_run(path: Path) -> bool:
    """Whether a folder has the files of a run.

    Parameters
    ----------
    path : Path

    Returns
    -------
    bool
    """
    return (path / "scenes.json").exists() or (path / "posterior.nc").exists()


def is_video(path: Path) -> bool:
    """Whether a path has the name of a video file.

    Parameters
    ----------
    path : Path

    Returns
    -------
    bool
    """
    return path.suffix.lower() in _VIDEOS


def clip_from(path: Path, options: argparse.Namespace, library: Library | None = None) -> Clip:
    """Read the clip at ``path`` with the given options; in a video, detect the joints first.

    Parameters
    ----------
    path : Path
        Clip file, keypoints, i3DB scene or video.
    options : argparse.Namespace
        Options of `clip_parser`.
    library : Library, optional
        Library with which the clip is to be solved. A video that does not suit it is refused before
        its joints are detected.

    Returns
    -------
    Clip

    Raises
    ------
    InputError
        The content of ``path`` is not a clip, or an option contradicts it.
    """
    said = clip_options(options)
    if is_video(path):
        from imapper_prob.clips.detect import detect
        from imapper_prob.clips.load import window

        if library is not None:
            _require_film(path, said.fps, options.frames, library)
        with progress_bars() as progress:
            clip = detect(path, options=said, progress=progress)
        return clip if options.frames is None else window(clip, *options.frames)
    from imapper_prob.api import load_clip

    return load_clip(path, options=said, frames=options.frames)


def _require_film(
    path: Path, fps: float | None, frames: tuple[int, int] | None, library: Library
) -> None:
    from imapper_prob.clips.detect import usual_step
    from imapper_prob.clips.video import open_video
    from imapper_prob.memory import require_film

    video = open_video(path)
    fps = video.fps if fps is None else fps
    step = usual_step(fps)
    n_frames = -(-video.n_frames // step)
    if frames is not None:
        n_frames = min(n_frames, frames[1] - frames[0] + 1)
    require_film(path.stem, fps / step, n_frames, library)


# ------------------------------------------------------------------------------------------------
# ``detect``: find the joints of the person in a video and write a clip file.


def add_detect_command(
    commands: argparse._SubParsersAction[Any], shared: argparse.ArgumentParser
) -> None:
    """Add the command to a parser.

    Parameters
    ----------
    commands : argparse._SubParsersAction
        The program's subparsers.
    shared : argparse.ArgumentParser
        Options that all commands have.
    """
    detect = commands.add_parser(
        "detect",
        parents=[shared, clip_parser(files=False)],
        help="find the joints of the person in a video",
        epilog=examples(
            "detect clip.mp4 -o clip.npz",
            "detect clip.mp4 -o clip.npz --start 3 --picture joints.png",
        ),
    )
    detect.add_argument("video", type=Path, help="a video file of one person, by a fixed camera")
    detect.add_argument(
        "-o", "--output", type=Path, required=True, metavar="CLIP.npz", help="clip file to write"
    )
    detect.add_argument(
        "--start", type=float, default=0.0, metavar="SECONDS", help="where to begin"
    )
    detect.add_argument(
        "--end", type=float, metavar="SECONDS", help="(default: the end of the video)"
    )
    detect.add_argument(
        "--step", type=int, metavar="N", help="take every n-th frame (default: ten a second)"
    )
    detect.add_argument(
        "--picture",
        type=Path,
        metavar="PNG",
        help="write frames with their joints (default: no picture)",
    )
    detect.add_argument("--overwrite", action="store_true", help="replace an earlier clip file")
    detect.set_defaults(execute=_detect)


def _detect(options: argparse.Namespace) -> None:
    from imapper_prob.cli.console import console
    from imapper_prob.clips.detect import detect
    from imapper_prob.clips.load import clip_table, write_clip

    output: Path = options.output
    _require_new_files(options)
    with progress_bars() as progress:
        clip = detect(
            options.video,
            options=clip_options(options),
            start=options.start,
            end=options.end,
            step=options.step,
            progress=progress,
        )
    with disk_errors_named(output):
        write_clip(output, clip)
    if options.picture is not None:
        with disk_errors_named(options.picture):
            _draw(options, clip)
    out = console()
    out.print(clip_table(clip))
    command = shlex.join(["imapper-prob", "run", str(output)])
    print_lines(f"Written to {output}; go on with: {command} -o DIR")


def _draw(options: argparse.Namespace, clip: Clip) -> None:
    from imapper_prob.clips.detect import contact_sheet, usual_step
    from imapper_prob.clips.video import open_video

    video = open_video(options.video)
    fps = options.fps or video.fps
    step = options.step or usual_step(fps)
    sheet = contact_sheet(video, clip, first=round(options.start * fps), step=step)
    with written_whole(options.picture) as beside:
        sheet.save(beside)


# ------------------------------------------------------------------------------------------------
# ``track``: assign identities to people that a detector found frame by frame.


def add_track_command(
    commands: argparse._SubParsersAction[Any], shared: argparse.ArgumentParser
) -> None:
    """Add the command to a parser.

    Parameters
    ----------
    commands : argparse._SubParsersAction
        The program's subparsers.
    shared : argparse.ArgumentParser
        Options that all commands have.
    """
    track = commands.add_parser(
        "track",
        parents=[shared, clip_parser()],
        help="tell people apart, and write the clip",
        epilog=examples("track keypoints/ -o clip.npz --people 2 --picture tracks.png"),
    )
    track.add_argument("clip", type=Path, help="keypoints of several people, in any format")
    track.add_argument(
        "-o", "--output", type=Path, required=True, metavar="CLIP.npz", help="clip file to write"
    )
    track.add_argument(
        "--picture", type=Path, metavar="PNG", help="draw the tracks (default: no picture)"
    )
    track.add_argument("--overwrite", action="store_true", help="replace an earlier clip file")
    track.set_defaults(execute=_track)


def _track(options: argparse.Namespace) -> None:
    from imapper_prob.cli.console import console
    from imapper_prob.clips.load import clip_table, write_clip
    from imapper_prob.plotting import save_figure

    _require_new_files(options)
    clip = clip_from(options.clip, options)
    with disk_errors_named(options.output):
        write_clip(options.output, clip)
    if options.picture is not None:
        from imapper_prob.clips.identity import track_figure

        with disk_errors_named(options.picture), written_whole(options.picture) as beside:
            save_figure(track_figure(clip), beside)
    console().print(clip_table(clip))
