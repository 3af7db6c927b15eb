"""Several takes of one room by one camera, as one clip.

Furniture and camera do not move between takes, so one take can resolve what another leaves
ambiguous. The people of each take become tracks of the clip that begin at its first frame; after
the end of a shorter take they are unobserved. The model does not use real time: people of different
takes do not interact, even in the same frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np

from imapper_prob.models.camera import Camera
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.skeleton import N_JOINTS

__all__ = ["same_room"]


def same_room(takes: Sequence[Clip]) -> Clip:
    """Combine takes of one room into one clip, for `solve` and `sample`.

    Parameters
    ----------
    takes : sequence of Clip
        With the same camera and frame rate.

    Returns
    -------
    Clip
        As long as the longest take, with frames numbered from 0 and the people of all takes, named
        by take, without ground truth. A single take is returned unchanged.

    Raises
    ------
    InputError
        There are no takes, or cameras or frame rates differ.

    Examples
    --------
    >>> together = im.same_room([im.demo_clip(), im.demo_clip(seed=4)])
    >>> [track.name for track in together.tracks]
    ['demo', 'demo (2)']
    """
    if not isinstance(takes, Sequence) or not all(isinstance(take, Clip) for take in takes):
        raise InputError(f"clip = {takes!r:.60} must be a Clip, or several; read it with load_clip")
    if not takes:
        raise InputError("no take of a room is given")
    first = takes[0]
    if len(takes) == 1:
        return first
    for other in takes[1:]:
        _require_same(first, other)
    n_frames = max(take.n_frames for take in takes)
    tracks = [_as_long(track, n_frames) for take in takes for track in take.tracks]
    return Clip(
        name=" + ".join(dict.fromkeys(take.name for take in takes)),
        camera=first.camera,
        fps=first.fps,
        frame_ids=np.arange(n_frames),
        tracks=tuple(
            replace(track, name=name) for track, name in zip(tracks, _names(takes), strict=True)
        ),
        focal_spread=first.focal_spread,
    )


def _require_same(first: Clip, other: Clip) -> None:
    pair = f"takes {first.name} and {other.name}"
    for one in fields(Camera):
        values = [getattr(take.camera, one.name) for take in (first, other)]
        if values[0] != values[1]:
            raise InputError(
                f"{pair}: their cameras differ, {one.name} is {values[0]:g} and {values[1]:g}; "
                "takes of one room are by one camera that does not move; repeat `detect` or "
                "`track` with the same --camera or --focal"
            )
    for name, word in (("fps", "frames a second"), ("focal_spread", "as focal spread")):
        values = [getattr(take, name) for take in (first, other)]
        if values[0] != values[1]:
            raise InputError(
                f"{pair}: {values[0]:g} and {values[1]:g} {word}; say what both have, with --fps "
                "or --focal-spread of the command that reads them, or of `detect` or `track`"
            )


def _as_long(track: Track, n_frames: int) -> Track:
    """The track extended to ``n_frames`` by frames in which nobody is observed."""
    more = n_frames - len(track.keypoints)
    if not more:
        return track
    return replace(
        track,
        keypoints=np.concatenate([track.keypoints, np.full((more, N_JOINTS, 2), np.nan)]),
        confidences=np.concatenate([track.confidences, np.zeros((more, N_JOINTS))]),
        poses=np.concatenate([track.poses, np.full((more, N_JOINTS, 3), np.nan)]),
        interpolated=np.concatenate([track.interpolated, np.zeros(more, bool)]),
    )


def _names(takes: Sequence[Clip]) -> list[str]:
    """A unique name for each track: that of its take, and of the person if the take has several."""
    names: list[str] = []
    for take in takes:
        for track in take.tracks:
            alone = len(take.tracks) == 1
            name = take.name if alone else f"{take.name} {track.name}"
            number = 1
            while (name if number == 1 else f"{name} ({number})") in names:
                number += 1
            names.append(name if number == 1 else f"{name} ({number})")
    return names
