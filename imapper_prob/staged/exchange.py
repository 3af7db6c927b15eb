"""Exchanges: one candidate at a time for what covers its frames, as long as that is better.

Combinations are made of the few candidates kept at each maximum of charness, and these were
judged in an empty scene. Among the others of a scene another one may do better: its motion goes
on from its neighbours', its furniture has room beside theirs, or it explains frames that had
nothing. The paper leaves the choice at that (Monszpart et al. 2019, section 5); this is a
coordinate ascent on top of it, over all candidates of all windows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imapper_prob.models.posterior import State, log_posterior
from imapper_prob.models.problem import Problem
from imapper_prob.staged.candidates import Candidate, refine

__all__ = ["Exchange", "exchange"]

_REFINED = 12
"""Exchanges that are refined before one is chosen: candidates were placed in an empty scene."""
_WORTH = 0.5
"""Nats an exchange has to bring; less is how exactly placements are found."""
_MOST = 20
"""Exchanges at most. On i3DB there are one to seven until none is left that brings anything."""


@dataclass(frozen=True)
class Exchange:
    """One exchange.

    Parameters
    ----------
    candidate : Candidate or None
        What came into the scene; None where a scenelet was taken out.
    gain : float
        Nats it brought.
    state : State
        The scene after it.
    """

    candidate: Candidate | None
    gain: float
    state: State


def exchange(
    problem: Problem, state: State, candidates: Sequence[Candidate]
) -> tuple[Exchange, ...]:
    """The best exchange, then the best one in the scene after it, and so on; the camera stays.

    An exchange puts a candidate in place of all scenelets that it overlaps, or takes one away.
    """
    done: list[Exchange] = []
    while len(done) < _MOST:
        before = log_posterior(problem, state)
        better = [
            Exchange(None, 0.0, state.without_item(index)) for index in range(state.n_scenelets)
        ]
        better += _most_promising(problem, state, candidates)
        if not better:
            break
        values = [log_posterior(problem, option.state) for option in better]
        best = int(np.argmax(values))
        if values[best] < before + _WORTH:
            break
        state = better[best].state
        done.append(Exchange(better[best].candidate, values[best] - before, state))
    return tuple(done)


def _most_promising(
    problem: Problem, state: State, candidates: Sequence[Candidate]
) -> list[Exchange]:
    """Those that are best as they were placed, refined."""
    options = [_in_place(problem, state, candidate) for candidate in candidates]
    values = np.array([log_posterior(problem, option) for option in options])
    promising = []
    for k in np.argsort(-values, kind="stable")[:_REFINED].tolist():
        if np.isfinite(values[k]):
            own = np.array([candidates[k].scenelet, candidates[k].start])
            index = int(np.flatnonzero((options[k].items == own).all(1))[0])
            promising.append(Exchange(candidates[k], 0.0, refine(problem, options[k], only=index)))
    return promising


def _in_place(problem: Problem, state: State, candidate: Candidate) -> State:
    """The scene with a candidate in place of what it overlaps."""
    first, last = candidate.start, candidate.start + problem.lengths[candidate.scenelet]
    ends = state.items[:, 1] + problem.lengths[state.items[:, 0]]
    for index in np.flatnonzero((state.items[:, 1] < last) & (first < ends))[::-1].tolist():
        state = state.without_item(index)
    return state.with_item(candidate.scenelet, first, candidate.placement, candidate.size)
