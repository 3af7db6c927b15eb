"""Libraries of scenelets, built in or kept in a file.

A library file is an ``.npz`` of plain arrays (no pickle), for L scenelets of F frames in
all, with O objects of K cuboids in all:

========================  ================  =================================================
``format``                ()                ``"imapper-prob scenelet library 1"``
``name``                  ()                name of the library
``names``, ``actions``    (L,) text         of each scenelet
``fps``                   (L,) float        frames a second
``first_frame``           (L + 1,) int      where each scenelet's frames start in ``joints``
``joints``                (F, 16, 3) float  local frame of the scenelet, metres
``object_scenelet``       (O,) int          which scenelet an object belongs to, ascending
``object_label``          (O,) text         category
``object_placement``      (O, 3) float      x, y in metres, yaw in radians
``cuboid_object``         (K,) int          which object a cuboid belongs to, ascending
``cuboid_part``           (K,) text         what it is of the object
``cuboid_centre``         (K, 3) float      metres, frame of the object
``cuboid_size``           (K, 3) float      full side lengths, metres
========================  ================  =================================================
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imapper_prob.files import written_whole
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Cuboid, Placement, SceneObject
from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.models.skeleton import N_JOINTS
from imapper_prob.scenelets.procedural.catalogue import build_library

__all__ = ["BUILT_IN", "built_in_library", "load_library", "save_library"]

BUILT_IN = "built-in"

_FORMAT = "imapper-prob scenelet library 1"

# The length that each part must have, by the part that sets it (None: free), and the rest.
_SHAPES: dict[str, tuple[str | None, *tuple[int, ...]]] = {
    "names": ("names",),
    "actions": ("names",),
    "fps": ("names",),
    "first_frame": (None,),
    "joints": (None, N_JOINTS, 3),
    "object_scenelet": ("object_label",),
    "object_label": ("object_label",),
    "object_placement": ("object_label", 3),
    "cuboid_object": ("cuboid_part",),
    "cuboid_part": ("cuboid_part",),
    "cuboid_centre": ("cuboid_part", 3),
    "cuboid_size": ("cuboid_part", 3),
}


@cache
def built_in_library(seed: int = 0) -> Library:
    """The library made by the project's own code; made once a process."""
    return build_library(seed)


def load_library(source: str | Path = BUILT_IN) -> Library:
    """The built-in library, or one from a file.

    Parameters
    ----------
    source : str or Path
        ``"built-in"``, or the path of a file of :func:`save_library`.

    Raises
    ------
    InputError
        If the file is missing, is no library, or contradicts itself.
    """
    if source == BUILT_IN:
        return built_in_library()
    path = Path(source)
    if not path.is_file():
        raise InputError(f"library {path}: no such file; give a library's .npz, or {BUILT_IN!r}")
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {key: archive[key] for key in archive.files}
    except Exception as error:  # numpy, zipfile, zlib and tokenize each have their own way to fail
        raise InputError(f"library {path}: damaged, or no .npz at all; make it again") from error
    if str(arrays.get("format")) != _FORMAT:
        raise InputError(f"library {path}: not a scenelet library of this version; make it again")
    try:
        _check(arrays)
        return _unpacked(arrays)
    except ValueError as error:  # an InputError, or text where numbers belong
        raise InputError(f"library {path}: {error}") from error


def save_library(library: Library, path: str | Path) -> None:
    """Write a library to an ``.npz`` file, whole or not at all."""
    path = Path(path)
    with written_whole(path) as beside, beside.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **_packed(library))


def _packed(library: Library) -> dict[str, NDArray[Any]]:
    objects = [(i, o) for i, s in enumerate(library) for o in s.objects]
    cuboids = [(i, c) for i, (_, o) in enumerate(objects) for c in o.cuboids]
    places = [(o.placement.x, o.placement.y, o.placement.yaw) for _, o in objects]
    return {
        "format": np.array(_FORMAT),
        "name": np.array(library.name),
        "names": np.array([s.name for s in library]),
        "actions": np.array([s.action for s in library]),
        "fps": np.array([s.fps for s in library]),
        "first_frame": np.cumsum([0, *(s.n_frames for s in library)]),
        "joints": np.concatenate([s.joints for s in library]),
        "object_scenelet": np.array([i for i, _ in objects], dtype=np.int64),
        "object_label": np.array([o.label for _, o in objects], dtype=np.str_),
        "object_placement": np.array(places).reshape(-1, 3),
        "cuboid_object": np.array([i for i, _ in cuboids], dtype=np.int64),
        "cuboid_part": np.array([c.part for _, c in cuboids], dtype=np.str_),
        "cuboid_centre": np.array([c.centre for _, c in cuboids]).reshape(-1, 3),
        "cuboid_size": np.array([c.size for _, c in cuboids]).reshape(-1, 3),
    }


def _check(arrays: dict[str, NDArray[Any]]) -> None:
    """Whether all parts are there, of sizes that agree, and point at things that exist."""
    for key in ("name", *_SHAPES):
        if key not in arrays:
            raise InputError(f"part {key} is missing; make it again")
    sizes = {key: arrays[key].size for key in ("names", "object_label", "cuboid_part")}
    for key, (length, *rest) in _SHAPES.items():
        array = arrays[key]
        expected = (sizes[length] if length else len(np.atleast_1d(array)), *rest)
        if array.shape != expected:
            raise InputError(f"{key} has shape {array.shape}, expected {expected}; make it again")
    steps = np.diff(arrays["first_frame"], prepend=0, append=len(arrays["joints"]))
    for key, owners in (("object_scenelet", "names"), ("cuboid_object", "object_label")):
        index = arrays[key]
        if ((index < 0) | (index >= sizes[owners])).any():
            raise InputError(f"{key} names one that does not exist; make it again")
    if len(arrays["first_frame"]) != sizes["names"] + 1 or (steps < 0).any() or steps[-1]:
        raise InputError("first_frame does not fit the scenelets and their joints; make it again")


def _unpacked(arrays: dict[str, NDArray[Any]]) -> Library:
    cuboid_of = arrays["cuboid_object"]
    objects = [
        SceneObject(
            str(label),
            Placement(*map(float, place)),
            tuple(
                Cuboid(
                    str(arrays["cuboid_part"][k]),
                    arrays["cuboid_centre"][k],
                    arrays["cuboid_size"][k],
                )
                for k in np.flatnonzero(cuboid_of == index)
            ),
        )
        for index, (label, place) in enumerate(
            zip(arrays["object_label"], arrays["object_placement"], strict=True)
        )
    ]
    owner, first, joints = arrays["object_scenelet"], arrays["first_frame"], arrays["joints"]
    scenelets = tuple(
        Scenelet(
            str(name),
            str(arrays["actions"][i]),
            joints[first[i] : first[i + 1]],
            tuple(objects[k] for k in np.flatnonzero(owner == i)),
            float(arrays["fps"][i]),
        )
        for i, name in enumerate(arrays["names"])
    )
    return Library(str(arrays["name"]), scenelets)
