"""Pictures of a clip inside its recording, and a recording inside a notebook.

A clip has no pictures, only detections. If the pictures are available, as a folder or a video file,
they can be drawn behind the detections.
"""

from __future__ import annotations

import io
import os
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip

if TYPE_CHECKING:
    from rerun_notebook import Viewer

__all__ = ["WIDTH", "Video", "read_video", "recording_widget"]

WIDTH = 640
"""Width in pixels of a recorded picture, about that of its panel."""
_QUALITIES = (55, 35, 20, 10)
"""JPEG qualities, tried in order until all pictures together are small enough."""
_MOST = 7_000_000
"""Most bytes of all pictures; the whole recording of 430 frames then stays below 15 MB."""
_KINDS = {".jpg", ".jpeg", ".png", ".bmp", ".webp"}


@dataclass(frozen=True)
class Video:
    """Pictures of some frames of a clip.

    Parameters
    ----------
    frame_ids : (n,) int
        Frame numbers of the clip, increasing.
    pictures : tuple of n bytes
        JPEG files.
    width, height : int
        Size of each picture in pixels.
    """

    frame_ids: NDArray[np.int64]
    pictures: tuple[bytes, ...]
    width: int
    height: int


def read_video(path: str | Path, clip: Clip, *, rate: float | None = None) -> Video:
    """Read the pictures of a clip and reduce their size.

    Parameters
    ----------
    path : path
        A folder of pictures whose names end in the number of their frame
        (``color_00012.jpg``), or a video file, in which frame n is n / fps seconds after the start.
    clip : Clip
        Only the pictures of its frames are kept.
    rate : float, optional
        Frames a second of a video file, if it does not say so itself or not correctly.

    Returns
    -------
    Video

    Raises
    ------
    InputError
        There is no picture of the clip, pictures differ in size or proportions from the clip's
        camera, or a video is given and PyAV is not installed.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f"{path}: no such folder of pictures or video file")
    width = min(WIDTH, clip.camera.width)
    height = round(width * clip.camera.height / clip.camera.width)
    # Reduced one by one: the original pictures of a clip would not fit in memory.
    frames = _of_folder(path, clip) if path.is_dir() else _of_file(path, clip, rate)
    found = {
        frame: _small(picture, width, height, f"{path}: frame {frame}", clip)
        for frame, picture in frames
    }
    if not found:
        raise InputError(
            f"{path}: no picture of a frame of clip {clip.name}, whose numbers are "
            f"{clip.frame_ids[0]} to {clip.frame_ids[-1]}; name pictures by their frame"
        )
    ids = sorted(found)
    pictures = [found[i] for i in ids]
    for quality in _QUALITIES[1:]:
        if sum(map(len, pictures)) <= _MOST:
            break
        pictures = [_coarser(p, quality) for p in pictures]
    return Video(np.array(ids, dtype=np.int64), tuple(pictures), width, height)


def _of_folder(folder: Path, clip: Clip) -> Iterator[tuple[int, Any]]:
    """Frame number, from the last number in the name, and picture of each file."""
    from PIL import Image

    wanted = set(clip.frame_ids.tolist())
    for file in sorted(folder.iterdir()):
        numbers = re.findall(r"\d+", file.stem)
        if file.suffix.lower() in _KINDS and numbers and int(numbers[-1]) in wanted:
            try:
                # Pillow warns of pictures that unpack to a suspicious size.
                with warnings.catch_warnings():
                    warnings.simplefilter("error")
                    picture = Image.open(file).convert("RGB")
            except Exception as error:  # each of Pillow's formats raises exceptions of its own
                raise InputError(f"{file}: is no picture that can be read") from error
            yield int(numbers[-1]), picture


def _of_file(file: Path, clip: Clip, rate: float | None) -> Iterator[tuple[int, Any]]:
    """The picture of each frame, both numbered from the start of the video.

    Numbers are used instead of times, as in detection, because the times of phones' videos are
    uneven.
    """
    try:
        import av
    except ImportError as error:
        raise InputError(
            f"{file}: reading a video needs PyAV (pip install av); or give a folder of pictures"
        ) from error
    left = clip.frame_ids.tolist()
    try:
        with av.open(str(file)) as container:
            rate = rate or float(container.streams.video[0].average_rate or clip.fps)
            for number, picture in enumerate(container.decode(video=0)):
                while left and number >= round(left[0] * rate / clip.fps):
                    # Phones record how they were held.
                    image = picture.to_image().rotate(
                        90 * round(picture.rotation / 90), expand=True
                    )
                    yield left.pop(0), image
                if not left:
                    return
    except (av.error.FFmpegError, IndexError) as error:
        raise InputError(f"{file}: is no video that can be read ({error})") from error


def _small(picture: Any, width: int, height: int, what: str, clip: Clip) -> bytes:
    """The picture as a JPEG of given size; it must have the proportions of the clip's camera."""
    proportion = clip.camera.width / clip.camera.height
    if abs(picture.width / picture.height / proportion - 1) > 0.01:
        raise InputError(
            f"{what}: is {picture.width} x {picture.height}, but the camera of clip {clip.name} "
            f"is {clip.camera.width} x {clip.camera.height}; crop it to that shape"
        )
    return _encoded(picture.resize((width, height)), _QUALITIES[0])


def _coarser(picture: bytes, quality: int) -> bytes:
    from PIL import Image

    with Image.open(io.BytesIO(picture)) as image:
        return _encoded(image, quality)


def _encoded(picture: Any, quality: int) -> bytes:
    out = io.BytesIO()
    picture.save(out, "JPEG", quality=quality, optimize=True)
    return out.getvalue()


# ------------------------------------------------------------------------------------------------
# Notebooks: show a recording without a network.

_ASSET = "RERUN_NOTEBOOK_ASSET"
_WIDTH, _HEIGHT = 1200, 750
"""Size of the viewer, pixels; chosen."""


def recording_widget(recording: str | Path) -> Viewer:
    """The viewer as the output of a notebook cell, with a recording in it.

    Parameters
    ----------
    recording : path
        An ``.rrd`` file.

    Returns
    -------
    rerun_notebook.Viewer

    Raises
    ------
    InputError
        There is no such recording, or rerun's notebook package is not installed.
    """
    recording = Path(recording)
    if not recording.is_file():
        raise InputError(f"{recording}: no such recording")
    # Read when the package is imported; without it the viewer is downloaded.
    os.environ.setdefault(_ASSET, "serve-local")
    try:
        from rerun_notebook import Viewer
    except ImportError as error:
        raise InputError(
            "a recording inside a notebook needs rerun-notebook; "
            "install it with: pip install -c constraints.txt -e '.[notebook]' in the clone"
        ) from error
    viewer = Viewer(width=_WIDTH, height=_HEIGHT)
    viewer.send_rrd(recording.read_bytes())
    return viewer
