"""Captures of whatever format, by the name of the format."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final

from imapper_prob.inputs.capture_file import read_capture
from imapper_prob.inputs.captures import Capture
from imapper_prob.inputs.i3db_capture import i3db_folders, read_i3db_capture
from imapper_prob.inputs.pigraphs import pigraphs_recordings, read_pigraphs
from imapper_prob.models.errors import InputError

__all__ = ["SOURCES", "captures_from"]

_log = logging.getLogger(__name__)

_TOLD: Final = 5
"""Recordings left out that are named; the others are counted."""

SOURCES: Final = ("i3db", "pigraphs", "npz")
"""Formats of captures."""


def captures_from(source: str, path: str | Path, *, leave_out: str | None = None) -> list[Capture]:
    """All captures of a folder, or those of one file.

    Parameters
    ----------
    source : str
        One of :data:`SOURCES`: scene folders of the i3DB benchmark, recordings of PiGraphs,
        or capture files (:mod:`imapper_prob.inputs.capture_file`).
    path : path
        File or folder.
    leave_out : str, optional
        A room none of whose captures are wanted, because it is going to be inferred.

    Returns
    -------
    list of Capture
        At least one. Of several files those that cannot be used are left out with a warning.

    Raises
    ------
    InputError
        There is nothing of this format, no room is called ``leave_out``, or no capture is
        left or can be used.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    places, read = _places_and_reader(source, path)
    captures: list[Capture] = []
    refused: list[str] = []
    for place in places:
        try:
            captures += read(place)
        except InputError as error:
            if len(places) == 1:
                raise
            refused.append(str(error))
    if not captures:
        raise InputError(
            f"{path}: none of {len(places)} files is a usable recording of {source}; "
            f"the first: {refused[0]}"
        )
    for reason in refused[:_TOLD]:
        _log.warning("left out: %s", reason)
    if len(refused) > _TOLD:
        _log.warning("left out: %d more", len(refused) - _TOLD)
    if leave_out is None:
        return captures
    scenes = sorted({c.scene for c in captures})
    if leave_out not in scenes:
        raise InputError(
            f"{path}: no scene {leave_out!r} to leave out; there are {', '.join(scenes)}"
        )
    kept = [c for c in captures if c.scene != leave_out]
    if not kept:
        raise InputError(f"{path}: nothing is left without {leave_out}, the only scene there")
    return kept


def _places_and_reader(
    source: str, path: Path
) -> tuple[list[Path], Callable[[Path], list[Capture]]]:
    """Files or folders of one recording each, and what reads them."""
    if source == "i3db":
        return i3db_folders(path), _i3db_scene
    if source == "pigraphs":
        folder = path.parent if path.is_file() else path
        return pigraphs_recordings(path), partial(read_pigraphs, folder=folder)
    if source == "npz":
        files = [path] if path.is_file() else sorted(path.glob("*.npz"))
        if not files:
            raise InputError(f"{path}: no capture file (.npz) there")
        return files, _capture_file
    raise InputError(f"unknown format of captures {source!r}; there are {', '.join(SOURCES)}")


def _i3db_scene(folder: Path) -> list[Capture]:
    return [read_i3db_capture(folder)]


def _capture_file(path: Path) -> list[Capture]:
    return [read_capture(path)]
