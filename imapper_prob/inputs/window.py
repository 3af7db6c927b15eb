"""A part of a clip."""

from __future__ import annotations

from dataclasses import replace

from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip, Track

__all__ = ["window"]


def window(clip: Clip, first: int, last: int) -> Clip:
    """The frames of a clip from one to another, both included, without its truth.

    Parameters
    ----------
    clip : Clip
    first, last : int
        The clip's own numbers of frames.

    Raises
    ------
    InputError
        If they are not of the clip.
    """
    start, end = int(clip.frame_ids[0]), int(clip.frame_ids[-1])
    if not start <= first <= last <= end:
        raise InputError(f"clip {clip.name}: no frames {first} to {last}; it has {start} to {end}")
    part = slice(first - start, last - start + 1)
    tracks = tuple(
        Track(
            name=t.name,
            keypoints=t.keypoints[part],
            confidences=t.confidences[part],
            poses=t.poses[part],
            interpolated=t.interpolated[part],
        )
        for t in clip.tracks
    )
    return replace(clip, frame_ids=clip.frame_ids[part], tracks=tracks, truth=None)
