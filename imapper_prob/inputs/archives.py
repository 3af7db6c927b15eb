"""Numpy archives that others wrote: opened without pickle, checked before use."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.errors import InputError

__all__ = ["Arrays", "Shapes", "check_shapes", "load_archive", "refuse_bombs"]

Arrays = dict[str, NDArray[Any]]

Shapes = Mapping[str, tuple[str, *tuple["str | int | None", ...]]]
"""For each entry the kind of its values (``"text"``, ``"number"`` or ``"index"``), then its
shape: a number, the name of the entry it must be as long as, or ``None`` for any length."""

_KINDS = {"text": "U", "number": "fiu", "index": "iu"}


_LARGEST: Final = 1 << 29
"""Bytes of an archive once unpacked, half a gigabyte: a hundred times the longest clip."""


def refuse_bombs(file: BinaryIO) -> None:
    """Look at an archive before any of it is unpacked.

    A few kilobytes can claim to hold terabytes, as zip members or as an array's shape. No
    member is ever written to disk, whatever its name.

    Raises
    ------
    InputError
        It would take more memory than :data:`_LARGEST`, or arrays claim to be larger than
        what is stored of them.
    zipfile.BadZipFile, ValueError, OSError
        It is no archive of arrays.
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
                continue
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
    """All entries of an ``.npz``.

    Parameters
    ----------
    path : path
    what : str
        What the file is, for messages: ``"library"``, ``"capture"``.

    Raises
    ------
    InputError
        There is no such file, or it is no readable archive of plain arrays.
    """
    if not path.is_file():
        raise InputError(f"{what} {path}: no such file")
    try:
        with path.open("rb") as file:
            refuse_bombs(file)
            with np.load(file, allow_pickle=False) as archive:
                return {key: archive[key] for key in archive.files}
    except InputError as error:
        raise InputError(f"{what} {path}: {error}") from error
    except Exception as error:  # numpy, zipfile, zlib and tokenize each have their own way to fail
        raise InputError(
            f"{what} {path}: damaged, or no .npz of plain arrays at all; make it again"
        ) from error


def check_shapes(arrays: Arrays, shapes: Shapes) -> None:
    """Whether all entries are there, of the right kind, and of sizes that agree.

    Raises
    ------
    InputError
        Without the file's name, which the caller knows.
    """
    missing = [key for key in shapes if key not in arrays]
    if missing:
        raise InputError(f"entry {missing[0]} is missing; see the description of the format")
    for key, (kind, *expected) in shapes.items():
        array = arrays[key]
        empty = array.size == 0 and array.dtype.kind == "f"  # what numpy makes of no values at all
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
