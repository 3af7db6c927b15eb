"""A move that draws all scenelets of a stretch of time anew, their number with them.

Two scenelets in a row have to change at once, in start, motion and place: one after the other
they pass through scenes that cost too much. Here a stretch is chosen by chance. Scenelets that
reach out of it stay; those wholly inside give way to a sequence of nodes drawn from sums over
all sequences that fit, with places drawn beside one another along the path.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.kernels.cache import Evaluator
from imapper_prob.models.log_posterior import Incremental, State, empty_state
from imapper_prob.models.problem import Problem
from imapper_prob.models.view import to_floor, to_view
from imapper_prob.samplers.reversible_jump import Drawn, Redraw
from imapper_prob.samplers.segments import new_sums
from imapper_prob.sampling.nodes import Nodes, Tables, tables_of
from imapper_prob.sampling.redraw_kernels import LONGEST, TAIL, Room, redraw

__all__ = ["StretchRedraw"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

POWERS = tuple(0.76**k for k in range(8))
"""Powers of the likelihood at which there are tables, from 1 to .15: as near to any other as
makes no difference to how well draws fit."""
_FLATTER = 2
"""How many powers further the flat table of a sharp one is: half the power, .58."""
_STRETCHES = (1.5, 2.5, 4.5)
"""Lengths of stretches, in those of the usual scenelet: room for one, two, and three or four."""


@dataclass(frozen=True)
class StretchRedraw(Redraw[State]):
    """Draw the scenelets of a stretch anew.

    Parameters
    ----------
    problem : Problem
        With incremental evaluation, not the published energy.
    nodes : Nodes
    tries : int
        Draws beside what is there.
    """

    problem: Problem
    nodes: Nodes
    tries: int = 8
    name: str = "redraw"
    _tables: Tables = field(init=False, repr=False)
    _evaluator: Evaluator = field(init=False, repr=False)
    _room: Room = field(init=False, repr=False)
    _lengths: tuple[int, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        tables = tables_of(self.problem, self.nodes, POWERS)
        n = len(self.nodes.items)
        sharp, flat = new_sums(tables.segments[0]), new_sums(tables.segments[0])
        usual = float(np.median(self.problem.lengths))
        lengths = tuple(min(round(usual * s), self.problem.n_frames) for s in _STRETCHES)
        object.__setattr__(self, "_tables", tables)
        object.__setattr__(
            self, "_evaluator", Incremental(self.problem, empty_state(self.problem)).evaluator
        )
        object.__setattr__(self, "_room", Room(sharp, flat, np.empty((2, n)), np.empty((2, n))))
        object.__setattr__(self, "_lengths", lengths)

    def draw(
        self, rng: np.random.Generator, state: State, /, *, power: float
    ) -> Drawn[State] | None:
        """Draws of a stretch chosen by chance; None where a scenelet in it is not a node."""
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
        nodes, places = present
        n, others = self.tries, np.delete(state.items, slice(first, last), axis=0)
        uniforms = rng.random((n, 2 + 2 * (finish - begin)))
        normals = rng.standard_normal((n, 4 * LONGEST))
        spreads = rng.chisquare(TAIL, n) / TAIL
        counts, sequences = np.empty(n, np.int64), np.empty((n, LONGEST), np.int64)
        where, log_density = np.empty((n, LONGEST, 4)), np.empty(n + 1)
        sharp = _nearest(power)
        flat = min(sharp + _FLATTER, len(POWERS) - 1)
        tables = self._tables
        redraw(
            self._evaluator, tables.common,
            tables.gaussians[sharp], tables.segments[sharp],
            tables.gaussians[flat], tables.segments[flat],
            self._room, state.camera, others, beside, beside_where, begin, finish,
            nodes, places, uniforms, normals, spreads, counts, sequences, where, log_density,
        )  # fmt: skip
        if log_density[n] == -math.inf:
            return None
        drawn = [
            (self._with(state, first, last, sequences[i, : counts[i]], where[i]), log_q)
            for i, log_q in enumerate(log_density[:n].tolist())
            if log_q > -math.inf
        ]
        return Drawn(float(log_density[n]), drawn)

    def _parsed(self, state: State, first: int, last: int) -> tuple[Ints, Array] | None:
        """The nodes that some scenelets of a state are, and where they stand."""
        if last - first > LONGEST:
            return None
        segments, items = self._tables.segments[0], self.nodes.items
        nodes, places = np.empty(last - first, np.int64), np.empty((last - first, 4))
        for k in range(first, last):
            scenelet, start = state.items[k].tolist()
            low, high = segments.starting[start], segments.starting[start + 1]
            at = int(low + np.searchsorted(items[low:high, 0], scenelet))
            if at == high or items[at, 0] != scenelet or state.placements[k, 1] <= 0:
                return None
            place = _where(state, k)
            yaw = float(self.nodes.where[at, 2])
            place[2] = yaw + math.remainder(place[2] - yaw, 2 * math.pi)
            nodes[k - first], places[k - first] = at, place
        return nodes, places

    def _with(self, state: State, first: int, last: int, nodes: Ints, where: Array) -> State:
        """A state with nodes in place of some of its scenelets."""
        where = where[: len(nodes)]
        placements, own_sizes = to_floor(where)
        items, own, sizes = state.items, state.placements, state.sizes
        return State(
            state.camera,
            np.concatenate([items[:first], self.nodes.items[nodes], items[last:]]),
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


def _nearest(power: float) -> int:
    """The power of the tables that is nearest to another."""
    if power <= POWERS[-1]:
        return len(POWERS) - 1
    return min(round(math.log(power) / math.log(POWERS[1])), len(POWERS) - 1)
