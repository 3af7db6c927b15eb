"""A trans-dimensional target small enough to enumerate: intervals that do not overlap.

States are sets of up to four intervals of one or two slots on six slots, like scenelets on
frames: 157 layouts, each with a known probability.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations, islice

import numpy as np

from imapper_prob.samplers.reversible_jump import Mixture, Proposal, sample
from tests.samplers.frequencies import chi_square

Interval = tuple[int, int]
Intervals = frozenset[Interval]

N_SLOTS, K_MAX = 6, 4
INTERVALS: list[Interval] = [
    (start, start + length) for length in (1, 2) for start in range(N_SLOTS - length + 1)
]
_RNG = np.random.default_rng(20_240)
WEIGHTS = dict(zip(INTERVALS, _RNG.normal(-0.9, 0.7, len(INTERVALS)), strict=True))
# Births are proposed by another distribution than the target's, or ratios would cancel.
BIRTH = dict(zip(INTERVALS, _RNG.dirichlet(np.full(len(INTERVALS), 10.0)), strict=True))


def overlap(state: Intervals) -> bool:
    covered = [slot for interval in state for slot in range(*interval)]
    return len(covered) > len(set(covered))


STATES: list[Intervals] = [
    state
    for k in range(K_MAX + 1)
    for state in map(frozenset, combinations(INTERVALS, k))
    if not overlap(state)
]


def log_density(state: Intervals) -> float:
    return sum(WEIGHTS[interval] for interval in state) + 0.3 * (len(state) == 2)


def exact() -> np.ndarray:
    weights = np.exp([log_density(state) for state in STATES])
    return weights / weights.sum()


def draw_interval(rng: np.random.Generator) -> Interval:
    return INTERVALS[rng.choice(len(INTERVALS), p=list(BIRTH.values()))]


def draw_member(rng: np.random.Generator, state: Intervals) -> Interval:
    return sorted(state)[rng.integers(len(state))]


@dataclass(frozen=True)
class Birth:
    name = "birth"
    reverse = "death"

    def propose(self, rng, state):
        new = draw_interval(rng)
        if len(state) == K_MAX or new in state or overlap(state | {new}):
            return None
        return Proposal(state | {new}, -np.log(len(state) + 1) - np.log(BIRTH[new]))

    def log_proposal_density(self, old, new):
        (born,) = new - old
        return np.log(BIRTH[born])


@dataclass(frozen=True)
class Death:
    name = "death"
    reverse = "birth"

    def propose(self, rng, state):
        if not state:
            return None
        gone = draw_member(rng, state)
        return Proposal(state - {gone}, np.log(BIRTH[gone]) + np.log(len(state)))

    def log_proposal_density(self, old, new):
        return -np.log(len(old))


@dataclass(frozen=True)
class Swap:
    name = "swap"
    reverse = "swap"

    def propose(self, rng, state):
        if not state:
            return None
        gone, new = draw_member(rng, state), draw_interval(rng)
        proposed = state - {gone} | {new}
        if len(proposed) < len(state) or overlap(proposed):
            return None
        return Proposal(proposed, np.log(BIRTH[gone]) - np.log(BIRTH[new]))

    def log_proposal_density(self, old, new):
        if old == new:
            # Every member may have been replaced by itself.
            return np.log(np.mean([BIRTH[interval] for interval in old]))
        (born,) = new - old
        return np.log(BIRTH[born]) - np.log(len(old))


class WrongStateBirth(Birth):
    """Takes the probability of the death that would undo it from the state before."""

    def propose(self, rng, state):
        proposal = super().propose(rng, state)
        if proposal is None:
            return None
        wrong = np.log(len(state) + 1) - np.log(max(len(state), 1))
        return Proposal(proposal.state, proposal.log_ratio + wrong)


class EagerDeath(Death):
    """Where nothing lives it gives birth instead, and forgets the factor for doing so."""

    def propose(self, rng, state):
        return super().propose(rng, state) if state else Birth().propose(rng, state)


class ForgetfulMixture(Mixture):
    """Leaves the probability of choosing a move out of the ratio."""

    def log_choice_ratio(self, move):
        return 0.0


def mixture(
    birth: Birth | None = None,
    death: Death | None = None,
    kind: Callable[..., Mixture] = Mixture,
) -> Mixture:
    return kind((birth or Birth(), death or Death(), Swap()), (0.45, 0.3, 0.25))


def visits(moves: Mixture, *, seed: int, n: int = 40_000) -> np.ndarray:
    """(n,) index of the state a chain is in."""
    index = {state: i for i, state in enumerate(STATES)}
    chain = sample(
        np.random.default_rng(seed), frozenset(), log_density_fn=log_density, mixture=moves
    )
    return np.array([index[at.state] for at, _ in islice(chain, n)])


def p_value(states: np.ndarray) -> float:
    """How probable visits are that far from the exact answer, layout by layout or by number.

    The better known numbers of intervals notice what drowns among 157 layouts; Bonferroni
    pays for asking twice.
    """
    sizes = np.array([len(state) for state in STATES])
    return 2 * min(
        chi_square(states, exact()),
        chi_square(sizes[states], np.bincount(sizes, weights=exact())),
    )
