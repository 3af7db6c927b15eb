"""A scenelet more that goes on where another ends, or ends where another begins, and one less.

A stay is somebody who sits down, sits and gets up: two or three scenelets, each of which gains
most where the person does not jump from one to the next. Births place a scenelet by its own fit,
half a step from where its neighbour left off, and are refused for that. Here its pelvis is put
to where the neighbour's is as one ends and the other begins, and the person keeps the size that
the image has of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.kernels.support import log_size_density
from imapper_prob.models.posterior import State
from imapper_prob.models.problem import Problem
from imapper_prob.models.skeleton import PELV
from imapper_prob.samplers.kernel import Proposal
from imapper_prob.sampling.looks import View
from imapper_prob.sampling.moves import added, item_of
from imapper_prob.sampling.proposals import Proposals, log_wrapped_normal
from imapper_prob.sampling.replace import window_of

__all__ = ["Continuations", "Extend", "Retract"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_SPREADS = ((0.005, 0.01, 0.1), (0.015, 0.03, 0.3))
"""Blurs of the pelvis in bearing (tangent) and log depth and of the yaw (radians), tried equally
often: what a person moves from one frame to the next, and three times that."""
_SIZED = 0.03
"""Standard deviation of the log size about that which keeps the look of the fit: chosen, the
narrower of the two blurs of a birth along the viewing ray."""


@dataclass(frozen=True)
class Continuations:
    """What may be joined to one end of a scenelet: to draw from and to evaluate."""

    proposals: Proposals
    _windows: Ints = field(init=False, repr=False)  # (T + 1,) nearest to each frame

    def __post_init__(self) -> None:
        frames = range(self.proposals.problem.n_frames + 1)
        nearest = [self.proposals.nearest_window(frame) for frame in frames]
        object.__setattr__(self, "_windows", np.array(nearest, dtype=np.int64))

    def draw(
        self, rng: np.random.Generator, state: State, index: int, *, later: bool
    ) -> tuple[int, int, Array, float] | None:
        """A scenelet, its start frame, placement (3,) and log size; None where none fits.

        Parameters
        ----------
        rng : numpy.random.Generator
        state : State
        index : int
            Of the scenelet that it joins.
        later : bool
            Whether it comes after that one, or before.
        """
        cumulative = self._weights(state, index, later=later).cumsum()
        if cumulative[-1] <= 0:
            return None
        pick = rng.random() * cumulative[-1]
        scenelet = int(np.searchsorted(cumulative, pick, side="right"))
        yaw = self._yaw(state, index, scenelet, later=later)
        across, along, around = _SPREADS[int(rng.integers(len(_SPREADS)))]
        turned, sized, aside, further = rng.standard_normal(4).tolist()
        yaw += around * turned
        size = self._size(state, index, scenelet, yaw, later=later)
        if size is None:
            return None
        size += _SIZED * sized
        x, y = self._pelvis(state, index, last=later)
        depth = y * math.exp(along * further)
        bearing = x / y + across * aside
        px, py = self._offset(state, scenelet, yaw, size, last=not later)
        placement = np.array([bearing * depth - px, depth - py, yaw])
        if placement[1] <= 0:
            return None
        return scenelet, self._start(state, index, scenelet, later=later), placement, size

    def log_density(
        self, state: State, index: int, drawn: tuple[int, int, Array, float], *, later: bool
    ) -> float:
        """Log density of :meth:`draw`, per square metre, radian and unit of log size."""
        scenelet, start, placement, size = drawn
        weights = self._weights(state, index, later=later)
        if start != self._start(state, index, scenelet, later=later) or not weights[scenelet] > 0:
            return -math.inf
        yaw = float(placement[2])
        usual = self._size(state, index, scenelet, yaw, later=later)
        if usual is None:
            return -math.inf
        x, y = self._pelvis(state, index, last=later)
        px, py = self._offset(state, scenelet, yaw, size, last=not later)
        own_x, own_y = float(placement[0]) + px, float(placement[1]) + py
        if own_y <= 0:
            return -math.inf
        turned = yaw - self._yaw(state, index, scenelet, later=later)
        aside, further = own_x / own_y - x / y, math.log(own_y / y)
        density = 0.0
        for across, along, around in _SPREADS:
            exponent = -0.5 * ((aside / across) ** 2 + (further / along) ** 2)
            exponent += log_wrapped_normal(turned, around)
            density += math.exp(exponent) / (2 * math.pi * across * along * len(_SPREADS))
        if density == 0:
            return -math.inf
        # |d(bearing, log depth) / d(x, y)| = 1 / y^2 of the pelvis, which goes with the placement.
        log_place = math.log(density) - 2 * math.log(own_y)
        log_chosen = math.log(weights[scenelet] / weights.sum())
        return log_chosen + log_place + log_size_density(size - usual, _SIZED)

    def _start(self, state: State, index: int, scenelet: int, *, later: bool) -> int:
        """First frame of a scenelet without a gap to the one that it joins."""
        joined, start = state.items[index].tolist()
        lengths = self.proposals.problem.lengths
        return int(start + lengths[joined] if later else start - lengths[scenelet])

    def _weights(self, state: State, index: int, *, later: bool) -> Array:
        """(L,) how often to try each scenelet: those of the windows it would be in, if it fits."""
        problem, candidates = self.proposals.problem, self.proposals.candidates
        lengths, (joined, start) = problem.lengths, state.items[index].tolist()
        if later:
            first = start + int(lengths[joined])
            last = index + 1 == state.n_scenelets
            room = (problem.n_frames if last else int(state.items[index + 1, 1])) - first
            starts = np.full(len(lengths), first)
        else:
            before = state.items[index - 1] if index else None
            room = start - (0 if before is None else int(before[1] + lengths[before[0]]))
            starts = start - lengths
        fits = lengths <= room
        middles = np.where(fits, starts + lengths // 2, 0)
        own: Array = candidates.weights[self._windows[middles], np.arange(len(lengths))] * fits
        return own

    def _fit(self, scenelet: int, start: int) -> int:
        """The window whose fit a scenelet has."""
        return int(self._windows[self.proposals.middle(scenelet, start)])

    def _yaw(self, state: State, index: int, scenelet: int, *, later: bool) -> float:
        """Turned from its fit as the one that it joins is from its own."""
        candidates = self.proposals.candidates
        window = self._fit(scenelet, self._start(state, index, scenelet, later=later))
        joined, other = int(state.items[index, 0]), window_of(self.proposals, state, index)
        turned = 0.0
        if candidates.weights[other, joined] > 0:
            turned = float(state.placements[index, 2] - candidates.placements[other, joined, 2])
        return float(candidates.placements[window, scenelet, 2]) + turned

    def _size(
        self, state: State, index: int, scenelet: int, yaw: float, *, later: bool
    ) -> float | None:
        """Log size with which it looks as large as in its fit, where it joins."""
        window = self._fit(scenelet, self._start(state, index, scenelet, later=later))
        view = View(state.camera)
        found = self.proposals.carried(view, window, scenelet)
        if found is None:
            return None
        stand = found[0]
        px, py = self._offset(state, scenelet, yaw, stand.size, last=not later)
        x, y = self._pelvis(state, index, last=later)
        near = math.hypot(stand.x + px, stand.y + py)
        return stand.size + math.log(math.hypot(x, y) / near) if near > 0 else None

    def _pelvis(self, state: State, index: int, *, last: bool) -> tuple[float, float]:
        """Of a scenelet in its first or last frame, metres on the floor."""
        x, y, yaw = state.placements[index].tolist()
        size = float(state.sizes[index])
        px, py = self._offset(state, int(state.items[index, 0]), yaw, size, last=last)
        return x + px, y + py

    def _offset(
        self, state: State, scenelet: int, yaw: float, size: float, *, last: bool
    ) -> tuple[float, float]:
        """From a placement to the pelvis in the first or last frame, metres on the floor."""
        problem = self.proposals.problem
        first, stop = problem.joint_first[scenelet : scenelet + 2].tolist()
        px, py = problem.joints[stop - 1 if last else first, PELV, :2].tolist()
        scale = math.exp(float(state.camera[3]) + size)
        c, s = scale * math.cos(yaw), scale * math.sin(yaw)
        return c * px - s * py, s * px + c * py


@dataclass(frozen=True)
class Extend:
    """One scenelet more, joined to either end of one."""

    continuations: Continuations
    name: str = "extend"
    reverse: str = "retract"

    def propose(self, rng: np.random.Generator, state: State) -> Proposal[State] | None:
        """Draw a scenelet; impossible where there is none to join, or no room."""
        if state.n_scenelets == 0:
            return None
        index, later = int(rng.integers(state.n_scenelets)), rng.random() < 0.5
        drawn = self.continuations.draw(rng, state, index, later=later)
        if drawn is None:
            return None
        new = state.with_item(*drawn)
        back = _log_retracted(self.continuations.proposals.problem, new, added(state, new))
        return Proposal(new, back - self.explain(state, new))

    def explain(self, before: State, after: State) -> float:
        """Log density of proposing ``after`` from ``before``: by either neighbour."""
        new = added(before, after)
        if new is None:
            return -math.inf
        drawn = item_of(after, new)
        ways = [
            self.continuations.log_density(before, index, drawn, later=later)
            for index, later in ((new - 1, True), (new, False))
            if 0 <= index < before.n_scenelets
        ]
        best = max(ways, default=-math.inf)
        if best == -math.inf:
            return best
        total = sum(math.exp(way - best) for way in ways)
        return best + math.log(total / (2 * before.n_scenelets))


@dataclass(frozen=True)
class Retract:
    """One scenelet less of those that are joined to another."""

    continuations: Continuations
    name: str = "retract"
    reverse: str = "extend"

    def propose(self, rng: np.random.Generator, state: State) -> Proposal[State] | None:
        """Drop a scenelet; impossible where it is joined to nothing at the end that is tried."""
        if state.n_scenelets == 0:
            return None
        problem = self.continuations.proposals.problem
        index, later = int(rng.integers(state.n_scenelets)), rng.random() < 0.5
        if (index if later else index - 1) not in _joins(problem, state):
            return None
        rest = state.without_item(index)
        back = Extend(self.continuations).explain(rest, state)
        return Proposal(rest, back - _log_retracted(problem, state, index))

    def explain(self, before: State, after: State) -> float:
        """Log density of proposing ``after`` from ``before``."""
        return _log_retracted(self.continuations.proposals.problem, before, added(after, before))


def _joins(problem: Problem, state: State) -> list[int]:
    """Indices of the scenelets that end where the next one begins."""
    ends = state.items[:-1, 1] + problem.lengths[state.items[:-1, 0]]
    joins: list[int] = np.flatnonzero(ends == state.items[1:, 1]).tolist()
    return joins


def _log_retracted(problem: Problem, state: State, index: int | None) -> float:
    """Log probability of dropping one scenelet, for either of its ends."""
    if index is None:
        return -math.inf
    ends = len({index - 1, index}.intersection(_joins(problem, state)))
    return math.log(ends / (2 * state.n_scenelets)) if ends else -math.inf
