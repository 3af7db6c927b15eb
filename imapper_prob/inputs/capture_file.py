"""Captures of any origin: one ``.npz`` with joints over time and boxes.

The file is a plain numpy archive, without pickled objects, so any tool can write one:

==================  =====================  ==================================================
``format``          () text                ``"imapper-prob capture 1"``
``fps``             () number              frames a second
``joints``          (T, J, 3) number       metres, floor at height 0; NaN where nobody was
``joint_names``     (J,) text, optional    names of the joints; without, they are the sixteen
                                           of :data:`imapper_prob.models.skeleton.JOINTS`
``up``              () text, optional      ``"z"``, or ``"y"`` where y is up in ``joints``:
                                           (x, y, z) then becomes (x, −z, y)
``actions``         (T,) text, optional    what is done in each frame: ``walk``, ``sit``, …
``name``            () text, optional      name of the capture; that of the file without
``scene``           () text, optional      name of the room; that of the capture without
==================  =====================  ==================================================

Furniture, if there is any, is in the arrays of :mod:`imapper_prob.inputs.furniture_arrays`,
always with z up. Sides of joints are the person's own.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.files import written_whole
from imapper_prob.inputs.archives import Arrays, Shapes, check_shapes, load_archive
from imapper_prob.inputs.captures import Capture
from imapper_prob.inputs.furniture_arrays import FURNITURE_SHAPES, pack_furniture, unpack_furniture
from imapper_prob.inputs.joint_names import joints_by_name
from imapper_prob.inputs.labels import category, left_out
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import SceneObject
from imapper_prob.models.skeleton import N_JOINTS

__all__ = ["FORMAT", "read_capture", "write_capture"]

Array = NDArray[np.float64]

_log = logging.getLogger(__name__)

FORMAT: Final = "imapper-prob capture 1"
"""First entry of the file; the number rises when a reader of old files would go wrong."""

_NEEDED: Final[Shapes] = {
    "format": ("text",),
    "fps": ("number",),
    "joints": ("number", None, None, 3),
}
_OPTIONAL: Final[Shapes] = {
    "up": ("text",),
    "actions": ("text", "joints"),
    "name": ("text",),
    "scene": ("text",),
    "joint_names": ("text", None),
}
_LONGEST: Final = 432_000
"""Frames: an hour at the 120 a second of motion capture."""
_FURNITURE_PREFIXES: Final = ("object_", "cuboid_")


def write_capture(path: str | Path, capture: Capture) -> None:
    """Write a capture, whole or not at all.

    Parameters
    ----------
    path : path
        Ends in ``.npz``.
    capture : Capture
    """
    path = Path(path)
    if path.suffix != ".npz":
        raise InputError(f"{path}: a capture file's name ends in .npz")
    arrays: Arrays = {
        "format": np.array(FORMAT),
        "name": np.array(capture.name),
        "scene": np.array(capture.scene),
        "fps": np.array(capture.fps),
        "joints": capture.joints,
        **pack_furniture(capture.objects),
    }
    if capture.actions:
        arrays["actions"] = np.array(capture.actions, dtype=np.str_)
    with written_whole(path) as beside, beside.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def read_capture(path: str | Path) -> Capture:
    """Read a capture that :func:`write_capture`, or any tool that keeps to the format, wrote.

    A frame in which any of the sixteen joints is NaN is one in which nobody was tracked.
    Labels of furniture are put into the words of our libraries; walls and the like are left
    out.

    Raises
    ------
    InputError
        The file is missing, damaged, of another version, or its content is no capture.
    """
    path = Path(path)
    arrays = load_archive(path, what="capture")
    try:
        return _capture(arrays, path.stem)
    except InputError as error:
        raise InputError(f"capture {path}: {error}") from error


def _capture(arrays: Arrays, stem: str) -> Capture:
    present = {key: shape for key, shape in _OPTIONAL.items() if key in arrays}
    check_shapes(arrays, {**_NEEDED, **present})
    form = str(arrays["format"])
    if form != FORMAT:
        raise InputError(f"format {form!r}, this version reads {FORMAT!r}")
    name = str(arrays.get("name", stem))
    joints = _sixteen(arrays)
    joints[~np.isfinite(joints).all((1, 2))] = np.nan
    return Capture(
        name=name,
        scene=str(arrays.get("scene", name)),
        joints=joints,
        objects=tuple(_furniture(arrays, name)),
        fps=float(arrays["fps"]),
        actions=tuple(str(word) for word in arrays.get("actions", ())),
    )


def _sixteen(arrays: Arrays) -> Array:
    """(T, 16, 3) joints, z up."""
    if len(arrays["joints"]) > _LONGEST:
        raise InputError(f"{len(arrays['joints'])} frames, more than {_LONGEST}; cut it")
    joints = arrays["joints"].astype(np.float64)
    if "joint_names" in arrays:
        names = [str(name) for name in arrays["joint_names"]]
        if len(names) != joints.shape[1]:
            raise InputError(f"{len(names)} joint_names for {joints.shape[1]} joints")
        joints = joints_by_name(joints, names)
    elif joints.shape[1] != N_JOINTS:
        raise InputError(f"{joints.shape[1]} joints without joint_names; add the entry")
    up = str(arrays.get("up", "z"))
    if up == "y":
        x, y, z = np.moveaxis(joints, -1, 0)
        joints = np.stack([x, -z, y], -1)
    elif up != "z":
        raise InputError(f"up is {up!r}, expected 'y' or 'z'")
    return joints


def _furniture(arrays: Arrays, name: str) -> list[SceneObject]:
    if not any(key.startswith(_FURNITURE_PREFIXES) for key in arrays):
        return []
    check_shapes(arrays, FURNITURE_SHAPES)
    pieces = unpack_furniture(arrays)
    labels = [category(piece.label) for piece in pieces]
    others = [p.label for p, label in zip(pieces, labels, strict=True) if label is None]
    if others:
        _log.warning("capture %s: %s", name, left_out(others))
    return [
        SceneObject(label, piece.placement, piece.cuboids)
        for piece, label in zip(pieces, labels, strict=True)
        if label is not None
    ]
