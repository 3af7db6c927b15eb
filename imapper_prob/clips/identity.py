"""Identity marks given by a user, and a figure of the tracks.

::

    {"actors": ["anna", "ben"],
     "marks": [{"frame": 0, "at": [412, 300], "actor": "anna"},
               {"frame": 0, "at": [880, 310], "actor": "ben"}]}

``at`` is a pixel on a person. In that frame the skeleton with the joint nearest to it belongs to
the named actor. The other skeletons are associated by :mod:`imapper_prob.clips.tracking`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.clips.parsing import field, load_json, numbers
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.skeleton import BONES, LHIP, LSHO, RHIP, RSHO

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Mark", "Marks", "read_marks", "rows_of_marks", "track_figure"]

Array = NDArray[np.float64]
_FARTHEST: Final = 0.5
"""Greatest distance of a mark from the nearest joint, as a fraction of the body's extent."""
_MOST: Final = 16
"""Greatest number of actors; with more, the integer program takes minutes."""


@dataclass(frozen=True)
class Mark:
    """A person identified in one frame.

    Parameters
    ----------
    frame : int
        Frame number of the input.
    at : (2,) float
        Position in pixels.
    actor : int
        Index of the actor.
    """

    frame: int
    at: Array
    actor: int


@dataclass(frozen=True)
class Marks:
    """The user's marks of who is who in some frames.

    Parameters
    ----------
    actors : tuple of str
        Names of all actors.
    marks : tuple of Mark
        May be empty; then only the number and names of the actors are known.
    """

    actors: tuple[str, ...]
    marks: tuple[Mark, ...]


def read_marks(path: str | Path) -> Marks:
    """Read a file of marks.

    Parameters
    ----------
    path : path

    Returns
    -------
    Marks

    Raises
    ------
    InputError
        The file is damaged, or a mark names somebody who is not among the actors.
    """
    path = Path(path)
    data = load_json(path)
    actors = field(path, data, "actors")
    named = isinstance(actors, list) and all(isinstance(a, str) and a for a in actors)
    if not (named and 0 < len(actors) <= _MOST and len(set(actors)) == len(actors)):
        raise InputError(f"{path}: 'actors' must be 1 to {_MOST} different names")
    listed = field(path, data, "marks")
    if not isinstance(listed, list):
        raise InputError(f"{path}: 'marks' must be a list")
    return Marks(tuple(actors), tuple(_mark(path, i, m, actors) for i, m in enumerate(listed)))


def _mark(path: Path, index: int, data: Any, actors: list[str]) -> Mark:
    place = f"{path}: mark {index}"
    frame, actor = field(path, data, "frame"), field(path, data, "actor")
    if type(frame) is not int:
        raise InputError(f"{place}: frame {str(frame)[:40]!r} is no whole number")
    if actor not in actors:
        raise InputError(f"{place}: {str(actor)[:40]!r} is not among the actors")
    at = numbers(field(path, data, "at"), shape=(2,), place=f"{place}, at")
    return Mark(frame, at, actors.index(actor))


def rows_of_marks(marks: Marks, frames: NDArray[np.int64], keypoints: Array) -> dict[int, int]:
    """The skeleton rows that the marks refer to, and their actors.

    Parameters
    ----------
    marks : Marks
    frames : (N,) int
        Frame number of each skeleton.
    keypoints : (N, 16, 2) float
        Pixels; NaN where missing.

    Returns
    -------
    dict of int to int
        Index of the actor by row.

    Raises
    ------
    InputError
        There is nobody at a mark, or one skeleton is marked as two actors.
    """
    rows: dict[int, int] = {}
    for mark in marks.marks:
        where = f"frame {mark.frame}, {mark.at[0]:.0f}, {mark.at[1]:.0f}"
        there = np.flatnonzero(frames == mark.frame)
        near = {int(row): _away(keypoints[row], mark.at) for row in there}
        row = min(near, key=lambda r: near[r], default=-1)
        if row < 0 or near[row] > _FARTHEST:
            raise InputError(f"{where}: there is nobody at this mark")
        if rows.get(row, mark.actor) != mark.actor:
            names = f"{marks.actors[rows[row]]} and {marks.actors[mark.actor]}"
            raise InputError(f"{where}: both {names} are marked on one skeleton")
        rows[row] = mark.actor
    return rows


def _away(joints: Array, at: Array) -> float:
    """Distance of a point from the nearest joint, as a fraction of the body's extent."""
    seen = joints[np.isfinite(joints).all(-1)]
    if not len(seen):
        return np.inf
    extent = max(float(np.linalg.norm(np.ptp(seen, axis=0))), 1.0)
    return float(np.linalg.norm(seen - at, axis=-1).min()) / extent


# ------------------------------------------------------------------------------------------------
# Figures of tracks.

_COLOURS: Final = ("#4e79a7", "#f28e2b", "#59a14f", "#e15759", "#b07aa1", "#76b7b2", "#9c755f")
"""Colours of Tableau 10, distinguishable for most colour-blind readers."""
_FIGURES: Final = 5
"""Number of skeletons drawn of each person, evenly spaced over their frames."""


def track_figure(clip: Clip) -> Figure:
    """Draw the tracks of a clip: the image plane at the top, time below.

    Parameters
    ----------
    clip : Clip

    Returns
    -------
    matplotlib.figure.Figure
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 7), layout="constrained")
    image, time = figure.subplots(2, 1, height_ratios=(5, 1))
    for index, track in enumerate(clip.tracks):
        colour = _COLOURS[index % len(_COLOURS)]
        _draw(image, track, colour)
        seen = (track.confidences > 0).sum(1)
        frames = clip.frame_ids[seen > 0]
        time.scatter(frames, np.full(len(frames), index), s=6, marker="|", color=colour)
    image.set(
        xlim=(0, clip.camera.width), ylim=(clip.camera.height, 0), aspect="equal", title=clip.name
    )
    image.legend(loc="upper right", frameon=False)
    time.set(
        yticks=range(len(clip.tracks)),
        yticklabels=[track.name for track in clip.tracks],
        ylim=(len(clip.tracks) - 0.5, -0.5),
        xlabel="frame",
    )
    return figure


def _draw(axes: Axes, track: Track, colour: str) -> None:
    """Draw the path of the trunk, and a few skeletons along it."""
    there = track.confidences[:, [RHIP, LHIP, RSHO, LSHO]].min(1) > 0
    trunk = track.keypoints[:, [RHIP, LHIP, RSHO, LSHO]].mean(1)
    axes.plot(*np.where(there[:, None], trunk, np.nan).T, color=colour, lw=1.5, label=track.name)
    frames = np.flatnonzero(there)
    if not len(frames):
        return
    for frame in frames[np.linspace(0, len(frames) - 1, _FIGURES).astype(int)]:
        for bone in BONES:
            ends = track.keypoints[frame, list(bone)]
            axes.plot(*ends.T, color=colour, lw=1, alpha=0.5)
