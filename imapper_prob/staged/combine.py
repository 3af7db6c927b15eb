"""Combinations: from candidates at the maxima of charness to whole scenes.

The paper tries every combination of three candidates a maximum (Monszpart et al. 2019,
section 5). Here a beam search over the maxima does, which may also leave a maximum empty;
the best scenes are refined once more under the full log-posterior.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from imapper_prob.models.posterior import State, empty_state, log_posterior
from imapper_prob.models.problem import Problem
from imapper_prob.staged.candidates import Candidate, furniture_kinds, refine
from imapper_prob.staged.maxima import CharnessCurve
from imapper_prob.staged.polish import polish

__all__ = ["CombineSettings", "combine"]

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class CombineSettings:
    """Parameters
    ----------
    kept : int
        Candidates a maximum (3 in the paper), each of another kind of furniture.
    beam : int
        Partial combinations carried from one maximum to the next.
    alternatives : int
        Scenes returned beside the best.
    """

    kept: int = 3
    beam: int = 40
    alternatives: int = 4


def combine(
    problem: Problem,
    candidates: Sequence[Candidate],
    curve: CharnessCurve,
    *,
    settings: CombineSettings | None = None,
    progress: Progress | None = None,
) -> tuple[State, ...]:
    """The best scene under the full log-posterior, then its diverse alternatives."""
    settings = settings or CombineSettings()
    groups = [_at(window, candidates, settings.kept) for window in sorted(curve.maxima.tolist())]
    ranked = _beam_search(problem, groups, settings.beam)
    chosen = _diverse(problem, ranked, 1 + settings.alternatives)
    states = []
    for i, state in enumerate(chosen):
        states.append(polish(problem, refine(problem, state)))
        if progress is not None:
            progress("refining scenes", (i + 1) / len(chosen))
    return tuple(sorted(states, key=lambda s: -log_posterior(problem, s)))


def _at(window: int, candidates: Sequence[Candidate], kept: int) -> list[Candidate]:
    """The best candidate of each kind in a window and those beside it, the best few of these."""
    best: dict[tuple[int, ...], Candidate] = {}
    for c in candidates:
        near = abs(c.window - window) <= 1
        if near and c.kind and (c.kind not in best or c.gain > best[c.kind].gain):
            best[c.kind] = c
    return sorted(best.values(), key=lambda c: -c.gain)[:kept]


def _beam_search(problem: Problem, groups: list[list[Candidate]], width: int) -> list[State]:
    """States, best first: each maximum in turn adds one of its candidates or none."""
    empty = empty_state(problem)
    beam = [(log_posterior(problem, empty), empty)]
    for group in groups:
        grown = list(beam)
        for _, state in beam:
            for c in group:
                new = state.with_item(c.scenelet, c.start, c.placement, c.size)
                value = log_posterior(problem, new)
                if np.isfinite(value):
                    grown.append((value, new))
        grown.sort(key=lambda pair: -pair[0])
        beam = grown[:width]
    return [state for _, state in beam]


def _diverse(problem: Problem, ranked: list[State], count: int) -> list[State]:
    """The best states no two of which have the same kinds of furniture in the same order."""
    kinds = furniture_kinds(problem)
    chosen: dict[tuple[tuple[int, ...], ...], State] = {}
    for state in ranked:
        chosen.setdefault(tuple(kinds[s] for s in state.items[:, 0]), state)
    return list(chosen.values())[:count]
