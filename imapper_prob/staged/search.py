"""Best-first search over combinations: one member of every group, or none of it.

A combination S is scored by its members alone and two by two,

    Q(S) = sum_{c in S} gain_c + sum_{pairs in S} together_cd,

with ``together`` what a pair is worth beyond its members (-inf where it cannot be).
Combinations come out in the order of Q, the best first, and only as many as are asked for are
ever looked at.

*The bound.* Let the first groups be decided, with members S, and r_c = gain_c + sum_{d in S}
together_cd what a member c of an open group would add to S. Any completion R has

    Q(S + R) - Q(S) = sum_{c in R} r_c + sum_{pairs in R} together_cd.

Split its pairs into those of neighbouring groups and the others. A pair of the latter kind
with c in the earlier group is worth no more than max(0, max over the members d of the later
group of together_cd), and over all later groups these sum to at most o_c, whether R has
members there or not. So

    Q(S + R) <= Q(S) + max over R of [ sum_{c in R} (r_c + o_c) + sum_{neighbours in R} together ],

and the maximum on the right is over a chain of groups, which dynamic programming finds
exactly. Nothing is thus ever thrown away that could still be better than what came out: the
bound (of minus Q, a lower one) is admissible. Once all groups are decided it is Q itself, so
that whatever is taken from the queue complete is the best of all that is left.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from itertools import count

import numpy as np
from numpy.typing import NDArray

__all__ = ["best_first", "bound"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


def best_first(
    groups: Sequence[Ints], gain: Array, together: Array
) -> Iterator[tuple[tuple[int, ...], float]]:
    """All combinations that are possible, with their scores Q, the best first.

    Parameters
    ----------
    groups : sequence of (k,) int
        Members of each group, by their index in ``gain``; a combination has one or none.
    gain : (N,) float
    together : (N, N) float
        Symmetric; -inf for pairs that cannot be.

    Yields
    ------
    members : tuple of int
        In the order of the groups.
    score : float
    """
    others = _optimistic(groups, together)
    order = count()  # of equal bounds the one found first; makes the order repeatable
    queue: list[tuple[float, int, int, tuple[int, ...], float, Array]] = []

    def push(decided: int, members: tuple[int, ...], score: float, added: Array) -> None:
        best = score + bound(groups[decided:], added + others, together)
        heapq.heappush(queue, (-best, next(order), decided, members, score, added))

    push(0, (), 0.0, np.asarray(gain, float))
    while queue:
        _, _, decided, members, score, added = heapq.heappop(queue)
        if decided == len(groups):
            yield members, score
            continue
        push(decided + 1, members, score, added)
        for c in groups[decided].tolist():
            if np.isfinite(added[c]):
                push(decided + 1, (*members, c), score + float(added[c]), added + together[c])


def bound(groups: Sequence[Ints], added: Array, together: Array) -> float:
    """Most that a chain of groups can add, pairs counted between neighbours only.

    Parameters
    ----------
    groups : sequence of (k,) int
    added : (N,) float
        What each member adds by itself.
    together : (N, N) float
    """
    best = np.zeros(1)  # by what is taken of the last group; the first entry is nothing
    last = np.empty(0, dtype=np.int64)
    for group in groups:
        pairs = np.zeros((1 + len(last), 1 + len(group)))
        pairs[1:, 1:] = together[np.ix_(last, group)]
        best = (best[:, None] + pairs).max(0) + np.concatenate([[0.0], added[group]])
        last = group
    return float(best.max())


def _optimistic(groups: Sequence[Ints], together: Array) -> Array:
    """(N,) o_c: most that later groups but the next can add to a member by pairs."""
    result = np.zeros(len(together))
    for position, group in enumerate(groups):
        for later in groups[position + 2 :]:
            if len(group) and len(later):
                result[group] += together[np.ix_(group, later)].max(1).clip(min=0.0)
    return result
