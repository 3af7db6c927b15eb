"""Reversible-jump MCMC: one step (choose a move, propose, accept), and chains of steps.

This is the reference kernel for any target and moves. The program's chains make the same steps by a
compiled kernel of their own, and tests compare both step by step.

The acceptance probability (Green 1995, Biometrika 82(4), eq. 7) has three factors that are computed
separately: the target density, which does not depend on moves; the proposal ratio of a move, which
does not depend on the target; and the probability of choosing the move, which belongs to the
mixture. Choice probabilities are constant, and a move that is impossible in a state leaves the
state unchanged. So no correction is needed at the edges (a death without components, a birth when
all are taken).
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import accumulate
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np

__all__ = [
    "AcceptanceTable",
    "ChainState",
    "Mixture",
    "Move",
    "Proposal",
    "StepInfo",
    "init",
    "sample",
    "step",
]

S = TypeVar("S")


class Proposal(NamedTuple, Generic[S]):
    """A proposed state and its proposal ratio.

    Parameters
    ----------
    state : S
        The proposed state.
    log_ratio : float
        ``log q(reverse) - log q(forward)``, including the log Jacobian; without the target density
        and without the probability of choosing the move.
    """

    state: S
    log_ratio: float


class Move(Protocol[S]):
    """A proposal mechanism.

    Parameters
    ----------
    *args, **kwargs
        The constructor is that of the class.
    """

    @property
    def name(self) -> str:
        """Unique in its mixture."""

    @property
    def reverse(self) -> str:
        """Name of the inverse move; its own name if it is its own inverse."""

    def propose(self, rng: np.random.Generator, state: S, /) -> Proposal[S] | None:
        """Propose a new state.

        Parameters
        ----------
        rng : numpy.random.Generator
        state : S

        Returns
        -------
        Proposal or None
            None where the move is impossible.
        """


@dataclass(frozen=True)
class Mixture(Generic[S]):
    """A mixture of moves, each chosen with the same probability in every state.

    Parameters
    ----------
    moves : sequence of Move
        The reverse of every move must be among them and name it as its reverse.
    weights : sequence of float
        Positive; scaled to sum to one.

    Raises
    ------
    ValueError
        The moves are not mutual inverses, or a weight is not positive.
    """

    moves: Sequence[Move[S]]
    weights: Sequence[float]
    _cumulative: list[float] = field(init=False, repr=False)
    _log_choice_ratio: dict[str, float] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not self.moves or len(self.moves) != len(self.weights):
            raise ValueError(f"{len(self.moves)} moves with {len(self.weights)} weights")
        by_name = {move.name: move for move in self.moves}
        if len(by_name) != len(self.moves):
            raise ValueError("two moves of the mixture have the same name")
        weight_of = dict(zip(by_name, self.weights, strict=True))
        for name, weight in weight_of.items():
            if not 0 < weight < math.inf:
                raise ValueError(f"move '{name}': weight {weight} is not positive")
            reverse = by_name[name].reverse
            if reverse not in by_name:
                raise ValueError(f"move '{name}': its reverse '{reverse}' is not in the mixture")
            if by_name[reverse].reverse != name:
                raise ValueError(f"move '{name}': its reverse '{reverse}' does not name it back")
        total = math.fsum(self.weights)
        cumulative = [value / total for value in accumulate(self.weights)]
        cumulative[-1] = 1.0
        ratios = {
            name: math.log(weight_of[move.reverse]) - math.log(weight_of[name])
            for name, move in by_name.items()
        }
        object.__setattr__(self, "_cumulative", cumulative)
        object.__setattr__(self, "_log_choice_ratio", ratios)

    def choose(self, rng: np.random.Generator) -> Move[S]:
        """Draw a move according to the weights.

        Parameters
        ----------
        rng : numpy.random.Generator

        Returns
        -------
        Move
        """
        return self.moves[bisect_right(self._cumulative, rng.random())]

    def log_choice_ratio(self, move: Move[S]) -> float:
        """log P(reverse is chosen) - log P(move is chosen).

        Parameters
        ----------
        move : Move

        Returns
        -------
        float
        """
        return self._log_choice_ratio[move.name]


class ChainState(NamedTuple, Generic[S]):
    """The state of a chain and its log density.

    Parameters
    ----------
    state : S
    log_density : float
    """

    state: S
    log_density: float


class StepInfo(NamedTuple):
    """Record of one step.

    Parameters
    ----------
    move : str
        The move that was chosen.
    accepted : bool
        Whether the proposal was accepted.
    log_acceptance : float
        Log acceptance probability; -inf if the move was impossible, or if its proposal was not
        evaluated in full because it was certain to be rejected.
    """

    move: str
    accepted: bool
    log_acceptance: float


def init(log_density_fn: Callable[[S], float], state: S) -> ChainState[S]:
    """Evaluate the start of a chain.

    Parameters
    ----------
    log_density_fn : callable
        Log density of the target up to a constant.
    state : S

    Returns
    -------
    ChainState

    Raises
    ------
    FloatingPointError
        The log density at ``state`` is not finite.
    """
    log_density = float(log_density_fn(state))
    if not math.isfinite(log_density):
        raise FloatingPointError(f"a chain cannot start where the log density is {log_density}")
    return ChainState(state, log_density)


def step(
    rng: np.random.Generator,
    chain_state: ChainState[S],
    *,
    log_density_fn: Callable[[S], float],
    mixture: Mixture[S],
) -> tuple[ChainState[S], StepInfo]:
    """Make one Metropolis-Hastings-Green step.

    Parameters
    ----------
    rng : numpy.random.Generator
    chain_state : ChainState
    log_density_fn : callable
        Log density of the target up to a constant; -inf outside its support.
    mixture : Mixture

    Returns
    -------
    chain_state : ChainState
    info : StepInfo

    Raises
    ------
    FloatingPointError
        A log density or ratio is NaN or +inf; the message names the move.
    """
    move = mixture.choose(rng)
    proposal = move.propose(rng, chain_state.state)
    if proposal is None:
        return chain_state, StepInfo(move.name, False, -math.inf)
    proposed = ChainState(proposal.state, float(log_density_fn(proposal.state)))
    for what, value in (("log ratio", proposal.log_ratio), ("log density", proposed.log_density)):
        if math.isnan(value) or value == math.inf:
            raise FloatingPointError(f"move '{move.name}': the {what} of a proposal is {value}")
    log_acceptance = min(
        0.0,
        proposed.log_density
        - chain_state.log_density
        + proposal.log_ratio
        + mixture.log_choice_ratio(move),
    )
    # P(Exponential > -log a) = a. This avoids the logarithm of a uniform number that may be 0.
    accepted = bool(rng.standard_exponential() > -log_acceptance)
    info = StepInfo(move.name, accepted, log_acceptance)
    return (proposed if accepted else chain_state), info


# ------------------------------------------------------------------------------------------------
# Chains are generators; the caller decides about stopping and thinning.


def sample(
    rng: np.random.Generator,
    state: S,
    *,
    log_density_fn: Callable[[S], float],
    mixture: Mixture[S],
) -> Iterator[tuple[ChainState[S], StepInfo]]:
    """Yield an endless chain from ``state``, one item per proposal.

    Parameters
    ----------
    rng : numpy.random.Generator
    state : S
        Start of the chain, which is not yielded.
    log_density_fn : callable
        Log density of the target up to a constant; -inf outside its support.
    mixture : Mixture

    Returns
    -------
    iterator of (ChainState, StepInfo)

    Raises
    ------
    FloatingPointError
        Raised at once if the log density of the start is not finite, and later if the log density
        or ratio of a proposal is NaN or +inf.

    Examples
    --------
    >>> chain = sample(rng, start, log_density_fn=target, mixture=mixture)  # doctest: +SKIP
    >>> draws = [at.state for at, info in islice(chain, 0, 10_000, 10)]  # doctest: +SKIP
    """
    return _steps(rng, init(log_density_fn, state), log_density_fn, mixture)


def _steps(
    rng: np.random.Generator,
    chain_state: ChainState[S],
    log_density_fn: Callable[[S], float],
    mixture: Mixture[S],
) -> Iterator[tuple[ChainState[S], StepInfo]]:
    while True:
        chain_state, info = step(rng, chain_state, log_density_fn=log_density_fn, mixture=mixture)
        yield chain_state, info


@dataclass
class AcceptanceTable:
    """Counts of proposals and acceptances by move.

    Impossible moves count as proposed. Tables of several chains can be added.

    Parameters
    ----------
    proposed, accepted : Counter of str
        Counts by name of the move.
    """

    proposed: Counter[str] = field(default_factory=Counter)
    accepted: Counter[str] = field(default_factory=Counter)

    def record(self, info: StepInfo) -> None:
        """Count one step.

        Parameters
        ----------
        info : StepInfo
        """
        self.proposed[info.move] += 1
        self.accepted[info.move] += info.accepted

    def rates(self) -> dict[str, float]:
        """Acceptance rates by move, in alphabetical order.

        Returns
        -------
        dict of str to float
        """
        return {name: self.accepted[name] / n for name, n in sorted(self.proposed.items())}

    def __add__(self, other: AcceptanceTable) -> AcceptanceTable:
        return AcceptanceTable(self.proposed + other.proposed, self.accepted + other.accepted)
