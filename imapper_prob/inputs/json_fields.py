"""Reading JSON that others wrote: every fault becomes one sentence naming file and place."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.errors import InputError
from imapper_prob.models.skeleton import JOINTS, N_JOINTS

__all__ = [
    "LARGEST_JSON",
    "LARGEST_NUMBER",
    "field",
    "frame_number",
    "frames_of_joints",
    "load_json",
    "load_lines",
    "numbers",
]

Array = NDArray[np.float64]

LARGEST_JSON: Final = 128 << 20
"""Bytes; an hour of one person at 30 frames a second. In memory it takes twenty times that."""


LARGEST_NUMBER: Final = 1e100
"""Anything that is measured is less, and its square still is a number."""


def load_lines(path: Path) -> list[str]:
    """The lines of a text file of at most :data:`LARGEST_JSON` bytes."""
    try:
        size = path.stat().st_size
        if size > LARGEST_JSON:
            raise InputError(f"{path}: {size / 2**20:.0f} MB, more than {LARGEST_JSON >> 20}")
        return path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: no text file ({error})") from error


def load_json(path: Path) -> Any:
    """The content of a JSON file of at most :data:`LARGEST_JSON` bytes."""
    try:
        size = path.stat().st_size
        if size > LARGEST_JSON:
            raise InputError(
                f"{path}: {size / 2**20:.0f} MB, more than {LARGEST_JSON >> 20}; cut the clip"
            )
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; a clip of this format needs it") from None
    except InputError:
        raise
    except (ValueError, RecursionError) as error:  # not only JSON: also numbers of 5,000 digits
        raise InputError(
            f"{path}: not valid JSON ({error}); it may be cut off, copy it again"
        ) from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error


def field(path: Path, data: Any, *keys: str) -> Any:
    """The value at ``data[keys[0]][keys[1]]…``."""
    for depth, key in enumerate(keys):
        if not isinstance(data, Mapping) or key not in data:
            raise InputError(f"{path}: no entry {'.'.join(keys[: depth + 1])!r}")
        data = data[key]
    return data


def numbers(values: Any, *, shape: tuple[int, ...], place: str) -> Array:
    """``values`` as a finite array of this shape; ``place`` names them in messages.

    Strings that look like numbers, truth values and nulls are refused: in a file of
    coordinates they are a sign that something else is wrong too.
    """
    try:
        array = np.array(values)
    except (ValueError, OverflowError):
        array = np.array(None)
    if array.dtype.kind not in "iuf" or array.shape != shape:
        expected = " x ".join(map(str, shape)) if shape else "one"
        raise InputError(f"{place}: expected {expected} numbers, got {_shortened(values)}")
    if not np.isfinite(array).all():
        raise InputError(f"{place}: {_shortened(values)} is not finite; remove or correct it")
    if (np.abs(array) >= LARGEST_NUMBER).any():
        raise InputError(f"{place}: {_shortened(values)} is too large to be true")
    return array.astype(np.float64)


def frames_of_joints(path: Path, data: Any) -> dict[int, Array]:
    """The ``3d`` table of an i3DB skeleton file.

    Returns
    -------
    dict of int to (16, 3) float
        Joints by frame number, in the file's own axes and units, in order of frames.
    """
    table = field(path, data, "3d")
    if not isinstance(table, Mapping) or not table:
        raise InputError(f"{path}: '3d' must map frame numbers to joints and not be empty")
    frames: dict[int, Array] = {}
    expected = [str(j) for j in range(N_JOINTS)]
    for key, joints in table.items():
        frame = frame_number(path, key)
        if frame in frames:
            raise InputError(f"{path}: frame {frame} occurs twice")
        if not isinstance(joints, Mapping) or set(joints) != set(expected):
            count = len(joints) if isinstance(joints, Mapping) else 0
            raise InputError(
                f"{path}, frame {frame}: expected joints 0 to {N_JOINTS - 1}, got {count} joints"
            )
        frames[frame] = np.stack(
            [
                numbers(joints[j], shape=(3,), place=f"{path}, frame {frame}, joint {name}")
                for j, name in zip(expected, JOINTS, strict=True)
            ]
        )
    return dict(sorted(frames.items()))


def frame_number(path: Path, key: Any) -> int:
    """A frame number from a JSON key such as ``"00012"``."""
    if not re.fullmatch(r"-?\d{1,15}", str(key)):
        raise InputError(f"{path}: {_shortened(key)} is not a frame number; expected an integer")
    return int(key)


def _shortened(values: Any, *, limit: int = 60) -> str:
    text = repr(values)
    return text if len(text) <= limit else text[: limit - 1] + "…"
