"""Parts of a step, one at a time."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from itertools import islice

import numpy as np
import pytest

from imapper_prob.samplers.reversible_jump import (
    AcceptanceTable,
    Mixture,
    Proposal,
    init,
    sample,
    step,
)


@dataclass(frozen=True)
class Shift:
    """Moves a number by a fixed amount."""

    name: str
    reverse: str
    by: float = 1.0
    log_ratio: float = 0.0

    def propose(self, rng, state):
        if self.by == 0:
            return None
        return Proposal(state + self.by, self.log_ratio)


UP, DOWN = Shift("up", "down"), Shift("down", "up", -1.0)


def flat(state: float) -> float:
    return 0.0


@pytest.mark.parametrize(
    ("moves", "weights", "message"),
    [
        ((), (), "0 moves"),
        ((UP, DOWN), (1.0,), "2 moves with 1 weights"),
        ((UP, UP), (1.0, 1.0), "same name"),
        ((UP,), (1.0,), "'down' is not in the mixture"),
        ((UP, DOWN), (1.0, 0.0), "'down': weight 0.0 is not positive"),
        ((UP, DOWN), (math.inf, 1.0), "'up': weight inf is not positive"),
        ((UP, Shift("down", "down")), (1.0, 1.0), "'up': its reverse 'down' does not name it"),
    ],
)
def test_a_mixture_that_cannot_be_undone_is_refused(moves, weights, message):
    with pytest.raises(ValueError, match=message):
        Mixture(moves, weights)


def test_moves_are_chosen_by_weight(rng):
    mixture = Mixture((UP, DOWN, Shift("still", "still")), (3.0, 1.0, 4.0))
    n = 20_000
    counts = Counter(mixture.choose(rng).name for _ in range(n))
    for name, share in (("up", 3 / 8), ("down", 1 / 8), ("still", 1 / 2)):
        assert counts[name] / n == pytest.approx(share, abs=4.5 * math.sqrt(share / n))


def test_the_choice_of_moves_is_in_the_ratio(rng):
    mixture = Mixture((UP, DOWN), (0.8, 0.2))
    infos = [step(rng, init(flat, 0.0), log_density_fn=flat, mixture=mixture)[1] for _ in range(50)]
    logs = {info.move: info.log_acceptance for info in infos}
    assert logs["up"] == pytest.approx(math.log(0.2 / 0.8))
    assert logs["down"] == 0.0


def test_a_fall_of_the_density_is_accepted_by_its_size(rng):
    loop = Mixture((Shift("loop", "loop"),), (1.0,))
    at, n = init(flat, 0.0), 20_000
    steps = [step(rng, at, log_density_fn=lambda _: -1.0, mixture=loop)[1] for _ in range(n)]
    share = sum(info.accepted for info in steps) / n
    assert share == pytest.approx(math.exp(-1), abs=4.5 * 0.5 / math.sqrt(n))
    assert {info.log_acceptance for info in steps} == {-1.0}


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_chain_does_not_start_where_the_density_is_not_finite(rng, value):
    with pytest.raises(FloatingPointError, match=f"log density is {value}"):
        # At once: a generator would wait until somebody asks it.
        sample(rng, 0.0, log_density_fn=lambda _: value, mixture=Mixture((UP, DOWN), (1, 1)))


def test_outside_the_support_is_rejected(rng):
    at = init(flat, 0.0)
    after, info = step(
        rng, at, log_density_fn=lambda _: -math.inf, mixture=Mixture((UP, DOWN), (1, 1))
    )
    assert after is at
    assert not info.accepted
    assert info.log_acceptance == -math.inf


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_impossible_densities_name_the_move(rng, value):
    loop = Mixture((Shift("loop", "loop"),), (1.0,))
    with pytest.raises(FloatingPointError, match="'loop': the log density of a proposal"):
        step(rng, init(flat, 0.0), log_density_fn=lambda _: value, mixture=loop)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_impossible_ratios_name_the_move(rng, value):
    loop = Mixture((Shift("loop", "loop", log_ratio=value),), (1.0,))
    with pytest.raises(FloatingPointError, match="'loop': the log ratio of a proposal"):
        step(rng, init(flat, 0.0), log_density_fn=flat, mixture=loop)


def test_an_impossible_move_stays_and_costs_no_density(rng):
    def never(state: float) -> float:
        raise AssertionError("asked for a density")

    at = init(flat, 0.0)
    still = Mixture((Shift("still", "still", by=0.0),), (1.0,))
    after, info = step(rng, at, log_density_fn=never, mixture=still)
    assert after is at
    assert info == ("still", False, -math.inf)


def test_the_same_seed_gives_the_same_chain():
    def density(state: float) -> float:
        return -0.5 * state**2

    def states(seed: int) -> list[float]:
        rng = np.random.default_rng(seed)
        chain = sample(rng, 0.0, log_density_fn=density, mixture=Mixture((UP, DOWN), (1, 1)))
        return [at.state for at, _ in islice(chain, 100)]

    assert states(1) == states(1)
    assert states(1) != states(2)


def test_acceptance_tables_add_up():
    def steep(state: float) -> float:
        return 0.0 if state <= 3 else -math.inf

    def table(seed: int) -> AcceptanceTable:
        result = AcceptanceTable()
        rng = np.random.default_rng(seed)
        chain = sample(rng, 3.0, log_density_fn=steep, mixture=Mixture((UP, DOWN), (1, 1)))
        for _, info in islice(chain, 40):
            result.record(info)
        return result

    one, two = table(1), table(2)
    both = one + two
    assert sum(both.proposed.values()) == 80
    assert both.accepted["down"] == both.proposed["down"]
    assert both.accepted["up"] == one.accepted["up"] + two.accepted["up"]
    assert 0 < both.rates()["up"] < 1
