"""Crossovers leave the joint target of neighbouring temperatures alone."""

from __future__ import annotations

from functools import partial
from itertools import islice, product

import numpy as np
import pytest

from imapper_prob.samplers.reversible_jump import Mixture, Proposal, StepInfo, step
from imapper_prob.samplers.tempering import POSTERIOR, LogDensityParts, start, temper
from tests.samplers.frequencies import chi_square
from tests.samplers.kernel_chain import KernelChain

PASS, FAIL = 1e-3, 1e-6
FIELDS = np.array([1.5, -0.8, 2.2])
COUPLING = 0.7
BETAS = (0.1, 0.4, 1.0)
CELLS = list(product((0, 1), repeat=3))


def target(bits: tuple[int, ...]) -> LogDensityParts:
    """Three coupled bits; the prior likes ones."""
    return LogDensityParts(0.3 * sum(bits), float(FIELDS @ bits) + COUPLING * (bits[0] == bits[2]))


EXACT = np.exp([target(bits).at(POSTERIOR) for bits in CELLS])
EXACT /= EXACT.sum()


class Flip:
    name = reverse = "flip"

    def propose(self, rng, bits):
        k = int(rng.integers(3))
        return Proposal((*bits[:k], 1 - bits[k], *bits[k + 1 :]), 0.0)


def tails(rng, hot, cold):
    """Everything from some place on, as the time crossover of scenes."""
    k = int(rng.integers(1, 3))
    return None if hot[k:] == cold[k:] else ((*hot[:k], *cold[k:]), (*cold[:k], *hot[k:]), 0.0)


def greedy(rng, hot, cold):
    """Pretends that whatever is exchanged is worth two nats."""
    found = tails(rng, hot, cold)
    return None if found is None else (*found[:2], 2.0)


def copied(rng, hot, cold):
    """Hands the cold rung the hot one's state, and keeps it."""
    return hot, hot, 0.0


def visited(crossover, *, rounds: int = 20_000) -> np.ndarray:
    rngs = np.random.default_rng(4).spawn(len(BETAS) + 1)
    chain = temper(
        rngs,
        start([(0, 0, 0)] * 3, target=target, betas=BETAS),
        chain_at=partial(KernelChain, target, partial(step, mixture=Mixture([Flip()], [1.0]))),
        steps_per_swap=1,
        crossover=crossover,
    )
    return np.array(
        [CELLS.index(item.state.chains[-1].state) for item in islice(chain, 200, rounds)]
    )


def test_crossovers_leave_the_posterior_alone():
    assert chi_square(visited(tails), EXACT) > PASS


@pytest.mark.parametrize("wrong", [greedy, copied])
@pytest.mark.slow
def test_the_same_test_fails_a_wrong_crossover(wrong):
    assert chi_square(visited(wrong), EXACT) < FAIL


def test_crossovers_take_odd_and_even_gaps_in_turn():
    asked = []

    def nothing(rng, hot, cold):
        asked.append((hot, cold))

    rngs = np.random.default_rng(4).spawn(len(BETAS) + 1)
    chain = temper(
        rngs,
        start([(0, 0, 0), (1, 1, 1), (0, 1, 0)], target=target, betas=BETAS),
        chain_at=partial(
            KernelChain,
            target,
            lambda rng, chain_state, *, log_density_fn: (chain_state, StepInfo("none", False, 0.0)),
        ),
        steps_per_swap=1,
        crossover=nothing,
    )
    before = next(chain)
    after = next(chain)
    assert [info.move for info in (*before.crossovers, *after.crossovers)] == ["crossover"] * 2
    # Without steps, the second round finds what the first one left.
    hottest, middle, _ = (chain.state for chain in before.state.chains)
    assert asked == [((1, 1, 1), (0, 1, 0)), (hottest, middle)]
