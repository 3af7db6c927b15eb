"""Parallel tempering with any kernel.

The tempered log density is ``log prior + beta log likelihood + tilts counts``, from the prior
(beta = 0) to the posterior (beta = 1). A kernel receives an ordinary log density, that of its rung
(one inverse temperature, and its tilts). Only swaps need the parts separately; the ratio of a swap
contains only likelihoods and counts.

The counts are the numbers of parts of each kind in a state, if these vary. Without tilts some
states can be far rarer at inverse temperatures in between than at both ends: where the posterior is
narrower than the prior, each part costs mass in between, some kinds more than others. These states
then have to pass a bottleneck. The tilts adapt until the mean counts on every rung lie between
those of both ends, which have no tilt.

Even and odd pairs of neighbours swap in alternation. Each swap leaves the joint target invariant.
Unlike randomly chosen pairs, the alternation moves states on in the same direction. Swaps evaluate
nothing anew, so every round makes as many sweeps as there are rungs: a state can travel from one
end to the other, and rungs are nearly assigned anew (as with infinitely many swaps).

If a state has many nearly independent parts, swaps of whole states rarely succeed: a gain in one
part is lost in another. A crossover exchanges only a part.

The prior can be any distribution with a density known up to a constant. If it can be sampled
directly, the chain at beta = 0 needs no kernel, and its states are independent of all earlier ones.

References
----------
Geyer 1991, Computing Science and Statistics 23, 156 (parallel tempering).
Liang & Wong 2000, Statistica Sinica 10, 317 (crossover between temperatures).
Woodard, Schmidler & Huber 2009, Electronic Journal of Probability 14, 780 (bottlenecks).
Grosse, Maddison & Salakhutdinov 2013, NeurIPS 26 (paths of averaged moments).
Tawn, Roberts & Rosenthal 2020, Statistics and Computing 30, 27 (weights that tempering preserves).
Dupuis, Liu, Plattner & Doll 2012, Multiscale Modeling & Simulation 10, 986 (infinitely many swaps).
Syed, Bouchard-Côté, Deligiannidis & Doucet 2022, JRSS B 84, 321 (even-odd swaps).
Surjanovic, Syed, Bouchard-Côté & Campbell 2022, NeurIPS 35 (a learnt distribution as the prior).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from operator import mul
from typing import Final, Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from imapper_prob.samplers.ladder import resized_betas, respaced, tilted
from imapper_prob.samplers.reversible_jump import ChainState, StepInfo, init

__all__ = [
    "POSTERIOR",
    "PRIOR",
    "LogDensityParts",
    "Rung",
    "TemperedDensity",
    "TemperingInfo",
    "TemperingState",
    "resized",
    "start",
    "temper",
]


S = TypeVar("S")

# Robbins-Monro: gains of n^-0.6 sum to infinity and their squares do not.
_ADAPTATION_DECAY = 0.6
_TRIES = 100
"""Draws from the prior that are tried to find one with nonzero likelihood; a chosen number."""


class Rung(NamedTuple):
    """Which tempered distribution a chain has.

    Parameters
    ----------
    beta : float
        Inverse temperature.
    tilts : tuple of float
        Factor of each kind's count in the log density; none is a factor of 0.
    """

    beta: float
    tilts: tuple[float, ...] = ()

    def log_tilt(self, counts: Sequence[float]) -> float:
        """The sum of factors times counts.

        Parameters
        ----------
        counts : sequence of float
            Number of parts of each kind.

        Returns
        -------
        float
        """
        return math.fsum(map(mul, self.tilts, counts))


PRIOR: Final = Rung(0.0)
POSTERIOR: Final = Rung(1.0)


class LogDensityParts(NamedTuple):
    """A log density as log prior and log likelihood, and the counts of its state.

    Parameters
    ----------
    log_prior : float
        Normalised if marginal likelihoods are wanted; -inf outside the support.
    log_likelihood : float
        Undefined where the prior is -inf.
    counts : tuple of float
        Number of parts of each kind.
    """

    log_prior: float
    log_likelihood: float
    counts: tuple[float, ...] = ()

    def at(self, rung: Rung) -> float:
        """The tempered log density, log prior + beta log likelihood + tilts counts.

        Parameters
        ----------
        rung : Rung

        Returns
        -------
        float
        """
        if self.log_prior == -math.inf:
            return self.log_prior
        tilted = self.log_prior + rung.log_tilt(self.counts)
        return tilted + rung.beta * self.log_likelihood if rung.beta > 0 else tilted


Target = Callable[[S], LogDensityParts]


class RungChain(Protocol[S]):
    """A chain on one rung; it may cache its state, so that a proposal costs only what it changes.

    Parameters
    ----------
    *args, **kwargs
        The constructor is that of the class.
    """

    def __call__(
        self, state: S, rung: Rung = PRIOR, least: float = -math.inf, /
    ) -> LogDensityParts:
        """Evaluate the log density of a state without moving the chain.

        Parameters
        ----------
        state : S
        rung : Rung
        least : float
            The evaluation may end early, with a log density of -inf, if the log density on this
            rung is less.

        Returns
        -------
        LogDensityParts
        """

    def move(self, state: S, /) -> None:
        """Set the state of the chain.

        Parameters
        ----------
        state : S
        """

    def advance(
        self, rng: np.random.Generator, rung: Rung, steps: int, /
    ) -> tuple[ChainState[S], tuple[StepInfo, ...]]:
        """Make steps on a rung.

        Parameters
        ----------
        rng : numpy.random.Generator
        rung : Rung
        steps : int

        Returns
        -------
        ChainState
            The chain afterwards.
        tuple of StepInfo
            Record of each step.
        """


@dataclass(frozen=True)
class TemperedDensity(Generic[S]):
    """The log density of one rung, for kernels that do not handle temperatures.

    Parameters
    ----------
    target : callable
        ``target(state) -> LogDensityParts``.
    rung : Rung
    """

    target: Target[S]
    rung: Rung

    def __call__(self, state: S) -> float:
        """Log density of ``state`` up to a constant."""
        return self.target(state).at(self.rung)


class Crossover(Protocol[S]):
    """A proposal that exchanges parts of two states."""

    def __call__(self, rng: np.random.Generator, hot: S, cold: S, /) -> tuple[S, S, float] | None:
        """Return both proposed states and the log ratio of reverse to forward proposal densities.

        The ratio includes the Jacobian. Exchanging the same part again must restore the two states.
        None if there is nothing to exchange.
        """


class TemperingState(NamedTuple, Generic[S]):
    """State of all chains of a ladder; with the generators it is all that a checkpoint needs.

    Parameters
    ----------
    betas : tuple of K float
        Inverse temperatures, ascending to 1.
    tilts : tuple of K tuples of float
        Factor of each kind's count in the log density of each rung.
    chains : tuple of K ChainState
        The chain on each rung; the last one samples the posterior.
    log_likelihoods : tuple of K float
        Log likelihoods of these states.
    counts : tuple of K tuples of float
        Number of parts of each kind of these states.
    mean_counts : tuple of 2 tuples of float
        Running means of the counts on the first rung and on the last.
    replicas : tuple of K int
        Index of the start whose replica is on each rung.
    rounds : int
        Number of rounds since the start.
    """

    betas: tuple[float, ...]
    tilts: tuple[tuple[float, ...], ...]
    chains: tuple[ChainState[S], ...]
    log_likelihoods: tuple[float, ...]
    counts: tuple[tuple[float, ...], ...]
    mean_counts: tuple[tuple[float, ...], tuple[float, ...]]
    replicas: tuple[int, ...]
    rounds: int

    @property
    def rungs(self) -> tuple[Rung, ...]:
        """The distribution of each rung."""
        return tuple(map(Rung, self.betas, self.tilts))


class TemperingInfo(NamedTuple, Generic[S]):
    """Record of one round: steps on every rung, then swaps.

    Parameters
    ----------
    state : TemperingState
        State after the round.
    steps : tuple of K tuples of StepInfo
        Record of the steps on each rung.
    swap_acceptance : tuple of K - 1 float
        Probability of a swap across each gap before the first sweep.
    crossovers : tuple of StepInfo
        Crossovers that were tried, from hot to cold; empty without a crossover.
    """

    state: TemperingState[S]
    steps: tuple[tuple[StepInfo, ...], ...]
    swap_acceptance: tuple[float, ...]
    crossovers: tuple[StepInfo, ...] = ()


def start(states: Sequence[S], *, target: Target[S], betas: Sequence[float]) -> TemperingState[S]:
    """Place one state on each rung.

    Parameters
    ----------
    states : sequence of K S
    target : callable
        ``target(state) -> LogDensityParts``.
    betas : sequence of K float
        Inverse temperatures, ascending from 0 or more to 1.

    Returns
    -------
    TemperingState

    Raises
    ------
    ValueError
        The number of states differs from that of rungs, or inverse temperatures do not ascend from
        0 or more to 1.
    FloatingPointError
        The log density of a state on its rung is not finite.
    """
    betas = tuple(betas)
    ascending = all(hot < cold for hot, cold in pairwise(betas))
    if not (betas and ascending and betas[0] >= 0 and betas[-1] == 1):
        raise ValueError(f"inverse temperatures must ascend from 0 or more to 1, not {betas}")
    if len(states) != len(betas):
        raise ValueError(f"{len(states)} states for {len(betas)} rungs")
    parts = [target(state) for state in states]
    counts = tuple(part.counts for part in parts)
    chains = tuple(
        init(TemperedDensity(target, Rung(beta)), state)
        for state, beta in zip(states, betas, strict=True)
    )
    return TemperingState(
        betas=betas,
        tilts=tuple((0.0,) * len(count) for count in counts),
        chains=chains,
        log_likelihoods=tuple(part.log_likelihood for part in parts),
        counts=counts,
        mean_counts=(counts[0], counts[-1]),
        replicas=tuple(range(len(betas))),
        rounds=0,
    )


def resized(state: TemperingState[S], rungs: int) -> TemperingState[S]:
    """A ladder with fewer or more rungs between the same ends.

    Each rung has the state of the nearest old one, with the log density of the new inverse
    temperature.

    Parameters
    ----------
    state : TemperingState
    rungs : int
        At least 2.

    Returns
    -------
    TemperingState

    Raises
    ------
    ValueError
        The number of rungs, old or new, is less than 2.
    """
    nearest, betas = resized_betas(state.betas, rungs)
    by_kind = [np.interp(betas, state.betas, of_kind) for of_kind in zip(*state.tilts, strict=True)]
    tilts = tuple(zip(*by_kind, strict=True)) if by_kind else ((),) * rungs
    return state._replace(
        betas=betas,
        tilts=tilts,
        chains=tuple(
            state.chains[k]._replace(
                log_density=state.chains[k].log_density
                + (beta - state.betas[k]) * state.log_likelihoods[k]
                + Rung(beta, tilt).log_tilt(state.counts[k])
                - state.rungs[k].log_tilt(state.counts[k])
            )
            for k, beta, tilt in zip(nearest, betas, tilts, strict=True)
        ),
        log_likelihoods=tuple(state.log_likelihoods[k] for k in nearest),
        counts=tuple(state.counts[k] for k in nearest),
        replicas=tuple(range(rungs)),
    )


def temper(
    rngs: Sequence[np.random.Generator],
    state: TemperingState[S],
    *,
    chain_at: Callable[[S], RungChain[S]],
    steps_per_swap: int,
    adapt: bool = False,
    adapt_tilts: bool = False,
    crossover: Crossover[S] | None = None,
    independent: Callable[[np.random.Generator], S] | None = None,
) -> Iterator[TemperingInfo[S]]:
    """Yield an endless tempered chain, one item per round.

    Parameters
    ----------
    rngs : sequence of K + 1 numpy.random.Generator
        One for each rung and one for swaps, such as ``rng.spawn(K + 1)``.
    state : TemperingState
        From `start`, or the last state of an earlier chain; it is not yielded.
    chain_at : callable
        ``chain_at(state) -> RungChain`` makes the chain of a rung at ``state``.
    steps_per_swap : int
        Proposals on each rung between two rounds of swaps.
    adapt : bool
        Adapt the inverse temperatures towards equal swap rates. An adapting chain does not leave
        its target invariant: adapt during burn-in, then continue from the last state without
        adaptation.
    adapt_tilts : bool
        Adapt the tilts, too, towards mean counts between those of both ends. Their noise decreases
        with the number of rounds.
    crossover : Crossover, optional
        Exchanges parts of states across every second gap, even and odd in turn, before the swaps.
    independent : callable, optional
        ``independent(rng) -> S`` draws from the prior. At beta = 0, one such draw per round
        replaces the steps of the kernel.

    Returns
    -------
    iterator of TemperingInfo

    Examples
    --------
    >>> burn_in = temper(rngs, start(...), adapt=True, ...)  # doctest: +SKIP
    >>> *_, last = islice(burn_in, 200)  # doctest: +SKIP
    >>> draws = [
    ...     item.state.chains[-1].state
    ...     for item in islice(temper(rngs, last.state, ...), 1_000)
    ... ]  # doctest: +SKIP
    """
    if len(rngs) != len(state.betas) + 1:
        raise ValueError(f"{len(rngs)} generators for {len(state.betas)} rungs and the swaps")
    if steps_per_swap < 1:
        raise ValueError(f"steps_per_swap must be at least 1, not {steps_per_swap}")
    rung_chains = [chain_at(chain.state) for chain in state.chains]
    return _rounds(
        rngs, state, rung_chains, steps_per_swap, adapt, adapt_tilts, crossover, independent
    )


def _rounds(
    rngs: Sequence[np.random.Generator],
    state: TemperingState[S],
    rung_chains: list[RungChain[S]],
    steps_per_swap: int,
    adapt: bool,
    adapt_tilts: bool,
    crossover: Crossover[S] | None,
    independent: Callable[[np.random.Generator], S] | None,
) -> Iterator[TemperingInfo[S]]:
    *rung_rngs, swap_rng = rngs
    while True:
        chains: list[ChainState[S]] = []
        steps: list[tuple[StepInfo, ...]] = []
        for rng, chain, rung, rung_chain in zip(
            rung_rngs, state.chains, state.rungs, rung_chains, strict=True
        ):
            if rung.beta == 0 and independent is not None:
                chain, info = _drawn(rng, chain, independent, rung_chain)
                infos: tuple[StepInfo, ...] = (info,)
            else:
                chain, infos = rung_chain.advance(rng, rung, steps_per_swap)
            chains.append(chain)
            steps.append(infos)
        crossed = []
        if crossover is not None:
            for gap in range(1 - state.rounds % 2, len(chains) - 1, 2):
                pair = slice(gap, gap + 2)
                chains[pair], info = _crossed(
                    swap_rng, chains[pair], rung_chains[pair], state.rungs[pair], crossover
                )
                crossed.append(info)
        parts = [
            rung_chain(chain.state) for rung_chain, chain in zip(rung_chains, chains, strict=True)
        ]
        densities = _log_densities(parts, state.rungs)
        acceptance = tuple(
            math.exp(min(0.0, _log_swap_ratio(densities, gap, gap, gap + 1)))
            for gap in range(len(parts) - 1)
        )
        order = _swapped(swap_rng, densities, odd=state.rounds % 2)
        rung_chains = [rung_chains[i] for i in order]
        parts, betas, tilts = [parts[i] for i in order], state.betas, state.tilts
        counts, mean_counts = tuple(part.counts for part in parts), state.mean_counts
        gain = (state.rounds + 1) ** -_ADAPTATION_DECAY
        if adapt:
            betas = respaced(betas, acceptance, gain=gain)
        if adapt_tilts:
            tilts, mean_counts = tilted(betas, tilts, counts, mean_counts, gain=gain)
        state = TemperingState(
            betas=betas,
            tilts=tilts,
            chains=tuple(
                ChainState(chains[i].state, part.at(Rung(beta, tilt)))
                for i, part, beta, tilt in zip(order, parts, betas, tilts, strict=True)
            ),
            log_likelihoods=tuple(part.log_likelihood for part in parts),
            counts=counts,
            mean_counts=mean_counts,
            replicas=tuple(state.replicas[i] for i in order),
            rounds=state.rounds + 1,
        )
        yield TemperingInfo(state, tuple(steps), acceptance, tuple(crossed))


def _drawn(
    rng: np.random.Generator,
    chain: ChainState[S],
    independent: Callable[[np.random.Generator], S],
    rung_chain: RungChain[S],
) -> tuple[ChainState[S], StepInfo]:
    """Draw from the prior until the likelihood is nonzero.

    After `_TRIES` failures the chain keeps its state; whether that happens does not depend on the
    state.
    """
    for _ in range(_TRIES):
        state = independent(rng)
        parts = rung_chain(state)
        if math.isfinite(parts.log_prior) and math.isfinite(parts.log_likelihood):
            rung_chain.move(state)
            return ChainState(state, parts.log_prior), StepInfo("independent", True, 0.0)
    return chain, StepInfo("independent", False, -math.inf)


def _crossed(
    rng: np.random.Generator,
    pair: Sequence[ChainState[S]],
    rung_chains: Sequence[RungChain[S]],
    rungs: Sequence[Rung],
    crossover: Crossover[S],
) -> tuple[list[ChainState[S]], StepInfo]:
    """States of two neighbouring rungs after one crossover attempt."""
    proposal = crossover(rng, pair[0].state, pair[1].state)
    if proposal is None:
        return list(pair), StepInfo("crossover", False, -math.inf)
    *states, log_ratio = proposal
    lowest, before = -rng.standard_exponential(), sum(chain.log_density for chain in pair)
    # The colder state first, because it decides more often; the other needs to be no better than
    # the exchange requires.
    cold = rung_chains[1](states[1]).at(rungs[1])
    least = lowest - log_ratio + before - cold
    hot = rung_chains[0](states[0], rungs[0], least).at(rungs[0]) if cold > -math.inf else -math.inf
    log_acceptance = min(0.0, hot + cold - before + log_ratio)
    accepted = bool(log_acceptance > lowest)
    new = [ChainState(states[0], hot), ChainState(states[1], cold)]
    if accepted:
        for chain, rung_chain in zip(new, rung_chains, strict=True):
            rung_chain.move(chain.state)
    return (new if accepted else list(pair)), StepInfo("crossover", accepted, log_acceptance)


def _log_densities(parts: Sequence[LogDensityParts], rungs: Sequence[Rung]) -> list[list[float]]:
    """Log density of each state on each rung."""
    return [[part.at(rung) for rung in rungs] for part in parts]


def _log_swap_ratio(densities: Sequence[Sequence[float]], gap: int, hot: int, cold: int) -> float:
    """Log ratio of the joint density after and before two states swap across a gap."""
    after = densities[hot][gap + 1] + densities[cold][gap]
    return after - densities[hot][gap] - densities[cold][gap + 1]


def _swapped(
    rng: np.random.Generator, densities: Sequence[Sequence[float]], *, odd: int
) -> list[int]:
    """Index of the state that each rung receives, after sweeps over even and odd gaps in turn."""
    rungs = len(densities)
    order = list(range(rungs))
    lowest = (-rng.standard_exponential((rungs, rungs))).tolist()
    for sweep in range(rungs):
        for gap in range((odd + sweep) % 2, rungs - 1, 2):
            hot, cold = order[gap : gap + 2]
            if _log_swap_ratio(densities, gap, hot, cold) > lowest[sweep][gap]:
                order[gap], order[gap + 1] = cold, hot
    return order
