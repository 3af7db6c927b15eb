"""Candidates from the solver's fits: proposal weights and placements of scenelets in windows.

A fit to detections does not account for occlusion by its furniture, for the path or for the floor.
So the best fits are optimised under the whole log-posterior and weighted by it.
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
"""(4, 4) steps between points of a parabola: in bearing, in log depth, in yaw, and in log size
together with log depth; about the standard deviations of placements in chains of a simulated
clip."""
_ROUNDS = 2
"""Number of passes over the directions; chosen."""
_FURTHEST = 2.0
"""Largest move of a parabola's maximum, in steps; chosen."""


@dataclass(frozen=True)
class Candidates:
    """Every scenelet fitted to every window, with proposal weights.

    Parameters
    ----------
    centres : (W,) int
        Middle frame of each window, ascending.
    placements : (W, L, 3) float
        x, y in metres (y > 0), yaw in radians, at the mean of the camera prior.
    sizes : (W, L) float
        Log size of the person in that fit.
    weights : (W, L) float
        Proposal weight of each fit; zero if a scenelet was not fitted.
    adjoining : (W, L) float
        The same for a scenelet that begins where another one ends.
    """

    centres: Ints
    placements: Array
    sizes: Array
    weights: Array
    adjoining: Array

    __repr__ = brief

    def __post_init__(self) -> None:
        centres = np.array(self.centres, dtype=np.int64)
        centres.setflags(write=False)
        object.__setattr__(self, "centres", centres)
        shape = (len(centres), np.shape(self.weights)[-1])
        shapes = {"placements": (*shape, 3), "sizes": shape, "weights": shape, "adjoining": shape}
        for name, size in shapes.items():
            object.__setattr__(
                self, name, read_only(getattr(self, name), shape=size, name=f"candidate {name}")
            )


class SingleScenelet:
    """Evaluates and optimises scenes of one scenelet.

    A placement is (4,): bearing (tangent), log depth (log m), yaw (radians) and log size.

    Parameters
    ----------
    problem : Problem
    """

    def __init__(self, problem: Problem) -> None:
        self._scene = empty_state(problem)
        # A single scenelet in an otherwise empty scene is quick to evaluate.
        self._judge = log_posterior_near(problem, self._scene)
        self._nothing = self._judge(self._scene)

    def gain(self, scenelet: int, start: int, where: Array) -> float:
        """Gain in log-posterior over the empty scene, nats.

        Parameters
        ----------
        scenelet : int
        start : int
            Start frame.
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
        """Improve the placement by parabolas along one direction after the other.

        Parameters
        ----------
        scenelet : int
        start : int
            Start frame.
        where : (4,) float
            Bearing (tangent), log depth (log m), yaw (radians), log size.
        gain : float
            Gain at ``where``, nats.

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
# Proposal weights and placements of scenelets in windows.
#
# A proposal is accepted more often if its weight reflects the gain of the scenelet. The solver
# knows the reprojection error of all fits. The best fits of each window, by that error and by kind
# of furniture, are judged by the full log-posterior in an otherwise empty scene, and the best of
# these are optimised. In a chain there are other scenelets and another camera, so gains are only
# known to some nats: weights are a mixture of a sharp and a flat softmax of them.
#
# A scenelet alone loses much at its ends, where the pose jumps. Beside another one it does not:
# somebody who sits between sitting down and standing up. The weight of an adjoining scenelet is
# therefore the mixture of both softmaxes of the reprojection error alone.

_JUDGED = 200
"""Fits of a window that are judged; in a seated window only few come within 20 nats of the best."""
_MENDED = 32
"""Fits of a window that are optimised; chosen: it takes seconds for a long clip."""
_UNJUDGED = 5.0
"""Nats by which all other fits are assumed to be worse than the worst judged one."""
_TEMPERATURES = (2.0, 6.0)
"""Temperatures of both softmaxes, nats. Replacing a scenelet by these weights is accepted two to
five times as often as by guesses alone at 5."""
_HOPELESS = 0.1
"""Weight of a window in which no fit improves the empty scene."""


def weighted_candidates(solution: Solution) -> Candidates:
    """Weight all fits of the solver by their estimated gain.

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
    alone, half, nats = SingleScenelet(problem), problem.lengths // 2, _misfits(solution)
    for window, guesses in _guessed(solution, nats).items():
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
        weights[window] = _softmaxes(gains) * (1.0 if gains.max() > 0 else _HOPELESS)
    adjoining = np.array([_softmaxes(-of_window) for of_window in nats])
    return Candidates(fits.centres, placements, sizes, weights, adjoining)


def _softmaxes(gains: Array) -> Array:
    """Mean of a sharp and a flat softmax; 0 where the gain is -inf."""
    if not np.isfinite(gains).any():
        return np.zeros(len(gains))
    parts = [np.exp((gains - gains.max()) / temperature) for temperature in _TEMPERATURES]
    mixed: Array = np.mean([part / part.sum() for part in parts], axis=0)
    return mixed


def _misfits(solution: Solution) -> Array:
    """(W, L) reprojection error of each fit, nats; inf where a scenelet was not fitted."""
    problem, fits = solution.problem, solution.fits
    seen = problem.used * problem.confidence_density.argmax(-1)
    half = int(np.median(problem.lengths)) // 2
    nats = np.full(fits.cost.shape, np.inf)
    for window, centre in enumerate(fits.centres.tolist()):
        joints = seen[max(0, centre - half) : centre + half].sum()
        # Without any surely seen joint there is no fit: avoid 0 times infinity.
        fitted = np.isfinite(fits.cost[window])
        nats[window, fitted] = problem.frame_weight * problem.likelihood * joints
        nats[window, fitted] *= fits.cost[window, fitted]
    return nats


def _guessed(solution: Solution, nats: Array) -> dict[int, Array]:
    """(L,) estimated gains by window; -inf where a scenelet was not fitted.

    The solver judged a few fits of each kind of furniture. The gain of another fit of that kind is
    estimated from the best of them and from the difference of the reprojection errors ``nats``.
    """
    problem, fits = solution.problem, solution.fits
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
        gains = np.full(len(problem.lengths), -np.inf)
        for kind, candidate in best.items():
            own, misfits = members[kind], nats[window]
            gains[own] = candidate.gain - (misfits[own] - misfits[candidate.scenelet])
        gains[fits.placements[window, :, 1] <= 0] = -np.inf
        guessed[window] = gains
    return guessed
