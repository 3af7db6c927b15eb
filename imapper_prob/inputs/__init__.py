"""Reading clips: whatever the format, the same type comes out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.inputs.camera_options import ClipOptions, read_camera
from imapper_prob.inputs.clip_file import read_clip, write_clip
from imapper_prob.inputs.formats import read_whatever
from imapper_prob.inputs.marks import read_marks
from imapper_prob.inputs.window import window
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip, Track

__all__ = [
    "SHORTEST_CLIP",
    "ClipOptions",
    "load_clip",
    "read_camera",
    "read_clip",
    "read_marks",
    "write_clip",
]

_SMALLEST: Final = 4.0
"""Pixels, height or width of a person: detectors place joints no better than that."""
SHORTEST_CLIP: Final = 8
"""Frames; in less than a second nobody does anything that furniture explains."""


def load_clip(
    path: str | Path,
    *,
    options: ClipOptions | None = None,
    lift: Callable[[Clip], Clip] | None = None,
    frames: tuple[int, int] | None = None,
) -> Clip:
    """Read a clip, whatever its format.

    Parameters
    ----------
    path : path
        A scene folder of the i3DB benchmark, an ``.npz`` of our own format
        (:mod:`imapper_prob.inputs.clip_file`), or anything else that ``docs/inputs.md`` lists.
    options : ClipOptions, optional
        What the files do not say: camera, image size, frame rate.
    lift : callable, optional
        Gives poses to the tracks of a clip that have none; such clips are refused without.
    frames : (int, int), optional
        First and last frame to take, by the clip's own numbers; all if not given.

    Returns
    -------
    Clip
        With at least ``SHORTEST_CLIP`` frames, one of which has both a detected joint and
        a lifted pose.

    Raises
    ------
    InputError
        What is at ``path`` is no clip, or one too short or too empty to say anything.
    """
    path = Path(path)
    clip = read_whatever(path, options or ClipOptions())
    if frames is not None:
        clip = window(clip, *frames)
    if clip.n_frames < SHORTEST_CLIP:
        raise InputError(
            f"{path}: a clip of {clip.n_frames} frames; at least {SHORTEST_CLIP} are needed"
        )
    if lift is not None and not all(track.has_pose.any() for track in clip.tracks):
        clip = lift(clip)
    for track in clip.tracks:
        if not ((track.confidences > 0).any(1) & track.has_pose).any():
            raise InputError(
                f"{path}: track {track.name} has no frame with both a detected joint and a "
                "lifted pose"
            )
        if _extent(track) < _SMALLEST:
            raise InputError(
                f"{path}: track {track.name} is {_extent(track):.1f} pixels high and wide; these "
                "are no joints of a person"
            )
    return clip


def _extent(track: Track) -> float:
    """Pixels, the larger of height and width of all joints in the median frame."""
    seen = np.where((track.confidences > 0)[..., None], track.keypoints, np.nan)
    there: NDArray[np.bool_] = np.isfinite(seen).all(-1).sum(1) > 1
    if not there.any():
        return 0.0
    size = np.nanmax(seen[there], axis=1) - np.nanmin(seen[there], axis=1)
    return float(np.median(size.max(1)))
