"""Reading clips: whatever the format, the same type comes out."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from imapper_prob.inputs.clip_file import read_clip, write_clip
from imapper_prob.inputs.i3db import DETECTIONS, read_i3db
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip

__all__ = ["SHORTEST_CLIP", "load_clip", "read_clip", "write_clip"]

SHORTEST_CLIP: Final = 8
"""Frames; in less than a second nobody does anything that furniture explains."""


def load_clip(path: str | Path) -> Clip:
    """Read a clip, whatever its format.

    Parameters
    ----------
    path : path
        A scene folder of the i3DB benchmark, or an ``.npz`` of our own format
        (:mod:`imapper_prob.inputs.clip_file`).

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
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    if path.is_dir() and any(path.glob(DETECTIONS)):
        clip = read_i3db(path)
    elif path.is_file() and path.suffix == ".npz":
        clip = read_clip(path)
    else:
        raise InputError(
            f"{path}: not a known clip; expected an i3DB scene folder (with {DETECTIONS}) "
            "or an .npz clip file"
        )
    if clip.n_frames < SHORTEST_CLIP:
        raise InputError(
            f"{path}: a clip of {clip.n_frames} frames; at least {SHORTEST_CLIP} are needed"
        )
    for track in clip.tracks:
        if not ((track.confidences > 0).any(1) & track.has_pose).any():
            raise InputError(
                f"{path}: track {track.name} has no frame with both a detected joint and a "
                "lifted pose"
            )
    return clip
