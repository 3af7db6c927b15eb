"""Several people's frames one after the other, and how to take them apart again.

Whatever is known by frame of a clip of K people has K T rows: all frames of the first track, then
all of the next.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import Clip, Track

__all__ = ["at_one_time", "by_person", "everybody", "in_a_row", "names_of_rows", "own_part"]

Values = NDArray[Any]


def by_person(clip: Clip, values: Values) -> Values:
    """Values by row, apart by person.

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
    """Values by row, put together for everybody in a frame.

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
    """Numbers of the rows, those of the first person being the clip's frame numbers.

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
    """Whose row each is.

    Parameters
    ----------
    clip : Clip

    Returns
    -------
    (K T,) str
    """
    return np.repeat(np.array([track.name for track in clip.tracks], np.str_), clip.n_frames)


def everybody(clip: Clip) -> Track:
    """All tracks in a row as one.

    Parameters
    ----------
    clip : Clip

    Returns
    -------
    Track
        Of K T frames.
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
    """What names of things of one person end in: nothing where there is nobody else.

    Parameters
    ----------
    clip : Clip
    person : int
        Number of the track.

    Returns
    -------
    str
    """
    return f" {clip.tracks[person].name}" if len(clip.tracks) > 1 else ""
