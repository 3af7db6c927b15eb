"""Libraries of scenelets in files.

A library file is an ``.npz`` of plain arrays (no pickle), for L scenelets of F frames in
all, with O objects in all:

========================  ================  =================================================
``format``                () text           ``"imapper-prob scenelet library 2"``
``name``                  () text           name of the library
``names``, ``actions``    (L,) text         of each scenelet
``fps``                   (L,) number       frames a second
``weights``               (L,) number       how much each counts among similar motions
``first_frame``           (L + 1,) index    where each scenelet's frames start in ``joints``
``joints``                (F, 16, 3)        local frame of the scenelet, metres
``object_scenelet``       (O,) index        which scenelet an object belongs to, ascending
========================  ================  =================================================

The objects themselves are in the arrays of :mod:`imapper_prob.inputs.furniture_arrays`, in
local frames too.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from imapper_prob.files import written_whole
from imapper_prob.inputs.archives import Arrays, Shapes, check_shapes, load_archive
from imapper_prob.inputs.furniture_arrays import (
    FURNITURE_SHAPES,
    check_owners,
    pack_furniture,
    unpack_furniture,
)
from imapper_prob.models.errors import InputError
from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.models.skeleton import N_JOINTS

__all__ = ["library_of", "pack_library", "read_library", "save_library"]

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
    """A library as the arrays of the module's description, ``format`` left out."""
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
    """Write a library to an ``.npz`` file, whole or not at all."""
    path = Path(path)
    arrays = {"format": np.array(_FORMAT), **pack_library(library)}
    with written_whole(path) as beside, beside.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def read_library(path: str | Path) -> Library:
    """A library from a file of :func:`save_library`.

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

    Raises
    ------
    InputError
        If they contradict each other. It does not say where they are from.
    """
    _check(arrays)
    return _unpacked(arrays)


def _check(arrays: Arrays) -> None:
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
