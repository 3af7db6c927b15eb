"""Logging what stands still, what moves, and a person."""

from __future__ import annotations

from typing import Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from imapper_prob.models.scene import Clip
from imapper_prob.models.skeleton import PELV
from imapper_prob.recording import shapes

__all__ = ["PATH_RADIUS", "log_moving", "log_person", "log_static", "own_entity"]

Array = NDArray[np.float64]

_JOINT_RADIUS: Final = 0.045
_LIMB_RADIUS: Final = 0.03
PATH_RADIUS: Final = 0.012
"""Radii of joints and lines in metres, chosen by eye."""


def own_entity(clip: Clip, entity: str, person: int) -> str:
    """Where things of one person are logged: below ``entity`` by name, if there are others."""
    if len(clip.tracks) == 1:
        return entity
    return f"{entity}/{rr.escape_entity_path_part(clip.tracks[person].name)}"


def log_static(recording: rr.RecordingStream, entity: str, what: rr.AsComponents) -> None:
    """Log what is there at all times."""
    recording.log(entity, what, static=True, strict=True)


def log_moving(
    recording: rr.RecordingStream,
    entity: str,
    index: rr.TimeColumn,
    columns: rr.ComponentColumnList,
    *,
    style: rr.AsComponents,
) -> None:
    """Log what changes along a timeline, and once what does not."""
    recording.send_columns(entity, indexes=[index], columns=columns, strict=True)
    log_static(recording, entity, style)


def log_person(
    recording: rr.RecordingStream, entity: str, joints: Array, number: int, frames: rr.TimeColumn
) -> None:
    """Log joints, limbs and path of a person below ``entity``.

    Parameters
    ----------
    joints : (T, 16, 3) float
        Metres; NaN where unknown.
    number : int
        Class of the person, see :mod:`imapper_prob.recording.palette`.
    frames : TimeColumn
        T times.
    """
    known = np.isfinite(joints).all(-1)
    columns = rr.Points3D.columns(
        positions=joints[known], keypoint_ids=np.nonzero(known)[1]
    ).partition(known.sum(1))
    log_moving(
        recording,
        f"{entity}/person",
        frames,
        columns,
        style=rr.Points3D.from_fields(class_ids=number, radii=_JOINT_RADIUS, show_labels=False),
    )
    strips = [shapes.limbs(pose) for pose in joints]
    limbs = rr.LineStrips3D.columns(strips=[s for row in strips for s in row])
    log_moving(
        recording,
        f"{entity}/limbs",
        frames,
        limbs.partition([len(row) for row in strips]),
        style=rr.LineStrips3D.from_fields(class_ids=number, radii=_LIMB_RADIUS, show_labels=False),
    )
    path = rr.LineStrips3D(
        shapes.paths(joints[:, PELV]), class_ids=number, radii=PATH_RADIUS, show_labels=False
    )
    log_static(recording, f"{entity}/path", path)
