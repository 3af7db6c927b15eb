"""Libraries by name: the built-in one, files, several joined, and a cache on disk.

Making the built-in library takes seconds, and reading it a tenth of that, so it is cached beside
the sources. The name of a cached file contains digests of the sources and machine and of its
content; a file whose content does not match its name is made again. Without write access the
library is made each time.
"""

from __future__ import annotations

import hashlib
import os
import platform
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache
from importlib.util import cache_from_source
from pathlib import Path
from typing import Final

import numpy as np

from imapper_prob.clips.furniture import (
    FURNITURE_SHAPES,
    check_owners,
    pack_furniture,
    unpack_furniture,
)
from imapper_prob.clips.parsing import Arrays, Shapes, check_shapes, load_archive
from imapper_prob.files import written_whole
from imapper_prob.models import scenelet
from imapper_prob.models.errors import InputError
from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.models.skeleton import N_JOINTS
from imapper_prob.scenelets.procedural.catalogue import build_library

__all__ = [
    "built_in_library",
    "joined",
    "kept",
    "library_of",
    "load_library",
    "pack_library",
    "read_library",
    "save_library",
    "sources_digest",
]

_FORMAT: Final = "imapper-prob scenelet library 2"
_SHAPES: Final[Shapes] = {
    "name": ("text",),
    "names": ("text", None),
    "actions": ("text", "names"),
    "fps": ("number", "names"),
    "weights": ("number", "names"),
    "first_frame": ("index", None),
    "joints": ("number", None, N_JOINTS, 3),
    "object_scenelet": ("index", "object_label"),
    **FURNITURE_SHAPES,
}


def pack_library(library: Library) -> Arrays:
    """Convert a library to the arrays of a library file, without ``format``.

    Parameters
    ----------
    library : Library

    Returns
    -------
    dict of str to array
    """
    return {
        "name": np.array(library.name),
        "names": np.array([s.name for s in library]),
        "actions": np.array([s.action for s in library]),
        "fps": np.array([s.fps for s in library]),
        "weights": np.array([s.weight for s in library]),
        "first_frame": np.cumsum([0, *(s.n_frames for s in library)]),
        "joints": np.concatenate([s.joints for s in library]),
        "object_scenelet": np.repeat(np.arange(len(library)), [len(s.objects) for s in library]),
        **pack_furniture([o for s in library for o in s.objects]),
    }


def save_library(library: Library, path: str | Path) -> None:
    """Write a library to an ``.npz`` file atomically.

    Parameters
    ----------
    library : Library
    path : path
    """
    path = Path(path)
    arrays = {"format": np.array(_FORMAT), **pack_library(library)}
    with written_whole(path) as beside, beside.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def read_library(path: str | Path) -> Library:
    """Read a library from a file of :func:`save_library`.

    Parameters
    ----------
    path : path

    Returns
    -------
    Library

    Raises
    ------
    InputError
        The file is missing, is not a library, or is inconsistent.
    """
    path = Path(path)
    arrays = load_archive(path, what="library")
    if str(arrays.get("format")) != _FORMAT:
        raise InputError(f"library {path}: not a scenelet library of this version; make it again")
    try:
        return library_of(arrays)
    except InputError as error:
        raise InputError(f"library {path}: {error}") from error


def library_of(arrays: Arrays) -> Library:
    """Restore a library from the arrays of :func:`pack_library`.

    Parameters
    ----------
    arrays : mapping of str to array

    Returns
    -------
    Library

    Raises
    ------
    InputError
        The arrays are inconsistent. The message does not name a file.
    """
    _require_library(arrays)
    return _unpacked(arrays)


def _require_library(arrays: Arrays) -> None:
    """Check that all parts exist, with consistent sizes and valid indices."""
    check_shapes(arrays, _SHAPES)
    check_owners(arrays, "object_scenelet", "names")
    first = arrays["first_frame"]
    steps = np.diff(first, prepend=0, append=len(arrays["joints"]))
    if len(first) != len(arrays["names"]) + 1 or (steps < 0).any() or steps[-1] or steps[0]:
        raise InputError("first_frame does not fit the scenelets and their joints")


def _unpacked(arrays: Arrays) -> Library:
    objects = unpack_furniture(arrays)
    count = len(arrays["names"])
    owned = np.searchsorted(arrays["object_scenelet"], np.arange(count + 1))
    first, joints = arrays["first_frame"], arrays["joints"]
    scenelets = tuple(
        Scenelet(
            name=str(arrays["names"][i]),
            action=str(arrays["actions"][i]),
            joints=joints[first[i] : first[i + 1]],
            objects=tuple(objects[owned[i] : owned[i + 1]]),
            fps=float(arrays["fps"][i]),
            weight=float(arrays["weights"][i]),
        )
        for i in range(count)
    )
    return Library(str(arrays["name"]), scenelets)


# ------------------------------------------------------------------------------------------------
# The cache.

_ROOMS: Final = (Path(__file__).parent, Path(scenelet.__file__).parent)
"""Folders of all sources that determine a library."""
_UNUSED_AFTER: Final = 24 * 3600.0
"""Age in seconds after which a cached library of other sources is removed."""
_DIGITS: Final = 16
"""Hexadecimal digits of each digest in a file name."""


def kept(name: str, make: Callable[[], Library], *, folder: Path | None = None) -> Library:
    """The result of ``make``, cached on disk for processes with the same sources.

    Parameters
    ----------
    name : str
        Distinguishes it from other libraries of the same sources.
    make : callable
        Makes the library; called if no file has it.
    folder : Path, optional
        Folder of the files; by default beside this module's compiled sources.

    Returns
    -------
    Library
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
    """A digest of everything that determines the numbers of a library: sixteen hexadecimal digits.

    It covers the texts in ``rooms``, and the numerical platform: numpy selects its loops by
    processor, and their rounding differs.

    Parameters
    ----------
    rooms : tuple of Path
        Folders of sources.

    Returns
    -------
    str
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
    """Remove cached files of other sources that no process has read for a day."""
    for path in folder.glob(f"{name}-{'[0-9a-f]' * _DIGITS}-{'[0-9a-f]' * _DIGITS}.npz"):
        with suppress(OSError):  # another process may remove it at the same time
            if path.stat().st_mtime < time.time() - _UNUSED_AFTER:
                path.unlink()


# ------------------------------------------------------------------------------------------------
# Loading.

_BUILT_IN: Final = "built-in"


@cache
def built_in_library(seed: int = 0) -> Library:
    """The built-in library; made once per machine, read once per process.

    Parameters
    ----------
    seed : int
        The same seed gives the same library.

    Returns
    -------
    Library
    """
    return kept(f"library-{seed}", lambda: build_library(seed))


def load_library(source: str | Path = _BUILT_IN) -> Library:
    """Load the built-in library, one from a file, or several joined.

    Parameters
    ----------
    source : str or Path
        ``"built-in"``, the path of a file of :func:`save_library`, or several of these separated by
        commas, as in ``"built-in,office.npz"``. A comma inside the name of an existing file does
        not separate.

    Returns
    -------
    Library

    Raises
    ------
    InputError
        A file is missing, is not a library, or is inconsistent, or one is named twice.

    Examples
    --------
    >>> library = im.load_library()
    >>> len(library) > 1000
    True
    >>> "walk" in {scenelet.action for scenelet in library}
    True
    """
    parts = [str(source)] if isinstance(source, Path) else _parts(source)
    twice = next((part for part in parts if parts.count(part) > 1), None)
    if twice is not None:
        raise InputError(f"library {twice} is named twice in {source}")
    libraries = [built_in_library() if part == _BUILT_IN else _from_file(part) for part in parts]
    return joined(libraries)


def joined(libraries: Sequence[Library]) -> Library:
    """Join several libraries in order.

    If an earlier library has the same scenelet name, the name is prefixed by that of its own
    library, such as ``office/desk-0007``.

    Parameters
    ----------
    libraries : sequence of Library

    Returns
    -------
    Library
    """
    if len(libraries) == 1:
        return libraries[0]
    scenelets = []
    names: set[str] = set()
    for library in libraries:
        own = [
            replace(s, name=f"{library.name}/{s.name}") if s.name in names else s for s in library
        ]
        scenelets += own
        names |= {s.name for s in own}
    return Library("+".join(library.name for library in libraries), tuple(scenelets))


def _parts(source: str) -> list[str]:
    """Split at commas, except those inside the name of an existing file."""
    pieces = source.split(",")
    parts = []
    while pieces:
        candidates = [",".join(pieces[:n]).strip() for n in range(1, len(pieces) + 1)]
        files = [n for n, candidate in enumerate(candidates, 1) if Path(candidate).is_file()]
        taken = max(files, default=1)
        parts.append(candidates[taken - 1])
        pieces = pieces[taken:]
    if not all(parts):
        raise InputError(f"library {source!r}: a name is empty; give {_BUILT_IN!r} or a path")
    return parts


def _from_file(path: str) -> Library:
    if not Path(path).is_file():
        raise InputError(f"library {path}: no such file; give a library's .npz, or {_BUILT_IN!r}")
    return read_library(path)
