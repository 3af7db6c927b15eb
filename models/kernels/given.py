"""The likelihood of all statements about a scene (docs/explanation/model.md 25 to 34).

Statements are flat rows of a problem, packed by :mod:`imapper_prob.models.statement_rows`; the term
of each kind is in :mod:`imapper_prob.models.kernels.statement_terms`. Without statements no kernel
of this module is called.

A seat is what its scenelet says, or a seat of any kind by chance. For each row of labels that a
statement has, every piece has *shares* of these cases: their probabilities, of which the true label
is one of those of the row. The sum of a piece's shares is the probability that its label is.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled, inner
from imapper_prob.models.kernels.axes import rotated, rotated_back
from imapper_prob.models.kernels.cache import Cache, Evaluator
from imapper_prob.models.kernels.intersection import overlap_depth
from imapper_prob.models.kernels.statement_terms import PIECE, statement_term
from imapper_prob.models.problem import Problem

__all__ = ["set_shares", "sum_given", "weigh_labels"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@inner
def _gather_pieces(
    problem: Problem, cache: Cache, n: int, pieces: Array, rotations: Array, owners: Ints
) -> Ints:
    """Find the objects of a proposal; an object that occurs in several scenelets counts once.

    Two objects are the same if they have one label, overlap on the floor, and have about the same
    yaw (unless the label has no front). The first in time is kept.

    Parameters
    ----------
    problem, cache, n
        See :func:`sum_given`.
    pieces : (K, 7) float
        Output: bounding boxes in the world frame, see :data:`PIECE`.
    rotations : (K, 2) float
        Output: cosine and sine of their yaws.
    owners : (B,) int
        Output: index of the object of each box in the cache; -1 for unused boxes.

    Returns
    -------
    (k,) int
        Categories of the k objects; the first k rows of ``pieces`` are filled.
    """
    size, merges = len(cache.boxes) // len(cache.counts), math.cos(problem.merge_angle)
    labels, count = np.empty(len(pieces), np.int64), 0
    low, high = np.empty(3), np.empty(3)
    for i in range(n):
        slot = cache.slots[1, i]
        first = problem.box_first[cache.items[slot, 0]]
        b, first_new = 0, count
        while b < cache.counts[slot]:
            own, begins = problem.box_object[first + b], b
            k = slot * size + b
            yaw = cache.yaws[k]
            c, s = math.cos(yaw), math.sin(yaw)
            low[:], high[:] = math.inf, -math.inf
            while b < cache.counts[slot] and problem.box_object[first + b] == own:
                box = cache.boxes[slot * size + b]
                at_x, at_y = rotated_back(c, s, box[0], box[1])
                low[0], high[0] = min(low[0], at_x - box[3]), max(high[0], at_x + box[3])
                low[1], high[1] = min(low[1], at_y - box[4]), max(high[1], at_y + box[4])
                low[2], high[2] = min(low[2], box[2] - box[5]), max(high[2], box[2] + box[5])
                b += 1
            piece, turn = pieces[count], rotations[count]
            mid_x, mid_y = 0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])
            piece[0], piece[1] = rotated(c, s, mid_x, mid_y)
            piece[2] = 0.5 * (low[2] + high[2])
            for a in range(3):
                piece[3 + a] = 0.5 * (high[a] - low[a])
            piece[6], turn[0], turn[1] = yaw, c, s
            labels[count] = cache.labels[k]
            met = count
            for j in range(first_new):
                if met == count and labels[j] == labels[count]:
                    front = problem.label_front[labels[j]]
                    alike = not front or math.cos(pieces[j, 6] - yaw) > merges
                    if alike and overlap_depth(pieces[j], rotations[j], piece, turn) > 0.0:
                        met = j
            owners[slot * size + begins : slot * size + b] = met
            if met == count:
                count += 1
    return labels[:count]


@compiled
def set_shares(chance: Array, said: Array, label: int, shares: Array) -> None:
    """Probabilities of the cases in which a piece has one of some labels.

    Parameters
    ----------
    chance : (C,) float
        ``label_chance`` of a problem.
    said : (C,) float
        1 for the labels in question, else 0; or the probability of a detected label given each.
    label : int
        Category of the piece in its scenelet.
    shares : (1 + C,) float
        Output: that it is what its scenelet says, or a seat of each category by chance, times
        ``said`` of its category.
    """
    shares[:] = 0.0
    shares[0] = said[label]
    if chance[label] > 0.0:
        shares[0] *= 1.0 - chance.sum()
        for kind in range(len(chance)):
            shares[1 + kind] = chance[kind] * said[kind]


@inner
def _all_shares(problem: Problem, labels: Ints) -> Array:
    """(Q, k, 1 + C) shares of each piece in each row of labels."""
    rows = problem.given_labels
    shares = np.empty((len(rows), len(labels), 1 + rows.shape[1]))
    for row in range(len(rows)):
        for k in range(len(labels)):
            set_shares(problem.label_chance, rows[row], labels[k], shares[row, k])
    return shares


@inner
def _gather(problem: Problem, cache: Cache, n: int) -> tuple[Array, Array, Ints, Ints, Array]:
    """Boxes, rotations and categories of a proposal's objects, owners of boxes, and shares."""
    most = 0
    for i in range(n):
        most += cache.counts[cache.slots[1, i]]
    pieces, rotations = np.empty((most, PIECE)), np.empty((most, 2))
    owners = np.full(len(cache.boxes), -1, np.int64)
    labels = _gather_pieces(problem, cache, n, pieces, rotations, owners)
    count = len(labels)
    return pieces[:count], rotations[:count], labels, owners, _all_shares(problem, labels)


@inner
def sum_given(problem: Problem, cache: Cache, n: int, camera: Array) -> float:
    """The log-likelihood of all statements, each raised to its power, nats.

    Parameters
    ----------
    problem : Problem
    cache : Cache
        With the proposal's furniture and joints.
    n : int
        Number of scenelets of the proposal.
    camera : (5,) float

    Returns
    -------
    float
    """
    total = 0.0
    pieces, rotations, _, owners, shares = _gather(problem, cache, n)
    for s in range(len(problem.given)):
        value = statement_term(problem, cache, n, camera, s, pieces, rotations, owners, shares)
        total += problem.given_power[s] * value
    return total


@compiled
def weigh_labels(evaluator: Evaluator, n: int, camera: Array) -> tuple[Array, Ints, Array]:
    """Log-likelihood of all statements and each true label that a piece may have.

    Parameters
    ----------
    evaluator : Evaluator
        Its last proposal is the state.
    n : int
        Number of scenelets of the state.
    camera : (5,) float

    Returns
    -------
    pieces : (k, 7) float
        Bounding boxes of the state's objects, see :data:`PIECE`.
    labels : (k,) int
        Their categories in the scenelets.
    values : (k, C) float
        Nats, up to a constant; -inf for labels that the piece cannot have. The labels of all other
        pieces are summed out.
    """
    problem, cache = evaluator.problem, evaluator.cache
    pieces, rotations, labels, owners, shares = _gather(problem, cache, n)
    chance, rows = problem.label_chance, problem.given_labels
    values = np.full((len(labels), len(chance)), -math.inf)
    only, cases = np.empty(len(chance)), np.empty(1 + len(chance))
    for k in range(len(labels)):
        summed_out = shares[:, k].copy()
        for label in range(len(chance)):
            only[:] = 0.0
            only[label] = 1.0
            set_shares(chance, only, labels[k], cases)
            if cases.sum() == 0.0:
                continue
            for row in range(len(rows)):
                shares[row, k] = cases * (rows[row, label] / cases.sum())
            values[k, label] = math.log(cases.sum())
            for s in range(len(problem.given)):
                values[k, label] += statement_term(
                    problem, cache, n, camera, s, pieces, rotations, owners, shares
                )
        shares[:, k] = summed_out
    return pieces, labels, values
