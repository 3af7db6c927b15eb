"""Libraries of scenelets by name: the built-in one, files, and several joined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Final

from imapper_prob.models.errors import InputError
from imapper_prob.models.scenelet import Library
from imapper_prob.scenelets.library_cache import kept
from imapper_prob.scenelets.library_file import read_library, save_library
from imapper_prob.scenelets.procedural.catalogue import build_library

__all__ = ["BUILT_IN", "built_in_library", "joined", "load_library", "save_library"]

BUILT_IN: Final = "built-in"


@cache
def built_in_library(seed: int = 0) -> Library:
    """The library made by the project's own code; made once a machine, read once a process."""
    return kept(f"library-{seed}", lambda: build_library(seed))


def load_library(source: str | Path = BUILT_IN) -> Library:
    """The built-in library, one from a file, or several joined.

    Parameters
    ----------
    source : str or Path
        ``"built-in"``, the path of a file of :func:`save_library`, or several of these
        parted by commas, as ``"built-in,office.npz"``. A comma in the name of a file that
        exists does not part.

    Raises
    ------
    InputError
        If a file is missing, is no library, or contradicts itself, or one is named twice.
    """
    parts = [str(source)] if isinstance(source, Path) else _parts(source)
    twice = next((part for part in parts if parts.count(part) > 1), None)
    if twice is not None:
        raise InputError(f"library {twice} is named twice in {source}")
    libraries = [built_in_library() if part == BUILT_IN else _from_file(part) for part in parts]
    return joined(libraries)


def joined(libraries: Sequence[Library]) -> Library:
    """One library of all scenelets of several, in order.

    A name that an earlier library has too is preceded by the name of its own, as
    ``office/desk-0007``.
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
        raise InputError(f"library {source!r}: a name is empty; give {BUILT_IN!r} or a path")
    return parts


def _from_file(path: str) -> Library:
    if not Path(path).is_file():
        raise InputError(f"library {path}: no such file; give a library's .npz, or {BUILT_IN!r}")
    return read_library(path)
