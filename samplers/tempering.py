"""Parallel tempering of any kernel, and the ladder of inverse temperatures.

The target is ``log prior + beta log likelihood``, from the prior (beta = 0) to the posterior
(beta = 1). A kernel is handed an ordinary log density, that of its rung. Only swaps need the two
parts, of which a swap's ratio keeps nothing but the likelihoods.

Even and odd pairs of neighbours swap in turn. Each pair's swap leaves the joint target alone, and
the alternation, unlike pairs drawn by chance, carries states on in the direction they came from.

Where states have parts that hardly know of each other, swaps of whole states fail because of their
sheer number: what is gained in one part is lost in another. A crossover exchanges a part only,
between the pairs that do not swap in that round.

The prior can be any distribution that is known up to a constant. Where it can be drawn from, the
chain at beta = 0 needs no kernel, and what comes from there is independent of all that was before.

References
----------
Geyer 1991, Computing Science and Statistics 23, 156 (parallel tempering).
Liang & Wong 2000, Statistica Sinica 10, 317 (crossover between temperatures).
Xie, Lewis, Fan, Kuo & Chen 2011, Syst. Biol. 60, 150 (powers of the likelihood).
Vousden, Farr & Mandel 2016, MNRAS 455, 1919 (equal swap rates by stochastic approximation).
Syed, Bouchard-Côté, Deligiannidis & Doucet 2022, JRSS B 84, 321 (even-odd swaps, barrier, round
trips).
Surjanovic, Syed, Bouchard-Côté & Campbell 2022, NeurIPS 35 (a learnt distribution as the prior).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from imapper_prob.samplers.reversible_jump import ChainState, StepInfo, init

__all__ = [
    "KernelWalker",
    "LadderSummary",
    "Parts",
    "SwapTable",
    "Tempered",
    "TemperingInfo",
    "TemperingState",
    "Walker",
    "power_ladder",
    "respaced",
    "start",
    "temper",
]


# The distributions change fastest near the prior. On the scale beta^0.3, on which Xie et al.
# recommend even steps, they change about evenly.
_SCALE = 0.3


def power_ladder(n_rungs: int) -> tuple[float, ...]:
    """Inverse temperatures to start from, even on the scale beta^0.3.

    Parameters
    ----------
    n_rungs : int
        At least 2.

    Returns
    -------
    tuple of float
        Ascending from 0, the prior itself, to 1.
    """
    if n_rungs < 2:
        raise ValueError(f"a ladder of {n_rungs} rungs cannot go from 0 to 1")
    betas = np.linspace(0, 1, n_rungs) ** (1 / _SCALE)
    return (0.0, *betas[1:-1].tolist(), 1.0)


def respaced(
    betas: Sequence[float], acceptance: Sequence[float], *, gain: float
) -> tuple[float, ...]:
    """Widen the gaps across which swaps succeed more often than on average, narrow the others.

    Gaps are taken on the scale beta^0.3 and multiplied by exp(gain (rate - mean rate)); both
    ends stay. Repeated with falling gains this is a stochastic approximation whose only
    fixed point has equal rates.

    Parameters
    ----------
    betas : sequence of K float
        Ascending.
    acceptance : sequence of K - 1 float
        Probability of a swap across each gap.
    gain : float
        Positive.

    Returns
    -------
    tuple of K float
    """
    if len(betas) <= 2:
        return tuple(betas)
    places = np.asarray(betas) ** _SCALE
    rates = np.asarray(acceptance)
    gaps = np.diff(places) * np.exp(gain * (rates - rates.mean()))
    gaps *= (places[-1] - places[0]) / gaps.sum()
    inner = (places[0] + np.cumsum(gaps[:-1])) ** (1 / _SCALE)
    return (betas[0], *inner.tolist(), betas[-1])


class LadderSummary(NamedTuple):
    """How well replicas travelled between the prior's end and the posterior's.

    Parameters
    ----------
    betas : tuple of K float
        Inverse temperatures, ascending.
    swap_rates : tuple of K - 1 float
        Mean probability of a swap across each gap.
    round_trips : int
        Journeys of replicas from one end to the other and back.
    rounds : int
        Rounds of swaps that were counted.
    """

    betas: tuple[float, ...]
    swap_rates: tuple[float, ...]
    round_trips: int
    rounds: int

    @property
    def barrier(self) -> float:
        """Sum of the rejection rates; 2 barrier + 1 rungs are about the best number (Syed)."""
        return float(sum(1 - rate for rate in self.swap_rates))


@dataclass(frozen=True)
class SwapTable:
    """Counts swaps and journeys while the inverse temperatures of a ladder stay.

    All fields are plain numbers, so that ``dataclasses.asdict`` can go into a checkpoint and
    ``SwapTable(**values)`` comes back.

    Parameters
    ----------
    betas : sequence of K float
    rounds : int
        Rounds so far.
    swaps : sequence of K - 1 float
        Sums of swap probabilities, by gap.
    last_end : sequence of K int
        By replica, the end where it was last: -1 the hottest, 1 the coldest, 0 none yet.
    crossings : sequence of K int
        By replica, how often it went from one end to the other.
    """

    betas: Sequence[float]
    rounds: int
    swaps: Sequence[float]
    last_end: Sequence[int]
    crossings: Sequence[int]

    @classmethod
    def empty(cls, betas: Sequence[float]) -> SwapTable:
        """Nothing counted yet.

        Parameters
        ----------
        betas : sequence of K float

        Returns
        -------
        SwapTable
        """
        n = len(betas)
        return cls(tuple(betas), 0, (0.0,) * (n - 1), (0,) * n, (0,) * n)

    def recorded(self, acceptance: Sequence[float], replicas: Sequence[int]) -> SwapTable:
        """The table with one round more.

        Parameters
        ----------
        acceptance : sequence of K - 1 float
            Probability of a swap across each gap.
        replicas : sequence of K int
            The replica on each rung afterwards.

        Returns
        -------
        SwapTable
        """
        last_end, crossings = list(self.last_end), list(self.crossings)
        if len(replicas) > 1:
            for replica, end in ((replicas[0], -1), (replicas[-1], 1)):
                crossings[replica] += last_end[replica] == -end
                last_end[replica] = end
        return SwapTable(
            betas=self.betas,
            rounds=self.rounds + 1,
            swaps=tuple(a + b for a, b in zip(self.swaps, acceptance, strict=True)),
            last_end=tuple(last_end),
            crossings=tuple(crossings),
        )

    def summary(self) -> LadderSummary:
        """What to tell a person; rates are NaN before the first round.

        Returns
        -------
        LadderSummary
        """
        return LadderSummary(
            betas=tuple(self.betas),
            swap_rates=tuple(s / self.rounds if self.rounds else float("nan") for s in self.swaps),
            round_trips=sum(count // 2 for count in self.crossings),
            rounds=self.rounds,
        )


# ------------------------------------------------------------------------------------------------
# Chains.

S = TypeVar("S")

# Robbins-Monro: gains of n^-0.6 sum to infinity and their squares do not.
_ADAPTATION_DECAY = 0.6
_TRIES = 100
"""Draws from the prior that are made to find one whose likelihood is not zero; chosen."""


class Parts(NamedTuple):
    """A log density in two parts.

    Parameters
    ----------
    log_prior : float
        Normalised if evidences are wanted; -inf outside the support.
    log_likelihood : float
        Means nothing where the prior is -inf.
    """

    log_prior: float
    log_likelihood: float

    def at(self, beta: float) -> float:
        """The log density of a rung: log prior + beta log likelihood.

        Parameters
        ----------
        beta : float
            Inverse temperature.

        Returns
        -------
        float
        """
        if self.log_prior == -math.inf or beta == 0:
            return self.log_prior
        return self.log_prior + beta * self.log_likelihood


Target = Callable[[S], Parts]


class Walker(Protocol[S]):
    """A chain on one rung: it knows where it stands, so that a proposal costs what it changes.

    Parameters
    ----------
    *args, **kwargs
        A walker is made as its own class says.
    """

    def __call__(self, state: S, /) -> Parts:
        """The log density of a state; the chain stays where it is.

        Parameters
        ----------
        state : S

        Returns
        -------
        Parts
        """

    def move(self, state: S, /) -> None:
        """The chain has gone to a state.

        Parameters
        ----------
        state : S
        """

    def advance(
        self, rng: np.random.Generator, beta: float, steps: int, /
    ) -> tuple[ChainState[S], tuple[StepInfo, ...]]:
        """Go some steps at an inverse temperature.

        Parameters
        ----------
        rng : numpy.random.Generator
        beta : float
        steps : int

        Returns
        -------
        ChainState
            Where the chain is then.
        tuple of StepInfo
            What happened.
        """


@dataclass(frozen=True)
class Tempered(Generic[S]):
    """The log density of one rung, for kernels that know nothing of temperatures.

    Parameters
    ----------
    target : callable
        ``target(state) -> Parts``.
    beta : float
        Inverse temperature.
    """

    target: Target[S]
    beta: float

    def __call__(self, state: S) -> float:
        """Log density of ``state`` up to a constant."""
        return self.target(state).at(self.beta)


class Kernel(Protocol[S]):
    """What advances a chain at one temperature.

    Such as ``functools.partial(imapper_prob.samplers.reversible_jump.step, mixture=mixture)``.
    """

    def __call__(
        self,
        rng: np.random.Generator,
        chain_state: ChainState[S],
        /,
        *,
        log_density_fn: Callable[[S], float],
    ) -> tuple[ChainState[S], StepInfo]:
        """Advance by one proposal and leave the density invariant."""


class Crossover(Protocol[S]):
    """How two states exchange a part of themselves."""

    def __call__(self, rng: np.random.Generator, hot: S, cold: S, /) -> tuple[S, S, float] | None:
        """Both states afterwards, and the log ratio of the way back to the way there.

        The Jacobian is in the ratio. To exchange the same part again must give the two states
        back. None where there is nothing to exchange.
        """


class TemperingState(NamedTuple, Generic[S]):
    """Where the chains of a ladder stand: all that a checkpoint needs beside the generators.

    Parameters
    ----------
    betas : tuple of K float
        Inverse temperatures, ascending to 1.
    chains : tuple of K ChainState
        On each rung; the last one samples the posterior.
    log_likelihoods : tuple of K float
        Of these states.
    replicas : tuple of K int
        Which of the starts has wandered to each rung.
    rounds : int
        Rounds since the start.
    """

    betas: tuple[float, ...]
    chains: tuple[ChainState[S], ...]
    log_likelihoods: tuple[float, ...]
    replicas: tuple[int, ...]
    rounds: int


class TemperingInfo(NamedTuple, Generic[S]):
    """One round: steps on every rung, then swaps.

    Parameters
    ----------
    position : TemperingState
        Afterwards.
    steps : tuple of K tuples of StepInfo
        What happened on each rung.
    swap_acceptance : tuple of K - 1 float
        Probability of a swap across each gap, those included whose turn it was not.
    crossovers : tuple of StepInfo
        Of the gaps whose turn it was, from hot to cold; none without a crossover.
    """

    position: TemperingState[S]
    steps: tuple[tuple[StepInfo, ...], ...]
    swap_acceptance: tuple[float, ...]
    crossovers: tuple[StepInfo, ...] = ()


def start(states: Sequence[S], *, target: Target[S], betas: Sequence[float]) -> TemperingState[S]:
    """Put one state on each rung.

    Parameters
    ----------
    states : sequence of K S
    target : callable
        ``target(state) -> Parts``.
    betas : sequence of K float
        Inverse temperatures, ascending from 0 or more to 1.

    Returns
    -------
    TemperingState

    Raises
    ------
    ValueError
        Not one state a rung, or inverse temperatures that do not ascend from 0 or more to 1.
    FloatingPointError
        A state whose log density on its rung is not finite.
    """
    betas = tuple(betas)
    ascending = all(hot < cold for hot, cold in pairwise(betas))
    if not (betas and ascending and betas[0] >= 0 and betas[-1] == 1):
        raise ValueError(f"inverse temperatures must ascend from 0 or more to 1, not {betas}")
    if len(states) != len(betas):
        raise ValueError(f"{len(states)} states for {len(betas)} rungs")
    chains = tuple(
        init(Tempered(target, beta), state) for state, beta in zip(states, betas, strict=True)
    )
    likelihoods = tuple(target(state).log_likelihood for state in states)
    return TemperingState(betas, chains, likelihoods, tuple(range(len(betas))), 0)


def temper(
    rngs: Sequence[np.random.Generator],
    position: TemperingState[S],
    *,
    walker: Callable[[S], Walker[S]],
    steps_per_swap: int,
    adapt: bool = False,
    crossover: Crossover[S] | None = None,
    independent: Callable[[np.random.Generator], S] | None = None,
) -> Iterator[TemperingInfo[S]]:
    """An endless tempered chain, one item a round.

    Parameters
    ----------
    rngs : sequence of K + 1 numpy.random.Generator
        One for each rung and one for the swaps, such as ``rng.spawn(K + 1)``.
    position : TemperingState
        From `start`, or where an earlier chain arrived; it is not yielded itself.
    walker : callable
        ``walker(state) -> Walker`` that stands at ``state``; one a rung. Such as
        ``functools.partial(KernelWalker, target, kernel)``.
    steps_per_swap : int
        Proposals on each rung between two rounds of swaps.
    adapt : bool
        Move the inverse temperatures towards equal swap rates. Such a chain does not leave
        its target invariant: adapt during burn-in, then go on from its last position without.
    crossover : Crossover, optional
        Exchanges parts of states across every second gap, before the swaps.
    independent : callable, optional
        ``independent(rng) -> S`` draws from the prior. Where beta = 0, one such draw a round
        takes the place of the kernel's steps.

    Returns
    -------
    iterator of TemperingInfo

    Examples
    --------
    >>> burn_in = temper(rngs, start(...), adapt=True, ...)  # doctest: +SKIP
    >>> *_, last = islice(burn_in, 200)  # doctest: +SKIP
    >>> draws = [
    ...     item.position.chains[-1].state
    ...     for item in islice(temper(rngs, last.position, ...), 1_000)
    ... ]  # doctest: +SKIP
    """
    if len(rngs) != len(position.betas) + 1:
        raise ValueError(f"{len(rngs)} generators for {len(position.betas)} rungs and the swaps")
    if steps_per_swap < 1:
        raise ValueError(f"steps_per_swap must be at least 1, not {steps_per_swap}")
    walkers = [walker(chain.state) for chain in position.chains]
    return _rounds(rngs, position, walkers, steps_per_swap, adapt, crossover, independent)


class KernelWalker(Generic[S]):
    """A walker by a kernel and a target that know nothing of where the chain has been.

    Parameters
    ----------
    target : callable
        ``target(state) -> Parts``.
    kernel : Kernel
    state : S
        Where it stands.
    """

    def __init__(self, target: Target[S], kernel: Kernel[S], state: S) -> None:
        self._target, self._kernel, self._state = target, kernel, state

    def __call__(self, state: S) -> Parts:
        """The log density of ``state``."""
        return self._target(state)

    def move(self, state: S) -> None:
        """The chain has gone to a state.

        Parameters
        ----------
        state : S
        """
        self._state = state

    def advance(
        self, rng: np.random.Generator, beta: float, steps: int
    ) -> tuple[ChainState[S], tuple[StepInfo, ...]]:
        """Go some steps of the kernel.

        Parameters
        ----------
        rng : numpy.random.Generator
        beta : float
        steps : int

        Returns
        -------
        ChainState
            Where the chain is then.
        tuple of StepInfo
            What happened.
        """
        density, infos = Tempered(self._target, beta), []
        at = ChainState(self._state, density(self._state))
        for _ in range(steps):
            at, info = self._kernel(rng, at, log_density_fn=density)
            infos.append(info)
        self._state = at.state
        return at, tuple(infos)


def _rounds(
    rngs: Sequence[np.random.Generator],
    position: TemperingState[S],
    walkers: list[Walker[S]],
    steps_per_swap: int,
    adapt: bool,
    crossover: Crossover[S] | None,
    independent: Callable[[np.random.Generator], S] | None,
) -> Iterator[TemperingInfo[S]]:
    *rung_rngs, swap_rng = rngs
    while True:
        chains: list[ChainState[S]] = []
        steps: list[tuple[StepInfo, ...]] = []
        for rng, chain, beta, walker in zip(
            rung_rngs, position.chains, position.betas, walkers, strict=True
        ):
            if beta == 0 and independent is not None:
                chain, info = _drawn(rng, chain, independent, walker)
                infos: tuple[StepInfo, ...] = (info,)
            else:
                chain, infos = walker.advance(rng, beta, steps_per_swap)
            chains.append(chain)
            steps.append(infos)
        crossed = []
        if crossover is not None:
            # The gaps that do not swap in this round.
            for gap in range(1 - position.rounds % 2, len(chains) - 1, 2):
                pair = slice(gap, gap + 2)
                chains[pair], info = _crossed(
                    swap_rng, chains[pair], walkers[pair], position.betas[pair], crossover
                )
                crossed.append(info)
        parts = [walker(chain.state) for walker, chain in zip(walkers, chains, strict=True)]
        rungs = zip(parts, position.betas, strict=True)
        acceptance = tuple(
            math.exp(min(0.0, _log_swap_ratio(hot, cold))) for hot, cold in pairwise(rungs)
        )
        order = _swapped(swap_rng, acceptance, odd=position.rounds % 2)
        walkers = [walkers[i] for i in order]
        betas = position.betas
        if adapt:
            gain = (position.rounds + 1) ** -_ADAPTATION_DECAY
            betas = respaced(betas, acceptance, gain=gain)
        position = TemperingState(
            betas=betas,
            chains=tuple(
                ChainState(chains[i].state, parts[i].at(beta))
                for i, beta in zip(order, betas, strict=True)
            ),
            log_likelihoods=tuple(parts[i].log_likelihood for i in order),
            replicas=tuple(position.replicas[i] for i in order),
            rounds=position.rounds + 1,
        )
        yield TemperingInfo(position, tuple(steps), acceptance, tuple(crossed))


def _drawn(
    rng: np.random.Generator,
    chain: ChainState[S],
    independent: Callable[[np.random.Generator], S],
    walker: Walker[S],
) -> tuple[ChainState[S], StepInfo]:
    """A draw from the prior where the likelihood is not zero.

    Where none is found the chain stays, which does not depend on where it is.
    """
    for _ in range(_TRIES):
        state = independent(rng)
        parts = walker(state)
        if math.isfinite(parts.log_prior) and math.isfinite(parts.log_likelihood):
            walker.move(state)
            return ChainState(state, parts.log_prior), StepInfo("independent", True, 0.0)
    return chain, StepInfo("independent", False, -math.inf)


def _crossed(
    rng: np.random.Generator,
    pair: Sequence[ChainState[S]],
    walkers: Sequence[Walker[S]],
    betas: Sequence[float],
    crossover: Crossover[S],
) -> tuple[list[ChainState[S]], StepInfo]:
    """Two neighbours after one attempt to exchange a part."""
    proposal = crossover(rng, pair[0].state, pair[1].state)
    if proposal is None:
        return list(pair), StepInfo("crossover", False, -math.inf)
    *states, log_ratio = proposal
    new = [
        ChainState(state, walker(state).at(beta))
        for state, walker, beta in zip(states, walkers, betas, strict=True)
    ]
    gain = sum(chain.log_density for chain in new) - sum(chain.log_density for chain in pair)
    log_acceptance = min(0.0, gain + log_ratio)
    accepted = bool(rng.standard_exponential() > -log_acceptance)
    if accepted:
        for chain, walker in zip(new, walkers, strict=True):
            walker.move(chain.state)
    return (new if accepted else list(pair)), StepInfo("crossover", accepted, log_acceptance)


def _log_swap_ratio(hot: tuple[Parts, float], cold: tuple[Parts, float]) -> float:
    """Of the joint density with two rungs' states exchanged to that without; priors cancel."""
    return (cold[1] - hot[1]) * (hot[0].log_likelihood - cold[0].log_likelihood)


def _swapped(rng: np.random.Generator, acceptance: Sequence[float], *, odd: int) -> list[int]:
    """Which rung's state goes to each rung, when the even or odd gaps may swap."""
    order = list(range(len(acceptance) + 1))
    for gap in range(odd, len(acceptance), 2):
        if rng.random() < acceptance[gap]:
            order[gap], order[gap + 1] = order[gap + 1], order[gap]
    return order
