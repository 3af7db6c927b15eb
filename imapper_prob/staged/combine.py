"""From independent fits to scenes: candidates, combinations, refinement.

After the paper's pipeline (Monszpart et al. 2019, section 5): the fits of a window are
judged by the full posterior, so that motion intersection and occlusion count; the few that
gain most at each maximum of charness are refined and combined; the best scenes are refined
once more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from imapper_prob.models.posterior import State, empty_state, log_posterior
from imapper_prob.models.problem import Problem
from imapper_prob.staged.fit import Fits
from imapper_prob.staged.maxima import CharnessCurve

__all__ = ["Candidate", "CombineSettings", "combine", "refine", "screen"]

Array = NDArray[np.float64]
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class CombineSettings:
    """Parameters
    ----------
    screened : int
        Fits a window of which the full posterior is evaluated, best reprojection first.
    kept : int
        Candidates a maximum (3 in the paper).
    beam : int
        Partial combinations carried from one maximum to the next.
    alternatives : int
        Scenes returned beside the best.
    """

    screened: int = 12
    kept: int = 3
    beam: int = 40
    alternatives: int = 4


@dataclass(frozen=True)
class Candidate:
    """A scenelet fitted to a window.

    Parameters
    ----------
    scenelet, start : int
        Index in the library, and start frame.
    placement : (3,) float
        x, y in metres, yaw in radians.
    gain : float
        Nats by which it alone improves on the scene without any scenelet.
    """

    scenelet: int
    start: int
    placement: Array
    gain: float


def screen(
    problem: Problem,
    fits: Fits,
    *,
    settings: CombineSettings | None = None,
    progress: Progress | None = None,
) -> tuple[Candidate, ...]:
    """The best fits of every window, with what each alone gains under the full posterior."""
    settings, tell = settings or CombineSettings(), progress or _silent
    empty = empty_state(problem)
    base = log_posterior(problem, empty)
    half = problem.lengths // 2
    found = []
    for w, centre in enumerate(fits.centres):
        order = np.argsort(fits.cost[w], kind="stable")[: settings.screened]
        for scenelet in order[np.isfinite(fits.cost[w, order])]:
            start = int(centre - half[scenelet])
            placement = fits.placements[w, scenelet]
            state = empty.with_item(int(scenelet), start, placement)
            gain = log_posterior(problem, state) - base
            if np.isfinite(gain):
                found.append(Candidate(int(scenelet), start, placement, gain))
        tell("evaluating candidates", (w + 1) / len(fits.centres))
    return tuple(found)


def combine(
    problem: Problem,
    candidates: Sequence[Candidate],
    curve: CharnessCurve,
    *,
    settings: CombineSettings | None = None,
    progress: Progress | None = None,
) -> tuple[State, ...]:
    """The best scene under the full log-posterior, then its diverse alternatives."""
    settings, tell = settings or CombineSettings(), progress or _silent
    groups = _at_maxima(problem, candidates, curve, settings, tell)
    ranked = _beam_search(problem, groups, settings, tell)
    states = []
    chosen = _diverse(ranked, 1 + settings.alternatives)
    for i, state in enumerate(chosen):
        states.append(refine(problem, state))
        tell("refining scenes", (i + 1) / len(chosen))
    return tuple(sorted(states, key=lambda s: -log_posterior(problem, s)))


def _silent(stage: str, part: float) -> None:
    """Progress that nobody watches."""


def _at_maxima(
    problem: Problem,
    candidates: Sequence[Candidate],
    curve: CharnessCurve,
    settings: CombineSettings,
    tell: Progress,
) -> list[list[Candidate]]:
    """For each maximum, in order of time, the few refined candidates that gain most."""
    empty = empty_state(problem)
    base = log_posterior(problem, empty)
    groups = []
    centre_of = np.array([c.start + problem.lengths[c.scenelet] // 2 for c in candidates])
    for i, w in enumerate(sorted(curve.maxima.tolist())):
        near = np.flatnonzero(np.abs(centre_of - curve.centres[w]) <= _reach(curve)).tolist()
        near.sort(key=lambda c: -candidates[c].gain)
        group = []
        for c in near[: 2 * settings.kept]:
            start = candidates[c]
            state = empty.with_item(start.scenelet, start.start, start.placement)
            state = refine(problem, state)
            gain = log_posterior(problem, state) - base
            group.append(Candidate(start.scenelet, start.start, state.placements[0], gain))
        group.sort(key=lambda c: -c.gain)
        groups.append(group[: settings.kept])
        tell("refining candidates", (i + 1) / len(curve.maxima))
    return groups


def _reach(curve: CharnessCurve) -> int:
    """Frames between neighbouring windows: a maximum speaks for those beside it."""
    return int(np.diff(curve.centres).max()) if len(curve.centres) > 1 else 0


def _beam_search(
    problem: Problem, groups: list[list[Candidate]], settings: CombineSettings, tell: Progress
) -> list[State]:
    """Beam search over the maxima: each adds one of its candidates or none."""
    beam = [(log_posterior(problem, empty_state(problem)), empty_state(problem))]
    for i, group in enumerate(groups):
        grown = list(beam)
        for _, state in beam:
            for c in group:
                new = state.with_item(c.scenelet, c.start, c.placement)
                value = log_posterior(problem, new)
                if np.isfinite(value):
                    grown.append((value, new))
        grown.sort(key=lambda pair: -pair[0])
        beam = grown[: settings.beam]
        tell("combining candidates", (i + 1) / len(groups))
    return [state for _, state in beam]


def _diverse(ranked: list[State], count: int) -> list[State]:
    """The best states of which no two share a scenelet at nearby times throughout."""
    chosen: list[State] = []
    for state in ranked:
        names = {tuple(row) for row in state.items.tolist()}
        if all(names != {tuple(r) for r in other.items.tolist()} for other in chosen):
            chosen.append(state)
        if len(chosen) == count:
            break
    return chosen


def refine(problem: Problem, state: State) -> State:
    """Placements under the full posterior, one scenelet at a time, by Nelder and Mead."""
    step = np.array([0.02, 0.05, 0.15])
    for index in range(state.n_scenelets):
        x, y, yaw = state.placements[index]
        start = np.array([x / y, np.log(y), yaw])

        def cost(theta: Array, index: int = index, state: State = state) -> float:
            depth = np.exp(theta[1])
            placed = state.with_placement(index, np.array([theta[0] * depth, depth, theta[2]]))
            return -log_posterior(problem, placed)

        simplex = start + np.vstack([np.zeros(3), np.diag(step)])
        result = minimize(
            cost, start, method="Nelder-Mead", options={"maxfev": 60, "initial_simplex": simplex}
        )
        depth = np.exp(result.x[1])
        placement = np.array([result.x[0] * depth, depth, result.x[2]])
        state = state.with_placement(index, placement)
    return state
