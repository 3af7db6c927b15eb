"""Libraries of scenelets by name: the built-in one, files, several joined, and the cache on disk.

The built-in library takes seconds to make and a tenth of that to read, so that it is kept beside
the sources. A cached file is named by the sources and the machine that it was made by, and by its
content; one that does not hold what its name says is made again. Who may not write there makes the
library each time.
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
    """A library as the arrays of the module's description, ``format`` left out.

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
    """Write a library to an ``.npz`` file, whole or not at all.

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
    """A library from a file of :func:`save_library`.

    Parameters
    ----------
    path : path

    Returns
    -------
    Library

    Raises
    ------
    InputError
        If the file is missing, is no library, or contradicts itself.
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
    """A library again, from the arrays of :func:`pack_library`.

    Parameters
    ----------
    arrays : mapping of str to array

    Returns
    -------
    Library

    Raises
    ------
    InputError
        If they contradict each other. It does not say where they are from.
    """
    _require_library(arrays)
    return _unpacked(arrays)


def _require_library(arrays: Arrays) -> None:
    """Whether all parts are there, of sizes that agree, and point at things that exist."""
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
    """Sixteen hexadecimal digits for all that decides the numbers of a library.

    These are the texts in ``rooms``, and what does the arithmetic: numpy chooses its loops by
    the processor, and they round each in its own way.

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
    """Remove the files of other sources that no process has read for a day."""
    for path in folder.glob(f"{name}-{'[0-9a-f]' * _DIGITS}-{'[0-9a-f]' * _DIGITS}.npz"):
        with suppress(OSError):  # somebody else removes it, too
            if path.stat().st_mtime < time.time() - _UNUSED_AFTER:
                path.unlink()


# ------------------------------------------------------------------------------------------------
# Loading.

_BUILT_IN: Final = "built-in"


@cache
def built_in_library(seed: int = 0) -> Library:
    """The library made by the project's own code; made once a machine, read once a process.

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
    """The built-in library, one from a file, or several joined.

    Parameters
    ----------
    source : str or Path
        ``"built-in"``, the path of a file of :func:`save_library`, or several of these
        parted by commas, as ``"built-in,office.npz"``. A comma in the name of a file that
        exists does not part.

    Returns
    -------
    Library

    Raises
    ------
    InputError
        If a file is missing, is no library, or contradicts itself, or one is named twice.

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
    """One library of all scenelets of several, in order.

    A name that an earlier library has too is preceded by the name of its own, as
    ``office/desk-0007``.

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
    """The sources parted by commas, of which a file that exists is one whole."""
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
