"""Draws beside what is there: the target stays, exactly."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from imapper_prob.samplers.reversible_jump import (
    Drawn,
    Mixture,
    Redraw,
    choice_probabilities,
    init,
    step,
)

TARGET = np.array([0.5, 0.3, 0.15, 0.05])
TABLE = np.array([0.1, 0.2, 0.3, 0.4])
"""Of the draws: the commonest state is drawn least often."""


def log_target(state: int) -> float:
    # Known up to a constant.
    return float(np.log(TARGET[state])) + 7.0


class Die(Redraw[int]):
    """Draws from a table, whatever the state."""

    name = "die"

    def __init__(self, n: int, *, wrong: float = 0.0) -> None:
        self.n, self.wrong = n, wrong

    def beside(self, state: int, others: tuple[int, ...]) -> Drawn[int]:
        log_q = np.log(TABLE)
        present = float(log_q[state]) + self.wrong * state
        return Drawn(present, [(k, float(log_q[k])) for k in others])

    def draw(self, rng: np.random.Generator, state: int, *, power: float) -> Drawn[int] | None:
        assert power == 1.0
        return self.beside(state, tuple(rng.choice(4, self.n, p=TABLE).tolist()))


def transitions(die: Die) -> np.ndarray:
    """(4, 4) probabilities of one step, over every way in which the draws can fall."""
    result = np.zeros((4, 4))
    for state in range(4):
        for others in itertools.product(range(4), repeat=die.n):
            chances, _ = choice_probabilities(
                log_target(state), die.beside(state, others), log_target
            )
            for k, chance in zip((state, *others), chances, strict=True):
                result[state, k] += math.prod(TABLE[list(others)]) * chance
    return result


@pytest.mark.parametrize("n", [1, 2, 5])
def test_the_target_is_left_as_it_is(n: int) -> None:
    matrix = transitions(Die(n))
    np.testing.assert_allclose(matrix.sum(1), 1.0, atol=1e-12)
    np.testing.assert_allclose(TARGET @ matrix, TARGET, atol=1e-12)
    flow = TARGET[:, None] * matrix
    np.testing.assert_allclose(flow, flow.T, atol=1e-12)


def test_more_draws_come_nearer_to_independent_ones() -> None:
    apart = [np.abs(transitions(Die(n)) - TARGET).max() for n in (1, 2, 5)]
    assert apart[0] > apart[1] > apart[2]


def test_a_density_of_what_is_there_that_is_off_is_seen() -> None:
    matrix = transitions(Die(2, wrong=0.1))
    assert np.abs(TARGET @ matrix - TARGET).max() > 1e-3


def test_steps_are_made_with_these_probabilities(rng: np.random.Generator) -> None:
    mixture, n = Mixture((Die(2),), (1.0,)), 20_000
    counts = np.zeros(4)
    for _ in range(n):
        at, info = step(rng, init(log_target, 0), log_density_fn=log_target, mixture=mixture)
        counts[at.state] += 1
        assert at.log_density == log_target(at.state)
        # One of the draws may be the state that is there.
        assert info.accepted or at.state == 0
        assert info.log_acceptance <= 0
    expected = transitions(Die(2))[0]
    assert np.abs(counts / n - expected).max() < 4.5 * 0.5 / math.sqrt(n)


def test_where_nothing_can_be_drawn_the_chain_stays(rng: np.random.Generator) -> None:
    class Nothing(Die):
        def draw(self, rng: np.random.Generator, state: int, *, power: float) -> None:
            return None

    mixture = Mixture((Nothing(1),), (1.0,))
    at = init(log_target, 2)
    after, info = step(rng, at, log_density_fn=log_target, mixture=mixture)
    assert after is at
    assert info == ("die", False, -math.inf, None)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_impossible_densities_name_the_move(rng: np.random.Generator, value: float) -> None:
    mixture = Mixture((Die(2),), (1.0,))
    with pytest.raises(FloatingPointError, match="'die': a draw has the log densities"):
        step(rng, init(log_target, 0), log_density_fn=lambda _: value, mixture=mixture)


def test_draws_outside_the_support_are_never_kept(rng: np.random.Generator) -> None:
    def only_two(state: int) -> float:
        return 0.0 if state == 2 else -math.inf

    mixture = Mixture((Die(4),), (1.0,))
    for _ in range(200):
        at, _ = step(rng, init(only_two, 2), log_density_fn=only_two, mixture=mixture)
        assert at.state == 2
