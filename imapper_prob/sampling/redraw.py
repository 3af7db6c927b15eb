"""A move that draws all scenelets of a stretch of time anew, their number with them.

Two scenelets in a row have to change at once, in start, motion and place: one after the other
they pass through scenes that cost too much. Here a stretch is chosen by chance. Scenelets that
reach out of it stay; those wholly inside are put into a pool with many others, each of which is
judged beside the scenelets that stay, and a sequence of the pool takes their place
(:mod:`imapper_prob.samplers.pools`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.kernels.cache import Evaluator, open_evaluator
from imapper_prob.models.log_posterior import State
from imapper_prob.models.problem import Problem
from imapper_prob.models.view import to_floor, to_view
from imapper_prob.samplers.reversible_jump import Drawn, Redraw
from imapper_prob.sampling.pool_kernels import LONGEST, TAIL, Table, draw_from_pool

__all__ = ["StretchRedraw"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_STRETCHES: Final = (1.5, 2.5, 4.5)
"""Lengths of stretches, in those of the usual scenelet: room for one, two, and three or four."""
_MORE: Final = 8
"""Scenelets by which the room of the evaluation grows."""


@dataclass
class _Room:
    """An evaluation with room for so many scenelets; opened when it is first needed."""

    capacity: int = 0
    evaluator: Evaluator | None = None


@dataclass(frozen=True)
class StretchRedraw(Redraw[State]):
    """Draw the scenelets of a stretch anew.

    Parameters
    ----------
    problem : Problem
        With incremental evaluation, not the published energy.
    table : Table
        What the pool is drawn from.
    pool : int
        Elements of the pool, those that are there included. Chosen: twice as many take twice as
        long, and hardly more of the draws are other ones.
    tries : int
        Draws from one pool.
    """

    problem: Problem
    table: Table
    pool: int = 64
    tries: int = 4
    name: str = "redraw"
    _room: _Room = field(default_factory=_Room, init=False, repr=False, compare=False)
    _lengths: tuple[int, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        usual = float(np.median(self.problem.lengths))
        lengths = tuple(min(round(usual * s), self.problem.n_frames) for s in _STRETCHES)
        object.__setattr__(self, "_lengths", lengths)

    def draw(
        self, rng: np.random.Generator, state: State, /, *, power: float
    ) -> Drawn[State] | None:
        """Draws of a stretch chosen by chance; None where a scenelet in it is not in the table."""
        length = self._lengths[int(rng.integers(len(self._lengths)))]
        begin = int(rng.integers(self.problem.n_frames)) - length // 2
        return self.beside(rng, state, begin, begin + length, power=power)

    def beside(
        self, rng: np.random.Generator, state: State, begin: int, finish: int, *, power: float
    ) -> Drawn[State] | None:
        """Draws of the frames from ``begin`` up to ``finish``, these or their part in the clip."""
        begin, finish = max(begin, 0), min(finish, self.problem.n_frames)
        starts = state.items[:, 1]
        ends = starts + self.problem.lengths[state.items[:, 0]]
        first = int(np.searchsorted(starts, begin))
        last = max(first, int(np.searchsorted(ends, finish, side="right")))
        beside, beside_where = np.full((2, 2), -1), np.zeros((2, 4))
        if first > 0:
            begin = max(begin, int(ends[first - 1]))
            beside[0], beside_where[0] = state.items[first - 1], _where(state, first - 1)
        if last < state.n_scenelets:
            finish = min(finish, int(starts[last]))
            beside[1], beside_where[1] = state.items[last], _where(state, last)
        present = self._parsed(state, first, last)
        if finish <= begin or present is None:
            return None
        stay = np.delete(np.arange(state.n_scenelets), slice(first, last))
        n, size = self.tries, self.pool
        nodes, where = np.empty(size, np.int64), np.empty((size, 4))
        counts, sequences = np.empty(n, np.int64), np.empty((n, LONGEST), np.int64)
        log_density = np.empty(n + 1)
        draw_from_pool(
            self._evaluator(len(stay) + 1), self.table, power, state.camera, state.latent,
            state.items[stay], state.placements[stay], state.sizes[stay], first,
            beside, beside_where, begin, finish, *present,
            rng.random((size, 2)), rng.standard_normal((size, 4)), rng.chisquare(TAIL, size) / TAIL,
            rng.random((n, LONGEST + 1)), nodes, where, counts, sequences, log_density,
        )  # fmt: skip
        if log_density[n] == -math.inf:
            return None
        drawn = []
        for i, log_q in enumerate(log_density[:n].tolist()):
            if log_q > -math.inf:
                chosen = sequences[i, : counts[i]]
                new = self._with(state, first, last, nodes[chosen], where[chosen])
                drawn.append((new, log_q))
        return Drawn(float(log_density[n]), drawn)

    def _evaluator(self, count: int) -> Evaluator:
        """An evaluation with room for so many scenelets."""
        room = self._room
        if room.evaluator is None or room.capacity < count:
            room.capacity = count + _MORE
            room.evaluator = open_evaluator(self.problem, room.capacity)
        return room.evaluator

    def _parsed(self, state: State, first: int, last: int) -> tuple[Ints, Array] | None:
        """The nodes of the table that some scenelets of a state are, and where they stand."""
        if last - first > LONGEST:
            return None
        table = self.table
        nodes, places = np.empty(last - first, np.int64), np.empty((last - first, 4))
        for k in range(first, last):
            scenelet, start = state.items[k].tolist()
            low, high = table.starting[start], table.starting[start + 1]
            at = int(low + np.searchsorted(table.items[low:high, 0], scenelet))
            if at == high or table.items[at, 0] != scenelet or state.placements[k, 1] <= 0:
                return None
            nodes[k - first], places[k - first] = at, _where(state, k)
        return nodes, places

    def _with(self, state: State, first: int, last: int, nodes: Ints, where: Array) -> State:
        """A state with nodes in place of some of its scenelets."""
        placements, own_sizes = to_floor(where)
        items, own, sizes = state.items, state.placements, state.sizes
        return State(
            state.camera,
            np.concatenate([items[:first], self.table.items[nodes], items[last:]]),
            np.concatenate([own[:first], placements, own[last:]]),
            np.concatenate([sizes[:first], own_sizes, sizes[last:]]),
            state.latent,
        )


def _where(state: State, index: int) -> Array:
    """Bearing, log depth, yaw and log size of a scenelet of a state; NaN behind the camera."""
    placement = state.placements[index]
    if placement[1] <= 0:
        return np.full(4, np.nan)
    return to_view(placement, state.sizes[index])
