"""Moves whose choices can be counted are balanced exactly: every state, every choice, no chance."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator
from itertools import combinations
from typing import cast

import numpy as np
import pytest

from imapper_prob.models.log_posterior import empty_state
from imapper_prob.sampling import moves
from imapper_prob.sampling.scene import (
    StateArrays,
    arrays_of,
    flush_run,
    state_of,
)
from tests.models import worlds
from tests.sampling.scenes import in_order

PROBLEM = worlds.problem(20)
LENGTH = int(PROBLEM.lengths[0])

Starts = tuple[int, ...]


Move = Callable[[np.random.Generator, StateArrays], tuple[StateArrays, float]]


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


def every_proposal(move: Move, scene: StateArrays) -> Iterator[tuple[float, StateArrays]]:
    """Probability and result of every way in which the choices can fall."""
    waiting: list[tuple[int, ...]] = [()]
    while waiting:
        told = waiting.pop()
        choices = Choices(told)
        new, ratio = move(cast("np.random.Generator", choices), scene)
        for k in range(len(told), len(choices.options)):
            first = (*told, *[0] * (k - len(told)))
            waiting += [(*first, other) for other in range(1, choices.options[k])]
        if ratio > -np.inf and in_order(PROBLEM, state_of(StateArrays(*(a.copy() for a in new)))):
            assert ratio == 0.0
            yield 1 / float(np.prod(choices.options)), new


def all_scenes() -> dict[Starts, StateArrays]:
    """Three scenelets of one motion in 20 frames, wherever there is room."""
    states = {}
    for slots in combinations(range(PROBLEM.n_frames - 3 * LENGTH + 3), 3):
        starts = tuple(s + k * (LENGTH - 1) for k, s in enumerate(slots))
        state = empty_state(PROBLEM)
        for start in starts:
            state = state.with_item(0, start, np.array([0.0, 4.0, 0.0]))
        states[starts] = arrays_of(state)
    return states


def imbalance(move: Move) -> float:
    """Greatest difference between the probabilities of going one way and back."""
    scenes, flow = all_scenes(), defaultdict[tuple[Starts, Starts], float](float)
    assert len(scenes) == 10
    for starts, scene in scenes.items():
        for probability, new in every_proposal(move, scene):
            flow[starts, tuple(new.items[:, 1].tolist())] += probability
    assert {pair[1] for pair in flow} == set(scenes)
    return max(abs(p - flow.get((b, a), 0.0)) for (a, b), p in flow.items())


def shifts(rng: np.random.Generator, scene: StateArrays) -> tuple[StateArrays, float]:
    return moves.shift.py_func(PROBLEM.lengths, rng, scene)


def hasty(rng: np.random.Generator, scene: StateArrays) -> tuple[StateArrays, float]:
    """Shifts what is flush together wherever it goes, to others that it will be flush with too."""
    index = rng.integers(0, len(scene.items))
    step = rng.integers(1, 2) * (1 if rng.random() < 0.5 else -1)
    first, last = flush_run(PROBLEM.lengths, scene.items, index)
    together, items = rng.random() < 0.5, scene.items.copy()
    items[slice(first, last) if together else slice(index, index + 1), 1] += step
    return scene._replace(items=items), 0.0


@pytest.mark.parametrize("reach", [1, 4])
def test_shifts_there_and_back_are_as_likely(reach: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(moves, "_REACH", reach)
    assert imbalance(shifts) < 1e-12


def test_a_shift_that_gathers_others_on_its_way_is_seen() -> None:
    assert imbalance(hasty) > 0.05


def test_every_choice_is_counted_once() -> None:
    def dice(rng: np.random.Generator, scene: StateArrays) -> tuple[StateArrays, float]:
        up = rng.random() < 0.5
        step = int(rng.integers(0, 3)) if up else 0
        return scene._replace(camera=scene.camera + step), 0.0

    ways = list(every_proposal(dice, arrays_of(empty_state(PROBLEM))))
    assert sorted(p for p, _ in ways) == pytest.approx([1 / 6, 1 / 6, 1 / 6, 1 / 2])
