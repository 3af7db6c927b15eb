"""Sequences of elements of a pool: sums over all of them, and draws, compiled.

A pool holds M elements, each with a first and a last unit of time. A sequence is a subset of which
no two overlap. Its weight is the product of its elements' weights and of a factor of each two that
follow one another. That is a hidden Markov chain whose states are what the pool holds (embedded
hidden Markov models: Neal 2003; Neal, Beal & Roweis 2004): forward sums give the sum over all
sequences, and drawn backwards a sequence has just the probability that its weight says.

With a pool a chain changes many elements of its state at once. The k elements that the state has in
some region and M - k others, drawn independently from a density q, make the pool; a sequence S
of it is drawn anew with probability in proportion to

    pi(S) (M - |S|)! / M! / prod over e in S of q(e).

That leaves pi as it is: it is the conditional distribution of S in the joint one of S, the
places that its elements have in the pool, and the other elements.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

import numba
import numpy as np
from numpy.typing import NDArray

__all__ = ["draw_sequence", "log_arrangements", "sequence_weight", "sum_sequences"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Function = TypeVar("Function", bound=Callable[..., Any])


def _compiled(function: Function) -> Function:
    njit: Any = numba.njit
    result: Function = njit(cache=True, error_model="numpy")(function)
    return result


@_compiled
def log_arrangements(size: int, count: int) -> float:
    """log of M! / (M - k)!, the ways to place k elements in a pool of M.

    Parameters
    ----------
    size, count : int
        M and k.

    Returns
    -------
    float
    """
    return math.lgamma(size + 1.0) - math.lgamma(size - count + 1.0)


@_compiled
def sum_sequences(order: Ints, log_weight: Array, log_pair: Array, ending: Array) -> float:
    """Log of the sum over all sequences, the empty one with weight 1 included.

    Parameters
    ----------
    order : (M,) int
        The elements in order of their first unit of time.
    log_weight : (M,) float
        -inf for what is in no sequence.
    log_pair : (M, M) float
        Log factor of the second element right after the first; -inf where they overlap.
    ending : (M,) float
        Out: log of the sum over the sequences that end with each element.

    Returns
    -------
    float
    """
    highest, terms = 0.0, np.empty(len(order) + 1)
    for i in range(len(order)):
        b = order[i]
        ending[b] = -math.inf
        if log_weight[b] == -math.inf:
            continue
        top, n = 0.0, 1
        terms[0] = 0.0
        for j in range(i):
            value = ending[order[j]] + log_pair[order[j], b]
            if value > -math.inf:
                terms[n] = value
                top = max(top, value)
                n += 1
        total = 0.0
        for j in range(n):
            total += math.exp(terms[j] - top)
        ending[b] = log_weight[b] + top + math.log(total)
        highest = max(highest, ending[b])
    total = math.exp(-highest)
    for b in range(len(ending)):
        total += math.exp(ending[b] - highest)
    return highest + math.log(total)


@_compiled
def draw_sequence(
    order: Ints, log_pair: Array, ending: Array, total: float, uniforms: Array, out: Ints
) -> int:
    """Draw a sequence with the probability that its weight says.

    Parameters
    ----------
    order, log_pair, ending
        As :func:`sum_sequences` took and left them.
    total : float
        What it returned.
    uniforms : (n + 1,) float
        In [0, 1).
    out : (n,) int
        Out: the elements in order of time.

    Returns
    -------
    int
        How many they are; -1 where they are more than ``out`` holds.
    """
    goal, chosen = uniforms[0] - math.exp(-total), -1
    for i in range(len(order)):
        if goal < 0.0:
            break
        part = math.exp(ending[order[i]] - total)
        if part > 0.0:
            chosen = i
            goal -= part
    if chosen < 0:
        return 0
    count = 0
    while chosen >= 0:
        if count == len(out):
            return -1
        b, at = order[chosen], chosen
        out[count] = b
        count += 1
        top = 0.0
        for j in range(at):
            top = max(top, ending[order[j]] + log_pair[order[j], b])
        whole = math.exp(-top)
        for j in range(at):
            whole += math.exp(ending[order[j]] + log_pair[order[j], b] - top)
        goal, chosen = uniforms[count] * whole - math.exp(-top), -1
        for j in range(at):
            if goal < 0.0:
                break
            part = math.exp(ending[order[j]] + log_pair[order[j], b] - top)
            if part > 0.0:
                chosen = j
                goal -= part
    for i in range(count // 2):
        out[i], out[count - 1 - i] = out[count - 1 - i], out[i]
    return count


@_compiled
def sequence_weight(log_weight: Array, log_pair: Array, sequence: Ints, count: int) -> float:
    """Log weight of a sequence; less what :func:`sum_sequences` returns, its log probability.

    Parameters
    ----------
    log_weight, log_pair : (M,), (M, M) float
        See :func:`sum_sequences`.
    sequence : (n,) int
        Elements in order of time.
    count : int
        How many of them count.

    Returns
    -------
    float
    """
    total = 0.0
    for k in range(count):
        total += log_weight[sequence[k]]
        if k > 0:
            total += log_pair[sequence[k - 1], sequence[k]]
    return total
