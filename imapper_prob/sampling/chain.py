"""One tempered reversible-jump chain over scenes, as a task that any process can run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.config import SampleSettings
from imapper_prob.models.log_posterior import State, empty_state
from imapper_prob.models.problem import Problem
from imapper_prob.samplers.chains import Report
from imapper_prob.samplers.checkpoint import Checkpointer, CheckpointError
from imapper_prob.samplers.reversible_jump import AcceptanceTable, ChainState
from imapper_prob.samplers.tempering import (
    LadderSummary,
    Parts,
    TemperingState,
    power_ladder,
    start,
    temper,
)
from imapper_prob.sampling.actors import JointProblem
from imapper_prob.sampling.ascent import climb
from imapper_prob.sampling.candidates import Candidates
from imapper_prob.sampling.checkpoints import ChainProgress
from imapper_prob.sampling.crossover import TimeCrossover
from imapper_prob.sampling.learning import learn
from imapper_prob.sampling.redraws import draw_scene
from imapper_prob.sampling.scene import state_of
from imapper_prob.sampling.schedule import (
    burn_in_of,
    draws_of,
    end_of,
    learning_of,
    piece_of,
    trace_of,
)
from imapper_prob.sampling.steps import Moves, Walker, parts_of, scene_moves
from imapper_prob.sampling.visits import Visits, camera_shape

__all__ = ["Chain", "Setup", "Tempered", "run_chain", "starts_of", "tempered"]


# ------------------------------------------------------------------------------------------------
# Where chains start, and each of their temperatures.


def starts_of(cast: JointProblem, count: int) -> list[tuple[State, ...]]:
    """By chain where its temperatures start, from the posterior itself to the hottest.

    The coldest are far apart on purpose: the best scene, none at all, and the alternatives, worst
    first. The hotter ones are at all that the solver found, the better the colder, so that what is
    worth more than where the coldest started can come to it, stretch by stretch.

    Parameters
    ----------
    cast : JointProblem
    count : int
        Chains.

    Returns
    -------
    list of tuple of State
    """
    others = list(cast.states[:0:-1]) or [cast.states[0]]
    pool = [cast.states[0], empty_state(cast.problem), *others]
    coldest = [pool[i % len(pool)] for i in range(count)]
    return [(own, *(s for s in cast.states if s is not own)) for own in coldest]


# ------------------------------------------------------------------------------------------------
# One tempered reversible-jump chain over scenes, as a task that any process can run.

Array = NDArray[np.float64]
_CLIMBING: Final = 0.25
"""Evaluations of the ascent over those of the chain's own steps, at most; chosen: on public clips
it ends after a tenth, and short chains should be short."""


@dataclass(frozen=True)
class Setup:
    """What all chains share.

    Parameters
    ----------
    problem : Problem
    candidates : Candidates
        Fits of the solver, with weights.
    similarity : (L, L) float
        Probabilities of exchanging one scenelet for another.
    settings : SampleSettings
    staged : tuple of State
        The solver's scenes, of which the first reference is learnt.
    known : tuple of Visits
        What all chains have noted for each reference that is learnt while they burn in, as far as
        they have come. A chain learns the others from what it has noted itself.
    """

    problem: Problem
    candidates: Candidates
    similarity: Array
    settings: SampleSettings
    staged: tuple[State, ...]
    known: tuple[Visits, ...] = ()


@dataclass(frozen=True)
class Chain:
    """What one chain leaves.

    Parameters
    ----------
    states : tuple of State
        Draws after burn-in, evenly spaced.
    log_posterior : (n,) float
        Of the draws, nats.
    trace : (m,) float
        Log-posterior over the whole run, burn-in included, evenly spaced.
    acceptance : AcceptanceTable
        At the posterior itself, after burn-in.
    ladder : LadderSummary
        Temperatures, and how states travelled between them after burn-in.
    finished : bool
        Whether it ran all its steps.
    progress : ChainProgress
        What it goes on from.
    """

    states: tuple[State, ...]
    log_posterior: Array
    trace: Array
    acceptance: AcceptanceTable
    ladder: LadderSummary
    finished: bool
    progress: ChainProgress


def run_chain(
    setup: Setup,
    starts: Sequence[State] | ChainProgress,
    rng: np.random.Generator,
    report: Report,
    keeper: Checkpointer | None = None,
    *,
    end: int | None = None,
) -> Chain:
    """Run a chain; asked to stop, it returns what it has.

    It starts at the posterior itself near what the first of ``starts`` is climbed to
    (:mod:`imapper_prob.sampling.ascent`), at the next hotter temperature from the second as it is,
    and so on, from the last wherever there are not enough; or it goes on from what an earlier call
    has left.

    While it burns in, the ladder of temperatures adapts, and the chain notes what it visits, from
    which references and the shape of the camera's walk are learnt; then all of them stay. Only
    draws of the posterior itself are kept, and none of the burn-in. With a ``keeper`` the chain
    goes on from its checkpoint, if there is one, a finished chain's too. It stops after ``end``
    rounds, that of the settings if not given; see :mod:`imapper_prob.sampling.schedule` for where
    it may.

    Parameters
    ----------
    setup : Setup
    starts : sequence of State, or ChainProgress
    rng : numpy.random.Generator
    report : callable
        Told how much is done, 0 to 1; says whether to go on.
    keeper : Checkpointer, optional
    end : int, optional
        Rounds.

    Returns
    -------
    Chain
    """
    settings = setup.settings
    end = end_of(settings) if end is None else end
    burn_in, keep, mark = burn_in_of(settings), draws_of(settings), trace_of(settings)
    learning = learning_of(settings)
    done = None if keeper is None else _resumed(keeper, setup)
    if done is None and isinstance(starts, ChainProgress):
        done = starts
    learnt = _of_noted(setup, [] if done is None else done.visits[:-1])
    finished = True
    if done is None:
        assert not isinstance(starts, ChainProgress)
        betas = power_ladder(settings.temperatures) if settings.temperatures > 1 else (1.0,)
        streams, (climbing,) = rng.spawn(len(betas) + 1), rng.spawn(1)
        first = climb(
            setup.problem, learnt.moves, starts[0], climbing,
            most=int(_CLIMBING * settings.steps * settings.temperatures), report=report,
        )  # fmt: skip
        coldest_first = [first, *(starts[min(k, len(starts) - 1)] for k in range(1, len(betas)))]
        position = start(coldest_first[::-1], target=learnt.target, betas=betas)
        done = ChainProgress.begin(streams, position)
        if 0 in learning.ends:
            done.visits = [Visits(), Visits()]
            done.visits[0].note(first)
        finished = report(0.0)
    crossover = TimeCrossover(setup.problem)
    while done.position.rounds < end and finished:
        now = done.position.rounds
        adapt = now < burn_in
        if now in learning.ends:
            learnt = _of_noted(setup, done.visits[:-1])
            done.position = _anew(done.position, learnt)
        # A piece begins with new walkers, as a chain does that goes on from a checkpoint.
        stops = (*learning.ends, burn_in, settings.rounds, end)
        last = next(stop for stop in stops if now < stop)
        piece = min(piece_of(settings), min(last, end) - now)
        rounds = temper(
            done.rngs,
            done.position,
            walker=learnt.walker,
            steps_per_swap=settings.swap_every,
            adapt=adapt,
            crossover=crossover,
            independent=learnt.independent,
        )
        for at in islice(rounds, piece):
            coldest = at.position.chains[-1]
            if not adapt:
                done.record(at)
            if keep.has(done.position.rounds):
                done.states.append(coldest.state)
                done.values.append(coldest.log_density)
            if mark.has(done.position.rounds):
                done.trace.append(coldest.log_density)
            done.thin(keep.most)
            done.position = at.position
            if learning.has(at.position.rounds):
                for beta, rung in zip(at.position.betas, at.position.chains, strict=True):
                    done.visits[-1].note(rung.state, beta)
        if done.position.rounds in learning.ends:
            done.visits.append(Visits())
        finished = report(done.position.rounds / end)
        if keeper is not None:
            keeper.offer(done.snapshot)
    if keeper is not None and (finished or done.position.rounds):
        # Where it was climbed to when it was asked to stop depends on when that was.
        keeper.save(done.snapshot())
    states, values, trace = done.states, done.values, done.trace
    coldest = done.position.chains[-1]
    if not states:
        # Stopped during burn-in: the last state is all there is.
        states, values = [coldest.state], [coldest.log_density]
    if not trace:
        # Stopped before the first of them was due.
        trace = [coldest.log_density]
    return Chain(
        tuple(states),
        np.array(values),
        np.array(trace),
        done.acceptance,
        done.table.summary(),
        finished,
        done,
    )


@dataclass(frozen=True)
class Tempered:
    """What a chain over scenes walks by, from a reference to the posterior.

    Parameters
    ----------
    problem : Problem
    moves : Moves
    """

    problem: Problem
    moves: Moves

    def target(self, state: State) -> Parts:
        """The log density in two parts.

        Parameters
        ----------
        state : State

        Returns
        -------
        Parts
        """
        return parts_of(self.problem, self.moves.reference, state)

    def walker(self, state: State) -> Walker:
        """A chain that stands at a state.

        Parameters
        ----------
        state : State

        Returns
        -------
        Walker
        """
        return Walker(self.problem, self.moves, state)

    def independent(self, rng: np.random.Generator) -> State:
        """A draw from the reference.

        Parameters
        ----------
        rng : numpy.random.Generator

        Returns
        -------
        State
        """
        return state_of(draw_scene(self.moves.reference, rng))


def tempered(setup: Setup, visits: Visits) -> Tempered:
    """What is learnt of some visits.

    Parameters
    ----------
    setup : Setup
    visits : Visits

    Returns
    -------
    Tempered
    """
    reference = learn(setup.problem, setup.candidates, setup.similarity, visits)
    moves = scene_moves(setup.problem, setup.similarity, reference, camera_shape(visits))
    return Tempered(setup.problem, moves)


def _of_noted(setup: Setup, noted: Sequence[Visits]) -> Tempered:
    """Of what the chains have noted last, or this one alone.

    At first of the solver's scenes, and then of these and of what was climbed to.
    """
    known = [*setup.known, *noted[len(setup.known) :]][: len(noted)]
    if len(known) > 1:
        return tempered(setup, known[-1])
    staged = Visits()
    for state in setup.staged:
        staged.note(state)
    return tempered(setup, Visits.together([staged, *known]))


def _anew(position: TemperingState[State], learnt: Tempered) -> TemperingState[State]:
    """Where a ladder stands, seen with another reference."""
    parts = [learnt.target(chain.state) for chain in position.chains]
    return position._replace(
        chains=tuple(
            ChainState(chain.state, part.at(beta))
            for chain, part, beta in zip(position.chains, parts, position.betas, strict=True)
        ),
        log_likelihoods=tuple(part.log_likelihood for part in parts),
    )


def _resumed(keeper: Checkpointer, setup: Setup) -> ChainProgress | None:
    """What a chain has left, or None where it has not begun."""
    saved = keeper.load()
    if saved is None:
        return None
    try:
        done = ChainProgress.of(saved)
        done.check(setup.problem, setup.settings)
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise CheckpointError(
            f"{keeper.path} is damaged ({error}): delete it, and its chain begins anew"
        ) from error
    return done
