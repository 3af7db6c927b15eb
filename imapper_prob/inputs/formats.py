"""Which format it is, by content, and its reader."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Final

from imapper_prob.inputs.assemble import assemble
from imapper_prob.inputs.camera_options import ClipOptions
from imapper_prob.inputs.clip_file import read_clip
from imapper_prob.inputs.i3db import DETECTIONS, read_i3db
from imapper_prob.inputs.joints_in_space import is_joints, read_joints, read_trc
from imapper_prob.inputs.json_fields import load_json
from imapper_prob.inputs.mediapipe_landmarks import is_mediapipe, read_mediapipe
from imapper_prob.inputs.openpose import ORDERS, is_openpose, read_openpose
from imapper_prob.inputs.proposals import is_proposals, read_proposals
from imapper_prob.inputs.result_lists import SETS, is_result_list, read_result_list
from imapper_prob.inputs.sightings import Sightings
from imapper_prob.inputs.trc import MAGIC
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip

__all__ = ["FORMATS", "format_of", "read_whatever"]

FORMATS: Final = (
    "i3db",
    "clip",
    "joints",
    "trc",
    *ORDERS,
    *SETS,
    "openpose",
    "results",
    "mediapipe",
    "proposals",
)
"""Names that ``--format`` takes; ``openpose`` and ``results`` leave the joint order open."""

_WHOLE: Final = ("i3db", "clip")
_FOLDERS: Final = ("i3db", "openpose", *ORDERS)


def format_of(path: Path) -> str:
    """One of :data:`FORMATS` by looking into a file or folder.

    Raises
    ------
    InputError
        It is none of them.
    """
    if path.is_dir():
        if any(path.glob(DETECTIONS)):
            return "i3db"
        if is_openpose(path):
            return "openpose"
    elif path.is_file():
        found = _format_of_file(path)
        if found is not None:
            return found
    raise InputError(
        f"{path}: not a known clip; expected an i3DB scene folder (with {DETECTIONS}), a folder of "
        "OpenPose files, a result list of MMPose or AlphaPose, a MediaPipe dump, pose proposals, a "
        "TRC file, or an .npz file; see docs/inputs.md"
    )


def _format_of_file(path: Path) -> str | None:
    with path.open("rb") as file:
        beginning = file.read(64)
    if beginning.startswith(b"PK"):
        try:
            with zipfile.ZipFile(path) as archive:
                entries = {name.removesuffix(".npy") for name in archive.namelist()}
        except (zipfile.BadZipFile, OSError, ValueError, RuntimeError):
            entries = set()
        return "joints" if is_joints(entries) else "clip"
    if path.suffix == ".npz":
        return "clip"
    if beginning.startswith(MAGIC.encode()):
        return "trc"
    if beginning.lstrip()[:1] in (b"[", b"{"):
        data = load_json(path)
        if is_result_list(data):
            return "results"
        if is_mediapipe(data):
            return "mediapipe"
        if is_proposals(data):
            return "proposals"
    return None


def read_whatever(path: Path, options: ClipOptions) -> Clip:
    """Read a clip of any format. Poses are NaN where the format has none.

    Raises
    ------
    InputError
        It is no clip, or an option does not go with its format.
    """
    form = _chosen(path, options)
    if form in _WHOLE:
        given = [
            name
            for name in (
                "camera",
                "focal",
                "focal_spread",
                "pitch",
                "height",
                "size",
                "fps",
                "confidence",
                "people",
            )
            if getattr(options, name) is not None
        ]
        if given:
            raise InputError(f"{path}: a clip of format {form} has its own {given[0]}")
        return read_i3db(path) if form == "i3db" else read_clip(path)
    sightings, options = _read(path, form, options)
    return assemble(sightings, options)


def _chosen(path: Path, options: ClipOptions) -> str:
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    form = options.format
    if form is None:
        return format_of(path)
    if form not in FORMATS:
        raise InputError(f"format {form!r}: known are {', '.join(FORMATS)}")
    if path.is_dir() != (form in _FOLDERS):
        raise InputError(f"{path}: {form} is a {'folder' if form in _FOLDERS else 'file'}")
    return form


def _read(path: Path, form: str, options: ClipOptions) -> tuple[Sightings, ClipOptions]:
    if form == "joints":
        return read_joints(path, options)
    if form == "trc":
        return read_trc(path, options), options
    if form == "mediapipe":
        return read_mediapipe(path), options
    if form == "proposals":
        return read_proposals(path), options
    if form in ("openpose", *ORDERS):
        return read_openpose(path, order=None if form == "openpose" else form), options
    return read_result_list(path, keypoint_set=None if form == "results" else form), options
