"""Files and folders that are there whole or not at all."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from imapper_prob.models.errors import InputError

__all__ = ["folder_written_whole", "require_writable", "written_whole"]


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """A path beside ``path`` to write to, renamed to it if nothing went wrong.

    Until then a file in the way stays as it was; afterwards nothing else is left. The name
    ends as that of ``path`` does, for writers that go by it.
    """
    beside = path.with_name(f".{path.stem}.partial-{os.getpid()}{path.suffix}")
    try:
        yield beside
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)


@contextmanager
def folder_written_whole(folder: Path) -> Iterator[Path]:
    """A new folder beside ``folder`` that takes its place if nothing went wrong.

    Raises
    ------
    InputError
        If the disk refuses.
    """
    folder = folder.resolve()  # a link stays, and what it points to is replaced
    beside = folder.with_name(f".{folder.name}.partial-{os.getpid()}")
    try:
        beside.mkdir(parents=True)
        yield beside
        if folder.exists():
            shutil.rmtree(folder)
        os.replace(beside, folder)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error})") from error
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def require_writable(folder: Path) -> None:
    """Refuse a folder that could not be made.

    Raises
    ------
    InputError
        If the nearest folder above that exists cannot be written to.
    """
    parent = folder.resolve().parent
    while not parent.exists():
        parent = parent.parent
    if not os.access(parent, os.W_OK):
        raise InputError(f"{folder}: {parent} is not writable; name another folder")
