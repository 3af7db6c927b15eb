"""Moves whose choices can be counted are balanced exactly: every state, every choice, no chance."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from typing import Protocol, cast

import numpy as np
import pytest

from imapper_prob.models.log_posterior import State, empty_state
from imapper_prob.samplers.reversible_jump import Proposal
from imapper_prob.sampling.moves import Shift, flush_run, in_order
from tests.models import worlds

PROBLEM = worlds.problem(20)
LENGTH = int(PROBLEM.lengths[0])

Starts = tuple[int, ...]


class Move(Protocol):
    def propose(self, rng: np.random.Generator, state: State) -> Proposal[State] | None: ...


class Choices:
    """In place of a generator: takes the choices it is told, and lists what else there was."""

    def __init__(self, told: tuple[int, ...]) -> None:
        self.told, self.options = told, list[int]()

    def _choose(self, n: int) -> int:
        position = len(self.options)
        self.options.append(n)
        return self.told[position] if position < len(self.told) else 0

    def integers(self, low: int, high: int | None = None) -> int:
        return self._choose(low) if high is None else low + self._choose(high - low)

    def random(self) -> float:
        """One of two halves, which is all that a move that compares it with .5 can tell."""
        return (0.25, 0.75)[self._choose(2)]


def every_proposal(move: Move, state: State) -> Iterator[tuple[float, Proposal[State]]]:
    """Probability and result of every way in which the choices can fall."""
    waiting: list[tuple[int, ...]] = [()]
    while waiting:
        told = waiting.pop()
        choices = Choices(told)
        proposal = move.propose(cast("np.random.Generator", choices), state)
        for k in range(len(told), len(choices.options)):
            first = (*told, *[0] * (k - len(told)))
            waiting += [(*first, other) for other in range(1, choices.options[k])]
        if proposal is not None:
            yield 1 / float(np.prod(choices.options)), proposal


def all_states() -> dict[Starts, State]:
    """Three scenelets of one motion in 20 frames, wherever there is room."""
    states = {}
    for slots in combinations(range(PROBLEM.n_frames - 3 * LENGTH + 3), 3):
        starts = tuple(s + k * (LENGTH - 1) for k, s in enumerate(slots))
        state = empty_state(PROBLEM)
        for start in starts:
            state = state.with_item(0, start, np.array([0.0, 4.0, 0.0]))
        states[starts] = state
    return states


def imbalance(move: Move) -> float:
    """Greatest difference between the probabilities of going one way and back."""
    states, flow = all_states(), defaultdict[tuple[Starts, Starts], float](float)
    assert len(states) == 10
    for starts, state in states.items():
        for probability, proposal in every_proposal(move, state):
            assert proposal.log_ratio == 0.0
            flow[starts, tuple(proposal.state.items[:, 1].tolist())] += probability
    assert {pair[1] for pair in flow} == set(states)
    return max(abs(p - flow.get((b, a), 0.0)) for (a, b), p in flow.items())


class Hasty(Shift):
    """Shifts what is flush together wherever it goes, to others that it will be flush with too."""

    def propose(self, rng: np.random.Generator, state: State) -> Proposal[State] | None:
        index, reach = int(rng.integers(state.n_scenelets)), self.reach
        step = int(rng.integers(1, reach + 1)) * (1 if rng.random() < 0.5 else -1)
        items = state.items.copy()
        run, together = flush_run(self.problem, state, index), rng.random() < 0.5
        items[run if together else slice(index, index + 1), 1] += step
        changed = replace(state, items=items)
        return Proposal(changed, 0.0) if in_order(self.problem, changed) else None


@pytest.mark.parametrize("reach", [1, 4])
def test_shifts_there_and_back_are_as_likely(reach: int) -> None:
    assert imbalance(Shift(PROBLEM, reach=reach)) < 1e-12


def test_a_shift_that_gathers_others_on_its_way_is_seen() -> None:
    assert imbalance(Hasty(PROBLEM, reach=1)) > 0.05


def test_every_choice_is_counted_once() -> None:
    class Dice:
        def propose(self, rng: np.random.Generator, state: State) -> Proposal[State] | None:
            up = rng.random() < 0.5
            step = int(rng.integers(3)) if up else 0
            return Proposal(replace(state, camera=state.camera + step), 0.0)

    ways = list(every_proposal(Dice(), empty_state(PROBLEM)))
    assert sorted(p for p, _ in ways) == pytest.approx([1 / 6, 1 / 6, 1 / 6, 1 / 2])
