"""Arrays with the frames of several people in one axis, and how to split them.

For a clip of K people, per-frame values have K T rows: all frames of the first track, then all
frames of the next.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import Clip, Track

__all__ = ["at_one_time", "by_person", "everybody", "in_a_row", "names_of_rows", "own_part"]

Values = NDArray[Any]


def by_person(clip: Clip, values: Values) -> Values:
    """Reshape values by row to one axis of people and one of frames.

    Parameters
    ----------
    clip : Clip
    values : (K T, ...) array

    Returns
    -------
    (K, T, ...) array
    """
    return values.reshape(-1, clip.n_frames, *values.shape[1:])


def at_one_time(clip: Clip, values: Values) -> Values:
    """Reshape values by row so that each frame has the joints of all people.

    Parameters
    ----------
    clip : Clip
    values : (K T, J, ...) array

    Returns
    -------
    (T, K J, ...) array
    """
    people = np.moveaxis(by_person(clip, values), 0, 1)
    return people.reshape(clip.n_frames, -1, *values.shape[2:])


def in_a_row(clip: Clip) -> NDArray[np.int64]:
    """Row numbers that start at the clip's first frame number and continue over all people.

    Parameters
    ----------
    clip : Clip

    Returns
    -------
    (K T,) int
    """
    numbers = np.arange(len(clip.tracks) * clip.n_frames, dtype=np.int64)
    return numbers + int(clip.frame_ids[0])


def names_of_rows(clip: Clip) -> NDArray[np.str_]:
    """Track name of each row.

    Parameters
    ----------
    clip : Clip

    Returns
    -------
    (K T,) str
    """
    return np.repeat(np.array([track.name for track in clip.tracks], np.str_), clip.n_frames)


def everybody(clip: Clip) -> Track:
    """All tracks of a clip concatenated to one.

    Parameters
    ----------
    clip : Clip

    Returns
    -------
    Track
        Has K T frames.
    """
    tracks = clip.tracks
    if len(tracks) == 1:
        return tracks[0]
    return Track(
        name=", ".join(track.name for track in tracks),
        keypoints=np.concatenate([track.keypoints for track in tracks]),
        confidences=np.concatenate([track.confidences for track in tracks]),
        poses=np.concatenate([track.poses for track in tracks]),
        interpolated=np.concatenate([track.interpolated for track in tracks]),
    )


def own_part(clip: Clip, person: int) -> str:
    """Ending for names of one person's entities; empty if the clip has one person.

    Parameters
    ----------
    clip : Clip
    person : int
        Index of the track.

    Returns
    -------
    str
    """
    return f" {clip.tracks[person].name}" if len(clip.tracks) > 1 else ""
