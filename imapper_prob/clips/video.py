"""Frames of a video, the right way up, and whether its camera stood still.

The model knows only a fixed camera. What moves in front of it is small or gone in other frames,
what stands still is most of the picture: :func:`stillness` compares distant frames tile by tile, by
phase correlation.
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
    """An image turned counter-clockwise by what the file says, to the nearest right angle.

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
    """Look at a video without decoding more than its first frame.

    Parameters
    ----------
    path : path

    Returns
    -------
    Video

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

    Parameters
    ----------
    name : str
        Of the module.

    Returns
    -------
    module

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


# ------------------------------------------------------------------------------------------------
# Stillness.

Array = NDArray[np.float64]
_MOST_SHIFT: Final = 0.015
"""Share of the image's width that the room may shift: a tripod that was touched, not a pan.
At a field of view of 53 degrees it is 0.9 degrees."""
_WIDTH: Final = 256
"""Pixels across a thumbnail, so that compression and noise do not count."""
_TILE: Final = 64
_TEXTURE: Final = 3.0
"""Grey levels of standard deviation below which a tile is a blank wall and says nothing."""
_FINEST: Final = 0.1
"""Cycles a pixel, standard deviation of the weight of frequencies: finer ones are noise."""
_PEAK: Final = 0.4
"""Height of the correlation's peak, of 1, below which two tiles show different things; tiles
that show different things reach .2 to .3."""
_ENOUGH: Final = 0.2
"""Share of the textured tiles that must be recognised for a pair of frames to say anything."""


@dataclass(frozen=True)
class Stillness:
    """How far the background moved.

    Parameters
    ----------
    shift : float
        Largest, over pairs of frames, of the median shift of tiles; share of the width.
    recognised : float
        Share of the pairs that show the same room at all.
    """

    shift: float
    recognised: float

    @property
    def cut(self) -> bool:
        """Whether there are several rooms in it, or one from several sides."""
        return self.recognised < 0.7

    @property
    def moving(self) -> bool:
        """Whether the camera moved."""
        return self.shift > _MOST_SHIFT


def grey_thumbnail(image: NDArray[np.uint8]) -> Array:
    """A small grey image, by averaging.

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
    """Compare each thumbnail with those a third and two thirds of the clip away.

    Parameters
    ----------
    thumbnails : list of (h, w) float
        Of frames spread over the clip, all of one size. Fewer than two say nothing, and
        count as still.

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
    """Median shift in pixels of the tiles of two thumbnails; None if they have little in common."""
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
