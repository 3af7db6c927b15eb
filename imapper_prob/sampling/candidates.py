"""Fits of the solver as candidates: how often to try each scenelet in each window, and where.

A fit to detections knows nothing of what its furniture hides, nor of path and floor. The best are
moved to where the whole log-posterior is highest, and weighed by it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imapper_prob.layouts import furniture_kinds
from imapper_prob.models.log_posterior import empty_state, log_posterior_near
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import read_only
from imapper_prob.models.text import brief
from imapper_prob.models.view import to_floor, to_view
from imapper_prob.solver.candidates import Candidate, along_the_ray
from imapper_prob.solver.solver import Solution

__all__ = ["Candidates", "SingleScenelet", "weighted_candidates"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
_STEPS = np.array(
    [[0.004, 0.0, 0.0, 0.0], [0.0, 0.03, 0.0, 0.0], [0.0, 0.0, 0.08, 0.0], [0.0, 0.025, 0.0, 0.025]]
)
"""(4, 4) from point to point of a parabola, in bearing, log depth, yaw, and in log size with the
depth along: about the standard deviations of placements in chains of one simulated clip."""
_ROUNDS = 2
"""Times that each direction is taken, chosen."""
_FURTHEST = 2.0
"""Steps at once, chosen: beyond, a parabola is not trusted."""


@dataclass(frozen=True)
class Candidates:
    """Every scenelet fitted to every window.

    Parameters
    ----------
    centres : (W,) int
        Middle frame of each window, ascending.
    placements : (W, L, 3) float
        x, y in metres (y > 0), yaw in radians, at the mean of the camera prior.
    sizes : (W, L) float
        Log size of the person there.
    weights : (W, L) float
        How often to try each; zero where a scenelet was not fitted.
    """

    centres: Ints
    placements: Array
    sizes: Array
    weights: Array

    __repr__ = brief

    def __post_init__(self) -> None:
        centres = np.array(self.centres, dtype=np.int64)
        centres.setflags(write=False)
        object.__setattr__(self, "centres", centres)
        shape = (len(centres), np.shape(self.weights)[-1])
        for name, size in (("placements", (*shape, 3)), ("sizes", shape), ("weights", shape)):
            object.__setattr__(
                self, name, read_only(getattr(self, name), shape=size, name=f"candidate {name}")
            )


class SingleScenelet:
    """Scenes of one scenelet.

    Where it stands is (4,): bearing (tangent), log depth (log m), yaw (radians) and log size.

    Parameters
    ----------
    problem : Problem
    """

    def __init__(self, problem: Problem) -> None:
        self._scene = empty_state(problem)
        # One scenelet alone is quickly judged where nothing else changes.
        self._judge = log_posterior_near(problem, self._scene)
        self._nothing = self._judge(self._scene)

    def gain(self, scenelet: int, start: int, where: Array) -> float:
        """Nats over the scene without it.

        Parameters
        ----------
        scenelet : int
        start : int
            Its first frame.
        where : (4,) float
            Bearing (tangent), log depth (log m), yaw (radians), log size.

        Returns
        -------
        float
            Nats.
        """
        placement, size = to_floor(where)
        there = self._scene.with_item(scenelet, start, placement, float(size))
        return self._judge(there) - self._nothing

    def mended(self, scenelet: int, start: int, where: Array, gain: float) -> tuple[Array, float]:
        """A better place nearby and its gain, by parabolas along one direction after the other.

        Parameters
        ----------
        scenelet : int
        start : int
            Its first frame.
        where : (4,) float
            Bearing (tangent), log depth (log m), yaw (radians), log size.
        gain : float
            There, nats.

        Returns
        -------
        where : (4,) float
        gain : float
            Nats.
        """
        for step in [*_STEPS] * _ROUNDS:
            less, more = (self.gain(scenelet, start, where + sign * step) for sign in (-1, 1))
            bend = 2 * gain - less - more
            if not np.isfinite(bend):
                continue
            by = 0.5 * (more - less) / bend if bend > 0 else np.sign(more - less)
            there = where + float(np.clip(by, -_FURTHEST, _FURTHEST)) * step
            found = self.gain(scenelet, start, there)
            if found > gain:
                where, gain = there, found
        return where, gain


# ------------------------------------------------------------------------------------------------
# How often to try each scenelet in each window, and where exactly.
#
# The better a weight says what a scenelet would gain, the more often its proposal is accepted.
# What the solver knows of all fits is their reprojection; the best of each window by that, kind
# by kind, are judged by the full log-posterior, alone in an empty scene, and the best of these
# are moved to where it is highest: a fit knows nothing of what its furniture hides. In a chain
# others are there and the camera is another, so gains are known to some nats only: weights are a
# mixture of a sharp and a flat softmax of them.

_JUDGED = 200
"""Fits of a window that are judged: a sitting window has few that come within 20 nats."""
_MENDED = 32
"""Of these, how many are moved to where they are best, chosen: it takes seconds for a long clip."""
_UNJUDGED = 5.0
"""Nats by which all others are taken to be worse than the worst of these."""
_TEMPERATURES = (2.0, 6.0)
"""Nats by which a fit may be worse than another and be tried 1/e times as often. Replacing a
scenelet by these weights is accepted two to five times as often as by guesses alone at 5."""
_HOPELESS = 0.1
"""Weight of a window none of whose fits improves the scene."""


def weighted_candidates(solution: Solution) -> Candidates:
    """All fits of the solver, weighted by how much they may gain.

    Parameters
    ----------
    solution : Solution

    Returns
    -------
    Candidates
    """
    problem, fits = solution.problem, solution.fits
    weights = np.zeros(fits.cost.shape)
    placements, sizes = np.array(fits.placements), np.zeros(fits.cost.shape)
    alone, half = SingleScenelet(problem), problem.lengths // 2
    for window, guesses in _guessed(solution).items():
        centre = int(fits.centres[window])
        order = np.argsort(-guesses, kind="stable")[:_JUDGED]
        judged = {}
        for scenelet in order[np.isfinite(guesses[order])].tolist():
            start = centre - int(half[scenelet])
            where = to_view(*along_the_ray(problem, centre, placements[window, scenelet]))
            judged[scenelet] = start, where, alone.gain(scenelet, start, where)
        best = sorted(judged, key=lambda scenelet: -judged[scenelet][2])[:_MENDED]
        gains = np.full(len(guesses), -np.inf)
        for scenelet, (start, where, gain) in judged.items():
            if scenelet in best and np.isfinite(gain):
                where, gain = alone.mended(scenelet, start, where, gain)
            placements[window, scenelet], sizes[window, scenelet] = to_floor(where)
            gains[scenelet] = gain
        known = np.isfinite(gains)
        if not known.any():
            continue
        gains[np.isfinite(guesses) & ~known] = gains[known].min() - _UNJUDGED
        top = gains.max()
        parts = [np.exp((gains - top) / temperature) for temperature in _TEMPERATURES]
        mixed = np.mean([part / part.sum() for part in parts], axis=0)
        weights[window] = mixed * (1.0 if top > 0 else _HOPELESS)
    return Candidates(fits.centres, placements, sizes, weights)


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
