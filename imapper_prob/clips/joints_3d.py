"""3D joints from other programs: TRC tables, and ``.npz`` archives with a camera.

Motion capture and trackers that fit a body model to video give joints in metres. They are either in
camera axes (x right, y down, z forward) or in a world frame with a known ``rotation`` and
``translation`` to the camera. The 2D detections that the model needs are projections of the joints.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.clips.assemble import FARTHEST, RawDetections
from imapper_prob.clips.keypoints import joints_by_name
from imapper_prob.clips.options import (
    CameraFile,
    ClipOptions,
    camera_of,
    check_matrix,
    check_rotation,
)
from imapper_prob.clips.parsing import Arrays, Shapes, check_shapes, load_archive
from imapper_prob.files import read_text
from imapper_prob.models.errors import InputError
from imapper_prob.models.settings import LONGEST_CLIP
from imapper_prob.models.skeleton import JOINTS, PELV

__all__ = ["MAGIC", "is_joints", "read_joints", "read_trc"]

Array = NDArray[np.float64]
MAGIC: Final = "PathFileType"
"""First word of every TRC file."""
_METRES: Final = {"m": 1.0, "cm": 0.01, "mm": 0.001}
"""Metres of each unit of a TRC file."""


@dataclass(frozen=True)
class TrcTable:
    """Marker positions over time.

    Parameters
    ----------
    names : tuple of J str
    positions : (T, J, 3) float
        Metres, in the file's axes; NaN where missing.
    first : int
        Frame number of the first row.
    fps : float
    """

    names: tuple[str, ...]
    positions: Array
    first: int
    fps: float


def _read_trc_table(path: Path) -> TrcTable:
    """Read the table of a TRC file; empty cells and 0, 0, 0 are missing markers.

    Raises
    ------
    InputError
        The file is damaged, or frames are missing or out of order.
    """
    text = read_text(path)
    lines = text.splitlines()
    if len(lines) < 6 or not lines[0].startswith(MAGIC):
        raise InputError(f"{path}: no TRC file, or cut off in its header")
    keys, values = lines[1].split("\t"), lines[2].split("\t")
    header = dict(zip((key.strip() for key in keys), (v.strip() for v in values), strict=False))
    fps = _number(path, 3, header.get("DataRate", ""))
    if not (np.isfinite(fps) and fps > 0):
        raise InputError(f"{path}, line 3: data rate {fps} must be positive")
    unit = header.get("Units", "m")
    if unit not in _METRES:
        raise InputError(f"{path}, line 3: unit {unit!r}, expected {', '.join(_METRES)}")
    cells = [cell.strip() for cell in lines[3].rstrip("\r\n").split("\t")]
    names = tuple(cell for cell in cells[2:] if cell)
    if not names:
        raise InputError(f"{path}, line 4: no marker names")
    rows = [(i, line) for i, line in enumerate(lines[5:], start=6) if line.strip()]
    if not 0 < len(rows) <= LONGEST_CLIP:
        raise InputError(f"{path}: {len(rows)} frames, expected 1 to {LONGEST_CLIP}")
    announced = _number(path, 3, header.get("NumFrames", "nan"))
    if announced != len(rows) and np.isfinite(announced):
        raise InputError(
            f"{path}: {len(rows)} frames, the header says {announced:.0f}; it may be cut off"
        )
    table = np.full((len(rows), len(names), 3), np.nan)
    frames = []
    for row, (number, line) in zip(table, rows, strict=True):
        parts = [part.strip() for part in line.rstrip("\r\n").split("\t")]
        frames.append(_number(path, number, parts[0]))
        parts = parts[2 : 2 + row.size]
        if len(parts) < row.size:
            if number == len(lines) and not text.endswith("\n"):
                raise InputError(f"{path}, line {number}: cut off; copy the file again")
            parts += [""] * (row.size - len(parts))  # programs often drop trailing empty cells
        values_of_row = [_number(path, number, part) if part else np.nan for part in parts]
        row[:] = np.reshape(values_of_row, row.shape)
    first = frames[0]
    if not (abs(first) < 2**53 and float(first).is_integer()):
        raise InputError(f"{path}, line {rows[0][0]}: frame {first} is no whole number")
    out_of_order = np.flatnonzero(np.array(frames) != first + np.arange(len(frames)))
    if len(out_of_order):
        raise InputError(
            f"{path}, line {rows[out_of_order[0]][0]}: frame {frames[out_of_order[0]]:g} does not "
            "follow the one before; frames must be consecutive"
        )
    for row, marker in np.argwhere((np.abs(table) > FARTHEST).any(-1))[:1]:
        raise InputError(
            f"{path}, line {rows[row][0]}, frame {frames[row]:g}, marker {names[marker]}: a "
            "coordinate is infinite, or too large to be one; leave the cells empty"
        )
    table[(table == 0).all(-1) | ~np.isfinite(table).all(-1)] = np.nan
    return TrcTable(names, table * _METRES[unit], int(first), fps)


def _number(path: Path, line: int, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{path}, line {line}: {text[:40]!r} is not a number") from None


# ------------------------------------------------------------------------------------------------
# Archives, and clips of either format. An ``.npz`` is a plain numpy archive:
#
# ======================  ==========================  ==========================================
# ``joints``              (T, J, 3) or (A, T, J, 3)   metres; NaN or 0, 0, 0 where missing
# ``joint_names``         (J,) text                   as in :mod:`imapper_prob.clips.keypoints`;
#                                                     if missing, J is 16 in this program's order
# ``fps``                 () number                   frames a second
# ``confidences``         (T, J) or (A, T, J)         in [0, 1]; optional
# ``matrix``, ``size``    (3, 3), (2,)                intrinsics, width and height in pixels;
#                                                     optional where a camera file is given
# ``rotation``,           (3, 3), (3,)                world to camera, optional
# ``translation``
# ======================  ==========================  ==========================================

_UNTOLD: Final = 0.75
"""Confidence of a projected joint. Whether it was visible is unknown; at this confidence the
detection tables favour neither case."""
_NEEDED: Final[Shapes] = {"fps": ("number",)}
# Shapes of the arrays that may be there.
_OPTIONAL: Final[Shapes] = {
    "joint_names": ("text", None),
    "matrix": ("number", 3, 3),
    "size": ("index", 2),
    "rotation": ("number", 3, 3),
    "translation": ("number", 3),
}


def is_joints(entries: set[str]) -> bool:
    """Whether an archive with these entries is a file of 3D joints.

    Parameters
    ----------
    entries : set of str

    Returns
    -------
    bool
    """
    return "joints" in entries and "format" not in entries


def read_joints(path: Path, options: ClipOptions) -> tuple[RawDetections, ClipOptions]:
    """Read an ``.npz`` of 3D joints.

    Parameters
    ----------
    path : Path
    options : ClipOptions

    Returns
    -------
    RawDetections
    ClipOptions
        With the file's own camera if the user gives none.

    Raises
    ------
    InputError
        The file is damaged, or its entries are inconsistent.
    """
    arrays = load_archive(path, what="joints")
    try:
        return _from_arrays(path, arrays, options)
    except InputError as error:
        message = str(error)
        raise InputError(message if str(path) in message else f"{path}: {message}") from error


def read_trc(path: Path, options: ClipOptions) -> RawDetections:
    """Read a TRC file; its camera comes from the options.

    Parameters
    ----------
    path : Path
    options : ClipOptions

    Returns
    -------
    RawDetections

    Raises
    ------
    InputError
        The file is damaged, a joint is missing, or there is no camera.
    """
    if options.camera is None:
        raise InputError(f"{path}: 3D joints without a camera; name its file with --camera")
    table = _read_trc_table(path)
    try:
        joints = joints_by_name(table.positions, table.names)[None]
        return _projected(
            path.stem,
            joints,
            np.where(np.isfinite(joints).all(-1), _UNTOLD, 0.0),
            camera=options.camera,
            first=table.first,
            fps=table.fps,
        )
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _from_arrays(
    path: Path, arrays: Arrays, options: ClipOptions
) -> tuple[RawDetections, ClipOptions]:
    present = {key: shape for key, shape in _OPTIONAL.items() if key in arrays}
    check_shapes(arrays, {**_NEEDED, **present})
    joints = arrays["joints"]
    if joints.dtype.kind not in "fiu" or joints.ndim not in (3, 4) or joints.shape[-1] != 3:
        raise InputError(f"joints are {joints.dtype} {joints.shape}, expected (T, J, 3) numbers")
    if not joints.size:
        raise InputError(f"joints have the shape {joints.shape}: there are none")
    joints = joints.astype(np.float64).reshape(-1, *joints.shape[-3:])
    actors, frames, count, _ = joints.shape
    if not 0 < frames <= LONGEST_CLIP:
        raise InputError(f"{frames} frames, expected 1 to {LONGEST_CLIP}")
    if not 0 < actors <= 16:
        raise InputError(f"{actors} people, expected 1 to 16")
    names = [str(name) for name in arrays.get("joint_names", JOINTS)]
    if len(names) != count:
        raise InputError(f"{len(names)} joint names for {count} joints")
    for person, frame, joint in np.argwhere((np.abs(joints) > FARTHEST).any(-1))[:1]:
        raise InputError(
            f"person {person}, frame {frame}, joint {names[joint]}: a coordinate is infinite, or "
            "too large to be metres; write NaN for a missing joint"
        )
    joints[(joints == 0).all(-1)] = np.nan
    own = arrays.get("confidences", np.full(joints.shape[:-1], _UNTOLD))
    told = own.shape if own.ndim == joints.ndim - 1 else (1, *own.shape)
    if own.dtype.kind not in "fiu" or told != joints.shape[:-1]:
        raise InputError(
            f"confidences are {own.dtype} {own.shape}, expected one a joint, "
            f"{arrays['joints'].shape[:-1]}"
        )
    # Confidences are matched by joint name in the same way as positions.
    wide = np.repeat(own.astype(np.float64).reshape(-1, count, 1), 3, axis=2)
    confidences = joints_by_name(wide, names)[..., 0].reshape(actors, frames, -1)
    for person, frame, joint in np.argwhere(~((confidences >= 0) & (confidences <= 1)))[:1]:
        raise InputError(
            f"person {person}, frame {frame}, joint {JOINTS[joint]}: confidence "
            f"{confidences[person, frame, joint]:g} must be in [0, 1]"
        )
    sixteen = joints_by_name(joints.reshape(-1, count, 3), names)
    sixteen = sixteen.reshape(actors, frames, -1, 3)
    if options.camera is None:
        options = replace(options, camera=_camera(arrays))
    assert options.camera is not None
    fps = float(arrays["fps"])
    sightings = _projected(path.stem, sixteen, confidences, camera=options.camera, first=0, fps=fps)
    return sightings, options


def _camera(arrays: Arrays) -> CameraFile:
    for key in ("matrix", "size"):
        if key not in arrays:
            raise InputError(f"no entry {key!r}; name a camera file with --camera")
    width, height = (int(n) for n in arrays["size"])
    matrix = arrays["matrix"].astype(np.float64)
    check_matrix(matrix)
    rotation = arrays.get("rotation")
    if (rotation is None) != ("translation" not in arrays):
        raise InputError("has one of 'rotation' and 'translation'; say both, or neither")
    if rotation is not None:
        rotation = rotation.astype(np.float64)
        check_rotation(rotation)
    return CameraFile(
        size=(width, height),
        matrix=matrix,
        distortion=np.zeros(0),
        rotation=rotation,
        translation=arrays.get("translation", np.zeros(3)).astype(np.float64),
    )


def _projected(
    name: str, joints: Array, confidences: Array, *, camera: CameraFile, first: int, fps: float
) -> RawDetections:
    """The detections that the camera would have made of joints (A, T, 16, 3)."""
    if not (np.isfinite(fps) and fps > 0):
        raise InputError(f"frame rate {fps} must be positive")
    if camera.rotation is not None and camera.translation is not None:
        joints = joints @ camera.rotation.T + camera.translation
    axes = joints[..., [0, 2, 1]] * (1, 1, -1)
    # The lens distortion is dropped: projected pixels are undistorted.
    straight = replace(camera, distortion=np.zeros(0))
    nominal, _ = camera_of(name, ClipOptions(camera=straight), size=camera.size)
    pixels = nominal.project_camera(axes)
    seen = np.isfinite(pixels).all(-1)
    if np.isfinite(axes).all(-1).any() and not seen.any():
        raise InputError(
            "all joints are behind the camera; without rotation and translation they must be in "
            "its axes: x right, y down, z forward, in metres"
        )
    who, when = np.nonzero(seen.any(-1))
    return RawDetections(
        name=name,
        map_name="identity",
        frames=when + first,
        keypoints=pixels[who, when],
        scores=np.where(seen, confidences, 0.0)[who, when],
        span=(first, first + joints.shape[1] - 1),
        poses=(axes - axes[..., PELV, None, :])[who, when],
        identities=tuple(f"person-{a}" for a in who),
        size=camera.size,
        fps=fps,
    )
