"""Read upright frames of a video, and check that its camera does not move.

The model supports only a fixed camera. People are small or absent in some frames, and most of the
picture is static. :func:`stillness` therefore compares distant frames tile by tile, by phase
correlation.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.errors import InputError

__all__ = [
    "Video",
    "grey_thumbnail",
    "needs",
    "open_video",
    "stillness",
    "upright",
]

Image = NDArray[np.uint8]
_ON_FILM: Final = "focal_length.35mm_equivalent"
"""Ending of the key under which phones record the 35 mm equivalent focal length."""
_FILM_DIAGONAL: Final = float(np.hypot(36, 24))
"""Diagonal of 35 mm film in millimetres."""
_LARGEST_SIDE: Final = 8192
"""Largest width or height in pixels; a header that declares more is damaged."""


@dataclass(frozen=True)
class Video:
    """What the header and the first frame of a video say.

    Parameters
    ----------
    path : Path
    width, height : int
        Pixels of an upright frame.
    fps : float
        Mean number of frames a second.
    n_frames : int
        As the header says; 0 if it does not.
    likely_focal : float, optional
        Focal length in pixels, if the file records its 35 mm equivalent.
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
        """Yield number and (height, width, 3) RGB image of every ``step``-th frame.

        Parameters
        ----------
        start, end : int
            First frame, and the frame after the last.
        step : int

        Yields
        ------
        number : int
        image : (height, width, 3) uint8
        """
        for number, frame in enumerate(_decoded(self.path)):
            if end is not None and number >= end:
                return
            if number >= start and (number - start) % step == 0:
                yield number, upright(frame.to_ndarray(format="rgb24"), frame.rotation)


def upright(image: Image, degrees: float) -> Image:
    """Rotate an image counter-clockwise by ``degrees``, rounded to a multiple of 90.

    Parameters
    ----------
    image : (H, W, 3) uint8
    degrees : float

    Returns
    -------
    (H, W, 3) or (W, H, 3) uint8
    """
    return np.ascontiguousarray(np.rot90(image, k=round(degrees / 90) % 4))


def open_video(path: str | Path) -> Video:
    """Read the properties of a video, decoding only its first frame.

    Parameters
    ----------
    path : path

    Returns
    -------
    Video

    Raises
    ------
    InputError
        The file is missing or not a video, or PyAV is not installed.
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
    """Focal length in pixels, from that on film with a diagonal of 43.3 mm."""
    for key, value in metadata.items():
        if key.endswith(_ON_FILM) and re.fullmatch(r"\d{1,3}(\.\d+)?", value):
            millimetres = float(value)
            return millimetres / _FILM_DIAGONAL * diagonal if millimetres > 0 else None
    return None


def needs(name: str) -> Any:
    """Import a module of the extra ``video``.

    Parameters
    ----------
    name : str
        Name of the module.

    Returns
    -------
    module

    Raises
    ------
    InputError
        The module is not installed.
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
    """Decoded frames of the first video stream; a truncated file ends early."""
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


# ------------------------------------------------------------------------------------------------
# Stillness.

Array = NDArray[np.float64]
_MOST_SHIFT: Final = 0.015
"""Greatest shift of the background, as a fraction of the image's width, that still counts as a
fixed camera: a touched tripod, not a pan. At a field of view of 53 degrees it is 0.9 degrees."""
_WIDTH: Final = 256
"""Least width of a thumbnail in pixels; averaging to it suppresses compression and noise."""
_TILE: Final = 64
"""Side of a tile in pixels of a thumbnail; chosen, a power of two for the Fourier transform."""
_TEXTURE: Final = 3.0
"""Standard deviation in grey levels below which a tile is blank and is not used."""
_FINEST: Final = 0.1
"""Standard deviation, in cycles a pixel, of the Gaussian weight of frequencies, which suppresses
noise."""
_PEAK: Final = 0.4
"""Least peak of the correlation, out of 1, of two tiles that show the same thing; tiles that show
different things reach .2 to .3."""
_ENOUGH: Final = 0.2
"""Least fraction of textured tiles that must match for a pair of frames to be used."""
_SAME_ROOM: Final = 0.7
"""Least fraction of pairs of frames that show the same background, in a video of one view;
chosen."""


@dataclass(frozen=True)
class Stillness:
    """How far the background moves.

    Parameters
    ----------
    shift : float
        Largest, over pairs of frames, of the median shift of tiles, as a fraction of the width.
    recognised : float
        Fraction of the pairs that show the same background.
    """

    shift: float
    recognised: float

    @property
    def cut(self) -> bool:
        """Whether the video shows several rooms, or one room from several viewpoints."""
        return self.recognised < _SAME_ROOM

    @property
    def moving(self) -> bool:
        """Whether the camera moved."""
        return self.shift > _MOST_SHIFT


def grey_thumbnail(image: NDArray[np.uint8]) -> Array:
    """A small grey image, made by averaging blocks.

    Parameters
    ----------
    image : (H, W, 3) uint8

    Returns
    -------
    (h, 256) float
    """
    factor = max(1, image.shape[1] // _WIDTH)
    grey = image.astype(np.float64).mean(-1)
    height, width = (n // factor * factor for n in grey.shape)
    blocks = grey[:height, :width].reshape(height // factor, factor, width // factor, factor)
    result: Array = blocks.mean((1, 3))
    return result


def stillness(thumbnails: list[Array]) -> Stillness:
    """Measure how far the background moves between frames a third of the clip apart.

    Parameters
    ----------
    thumbnails : list of (h, w) float
        Thumbnails of frames spread over the clip, all of one size. With fewer than two the result
        is still.

    Returns
    -------
    Stillness
    """
    n = len(thumbnails)
    pairs = {(i, j) for i in range(n) for j in (i + n // 3, i + 2 * n // 3) if i < j < n}
    shifts = [_shift(thumbnails[i], thumbnails[j]) for i, j in sorted(pairs)]
    known = [shift for shift in shifts if shift is not None]
    if not shifts:
        return Stillness(0.0, 1.0)
    width = thumbnails[0].shape[1]
    return Stillness(max(known, default=0.0) / width, len(known) / len(shifts))


def _shift(one: Array, other: Array) -> float | None:
    """Median shift in pixels of the tiles of two thumbnails; None if too few tiles match."""
    window = np.outer(np.hanning(_TILE), np.hanning(_TILE))
    fineness = np.hypot(np.fft.fftfreq(_TILE)[:, None], np.fft.rfftfreq(_TILE))
    weight = np.exp(-(fineness**2) / (2 * _FINEST**2))
    highest = np.fft.irfft2(weight, s=window.shape)[0, 0]
    shifts, textured = [], 0
    for row in range(0, one.shape[0] - _TILE + 1, _TILE // 2):
        for column in range(0, one.shape[1] - _TILE + 1, _TILE // 2):
            tiles = [image[row : row + _TILE, column : column + _TILE] for image in (one, other)]
            if min(tile.std() for tile in tiles) < _TEXTURE:
                continue
            textured += 1
            spectra = [np.fft.rfft2((tile - tile.mean()) * window) for tile in tiles]
            cross = spectra[0] * np.conj(spectra[1])
            phase = weight * cross / np.maximum(np.abs(cross), 1e-9)
            correlation = np.fft.irfft2(phase, s=window.shape) / highest
            peak = np.unravel_index(np.argmax(correlation), correlation.shape)
            if correlation[peak] >= _PEAK:
                down, right = ((int(p) + _TILE // 2) % _TILE - _TILE // 2 for p in peak)
                shifts.append(float(np.hypot(down, right)))
    if textured == 0:
        return 0.0
    return float(np.median(shifts)) if len(shifts) >= _ENOUGH * textured else None
