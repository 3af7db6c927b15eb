"""Where to cut a long motion: clips of equal way, closer together where somebody stays.

Monszpart et al. (2019, section 4) cut where the pelvis has gone a constant way in top view,
after smoothing away what a standing person sways. Of the length of the way and of the
distance between clips the paper says nothing. Taken literally, the rule passes over people
who stay: in the truth of four i3DB scenes a metre of way takes 13 to 16 frames (1.5 s) of
walking, as published, but 29 to 42 (3 to 4 s) of sitting, all of a stay with the ways
to it and from it. So a clip ends after a second on either side even if the way is shorter, and
clips are centred at least every second. Several clips of one stay then count as one by their
weights.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["CutSettings", "cut", "smooth_path", "stretches"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class CutSettings:
    """How motion is cut.

    Parameters
    ----------
    way : float
        Metres of pelvis path in a clip. In i3DB 1 m gives the 14-20 frames that the paper's
        clips have.
    way_between : float
        Metres between the centres of clips: four clips share each place of a walk.
    longest : float
        Seconds a clip lasts at most, which is what the longest of the paper's do.
    time_between : float
        Most seconds between the centres of clips.
    shortest : float
        Seconds a clip lasts at least; a metre of quick walking. What is shorter was cut off
        by the end of the tracking, or is a jump of the tracker.
    smoothing_radius : float
        Metres of way on either side over which a point of the path is averaged (paper).
    smoothing_passes : int
        Times it is averaged (paper).
    """

    way: float = 1.0
    way_between: float = 0.25
    longest: float = 2.0
    time_between: float = 1.0
    shortest: float = 0.6
    smoothing_radius: float = 0.01
    smoothing_passes: int = 10


def smooth_path(path: ArrayLike, *, radius: float, passes: int) -> Array:
    """A path (n, 2) averaged over the points within ``radius`` of way, ``passes`` times.

    Steps longer than the radius stay as they are, and the trembling of somebody who stands
    is averaged away.
    """
    smooth: Array = np.asarray(path, float)
    for _ in range(passes):
        way = _way(smooth)
        first = np.searchsorted(way, way - radius, "left")
        last = np.searchsorted(way, way + radius, "right")
        sums = np.concatenate([np.zeros((1, 2)), np.cumsum(smooth, 0)])
        smooth = (sums[last] - sums[first]) / (last - first)[:, None]
    return smooth


def cut(path: ArrayLike, *, fps: float, settings: CutSettings) -> Ints:
    """Clips of one uninterrupted motion.

    Parameters
    ----------
    path : (n, 2) float
        Pelvis in top view, metres, regular frames.
    fps : float
        Frames a second.
    settings : CutSettings

    Returns
    -------
    (C, 2) int
        First frame of each clip and the one after its last, in order, each clip once; none
        if the motion is too short.
    """
    path = np.asarray(path, float)
    if len(path) < 2:
        return np.empty((0, 2), dtype=np.int64)
    way = _way(
        smooth_path(path, radius=settings.smoothing_radius, passes=settings.smoothing_passes)
    )
    # A centre wherever the next step of way or of time is done, whichever comes first.
    hurry = np.maximum(np.diff(way) / settings.way_between, 1.0 / fps / settings.time_between)
    progress = np.concatenate([[0.0], np.cumsum(hurry)])
    # Sums of tenths are a hair off: a centre due in a frame is not to slip into the next.
    centres = np.searchsorted(progress + 1e-9, np.arange(0.5, progress[-1]))
    half = round(settings.longest / 2 * fps)
    first = np.searchsorted(way, way[centres] - settings.way / 2 - 1e-9, "left")
    end = np.searchsorted(way, way[centres] + settings.way / 2 + 1e-9, "right")
    clips = np.stack([np.maximum(first, centres - half), np.minimum(end, centres + half + 1)], 1)
    lasting = clips[:, 1] - clips[:, 0] > settings.shortest * fps - 1e-9
    unique: Ints = np.unique(clips[lasting], axis=0)
    return unique


def stretches(there: ArrayLike) -> Ints:
    """(S, 2) first index and the one after the last of each run of true values (n,)."""
    flags = np.concatenate([[False], np.asarray(there, bool), [False]])
    edges: Ints = np.flatnonzero(flags[1:] != flags[:-1]).reshape(-1, 2)
    return edges


def _way(path: Array) -> Array:
    """(n,) way gone until each point, metres."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
