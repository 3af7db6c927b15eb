"""Exchanges: one stay at a time, what happens in it for what does better, as long as it does.

Combinations are made of the few candidates kept at each maximum of charness, and these were
judged in an empty scene. Among the others of a scene another one may do better, or several in
a row: its motion goes on from its neighbours', its furniture has room beside theirs, or it
explains frames that had nothing. The paper leaves the choice at that (Monszpart et al. 2019,
section 5); this is a coordinate ascent on top of it, stretch by stretch of the clip, over the best
sequences of candidates of all windows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imapper_prob.models.posterior import State, log_posterior
from imapper_prob.models.problem import Problem
from imapper_prob.staged.candidates import Candidate, assigned, refine
from imapper_prob.staged.sequences import best_sequences

__all__ = ["Exchange", "exchange"]

_REFINED = 12
"""Sequences that are refined before one is chosen: candidates were placed in an empty scene."""
_WORTH = 0.5
"""Nats an exchange has to bring; less is how exactly placements are found."""
_ROUNDS = 4
"""Times at most that the clip is gone through. On i3DB nothing is left to do after one or two."""
_APART = 3
"""Windows without a scenelet that part two stays; 1.2 s."""


@dataclass(frozen=True)
class Exchange:
    """One exchange.

    Parameters
    ----------
    candidates : tuple of Candidate
        What came into the scene, as it was placed before it was refined; none where scenelets
        were only taken out.
    gain : float
        Nats it brought.
    state : State
        The scene after it.
    """

    candidates: tuple[Candidate, ...]
    gain: float
    state: State


def exchange(
    problem: Problem, state: State, candidates: Sequence[Candidate], *, step: int
) -> tuple[Exchange, ...]:
    """The best exchange in each stretch of the clip, and again until none brings anything.

    A stretch is what lies between the stays before and after one. The camera stays.

    Parameters
    ----------
    problem : Problem
    state : State
    candidates : sequence of Candidate
    step : int
        Frames from one window to the next.
    """
    done: list[Exchange] = []
    tried: set[tuple[int, int, bytes, bytes]] = set()
    for _ in range(_ROUNDS):
        before, reached = len(done), -1
        while ahead := [s for s in _stretches(problem, state, _APART * step) if s[1] > reached]:
            begin, reached = ahead[0]
            rest = _without(state, begin, reached)
            attempt = (begin, reached, rest.items.tobytes(), rest.placements.tobytes())
            if attempt in tried:
                continue
            tried.add(attempt)
            better = _best(problem, state, rest, candidates, (begin, reached), step)
            if better is not None:
                done.append(better)
                state = better.state
        if len(done) == before:
            break
    return tuple(done)


def _best(
    problem: Problem,
    state: State,
    rest: State,
    candidates: Sequence[Candidate],
    stretch: tuple[int, int],
    step: int,
) -> Exchange | None:
    """The best of what may happen in a stretch beside the rest, if it is worth it."""
    sequences = best_sequences(
        problem, rest, candidates, within=stretch, slide=step // 2, count=_REFINED
    )
    scenes = [rest, *(_refined(problem, rest, members) for members in sequences)]
    values = [log_posterior(problem, scene) for scene in scenes]
    best = int(np.argmax(values))
    gain = values[best] - log_posterior(problem, state)
    return Exchange(((), *sequences)[best], gain, scenes[best]) if gain >= _WORTH else None


def _refined(problem: Problem, rest: State, members: Sequence[Candidate]) -> State:
    """The scene with these as well, refined twice: where one ends up moves those it joins."""
    state = assigned(rest, members)
    own = {(c.scenelet, c.start) for c in members}
    added = [k for k, item in enumerate(state.items.tolist()) if tuple(item) in own]
    return refine(problem, state, only=2 * added)


def _stretches(problem: Problem, state: State, apart: int) -> list[tuple[int, int]]:
    """By stay the frames from the end of the one before to the start of the one after it.

    The whole clip where there is none.
    """
    starts = state.items[:, 1]
    ends = starts + problem.lengths[state.items[:, 0]]
    parts = np.flatnonzero(starts[1:] - ends[:-1] >= apart)
    if not len(starts):
        return [(0, problem.n_frames)]
    # Where stays begin and end, with nothing before the first and after the last.
    stops = [0, *ends[parts].tolist(), int(ends[-1])]
    begins = [int(starts[0]), *starts[parts + 1].tolist(), problem.n_frames]
    return list(zip(stops[:-1], begins[1:], strict=True))


def _without(state: State, begin: int, end: int) -> State:
    """The scene without what is in a stretch."""
    for index in reversed(range(state.n_scenelets)):
        if begin <= state.items[index, 1] < end:
            state = state.without_item(index)
    return state
