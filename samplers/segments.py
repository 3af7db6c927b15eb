"""Sums over all ways to cut a stretch of time into segments, and draws from them, compiled.

A segment begins at one time and ends at another; between two of them there may be free time. The
weight of a sequence is a product: of each segment's own weight, of one factor each for the first
and the last, and of one by the kinds of each two that follow one another. Where a segment begins as
the one before it ends there is one more, of that very pair.
That is a semi-Markov chain: forward sums give the sum over all sequences, and drawn backwards a
sequence has just the probability that its weight says (Murphy 2002, *Hidden semi-Markov models*;
Scott 2002, JASA 97, 337).

All kernels are in this module, for numba looks for changes in the file of a kernel only.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numba
import numpy as np
from numpy.typing import NDArray

__all__ = ["Segments", "Sums", "draw_sequence", "forward", "new_sums", "sequence_weight"]

Array = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.int64]

Function = TypeVar("Function", bound=Callable[..., Any])

_LIBERTIES = {"reassoc", "contract", "nsz"}
"""Sums may change their order, so that many factors are worked on at once; what is infinite
stays so."""


def _compiled(function: Function) -> Function:
    njit: Any = numba.njit
    result: Function = njit(cache=True, error_model="numpy", fastmath=_LIBERTIES)(function)
    return result


class Segments(NamedTuple):
    """A table of N segments of C kinds in T units of time.

    Parameters
    ----------
    start, end : (N,) int
        First unit of time and the one after the last; starts ascend.
    kind : (N,) int
    by_end : (N,) int
        The segments in order of their ends.
    starting, ending : (T + 2,) int
        Where the segments of each start begin, and in ``by_end`` those of each end.
    log_weight : (N,) float
    follow : (C, C) float
        Factor of two that follow one another, by the kinds of the earlier and of the later one.
    gap : float
        One more factor of two that follow one another with a gap.
    pairs : (T + 2,) int
        Where the factors of each time begin in ``flush``.
    flush : (P,) single
        Factor of two without a gap: for each segment of a start those of all that end there.
    """

    start: Ints
    end: Ints
    kind: Ints
    by_end: Ints
    starting: Ints
    ending: Ints
    log_weight: Array
    follow: Array
    gap: float
    pairs: Ints
    flush: Singles


class Sums(NamedTuple):
    """What the forward sums of a stretch leave for draws.

    Parameters
    ----------
    log_sum : (N,) float
        Of all sequences that end with a segment, its own weight included.
    before : (T + 1, C) float
        Sum over the sequences that ended before a time, weighted for one of a kind to follow.
    closed : (T + 1, C) float
        Sum over the sequences that end at a time, by kind of their last.
    scale : (T + 1,) float
        Log of the unit of both.
    cumulative : (N + 1,) float
        Of the sums over the sequences that end with each segment of the stretch, the factor of
        the last included; first that of no segment at all.
    """

    log_sum: Array
    before: Array
    closed: Array
    scale: Array
    cumulative: Array


def new_sums(table: Segments) -> Sums:
    """Room for the sums over a table.

    Parameters
    ----------
    table : Segments

    Returns
    -------
    Sums
    """
    n, times, kinds = len(table.start), len(table.starting) - 1, len(table.follow)
    return Sums(
        np.empty(n), np.empty((times, kinds)), np.empty((times, kinds)), np.empty(times),
        np.empty(n + 1),
    )  # fmt: skip


@_compiled
def _dot(factors: Singles, first: int, sums: Array, n: int) -> float:
    total = 0.0
    for j in range(n):
        total += factors[first + j] * sums[j]
    return total


@_compiled
def forward(
    table: Segments, begin: int, finish: int, left: Array, right: Array, nothing: float, sums: Sums
) -> float:
    """Log of the sum over all sequences in a stretch of time.

    Parameters
    ----------
    table : Segments
    begin, finish : int
        First unit of the stretch and the one after its last.
    left, right : (N,) float
        Log factors of the first and of the last segment; read within the stretch only.
    nothing : float
        Log weight of no segment at all.
    sums : Sums
        Out.

    Returns
    -------
    float
        Nats.
    """
    log_sum, scale, kinds = sums.log_sum, sums.scale, len(table.follow)
    low, high = table.starting[begin], table.starting[max(begin, finish)]
    unit = nothing
    for b in range(low, high):
        if table.end[b] <= finish:
            unit = max(unit, left[b])
    open_ = np.zeros(kinds)
    ended = np.empty(len(table.start))
    joined = np.empty((kinds, len(table.start)))
    for t in range(begin, finish + 1):
        first, last = table.ending[t], table.ending[t + 1]
        raised = unit
        for j in range(first, last):
            a = table.by_end[j]
            if table.start[a] >= begin:
                raised = max(raised, log_sum[a])
        if raised > unit:
            shrunk = math.exp(unit - raised)
            for h in range(kinds):
                open_[h] *= shrunk
            unit = raised
        scale[t] = unit
        for j in range(first, last):
            a = table.by_end[j]
            inside = table.start[a] >= begin
            ended[j - first] = math.exp(log_sum[a] - unit) if inside else 0.0
        for c in range(kinds):
            total = 0.0
            for h in range(kinds):
                total += open_[h] * table.follow[h, c]
            sums.before[t, c] = table.gap * total
            sums.closed[t, c] = 0.0
            for j in range(first, last):
                joined[c, j - first] = (
                    ended[j - first] * table.follow[table.kind[table.by_end[j]], c]
                )
        if t < finish:
            row = table.pairs[t]
            for b in range(table.starting[t], table.starting[t + 1]):
                if table.end[b] <= finish:
                    total = math.exp(left[b] - unit) + sums.before[t, table.kind[b]]
                    total += _dot(table.flush, row, joined[table.kind[b]], last - first)
                    log_sum[b] = table.log_weight[b] + unit + math.log(total)
                row += last - first
        for j in range(first, last):
            sums.closed[t, table.kind[table.by_end[j]]] += ended[j - first]
        for h in range(kinds):
            open_[h] += sums.closed[t, h]
    highest = nothing
    for b in range(low, high):
        if table.end[b] <= finish:
            highest = max(highest, log_sum[b] + right[b])
    total = math.exp(nothing - highest)
    sums.cumulative[0] = total
    for b in range(low, high):
        if table.end[b] <= finish:
            total += math.exp(log_sum[b] + right[b] - highest)
        sums.cumulative[b - low + 1] = total
    return highest + math.log(total)


@_compiled
def draw_sequence(
    table: Segments, begin: int, finish: int, left: Array, sums: Sums, uniforms: Array, out: Ints
) -> int:
    """Draw a sequence in the stretch that :func:`forward` has summed over.

    Parameters
    ----------
    table, begin, finish, left, sums
        See :func:`forward`.
    uniforms : (n,) float
        Numbers in [0, 1): one for the last segment and two for each that there can be.
    out : (m,) int
        Out: the segments in order of time.

    Returns
    -------
    int
        How many they are.
    """
    low, high = table.starting[begin], table.starting[max(begin, finish)]
    n = high - low
    goal = uniforms[0] * sums.cumulative[n]
    if goal < sums.cumulative[0]:
        return 0
    b = low + min(np.searchsorted(sums.cumulative[1 : n + 1], goal, side="right"), n - 1)
    while table.end[b] > finish:  # at the upper edge, by rounding
        b -= 1
    count, used = 0, 1
    while True:
        out[count] = b
        count += 1
        t, c = table.start[b], table.kind[b]
        total = math.exp(sums.log_sum[b] - table.log_weight[b] - sums.scale[t])
        goal = uniforms[used] * total - math.exp(left[b] - sums.scale[t])
        if goal < 0.0:
            break
        goal -= sums.before[t, c]
        if goal < 0.0:
            previous = _before_gap(table, begin, t, c, sums, uniforms[used + 1])
        else:
            previous = _flush_before(table, begin, b, sums, goal)
        used += 2
        if previous < 0:  # nothing ends before, by rounding
            break
        b = previous
    for i in range(count // 2):
        out[i], out[count - 1 - i] = out[count - 1 - i], out[i]
    return count


@_compiled
def _before_gap(table: Segments, begin: int, t: int, c: int, sums: Sums, uniform: float) -> int:
    """The last segment of a sequence that ended before ``t``; -1 if there is none."""
    goal: float = uniform * sums.before[t, c]
    chosen = -1
    for e in range(t - 1, begin, -1):
        unit = math.exp(sums.scale[e] - sums.scale[t])
        for h in range(len(table.follow)):
            part = sums.closed[e, h] * table.follow[h, c] * table.gap * unit
            if part <= 0.0:
                continue
            if goal >= part:
                goal -= part
                continue
            factor = table.follow[h, c] * table.gap * unit
            for j in range(table.ending[e], table.ending[e + 1]):
                a = table.by_end[j]
                if table.start[a] >= begin and table.kind[a] == h:
                    chosen = int(a)
                    goal -= factor * math.exp(sums.log_sum[a] - sums.scale[e])
                    if goal < 0.0:
                        return chosen
            return chosen
    return chosen


@_compiled
def _flush_before(table: Segments, begin: int, b: int, sums: Sums, goal: float) -> int:
    """The segment before ``b`` without a gap; -1 if there is none."""
    t: int = table.start[b]
    chosen: int = -1
    first, last = table.ending[t], table.ending[t + 1]
    row = table.pairs[t] + (b - table.starting[t]) * (last - first)
    for j in range(first, last):
        a = table.by_end[j]
        factor = table.flush[row + j - first] * table.follow[table.kind[a], table.kind[b]]
        if table.start[a] >= begin and factor > 0.0:
            chosen = int(a)
            goal -= factor * math.exp(sums.log_sum[a] - sums.scale[t])
            if goal < 0.0:
                break
    return chosen


@_compiled
def sequence_weight(
    table: Segments, sequence: Ints, count: int, left: Array, right: Array, nothing: float
) -> float:
    """Log weight of a sequence; less what :func:`forward` returns, its log probability.

    Parameters
    ----------
    table : Segments
    sequence : (count or more,) int
        Segments in order of time.
    count : int
    left, right, nothing
        See :func:`forward`.

    Returns
    -------
    float
    """
    if count == 0:
        return nothing
    total: float = left[sequence[0]] + right[sequence[count - 1]]
    for k in range(count):
        b = sequence[k]
        total += table.log_weight[b]
        if k == 0:
            continue
        a, t = sequence[k - 1], table.start[b]
        total += math.log(table.follow[table.kind[a], table.kind[b]])
        if table.end[a] < t:
            total += math.log(table.gap)
            continue
        first, last = table.ending[t], table.ending[t + 1]
        row = table.pairs[t] + (b - table.starting[t]) * (last - first)
        for j in range(first, last):
            if table.by_end[j] == a:
                total += math.log(np.float64(table.flush[row + j - first]))
    return total
