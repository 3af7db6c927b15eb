"""What a user knows of who is who: a small JSON of marks.

::

    {"actors": ["anna", "ben"],
     "marks": [{"frame": 0, "at": [412, 300], "actor": "anna"},
               {"frame": 0, "at": [880, 310], "actor": "ben"}]}

``at`` is a pixel on the person: the skeleton nearest to it in that frame, by its joints, belongs
to the actor. All other skeletons follow from these.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.inputs.json_fields import field, load_json, numbers
from imapper_prob.models.errors import InputError

__all__ = ["Mark", "Marks", "read_marks", "rows_of_marks"]

Array = NDArray[np.float64]

_FARTHEST: Final = 0.5
"""Share of a body's extent that a mark may lie away from the body's nearest joint."""
_MOST: Final = 16
"""Actors; a program of whole numbers with more takes minutes."""


@dataclass(frozen=True)
class Mark:
    """Somebody who was recognised.

    Parameters
    ----------
    frame : int
        The input's own number.
    at : (2,) float
        Pixel.
    actor : int
        Index of the actor.
    """

    frame: int
    at: Array
    actor: int


@dataclass(frozen=True)
class Marks:
    """Parameters
    ----------
    actors : tuple of str
        Names of all actors.
    marks : tuple of Mark
        May be empty: then only the number and names of the actors are known.
    """

    actors: tuple[str, ...]
    marks: tuple[Mark, ...]


def read_marks(path: str | Path) -> Marks:
    """Read a file of marks.

    Raises
    ------
    InputError
        It is damaged, or a mark names somebody who is not among the actors.
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
    """The marked rows, and whose they are.

    Parameters
    ----------
    marks : Marks
    frames : (N,) int
        When each skeleton was seen.
    keypoints : (N, 16, 2) float
        Pixels; NaN where missing.

    Raises
    ------
    InputError
        There is nobody at a mark, or two actors are marked on one skeleton.
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
    """Distance of a point from the nearest joint, as a share of the body's extent."""
    seen = joints[np.isfinite(joints).all(-1)]
    if not len(seen):
        return np.inf
    extent = max(float(np.linalg.norm(np.ptp(seen, axis=0))), 1.0)
    return float(np.linalg.norm(seen - at, axis=-1).min()) / extent
