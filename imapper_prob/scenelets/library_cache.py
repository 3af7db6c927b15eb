"""Libraries that were made before, kept on disk beside the sources.

The built-in library takes seconds to make and a tenth of that to read. A file is named by the
sources that it was made by and the machine it was made on, and by what is in it; one that does
not hold what its name says is made again. Who may not write there makes the library each time.
"""

from __future__ import annotations

import hashlib
import os
import platform
import time
from collections.abc import Callable
from contextlib import suppress
from importlib.util import cache_from_source
from pathlib import Path
from typing import Final

import numpy as np

from imapper_prob.models import scenelet
from imapper_prob.models.errors import InputError
from imapper_prob.models.scenelet import Library
from imapper_prob.scenelets.library_file import read_library, save_library

__all__ = ["kept", "sources_digest"]

_ROOMS: Final = (Path(__file__).parent, Path(scenelet.__file__).parent)
"""Where everything is that a library is made of."""

_UNUSED_AFTER: Final = 24 * 3600.0
"""Seconds after which a library of other sources is taken for one that nobody needs."""

_DIGITS: Final = 16
"""Hexadecimal digits of each digest in a name."""


def kept(name: str, make: Callable[[], Library], *, folder: Path | None = None) -> Library:
    """What ``make`` gives, or gave an earlier process with the same sources.

    Parameters
    ----------
    name : str
        Tells what is made from other libraries of the same sources.
    make : callable
        Gives the library; called where no file holds it.
    folder : Path, optional
        Where the files are; beside the compiled sources of this module, if not given.
    """
    folder = Path(cache_from_source(__file__)).parent if folder is None else folder
    stem = f"{name}-{sources_digest(_ROOMS)}"
    for path in folder.glob(f"{stem}-*.npz"):
        with suppress(InputError, OSError):
            library = read_library(path)
            if path == _path(folder, stem, library):
                os.utime(path)
                return library
    library = make()
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        save_library(library, _path(folder, stem, library))
        _remove_unused(folder, name)
    return library


def sources_digest(rooms: tuple[Path, ...]) -> str:
    """Sixteen hexadecimal digits for all that decides the numbers of a library.

    These are the texts in ``rooms``, and what does the arithmetic: numpy chooses its loops by
    the processor, and they round each in its own way.
    """
    state = hashlib.sha256()
    processor = np.show_config(mode="dicts")["SIMD Extensions"]["found"]
    state.update(f"{np.__version__} {platform.platform()} {platform.machine()}".encode())
    state.update(" ".join(processor).encode())
    for room in rooms:
        paths = (p for kind in ("*.py", "*.toml") for p in room.rglob(kind))
        for path in sorted(paths):
            state.update(f"\n{path.relative_to(room.parent)}\n".encode() + path.read_bytes())
    return state.hexdigest()[:_DIGITS]


def _path(folder: Path, stem: str, library: Library) -> Path:
    return folder / f"{stem}-{library.digest[:_DIGITS]}.npz"


def _remove_unused(folder: Path, name: str) -> None:
    """Remove the files of other sources that no process has read for a day."""
    for path in folder.glob(f"{name}-{'[0-9a-f]' * _DIGITS}-{'[0-9a-f]' * _DIGITS}.npz"):
        with suppress(OSError):  # somebody else removes it, too
            if path.stat().st_mtime < time.time() - _UNUSED_AFTER:
                path.unlink()
