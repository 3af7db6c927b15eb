"""Numpy archives that others wrote: opened without pickle, checked before use."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.errors import InputError

__all__ = ["Arrays", "Shapes", "check_shapes", "load_archive"]

Arrays = dict[str, NDArray[Any]]

Shapes = Mapping[str, tuple[str, *tuple["str | int | None", ...]]]
"""For each entry the kind of its values (``"text"``, ``"number"`` or ``"index"``), then its
shape: a number, the name of the entry it must be as long as, or ``None`` for any length."""

_KINDS = {"text": "U", "number": "fiu", "index": "iu"}


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
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return {key: archive[key] for key in archive.files}
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
        if array.dtype.kind not in _KINDS[kind] and array.size:
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
