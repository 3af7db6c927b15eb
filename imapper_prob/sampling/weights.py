"""How often to try each scenelet in each window, and where exactly.

The better a weight says what a scenelet would gain, the more often its proposal is accepted.
What the solver knows of all fits is their reprojection; the best of each window by that, kind
by kind, are judged by the full log-posterior, alone in an empty scene, and the best of these
are moved to where it is highest: a fit knows nothing of what its furniture hides. In a chain
others are there and the camera is another, so gains are known to some nats only: weights are a
mixture of a sharp and a flat softmax of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.incremental import Incremental
from imapper_prob.models.posterior import State, empty_state, log_posterior
from imapper_prob.sampling.proposals import Candidates
from imapper_prob.staged.candidates import Candidate, along_the_ray
from imapper_prob.staged.kinds import furniture_kinds
from imapper_prob.staged.solver import Solution

__all__ = ["weighted_candidates"]

Array = NDArray[np.float64]
Judge = Callable[[State], float]

_JUDGED = 200
"""Fits of a window that are judged: a sitting window has few that come within 20 nats."""
_MENDED = 32
"""Of these, how many are moved to where they are best; the others' weights are small."""
_STEPS = np.array([0.004, 0.03, 0.08, 0.025])
"""Between the points of a parabola, in bearing, log depth, yaw, and log size with the depth along:
standard deviations of a scenelet's placement in chains."""
_ROUNDS = 2
_UNJUDGED = 5.0
"""Nats by which all others are taken to be worse than the worst of these."""
_TEMPERATURES = (2.0, 6.0)
"""Nats by which a fit may be worse than another and be tried 1/e times as often. Replacing a
scenelet by these weights is accepted two to five times as often as by guesses alone at 5."""
_HOPELESS = 0.1
"""Weight of a window none of whose fits improves the scene."""


@dataclass(frozen=True)
class _Placed:
    """Bearing, log depth, yaw and log size of a scenelet alone in the scene, and its gain."""

    where: Array
    gain: float


def weighted_candidates(solution: Solution) -> Candidates:
    """All fits of the solver, weighted by how much they may gain."""
    problem, fits = solution.problem, solution.fits
    weights = np.zeros(fits.cost.shape)
    placements, sizes = np.array(fits.placements), np.zeros(fits.cost.shape)
    scene = empty_state(problem)
    # One scenelet alone is quickly judged where nothing else changes.
    alone = Incremental(problem, scene) if not problem.of_paper else None

    def judge(state: State) -> float:
        return log_posterior(problem, state) if alone is None else sum(alone.propose(state))

    nothing = judge(scene)
    half = problem.lengths // 2
    for window, guesses in _guessed(solution).items():
        centre = int(fits.centres[window])
        order = np.argsort(-guesses, kind="stable")[:_JUDGED]
        found = {}
        for scenelet in order[np.isfinite(guesses[order])].tolist():
            (x, y, yaw), size = along_the_ray(problem, centre, fits.placements[window, scenelet])
            where = np.array([x / y, np.log(y), yaw, size])
            item = (scenelet, centre - int(half[scenelet]))
            found[item] = _Placed(where, _judged(judge, scene, item, where) - nothing)
        best = sorted(found, key=lambda item: -found[item].gain)[:_MENDED]
        for item in best:
            if np.isfinite(found[item].gain):
                found[item] = _mended(judge, scene, item, found[item], nothing)
        gains = np.full(len(guesses), -np.inf)
        for (scenelet, _), placed in found.items():
            bearing, log_depth, yaw, size = placed.where
            depth = np.exp(log_depth)
            gains[scenelet], sizes[window, scenelet] = placed.gain, size
            placements[window, scenelet] = bearing * depth, depth, yaw
        known = np.isfinite(gains)
        if not known.any():
            continue
        gains[np.isfinite(guesses) & ~known] = gains[known].min() - _UNJUDGED
        top = gains.max()
        parts = [np.exp((gains - top) / temperature) for temperature in _TEMPERATURES]
        mixed = np.mean([part / part.sum() for part in parts], axis=0)
        weights[window] = mixed * (1.0 if top > 0 else _HOPELESS)
    return Candidates(fits.centres, placements, sizes, weights)


def _judged(judge: Judge, scene: State, item: tuple[int, int], where: Array) -> float:
    bearing, log_depth, yaw, size = where.tolist()
    depth = np.exp(log_depth)
    return judge(scene.with_item(*item, np.array([bearing * depth, depth, yaw]), size))


def _mended(
    judge: Judge, scene: State, item: tuple[int, int], placed: _Placed, nothing: float
) -> _Placed:
    """Parabolas through three points, direction after direction."""
    where, gain = placed.where, placed.gain
    directions = np.diag(_STEPS)
    directions[3, 1] = _STEPS[3]
    for direction in [*directions] * _ROUNDS:
        less, more = (
            _judged(judge, scene, item, where + sign * direction) - nothing for sign in (-1, 1)
        )
        bend = 2 * gain - less - more
        if not np.isfinite(bend):
            continue
        by = 0.5 * (more - less) / bend if bend > 0 else np.sign(more - less)
        there = where + float(np.clip(by, -2.0, 2.0)) * direction
        value = _judged(judge, scene, item, there) - nothing
        if value > gain:
            where, gain = there, value
    return _Placed(where, gain)


def _guessed(solution: Solution) -> dict[int, Array]:
    """(L,) gains by window, -inf where a scenelet was not fitted.

    A few of each kind of furniture were judged by the solver. What another of the kind gains
    is guessed from the best of them and from how much worse its own fit is.
    """
    problem, fits = solution.problem, solution.fits
    seen = problem.used * problem.confidence_density.argmax(-1)
    half = int(np.median(problem.lengths)) // 2
    members: dict[tuple[int, ...], list[int]] = {}
    for scenelet, kind in enumerate(furniture_kinds(problem)):
        members.setdefault(kind, []).append(scenelet)
    judged: dict[int, dict[tuple[int, ...], Candidate]] = {}
    for candidate in solution.candidates:
        best = judged.setdefault(candidate.window, {})
        if candidate.kind not in best or candidate.gain > best[candidate.kind].gain:
            best[candidate.kind] = candidate
    guessed = {}
    for window, best in judged.items():
        centre = int(fits.centres[window])
        joints = seen[max(0, centre - half) : centre + half].sum()
        nats = np.full(len(fits.cost[window]), np.inf)
        fitted = np.isfinite(fits.cost[window])
        # Where no joint is surely seen there is no fit: infinite, not nothing times infinity.
        nats[fitted] = problem.frame_weight * problem.likelihood * joints
        nats[fitted] *= fits.cost[window][fitted]
        gains = np.full(len(nats), -np.inf)
        for kind, candidate in best.items():
            own = members[kind]
            gains[own] = candidate.gain - (nats[own] - nats[candidate.scenelet])
        gains[fits.placements[window, :, 1] <= 0] = -np.inf
        guessed[window] = gains
    return guessed
