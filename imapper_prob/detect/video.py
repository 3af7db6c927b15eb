"""Frames of a video, the right way up."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.errors import InputError

__all__ = ["Video", "needs", "open_video", "upright"]

Image = NDArray[np.uint8]

_ON_FILM: Final = "focal_length.35mm_equivalent"
"""Ending of the key under which phones write what their lens would be on film."""
_FILM_DIAGONAL: Final = float(np.hypot(36, 24))
"""Millimetres."""
_LARGEST_SIDE: Final = 8192
"""Pixels; a header that claims more is damaged."""


@dataclass(frozen=True)
class Video:
    """What the header of a video says, and its first frame.

    Parameters
    ----------
    path : Path
    width, height : int
        Pixels of a frame the right way up.
    fps : float
        Frames a second, on average.
    n_frames : int
        As far as the header knows; 0 where it does not.
    likely_focal : float, optional
        Focal length in pixels, of phones that write down what it is on 35 mm film.
    """

    path: Path
    width: int
    height: int
    fps: float
    n_frames: int
    likely_focal: float | None = None

    def frames(
        self, *, start: int = 0, end: int | None = None, step: int = 1
    ) -> Iterator[tuple[int, Image]]:
        """Numbers and (height, width, 3) RGB images of every ``step``-th frame.

        Parameters
        ----------
        start, end : int
            First frame, and the one after the last.
        step : int
        """
        for number, frame in enumerate(_decoded(self.path)):
            if end is not None and number >= end:
                return
            if number >= start and (number - start) % step == 0:
                yield number, upright(frame.to_ndarray(format="rgb24"), frame.rotation)


def upright(image: Image, degrees: float) -> Image:
    """An image turned counter-clockwise by what the file says, to the nearest right angle."""
    return np.ascontiguousarray(np.rot90(image, k=round(degrees / 90) % 4))


def open_video(path: str | Path) -> Video:
    """Look at a video without decoding more than its first frame.

    Raises
    ------
    InputError
        There is no such file, it is no video, or PyAV is not installed.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    av = needs("av")
    first = next(_decoded(path), None)
    if first is None:
        raise InputError(f"{path}: no frame can be decoded; is this a video?")
    try:
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            rate, count = stream.average_rate, stream.frames
            metadata = {**container.metadata, **stream.metadata}
    except (av.FFmpegError, IndexError, ValueError) as error:
        raise InputError(f"{path}: not a readable video ({error})") from error
    if not rate or rate <= 0:
        raise InputError(f"{path}: the file does not say how many frames a second it has")
    height, width = upright(first.to_ndarray(format="rgb24"), first.rotation).shape[:2]
    focal = _likely_focal(metadata, float(np.hypot(width, height)))
    return Video(path, width, height, float(rate), int(count), focal)


def _likely_focal(metadata: dict[str, str], diagonal: float) -> float | None:
    """Pixels, from the focal length on film whose frame has a diagonal of 43.3 mm."""
    for key, value in metadata.items():
        if key.endswith(_ON_FILM) and re.fullmatch(r"\d{1,3}(\.\d+)?", value):
            millimetres = float(value)
            return millimetres / _FILM_DIAGONAL * diagonal if millimetres > 0 else None
    return None


def needs(name: str) -> Any:
    """A module of the extra ``video``.

    Raises
    ------
    InputError
        It is not installed.
    """
    from importlib import import_module

    try:
        return import_module(name)
    except ImportError as error:
        raise InputError(
            f"videos need {name}: pip install -c constraints.txt -e '.[video]' in the clone "
            f"({error})"
        ) from error


def _decoded(path: Path) -> Iterator[Any]:
    """Frames of the first video stream; a file that is cut off ends early."""
    av = needs("av")
    try:
        with av.open(str(path)) as container:
            if not container.streams.video:
                raise InputError(f"{path}: no video in it")
            stream = container.streams.video[0]
            if max(stream.width or 0, stream.height or 0) > _LARGEST_SIDE:
                raise InputError(f"{path}: larger than {_LARGEST_SIDE} pixels a side")
            yield from container.decode(stream)
    except av.EOFError:
        return
    except (av.FFmpegError, ValueError) as error:
        raise InputError(f"{path}: not a readable video ({error})") from error
