"""The paper's association of skeletons with actors, solved exactly.

Every actor takes exactly one skeleton or nothing in each frame, every skeleton belongs to at
most one actor (Monszpart et al. 2019 print the two quantifiers the other way round, and
subtract a unary term that carries a minus already, which would prefer unsure skeletons). With
``c`` the mean confidence of a skeleton and ``d`` the distance of two that follow each other,
actors are chosen to minimise

    sum over skeletons (1 - c)  +  sum over successions d  +  ABSENT x frames without skeleton.

An actor is a path through time, so this is a flow of least cost, and its optimum is found. A
succession may leave out frames: whoever comes back is recognised by where they were. The costs that
the paper prints are in :mod:`imapper_prob.tracking.paper_costs`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.errors import InputError
from imapper_prob.tracking.distances import distances
from imapper_prob.tracking.flow import Network, cheapest_paths
from imapper_prob.tracking.paper_costs import published_network

__all__ = ["ABSENT", "associate", "people_in"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

ABSENT: Final = 1.2
"""Cost of a frame without a skeleton: a little more than the least confident one has, so that
nobody is left out for being unsure, only for being somewhere else."""
_STRANGER: Final = 4.0
"""Cost of coming back as somebody else, as it were: after long absence or from far away. Must
be less than what two exchanged actors cost, and more than any true step."""
_MOST_GAP: Final = 45
"""Frames of absence after which where somebody was says nothing any more: 1.5 s at 30 a second."""
_MOST_LINKS: Final = 300_000
"""Successions that are considered; with more skeletons, shorter absences are bridged."""
_REGULARLY: Final = 0.25
"""Share of frames in which a person must be there to be counted."""


def people_in(frames: Ints) -> int:
    """How many people there are: the most that are there in a quarter of the frames."""
    _, counts = np.unique(frames, return_counts=True)
    return max(1, int(np.quantile(counts, 1 - _REGULARLY, method="lower")))


def associate(
    frames: Ints,
    keypoints: Array,
    confidences: Array,
    *,
    people: int | None = None,
    marks: Mapping[int, int] | None = None,
    half_diagonal: float | None = None,
) -> list[Ints]:
    """The rows of each actor.

    Parameters
    ----------
    frames : (N,) int
        When each skeleton was seen.
    keypoints : (N, 16, 2) float
        Pixels; NaN where missing.
    confidences : (N, 16) float
        0 where missing.
    people : int, optional
        Number of actors; :func:`people_in` if not given, and not fewer than are marked.
    marks : mapping of int to int, optional
        Rows that are known to be of a certain actor.
    half_diagonal : float, optional
        Of the image, pixels. If given, costs are those that the paper prints
        (:mod:`imapper_prob.tracking.paper_costs`).

    Returns
    -------
    list of (n,) int
        For each actor its rows, in order of time; the first begins earliest unless there
        are marks. Actors who take none are left out, unless marked.

    Raises
    ------
    InputError
        If marks contradict each other.
    """
    frames = np.asarray(frames, np.int64)
    marks = dict(marks or {})
    _check(frames, marks)
    wanted = people if people is not None else people_in(frames)
    actors = max(wanted, max(marks.values(), default=-1) + 1)
    alone = len(np.unique(frames)) == len(frames)
    if alone and actors == 1:
        return [np.argsort(frames, kind="stable")]
    order = np.argsort(frames, kind="stable")
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    found = _solve(
        frames[order],
        keypoints[order],
        confidences[order],
        actors,
        {int(place[row]): actor for row, actor in marks.items()},
        half_diagonal,
    )
    rows = [order[own] for own in found]
    if marks:
        return rows
    return sorted((r for r in rows if len(r)), key=lambda r: (frames[r[0]], r[0]))


def _check(frames: Ints, marks: Mapping[int, int]) -> None:
    seen: dict[tuple[int, int], int] = {}
    for row, actor in marks.items():
        when = (int(frames[row]), actor)
        if when in seen:
            raise InputError(f"frame {when[0]}: actor {actor} is marked twice")
        seen[when] = row


def _solve(
    frames: Ints,
    keypoints: Array,
    confidences: Array,
    actors: int,
    marks: Mapping[int, int],
    half_diagonal: float | None,
) -> list[Ints]:
    """Rows, sorted by frame, of each actor."""
    network = (
        _network(frames, keypoints, confidences)
        if half_diagonal is None
        else published_network(frames, keypoints, confidences, half_diagonal=half_diagonal)
    )
    return cheapest_paths(network, actors, passing=marks)


def _network(frames: Ints, keypoints: Array, confidences: Array) -> Network:
    """Our costs; rows are sorted by frame."""
    n, first, last = len(frames), frames[0], frames[-1]
    before, after = _links(frames)
    gap = frames[after] - frames[before]
    step = distances(keypoints, confidences, before, after) / np.sqrt(gap)
    near = step < _STRANGER
    before, after, gap, step = before[near], after[near], gap[near], step[near]

    # Nodes: arrival and departure of each row, "nobody" in each frame, beginning and end.
    times = last - first + 1
    arrive, depart = np.arange(n), n + np.arange(n)
    nobody, begin = 2 * n + np.arange(times), 2 * n + times
    end = begin + 1
    at = frames - first
    left, came = at < times - 1, at > 0
    half = _STRANGER / 2
    edges: list[tuple[Ints, Ints, Array]] = [
        (arrive, depart, 1 - _mean_confidence(confidences)),
        (depart[before], arrive[after], step + ABSENT * (gap - 1)),
        (np.full(n, begin), arrive, ABSENT * at),
        (depart, np.full(n, end), ABSENT * (times - 1.0 - at)),
        (depart[left], nobody[at[left] + 1], np.full(left.sum(), half + ABSENT)),
        (nobody[:-1], nobody[1:], np.full(times - 1, ABSENT)),
        (nobody[at[came] - 1], arrive[came], np.full(came.sum(), half)),
        (np.array([begin]), np.array([end]), np.array([ABSENT * times])),
    ]
    tail, head, cost = (np.concatenate(part) for part in zip(*edges, strict=True))
    return Network(tail=tail, head=head, cost=cost, begin=int(begin), end=int(end), single=n)


def _links(frames: Ints) -> tuple[Ints, Ints]:
    """Pairs of rows that may follow each other directly; rows are sorted by frame."""
    low = np.searchsorted(frames, frames, side="right")
    reach = _MOST_GAP
    while True:
        counts = np.searchsorted(frames, frames + reach, side="right") - low
        if counts.sum() <= _MOST_LINKS or reach == 1:
            break
        reach //= 2
    before = np.repeat(np.arange(len(frames)), counts)
    offset = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    return before, low[before] + offset


def _mean_confidence(confidences: Array) -> Array:
    there = confidences > 0
    result: Array = np.where(there, confidences, 0).sum(1) / np.maximum(there.sum(1), 1)
    return result
