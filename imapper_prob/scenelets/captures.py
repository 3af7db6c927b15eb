"""Captures: recorded motion with the surrounding furniture, from ``.npz`` and i3DB files.

Scenelets are cut from captures: motion capture with scanned or measured furniture, or the ground
truth of a benchmark. In a capture, unlike in a clip, 3D motion and furniture are known.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.clips.furniture import (
    FURNITURE_SHAPES,
    category,
    left_out,
    pack_furniture,
    unpack_furniture,
)
from imapper_prob.clips.i3db import ACTIONS, DETECTIONS, action_words, read_i3db, read_i3db_truth
from imapper_prob.clips.keypoints import joints_by_name
from imapper_prob.clips.parsing import Arrays, Shapes, check_shapes, load_archive
from imapper_prob.files import written_whole
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import SceneObject, read_only
from imapper_prob.models.skeleton import JOINTS, N_JOINTS

__all__ = [
    "FORMAT",
    "Capture",
    "i3db_folders",
    "joints_at",
    "read_capture",
    "read_i3db_capture",
    "write_capture",
]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Capture:
    """The motion of one person among furniture.

    World frame: metres, z up, floor at z = 0.

    Parameters
    ----------
    name : str
        Used in messages, and as first part of the names of its scenelets.
    scene : str
        Name of the room; captures of one room share it.
    joints : (T, 16, 3) float
        Joints, metres; NaN in all joints of a frame without tracking.
    objects : tuple of SceneObject
        Furniture, which does not move.
    fps : float
        Frames per second.
    actions : tuple of str
        One word per frame, or empty.
    """

    name: str
    scene: str
    joints: Array
    objects: tuple[SceneObject, ...]
    fps: float
    actions: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        joints = read_only(self.joints, shape=(None, N_JOINTS, 3), name=f"capture {self.name}")
        finite: NDArray[np.bool_] = np.all(np.isfinite(joints), axis=2)
        partial = np.any(finite, axis=1) & ~np.all(finite, axis=1)
        if partial.any():
            t = int(np.argmax(partial))
            j = int(np.argmin(finite[t]))
            raise InputError(
                f"capture {self.name}, frame {t}, joint {JOINTS[j]}: not finite; a frame has all "
                "joints or none"
            )
        if not finite.any():
            raise InputError(f"capture {self.name}: no frame with a person in it")
        if not (np.isfinite(self.fps) and self.fps > 0):
            raise InputError(f"capture {self.name}: frame rate {self.fps} must be positive")
        if self.actions and len(self.actions) != len(joints):
            raise InputError(
                f"capture {self.name}: {len(self.actions)} actions for {len(joints)} frames"
            )
        object.__setattr__(self, "joints", joints)
        object.__setattr__(self, "objects", tuple(self.objects))
        object.__setattr__(self, "actions", tuple(self.actions))


# ------------------------------------------------------------------------------------------------
# Motion at other times.


def joints_at(moments: ArrayLike, times: ArrayLike, joints: ArrayLike, *, bridged: float) -> Array:
    """Interpolate joints linearly at given times.

    Each joint is interpolated separately, so that losing one joint for a moment does not affect the
    others.

    Parameters
    ----------
    moments : (M,) float
        Seconds.
    times : (T,) float
        Times of ``joints``, seconds, ascending.
    joints : (T, 16, 3) float
        Metres; NaN where a joint was lost.
    bridged : float
        Longest time in seconds between two sightings that is interpolated.

    Returns
    -------
    (M, 16, 3) float
        NaN in all joints of a frame before the first and after the last sighting of any joint, and
        if any joint was lost for longer than ``bridged``.
    """
    moments, times = np.asarray(moments, float), np.asarray(times, float)
    joints = np.asarray(joints, float)
    seen = np.isfinite(joints).all(2)
    result = np.full((len(moments), N_JOINTS, 3), np.nan)
    # Times are sums of rounded steps, so comparisons need a small tolerance.
    hair = 1e-9 * (1.0 + np.abs(times).max(initial=0.0))
    for joint in range(N_JOINTS):
        known = times[seen[:, joint]]
        if len(known) == 0:
            continue
        after = np.clip(np.searchsorted(known, moments - hair), 0, len(known) - 1)
        before = np.clip(np.searchsorted(known, moments + hair, "right") - 1, 0, len(known) - 1)
        inside = (moments >= known[0] - hair) & (moments <= known[-1] + hair)
        inside &= known[after] - known[before] <= bridged + hair
        for axis in range(3):
            values = np.interp(moments, known, joints[seen[:, joint], joint, axis])
            result[inside, joint, axis] = values[inside]
    result[~np.isfinite(result).all((1, 2))] = np.nan
    return result


# ------------------------------------------------------------------------------------------------
# Capture files: plain numpy archives without pickled objects, which any tool can write.
#
# ==================  =====================  ==================================================
# ``format``          () text                ``"imapper-prob capture 1"``
# ``fps``             () number              frames a second
# ``joints``          (T, J, 3) number       metres, floor at height 0; NaN where nobody was
# ``joint_names``     (J,) text, optional    names of the joints; without, they are the sixteen
#                                            of :data:`imapper_prob.models.skeleton.JOINTS`
# ``up``              () text, optional      ``"z"``, or ``"y"`` where y is up in ``joints``:
#                                            (x, y, z) then becomes (x, −z, y)
# ``actions``         (T,) text, optional    what is done in each frame: ``walk``, ``sit``, …
# ``name``            () text, optional      name of the capture; that of the file without
# ``scene``           () text, optional      name of the room; that of the capture without
# ==================  =====================  ==================================================
#
# Furniture, if there is any, is in the arrays of :mod:`imapper_prob.clips.furniture`,
# always with z up. Sides of joints are the person's own.

_log = logging.getLogger(__name__)
FORMAT: Final = "imapper-prob capture 1"
"""Format of the file; the number is raised when an older reader would misread it."""
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
"""Largest number of frames: an hour at the 120 per second of motion capture."""
_FURNITURE_PREFIXES: Final = ("object_", "cuboid_")


def write_capture(path: str | Path, capture: Capture) -> None:
    """Write a capture atomically.

    Parameters
    ----------
    path : path
        Path that ends in ``.npz``.
    capture : Capture

    Raises
    ------
    InputError
        The name of the file does not end in ``.npz``.
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
    """Read a capture file, written by :func:`write_capture` or by another tool.

    A frame in which any of the sixteen joints is NaN counts as untracked. Furniture labels are
    mapped to the categories of our libraries; walls and the like are left out.

    Parameters
    ----------
    path : path

    Returns
    -------
    Capture

    Raises
    ------
    InputError
        The file is missing, damaged, of another version, or its content is not a capture.
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


# ------------------------------------------------------------------------------------------------
# The ground truth of i3DB scenes; a scene that is to be inferred must be left out by name.

_BRIDGED: Final = 0.3
"""Longest gap in seconds between annotated frames that is interpolated; they are 0.2 s apart."""
_WORDS: Final = {
    "walking": "walk",
    "sitting": "sit",
    "standing(from sitting)": "stand-up",
    "reaching": "reach",
    "standing": "stand",
    "": "",
}
"""Actions of the benchmark, and ours."""


def read_i3db_capture(folder: str | Path) -> Capture:
    """Read the annotated motion and furniture of one scene.

    Parameters
    ----------
    folder : path
        Folder such as ``Scene04``, with its ``gt/``.

    Returns
    -------
    Capture
        All frames from the first to the last annotated one, linearly interpolated.

    Raises
    ------
    InputError
        A file is missing, damaged, or does not follow the format.
    """
    folder = Path(folder)
    clip = read_i3db(folder)
    truth = read_i3db_truth(folder, clip)
    times = np.arange(clip.n_frames) / clip.fps
    path = folder / "gt" / ACTIONS
    words = action_words(path, clip.n_frames)
    strange = sorted(set(words) - set(_WORDS))
    if strange:
        raise InputError(
            f"{path}: unknown action {strange[0]!r}; known are {', '.join(filter(None, _WORDS))}"
        )
    return Capture(
        name=clip.name,
        scene=clip.name,
        joints=joints_at(times, times, truth.joints, bridged=_BRIDGED),
        objects=truth.objects,
        fps=clip.fps,
        actions=tuple(_WORDS[word] for word in words),
    )


def i3db_folders(path: str | Path) -> list[Path]:
    """Find scene folders: ``path`` itself if it is one, otherwise those in it.

    Parameters
    ----------
    path : path

    Returns
    -------
    list of Path

    Raises
    ------
    InputError
        There is none.
    """
    path = Path(path)
    candidates = [path, *sorted(p for p in path.iterdir() if p.is_dir())] if path.is_dir() else []
    folders = [folder for folder in candidates if any(folder.glob(DETECTIONS))]
    if not folders:
        raise InputError(f"{path}: no i3DB scene there (a folder with {DETECTIONS}, and gt/)")
    return folders
