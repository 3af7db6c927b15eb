"""Read a clip of any format.

:func:`format_of` recognises the format by its content and :func:`read_whatever` calls its reader.
:func:`read_frames` selects frames; :func:`require_people` refuses tracks without a person.
"""

from __future__ import annotations

import codecs
import zipfile
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.clips.assemble import RawDetections, assemble
from imapper_prob.clips.clip_file import read_clip, write_clip
from imapper_prob.clips.i3db import DETECTIONS, read_i3db
from imapper_prob.clips.identity import read_marks
from imapper_prob.clips.joints_3d import MAGIC, is_joints, read_joints, read_trc
from imapper_prob.clips.mediapipe import is_mediapipe, read_mediapipe
from imapper_prob.clips.openpose import ORDERS, is_openpose, read_openpose
from imapper_prob.clips.options import ClipOptions, read_camera
from imapper_prob.clips.parsing import load_json
from imapper_prob.clips.result_lists import (
    SETS,
    is_proposals,
    is_result_list,
    read_proposals,
    read_result_list,
)
from imapper_prob.models.errors import InputError, require_kind, require_whole
from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.settings import SHORTEST_CLIP
from imapper_prob.models.skeleton import DETECTED, JOINTS

if TYPE_CHECKING:
    from rich.table import Table

__all__ = [
    "ClipOptions",
    "clip_table",
    "format_of",
    "load_clip",
    "read_camera",
    "read_clip",
    "read_frames",
    "read_marks",
    "read_whatever",
    "require_people",
    "window",
    "write_clip",
]


def _never_seen(track: Track) -> tuple[str, ...]:
    """Joints that detectors report but that are missing in all frames of a track."""
    seen = track.confidences.max(0) > 0
    return tuple(JOINTS[joint] for joint in DETECTED if not seen[joint])


def clip_table(clip: Clip) -> Table:
    """A table with one row a track, titled with camera and frames.

    Parameters
    ----------
    clip : Clip

    Returns
    -------
    rich.table.Table
    """
    from rich.table import Table

    camera = clip.camera
    doubt = "" if clip.focal_known else f" (assumed, ± {100 * clip.focal_spread:.0f} %)"
    focal = f"focal length {camera.fx:.0f} px{doubt}"
    table = Table(
        title=f"{clip.name}: {clip.n_frames} frames at {clip.fps:g} a second, "
        f"{camera.width} x {camera.height}, {focal}",
        title_justify="left",
    )
    table.add_column("person")
    for column in ("frames seen", "joints a frame", "mean confidence", "frames with a pose"):
        table.add_column(column, justify="right")
    table.add_column("joints never seen")
    for track in clip.tracks:
        there = track.confidences > 0
        frames = there.any(1)
        table.add_row(
            track.name,
            str(frames.sum()),
            f"{there.sum() / max(frames.sum(), 1):.1f}",
            f"{np.mean(track.confidences[there]) if there.any() else 0:.2f}",
            str(track.has_pose.sum()),
            ", ".join(_never_seen(track)) or "none",
        )
    return table


# ------------------------------------------------------------------------------------------------
# Frame ranges of clips.


def window(clip: Clip, first: int, last: int) -> Clip:
    """The frames ``first`` to ``last`` of a clip, both included, with the ground truth of these.

    Parameters
    ----------
    clip : Clip
    first, last : int
        Frame numbers of the clip.

    Returns
    -------
    Clip

    Raises
    ------
    InputError
        The frames are not in the clip.
    """
    start, end = int(clip.frame_ids[0]), int(clip.frame_ids[-1])
    if not start <= first <= last <= end:
        raise InputError(f"clip {clip.name}: no frames {first} to {last}; it has {start} to {end}")
    part = slice(first - start, last - start + 1)
    tracks = tuple(
        Track(
            name=t.name,
            keypoints=t.keypoints[part],
            confidences=t.confidences[part],
            poses=t.poses[part],
            interpolated=t.interpolated[part],
        )
        for t in clip.tracks
    )
    truth = clip.truth
    if truth is not None:
        people = len(truth.joints) // clip.n_frames
        rows = np.arange(people * clip.n_frames).reshape(people, -1)[:, part].ravel()
        truth = replace(
            truth,
            joints=truth.joints[rows],
            hidden=truth.hidden[rows],
            actions=tuple(truth.actions[row] for row in rows if truth.actions),
        )
    return replace(clip, frame_ids=clip.frame_ids[part], tracks=tracks, truth=truth)


# ------------------------------------------------------------------------------------------------
# Formats.

_FORMATS: Final = (
    "i3db",
    "clip",
    "joints",
    "trc",
    *ORDERS,
    *SETS,
    "openpose",
    "results",
    "mediapipe",
    "proposals",
)
"""Names that ``--format`` accepts; ``openpose`` and ``results`` do not fix the joint order."""
_WHOLE: Final = ("i3db", "clip")
_FOLDERS: Final = ("i3db", "openpose", *ORDERS)


def format_of(path: Path) -> str:
    """Find the format of a file or folder from its content.

    Parameters
    ----------
    path : Path

    Returns
    -------
    str
        Such as ``"i3db"`` or ``"openpose"``.

    Raises
    ------
    InputError
        The format is unknown.
    """
    if path.is_dir():
        if any(path.glob(DETECTIONS)):
            return "i3db"
        if is_openpose(path):
            return "openpose"
    elif path.is_file():
        found = _format_of_file(path)
        if found is not None:
            return found
    raise InputError(f"{path}: not a known clip, but {_seen(path)}; see docs/reference/inputs.md")


def _seen(path: Path) -> str:
    """Message that says what was found instead of a clip, and what a clip would contain."""
    if path.is_dir():
        kinds = Counter(p.suffix or "other" for p in path.iterdir() if p.is_file())
        if (path / "posterior.nc").is_file():
            return "the folder of a run; give the clip that it was made of"
        if not kinds:
            return (
                f"a folder without files; expected an i3DB scene (with {DETECTIONS}) or a folder "
                "of OpenPose files"
            )
        held = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common(3))
        return (
            f"a folder with {held} files; expected an i3DB scene (with {DETECTIONS}) or a folder "
            "of OpenPose files, one JSON with 'people' a frame"
        )
    if path.suffix == ".nc":
        return "the draws of a run; give the clip that it was made of"
    with path.open("rb") as file:
        beginning = file.read(64).removeprefix(codecs.BOM_UTF8)
    if not beginning.strip():
        return "an empty file"
    if beginning.lstrip()[:1] in (b"[", b"{"):
        return (
            "JSON of another kind; expected results of MMPose or AlphaPose ('keypoints'), a "
            "MediaPipe dump ('landmarks') or pose proposals ('proposals')"
        )
    kind = "text" if beginning.isascii() and b"\0" not in beginning else "binary"
    return (
        f"a {kind} file; expected JSON of a pose detector, a TRC file (begins with {MAGIC}) or an "
        ".npz file"
    )


def _format_of_file(path: Path) -> str | None:
    with path.open("rb") as file:
        beginning = file.read(64).removeprefix(codecs.BOM_UTF8)
    if beginning.startswith(b"PK"):
        try:
            with zipfile.ZipFile(path) as archive:
                entries = {name.removesuffix(".npy") for name in archive.namelist()}
        except (zipfile.BadZipFile, OSError, ValueError, RuntimeError):
            entries = set()
        return "joints" if is_joints(entries) else "clip"
    if path.suffix == ".npz":
        return "clip"
    if beginning.startswith(MAGIC.encode()):
        return "trc"
    if beginning.lstrip()[:1] in (b"[", b"{"):
        data = load_json(path)
        if is_result_list(data):
            return "results"
        if is_mediapipe(data):
            return "mediapipe"
        if is_proposals(data):
            return "proposals"
    return None


def read_whatever(path: Path, options: ClipOptions) -> Clip:
    """Read a clip of any format; poses are NaN if the format has none.

    Parameters
    ----------
    path : Path
    options : ClipOptions

    Returns
    -------
    Clip

    Raises
    ------
    InputError
        The content is not a clip, or an option does not apply to its format.
    """
    form = _chosen(path, options)
    if form in _WHOLE:
        given = [
            name
            for name in (
                "camera",
                "focal",
                "focal_spread",
                "pitch",
                "height",
                "size",
                "fps",
                "confidence",
                "people",
                "marks",
            )
            if getattr(options, name) is not None
        ]
        if options.tracker != ClipOptions().tracker:
            given.append("tracker")
        if given:
            advice = (
                "leave the option out"
                if form == "i3db"
                else "give the option to the command that makes the file, `detect` or `track`"
            )
            raise InputError(f"{path}: a clip of format {form} has its own {given[0]}; {advice}")
        return read_i3db(path) if form == "i3db" else read_clip(path)
    try:
        sightings, options = _read(path, form, options)
        return assemble(sightings, options)
    except InputError as error:
        message = str(error)
        raise InputError(message if str(path) in message else f"{path}: {message}") from error


def _chosen(path: Path, options: ClipOptions) -> str:
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    if not (path.is_file() or path.is_dir()):
        raise InputError(f"{path}: is a pipe or device; write the clip to a file first")
    form = options.format
    if form is None:
        return format_of(path)
    if form not in _FORMATS:
        raise InputError(f"format {form!r}: known are {', '.join(_FORMATS)}")
    if path.is_dir() != (form in _FOLDERS):
        raise InputError(f"{path}: {form} is a {'folder' if form in _FOLDERS else 'file'}")
    return form


def _read(path: Path, form: str, options: ClipOptions) -> tuple[RawDetections, ClipOptions]:
    if form == "joints":
        sightings, options = read_joints(path, options)
        return sightings, _without_distortion(options)
    if form == "trc":
        return read_trc(path, options), _without_distortion(options)
    if form == "mediapipe":
        return read_mediapipe(path), options
    if form == "proposals":
        return read_proposals(path), options
    if form in ("openpose", *ORDERS):
        return read_openpose(path, order=None if form == "openpose" else form), options
    return read_result_list(path, keypoint_set=None if form == "results" else form), options


def _without_distortion(options: ClipOptions) -> ClipOptions:
    """The options for joints in space, which are projected without the distortion of the lens."""
    if options.camera is None:
        return options
    return replace(options, camera=replace(options.camera, distortion=np.zeros(0)))


# ------------------------------------------------------------------------------------------------
# Reading.

_SMALLEST: Final = 4.0
"""Least height or width of a person in pixels, about the precision of detectors."""


def load_clip(
    path: str | Path,
    *,
    options: ClipOptions | None = None,
    frames: tuple[int, int] | None = None,
) -> Clip:
    """Read a clip that includes poses, such as a scene of i3DB or a clip file.

    :func:`imapper_prob.api.load_clip` also reads clips without poses and lifts them.

    Parameters
    ----------
    path, options, frames
        See :func:`read_frames`.

    Returns
    -------
    Clip

    Raises
    ------
    InputError
        See :func:`read_frames` and :func:`require_people`.
    """
    clip = read_frames(path, options=options, frames=frames)
    require_people(clip, path)
    return clip


def read_frames(
    path: str | Path,
    *,
    options: ClipOptions | None = None,
    frames: tuple[int, int] | None = None,
) -> Clip:
    """Read a clip of any format, or a range of its frames.

    Parameters
    ----------
    path : path
        A scene folder of the i3DB benchmark, an ``.npz`` of the program's own format
        (:mod:`imapper_prob.clips.clip_file`), or anything else that ``inputs.md`` lists.
    options : ClipOptions, optional
        What the files do not state: camera, image size, frame rate.
    frames : (int, int), optional
        First and last frame to read, by the clip's own numbers; all if not given.

    Returns
    -------
    Clip
        Poses are NaN where the format has none.

    Raises
    ------
    InputError
        The content of ``path`` is not a clip, or the clip is too short.
    """
    path, options = Path(path), ClipOptions() if options is None else options
    require_kind("options", options, ClipOptions, "ClipOptions")
    if frames is not None:
        if np.shape(frames) != (2,):
            raise InputError(f"frames = {frames!r:.60} must be (first, last)")
        for frame in frames:
            require_whole("frame", frame, least=-(2**63))
    clip = read_whatever(path, options)
    if frames is not None:
        clip = window(clip, *frames)
    if clip.n_frames < SHORTEST_CLIP:
        raise InputError(
            f"{path}: a clip of {clip.n_frames} frames; at least {SHORTEST_CLIP} are needed"
        )
    return clip


def require_people(clip: Clip, path: str | Path) -> None:
    """Refuse a clip in which some track shows no person with a pose.

    Parameters
    ----------
    clip : Clip
    path : path
        Path it was read from, for messages.

    Raises
    ------
    InputError
        A track has no frame with both a detected joint and a pose, or is only a few pixels large.
    """
    for track in clip.tracks:
        if not ((track.confidences > 0).any(1) & track.has_pose).any():
            raise InputError(
                f"{path}: track {track.name} has no frame with both a detected joint and a "
                "lifted pose"
            )
        if _extent(track) < _SMALLEST:
            raise InputError(
                f"{path}: track {track.name} is {_extent(track):.1f} pixels high and wide; these "
                "are no joints of a person"
            )


def _extent(track: Track) -> float:
    """Larger of height and width in pixels of all joints, median over frames."""
    seen = np.where((track.confidences > 0)[..., None], track.keypoints, np.nan)
    there: NDArray[np.bool_] = np.isfinite(seen).all(-1).sum(1) > 1
    if not there.any():
        return 0.0
    size = np.nanmax(seen[there], axis=1) - np.nanmin(seen[there], axis=1)
    return float(np.median(size.max(1)))
