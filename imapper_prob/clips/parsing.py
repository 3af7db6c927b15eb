"""Reading JSON files and numpy archives; errors name the file and the place in it.

Archives are opened without pickle, and checked before any of them is unpacked.
"""

from __future__ import annotations

import json
import math
import re
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.files import read_text
from imapper_prob.models.errors import InputError
from imapper_prob.models.skeleton import JOINTS, N_JOINTS

__all__ = [
    "LARGEST_NUMBER",
    "Arrays",
    "Shapes",
    "check_shapes",
    "field",
    "frame_number",
    "frames_of_joints",
    "load_archive",
    "load_json",
    "numbers",
]

Array = NDArray[np.float64]
_SHOWN: Final = 60
"""Characters of a wrong value that a message shows."""
LARGEST_NUMBER: Final = 1e100
"""Bound on any measured value; its square is still finite."""


def load_json(path: Path) -> Any:
    """Read the content of a JSON file of limited size.

    Parameters
    ----------
    path : Path

    Returns
    -------
    object

    Raises
    ------
    InputError
        The file cannot be read, is too large, is not JSON, or has a key twice in one object.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file")
    text = read_text(path)

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        table = dict(pairs)
        if len(table) < len(pairs):
            keys = [key for key, _ in pairs]
            twice = next(key for key in keys if keys.count(key) > 1)
            raise InputError(f"{path}: key {twice!r:.60} occurs twice in one object; keep one")
        return table

    try:
        return json.loads(text, object_pairs_hook=unique)
    except InputError:
        raise
    except (ValueError, RecursionError) as error:  # also covers numbers of more than 4,300 digits
        raise InputError(
            f"{path}: not valid JSON ({error}); it may be cut off, copy it again"
        ) from error


def field(path: Path, data: Any, *keys: str) -> Any:
    """The value at ``data[keys[0]][keys[1]]…``.

    Parameters
    ----------
    path : Path
        Path of the file, for messages.
    data : object
        Content of a JSON file.
    *keys : str

    Returns
    -------
    object

    Raises
    ------
    InputError
        The value is missing.
    """
    for depth, key in enumerate(keys):
        if not isinstance(data, Mapping) or key not in data:
            raise InputError(f"{path}: no entry {'.'.join(keys[: depth + 1])!r}")
        data = data[key]
    return data


def numbers(values: Any, *, shape: tuple[int, ...], place: str) -> Array:
    """``values`` as a finite array of shape ``shape``; ``place`` names them in messages.

    Strings that look like numbers, booleans and nulls are refused: in a file of coordinates they
    are a sign of other errors.

    Parameters
    ----------
    values : object
        Part of a JSON file.
    shape : tuple of int
    place : str
        Names the values in messages.

    Returns
    -------
    ndarray of float

    Raises
    ------
    InputError
        The values are not finite numbers, or have another shape.
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
    """Read the ``3d`` table of an i3DB skeleton file.

    Parameters
    ----------
    path : Path
        Path of the file, for messages.
    data : object
        Content of the file.

    Returns
    -------
    dict of int to (16, 3) float
        Joints by frame number, in the file's own axes and units, in order of frames.

    Raises
    ------
    InputError
        The table is invalid, or a frame lacks joints.
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
    """A frame number from a JSON key such as ``"00012"``.

    Parameters
    ----------
    path : Path
        Path of the file, for messages.
    key : object

    Returns
    -------
    int

    Raises
    ------
    InputError
        The key is not a frame number.
    """
    if not re.fullmatch(r"-?\d{1,15}", str(key)):
        raise InputError(f"{path}: {_shortened(key)} is not a frame number; expected an integer")
    return int(key)


def _shortened(values: Any) -> str:
    text = repr(values)
    return text if len(text) <= _SHOWN else text[: _SHOWN - 1] + "…"


# ------------------------------------------------------------------------------------------------
# Numpy archives.

Arrays = dict[str, NDArray[Any]]
Shapes = Mapping[str, tuple[str, *tuple["str | int | None", ...]]]
"""For each entry the kind of its values (``"text"``, ``"number"`` or ``"index"``), then its shape.
Each length is a number, the name of the entry with the same length, or ``None`` for any length."""
_KINDS = {"text": "U", "number": "fiu", "index": "iu"}


_LARGEST: Final = 1 << 29
"""Largest unpacked size of an archive in bytes: a hundred times the longest clip."""


def _refuse_bombs(file: BinaryIO) -> None:
    """Check the declared sizes of an archive before any of it is unpacked.

    A few kilobytes can declare terabytes, as zip members or as an array's shape. Members are never
    written to disk, whatever their names.

    Parameters
    ----------
    file : binary file

    Raises
    ------
    InputError
        It would take more memory than :data:`_LARGEST`, an entry is no array, or arrays declare
        more data than is stored.
    zipfile.BadZipFile, ValueError, OSError
        The file is not an archive of arrays.
    """
    with zipfile.ZipFile(file) as archive:
        members = archive.infolist()
        total = sum(member.file_size for member in members)
        if total > _LARGEST:
            raise InputError(
                f"would take {total / 2**20:.0f} MB of memory, more than {_LARGEST >> 20}; is it "
                "what you meant?"
            )
        for member in members:
            if not member.filename.endswith(".npy"):
                raise InputError(f"entry {member.filename} is no array")
            with archive.open(member) as entry:
                major, _ = np.lib.format.read_magic(entry)
                read = {1: np.lib.format.read_array_header_1_0}.get(
                    major, np.lib.format.read_array_header_2_0
                )
                shape, _, dtype = read(entry)
            if math.prod(shape) * dtype.itemsize > member.file_size:
                raise InputError(f"entry {member.filename} is cut off")
    file.seek(0)


def load_archive(path: Path, *, what: str) -> Arrays:
    """Read all entries of an ``.npz``.

    Parameters
    ----------
    path : path
    what : str
        Kind of the file, for messages: ``"library"``, ``"capture"``.

    Returns
    -------
    dict of str to array

    Raises
    ------
    InputError
        The file is missing, or is not a readable archive of plain arrays.
    """
    if not path.is_file():
        raise InputError(f"{what} {path}: no such file")
    try:
        with path.open("rb") as file:
            _refuse_bombs(file)
            with np.load(file, allow_pickle=False) as archive:
                return {key: archive[key] for key in archive.files}
    except InputError as error:
        raise InputError(f"{what} {path}: {error}") from error
    except PermissionError as error:
        raise InputError(f"{what} {path}: cannot be read ({error.strerror})") from error
    except Exception as error:  # numpy, zipfile, zlib and tokenize raise many kinds
        raise InputError(
            f"{what} {path}: damaged, or no .npz of plain arrays at all; make it again"
        ) from error


def check_shapes(arrays: Arrays, shapes: Shapes) -> None:
    """Check that all entries are present, of the right kind, and of consistent sizes.

    Parameters
    ----------
    arrays : mapping of str to array
    shapes : mapping of str to shape
        Kind and shape of each entry, see ``Shapes``.

    Raises
    ------
    InputError
        They are not; the message lacks the file's name, which the caller adds.
    """
    missing = [key for key in shapes if key not in arrays]
    if missing:
        raise InputError(f"entry {missing[0]} is missing; see the description of the format")
    for key, (kind, *expected) in shapes.items():
        array = arrays[key]
        empty = array.size == 0 and array.dtype.kind == "f"  # numpy's dtype of empty arrays
        if array.dtype.kind not in _KINDS[kind] and not empty:
            raise InputError(f"{key} holds {array.dtype}, expected {kind}")
        wanted = tuple(len(np.atleast_1d(arrays[e])) if isinstance(e, str) else e for e in expected)
        fits = len(wanted) == array.ndim and all(
            w is None or w == n for w, n in zip(wanted, array.shape, strict=True)
        )
        if not fits:
            raise InputError(f"{key} has shape {array.shape}, expected {_written(wanted)}")


def _written(shape: tuple[int | None, ...]) -> str:
    inner = ", ".join("any" if n is None else str(n) for n in shape)
    return f"({inner},)" if len(shape) == 1 else f"({inner})"
