"""Moves of scenes one by one, for the samplers and checks that are not compiled."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from imapper_prob.models.log_posterior import State, empty_state
from imapper_prob.models.problem import Problem
from imapper_prob.samplers.reversible_jump import Mixture, Proposal
from imapper_prob.sampling.gains import Gains, frames_left_of
from imapper_prob.sampling.learning import learn
from imapper_prob.sampling.reference import Reference
from imapper_prob.sampling.scene import arrays_of, state_of
from imapper_prob.sampling.steps import MOVES, Moves, propose, scene_moves
from imapper_prob.sampling.visits import Visits


def assert_same_states(one: Sequence[State], other: Sequence[State]) -> None:
    """All numbers of all states are the same to the last bit."""
    for a, b in zip(one, other, strict=True):
        for field in fields(State):
            np.testing.assert_array_equal(getattr(a, field.name), getattr(b, field.name))


def in_order(problem: Problem, state: State) -> bool:
    """Whether scenelets are inside the clip, in order and without overlap."""
    end = 0
    for scenelet, start in state.items.tolist():
        if start < end:
            return False
        end = start + int(problem.lengths[scenelet])
    return end <= problem.n_frames


@dataclass(frozen=True)
class SceneMove:
    """One of ``MOVES``, which undoes itself."""

    moves: Moves
    name: str

    @property
    def reverse(self) -> str:
        return self.name

    def propose(self, rng: np.random.Generator, state: State) -> Proposal[State] | None:
        number = list(MOVES).index(self.name)
        scene, ratio = propose(self.moves, number, rng, arrays_of(state))
        return None if ratio == -math.inf else Proposal(state_of(scene), float(ratio))


def mixture_of(moves: Moves, names: Sequence[str] = tuple(MOVES)) -> Mixture[State]:
    """Those that are ever tried."""
    chosen = {
        name: weight
        for name, weight in zip(MOVES, moves.weights.tolist(), strict=True)
        if weight > 0 and name in names
    }
    return Mixture([SceneMove(moves, name) for name in chosen], list(chosen.values()))


def random_gains(problem: Problem, seed: int = 0) -> Gains:
    """Of less than a nat, and sizes, which say nothing of the data."""
    rng = np.random.default_rng(seed)
    shape = problem.n_frames, len(problem.lengths)
    gains = 0.3 * rng.normal(size=shape)
    gains[problem.lengths > frames_left_of(problem)[:-1, None]] = -np.inf
    return Gains(gains, 0.05 * rng.normal(size=shape))


def similarity() -> np.ndarray:
    """The second is more like the first than the third is."""
    return np.array([[0.0, 0.7, 0.3], [0.6, 0.0, 0.4], [0.5, 0.5, 0.0]])


def learnt_at_random(problem: Problem, count: int = 200) -> Reference:
    """A reference of scenes at random: it knows nothing of the data."""
    visits = Visits()
    for seed in range(count):
        visits.note(random_state(problem, seed))
    return learn(problem, random_gains(problem), similarity(), visits)


def moves_of(problem: Problem) -> Moves:
    """All moves, the camera's in half of its prior."""
    shape = 0.5 * np.linalg.cholesky(np.linalg.inv(problem.camera_precision))
    return scene_moves(problem, learnt_at_random(problem), shape)


def random_state(problem: Problem, seed: int) -> State:
    """A state with up to four scenelets, wherever there is room."""
    rng = np.random.default_rng(seed)
    state = empty_state(problem)
    for _ in range(int(rng.integers(0, 5))):
        scenelet = int(rng.integers(len(problem.lengths)))
        start = int(rng.integers(problem.n_frames - problem.lengths[scenelet] + 1))
        place = np.array([rng.normal(0, 0.5), rng.uniform(3, 5), rng.uniform(-3, 3)])
        more = state.with_item(scenelet, start, place, rng.normal(0, 0.03))
        state = more if in_order(problem, more) else state
    return state
