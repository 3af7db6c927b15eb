"""One tempered reversible-jump chain over scenes, as a task for a worker process."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice, repeat, zip_longest
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.config import SampleSettings
from imapper_prob.models.log_posterior import State, empty_state
from imapper_prob.models.problem import Problem
from imapper_prob.samplers.chains import Report
from imapper_prob.samplers.checkpoint import Checkpointer, CheckpointError
from imapper_prob.samplers.ladder import LadderSummary, SwapTable, best_rungs, power_ladder
from imapper_prob.samplers.reversible_jump import AcceptanceTable, ChainState
from imapper_prob.samplers.tempering import (
    POSTERIOR,
    LogDensityParts,
    TemperingState,
    resized,
    start,
    temper,
)
from imapper_prob.sampling.actors import JointProblem
from imapper_prob.sampling.ascent import climb
from imapper_prob.sampling.checkpoints import ChainProgress
from imapper_prob.sampling.crossover import TimeCrossover
from imapper_prob.sampling.gains import Gains
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
from imapper_prob.sampling.steps import MOVES, Moves, SceneChain, parts_of, scene_moves
from imapper_prob.sampling.visits import Visits, camera_shape

__all__ = [
    "Chain", "Setup", "TemperedProblem", "first_used", "learnt_from", "run_chain", "starts_of",
    "temperatures_of", "tempered",
]  # fmt: skip


# ------------------------------------------------------------------------------------------------
# Starts of chains at each temperature.


def starts_of(source: JointProblem, count: int) -> list[tuple[State, ...]]:
    """Starting states of every chain by temperature, from the posterior (coldest) to the hottest.

    The coldest ones differ deliberately: the best scene, the empty scene, and the alternatives,
    worst first. The hotter ones are all scenes of the solver, better ones at colder temperatures,
    so that a better scene can reach the posterior piece by piece.

    Parameters
    ----------
    source : JointProblem
    count : int
        Number of chains.

    Returns
    -------
    list of tuple of State
    """
    others = list(source.states[:0:-1]) or [source.states[0]]
    pool = [source.states[0], empty_state(source.problem), *others]
    coldest = [pool[i % len(pool)] for i in range(count)]
    return [(own, *(s for s in source.states if s is not own)) for own in coldest]


# ------------------------------------------------------------------------------------------------
# The chain.

Array = NDArray[np.float64]
_WALK: Final = 0.04
"""Steps of the walk about the result of the ascent, or about the best scene so far, as a share of
the chain's steps; chosen: scenelets are exchanged about a hundred times."""
_WALKED: Final = 200
"""Largest number of states of that walk that are recorded; chosen: consecutive ones resemble each
other."""
_WALKS: Final = 0.25
"""Weight of the walks' visits relative to the other ones; chosen, see :func:`learnt_from`."""
_CLIMBING: Final = 0.5
"""Largest number of evaluations of the ascent as a share of the chain's steps; chosen: short chains
should remain short."""
_AT_FIRST: Final = 8
"""Largest number of temperatures before their number is known; chosen: as many as the barriers of
most public scenes ask for."""
_TILTED_FROM: Final = 5000
"""Least number of rounds of the burn-in with tilts; chosen: in fewer rounds they remain uncertain
by a nat, and the demo has fewer effective draws with them."""


@dataclass(frozen=True)
class Setup:
    """Data that all chains share.

    Parameters
    ----------
    problem : Problem
    gains : Gains
        See :func:`imapper_prob.sampling.gains.gains_of`.
    similarity : (L, L) float
        Probabilities of exchanging one scenelet for another.
    settings : SampleSettings
    staged : tuple of State
        Scenes of the solver, from which the first reference is learnt.
    known : tuple of tuple of Visits
        Visits of each chain before each reference that is learnt, as far as they are
        available. A chain learns further references from its own visits.
    learnt : TemperedProblem, optional
        What is learnt from ``known``, see :func:`learnt_from`. A chain learns it if not given.
    temperatures : int, optional
        Number of temperatures with the last reference, see :func:`temperatures_of`. A chain takes
        its own if not given.
    """

    problem: Problem
    gains: Gains
    similarity: Array
    settings: SampleSettings
    staged: tuple[State, ...]
    known: tuple[tuple[Visits, ...], ...] = ()
    learnt: TemperedProblem | None = None
    temperatures: int | None = None


@dataclass(frozen=True)
class Chain:
    """The result of one chain.

    Parameters
    ----------
    states : tuple of State
        Draws after burn-in, evenly spaced.
    log_posterior : (n,) float
        Log-posterior of the draws, nats.
    trace : (m,) float
        Log-posterior over the whole run, burn-in included, evenly spaced.
    acceptance : AcceptanceTable
        Acceptance at the posterior (inverse temperature 1) after burn-in.
    ladder : LadderSummary
        Temperatures, and how states travelled between them after burn-in.
    finished : bool
        Whether it completed all its rounds.
    progress : ChainProgress
        Progress from which the chain can continue.
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
    checkpointer: Checkpointer | None = None,
    *,
    end: int | None = None,
) -> Chain:
    """Run a chain; if asked to stop, it returns what it has.

    The coldest temperature starts near the first of ``starts`` after its ascent
    (:mod:`imapper_prob.sampling.ascent`), the next hotter one at the second, and so on; the last
    start is repeated if there are not enough. If ``starts`` is the progress of an earlier call, the
    chain continues from there.

    The chain records the scenes it visits, from which references and the covariance of camera moves
    are learnt, after burn-in ever more rarely. The ladder of temperatures adapts during burn-in and
    is fixed afterwards. Only draws of the posterior after burn-in are kept. With a ``checkpointer``
    the chain continues from its checkpoint, if there is one, even if that chain was finished. It
    stops after ``end`` rounds, by default those of the settings; see
    :mod:`imapper_prob.sampling.schedule` for permitted values.

    Parameters
    ----------
    setup : Setup
    starts : sequence of State, or ChainProgress
    rng : numpy.random.Generator
    report : callable
        Called with the completed share, 0 to 1; returns whether to continue.
    checkpointer : Checkpointer, optional
    end : int, optional
        Rounds.

    Returns
    -------
    Chain
    """
    settings = setup.settings
    end = end_of(settings) if end is None else end
    burn_in, learning = burn_in_of(settings), learning_of(settings)
    done = None if checkpointer is None else _resumed(checkpointer, setup)
    if done is None and isinstance(starts, ChainProgress):
        done = starts
    learnt: TemperedProblem | None = None
    finished = True
    if done is None:
        assert not isinstance(starts, ChainProgress)
        learnt = _of_noted(setup, [])
        done = _begun(setup, learnt, starts, rng, report)
        finished = report(0.0)
    crossover = TimeCrossover(setup.problem)
    while done.position.rounds < end and finished:
        now = done.position.rounds
        if learnt is None or now in learning.ends:
            learnt = _of_noted(setup, done.visits[:-1])
        if now in learning.ends:
            if now and now == learning.last_of_burn_in:
                own = temperatures_of(settings, [done.barrier])
                _resize_ladder(done, setup.temperatures or own)
            done.position = _anew(done.position, learnt)
            unused = slice(1, first_used(len(done.visits) - 1))
            done.visits[unused] = [Visits() for _ in done.visits[unused]]
        if now in (*learning.ends, burn_in) and now <= burn_in:
            done.count_anew()
        stops = (*learning.ends, burn_in, settings.rounds, end)
        last = min(stop for stop in stops if now < stop)
        _advance(done, learnt, settings, crossover, rounds=min(piece_of(settings), last - now))
        if done.position.rounds in learning.ends:
            done.visits[-1:] = [_with_best(done, learnt, settings), Visits()]
            if done.position.rounds <= learning.last_of_burn_in:
                done.barrier = done.table.summary().barrier
        finished = report(done.position.rounds / end)
        if checkpointer is not None:
            checkpointer.offer(done.snapshot)
    if checkpointer is not None and (finished or done.position.rounds):
        # If the ascent was interrupted, its state depends on when, so it is not saved.
        checkpointer.save(done.snapshot())
    return _result(done, finished=finished)


def _begun(
    setup: Setup,
    learnt: TemperedProblem,
    starts: Sequence[State],
    rng: np.random.Generator,
    report: Report,
) -> ChainProgress:
    """The progress of a new chain after the ascent of its coldest temperature."""
    settings = setup.settings
    rungs = min(settings.temperatures, _AT_FIRST)
    betas = power_ladder(rungs) if rungs > 1 else (1.0,)
    streams, (climbing,) = rng.spawn(len(betas) + 1), rng.spawn(1)
    first = climb(
        setup.problem, learnt.moves, starts[0], climbing,
        most=int(_CLIMBING * settings.steps * rungs), report=report,
    )  # fmt: skip
    coldest_first = [first, *(starts[min(k, len(starts) - 1)] for k in range(1, len(betas)))]
    position = start(coldest_first[::-1], target=learnt.target, betas=betas)
    done = ChainProgress.begin(streams, position)
    if 0 in learning_of(settings).ends:
        done.visits = [_walk(learnt, first, climbing, int(_WALK * settings.steps)), Visits()]
    return done


def _walk(learnt: TemperedProblem, first: State, rng: np.random.Generator, steps: int) -> Visits:
    """Visits of a walk at the posterior whose moves draw nothing from the reference."""
    weights = learnt.moves.weights * [not name.endswith("redraw") for name in MOVES]
    chain = SceneChain(learnt.problem, learnt.moves._replace(weights=weights), first)
    visits, apart = Visits(), max(1, steps // _WALKED)
    visits.note(first)
    for _ in range(steps // apart):
        visits.note(chain.advance(rng, POSTERIOR, apart)[0].state)
    return visits


def _with_best(done: ChainProgress, learnt: TemperedProblem, settings: SampleSettings) -> Visits:
    """Visits since the last reference, with those of a walk about the best scene so far."""
    assert done.best is not None
    visits = done.visits[-1]
    walk = _walk(learnt, done.best.state, done.rngs[-1], int(_WALK * settings.steps))
    again = max(1, round(_WALKS * visits.n_states / max(1, walk.n_states)))
    return Visits.of(Visits.together([visits, *repeat(walk, again)]).arrays())


def _advance(
    done: ChainProgress,
    learnt: TemperedProblem,
    settings: SampleSettings,
    crossover: TimeCrossover,
    *,
    rounds: int,
) -> None:
    """Continue a chain by a piece, and keep its draws, trace and visits.

    Each piece begins with new evaluators, like a chain that resumes from a checkpoint.
    """
    kept, traced, learning = draws_of(settings), trace_of(settings), learning_of(settings)
    adapt = done.position.rounds < burn_in_of(settings)
    swaps = temper(
        done.rngs,
        done.position,
        chain_at=learnt.chain_at,
        steps_per_swap=settings.swap_every,
        adapt=adapt,
        adapt_tilts=adapt and burn_in_of(settings) >= _TILTED_FROM,
        crossover=crossover,
        independent=learnt.independent,
    )
    for at in islice(swaps, rounds):
        coldest = at.state.chains[-1]
        if done.best is None or coldest.log_density > done.best.log_density:
            done.best = coldest
        done.record(at, fixed=not adapt)
        if kept.has(done.position.rounds):
            done.states.append(coldest.state)
            done.values.append(coldest.log_density)
        if traced.has(done.position.rounds):
            done.trace.append(coldest.log_density)
        done.thin(kept.most)
        done.position = at.state
        if learning.has(at.state.rounds):
            for beta, rung in zip(at.state.betas, at.state.chains, strict=True):
                done.visits[-1].note(rung.state, beta)


def _result(done: ChainProgress, *, finished: bool) -> Chain:
    """The draws of a chain; the last state alone if it was stopped during burn-in."""
    coldest = done.position.chains[-1]
    states, values = done.states, done.values
    if not states:
        states, values = [coldest.state], [coldest.log_density]
    # Swaps at fixed temperatures are counted with the moves.
    table = done.table if done.acceptance.proposed else SwapTable.empty(done.position.betas)
    # Without a trace it was stopped before the first value of it was due.
    return Chain(
        tuple(states),
        np.array(values),
        np.array(done.trace or [coldest.log_density]),
        done.acceptance,
        table.summary(),
        finished,
        done,
    )


@dataclass(frozen=True)
class TemperedProblem:
    """Target and moves of a chain over scenes, tempered from a reference to the posterior.

    Parameters
    ----------
    problem : Problem
    moves : Moves
    """

    problem: Problem
    moves: Moves

    def target(self, state: State) -> LogDensityParts:
        """Evaluate the log density in two parts, reference and rest.

        Parameters
        ----------
        state : State

        Returns
        -------
        LogDensityParts
        """
        return parts_of(self.problem, self.moves.reference, state)

    def chain_at(self, state: State) -> SceneChain:
        """Make a chain at a state.

        Parameters
        ----------
        state : State

        Returns
        -------
        SceneChain
        """
        return SceneChain(self.problem, self.moves, state)

    def independent(self, rng: np.random.Generator) -> State:
        """Draw a scene from the reference.

        Parameters
        ----------
        rng : numpy.random.Generator

        Returns
        -------
        State
        """
        return state_of(draw_scene(self.moves.reference, rng))


def tempered(setup: Setup, visits: Visits) -> TemperedProblem:
    """Learn reference and moves from visited scenes.

    Parameters
    ----------
    setup : Setup
    visits : Visits

    Returns
    -------
    TemperedProblem
    """
    reference = learn(setup.problem, setup.gains, setup.similarity, visits)
    moves = scene_moves(setup.problem, reference, camera_shape(visits))
    return TemperedProblem(setup.problem, moves)


def learnt_from(setup: Setup) -> TemperedProblem:
    """Learn reference and moves from the visits of all chains that are known.

    At first they are learnt from the solver's scenes, then from these and the walks about the
    results of the ascents. The walks' visits keep a share among later ones, and so do those of
    walks about the best scene that each chain has found. Otherwise the reference forgets scenes
    that are far better than most, but have few alternatives that it knows: a chain that leaves them
    does not return, and the others do not find them.

    Parameters
    ----------
    setup : Setup

    Returns
    -------
    TemperedProblem
    """
    known = setup.known
    if len(known) > 1:
        walks, later = known[0], known[first_used(len(known)) :]
        count = sum(visits.n_states for of in later for visits in of)
        again = max(1, round(_WALKS * count / max(1, sum(walk.n_states for walk in walks))))
        by_chain = zip_longest(*repeat(walks, again), *later, fillvalue=Visits())
        return tempered(setup, Visits.together(v for own in by_chain for v in own))
    staged = Visits()
    for state in setup.staged:
        staged.note(state)
    return tempered(setup, Visits.together([staged, *(v for of in known for v in of)]))


def first_used(count: int) -> int:
    """Index of the first visits, after those of the walks, from which references are learnt.

    A reference is learnt from the visits of the walks and from the later half of the other visits
    recorded so far. The earlier half is not used by later references either, so it can be dropped.

    Parameters
    ----------
    count : int
        How many times visits were recorded, including the walks'; as many references were learnt
        after the first one.

    Returns
    -------
    int
    """
    return 1 + max(count - 1, 0) // 2


def _of_noted(setup: Setup, noted: Sequence[Visits]) -> TemperedProblem:
    """Reference and moves at a chain's position, learnt from its own visits if no others are known.

    ``noted`` are its visits before each reference so far.
    """
    if setup.learnt is not None and len(noted) == len(setup.known):
        return setup.learnt
    own = tuple((visits,) for visits in noted[len(setup.known) :])
    return learnt_from(replace(setup, known=(*setup.known, *own)[: len(noted)]))


def temperatures_of(settings: SampleSettings, barriers: Sequence[float]) -> int:
    """Number of temperatures with the last reference, from the chains' barriers before it.

    The same for all chains, and not more than the settings'.

    Parameters
    ----------
    settings : SampleSettings
    barriers : sequence of float
        Of each chain.

    Returns
    -------
    int
    """
    return min(settings.temperatures, best_rungs(float(np.mean(barriers))))


def _resize_ladder(done: ChainProgress, temperatures: int) -> None:
    """Change the number of temperatures; each has a generator."""
    now = len(done.position.betas)
    if temperatures != now:
        done.position = resized(done.position, temperatures)
        *own, last = done.rngs
        done.rngs = [*own[:temperatures], *last.spawn(max(0, temperatures - now)), last]


def _anew(position: TemperingState[State], learnt: TemperedProblem) -> TemperingState[State]:
    """The position of a ladder, re-evaluated with another reference."""
    parts = [learnt.target(chain.state) for chain in position.chains]
    return position._replace(
        chains=tuple(
            ChainState(chain.state, part.at(rung))
            for chain, part, rung in zip(position.chains, parts, position.rungs, strict=True)
        ),
        log_likelihoods=tuple(part.log_likelihood for part in parts),
    )


def _resumed(checkpointer: Checkpointer, setup: Setup) -> ChainProgress | None:
    """Progress of a chain from its checkpoint; None if there is none."""
    saved = checkpointer.load()
    if saved is None:
        return None
    try:
        done = ChainProgress.of(saved)
        done.check(setup.problem, setup.settings)
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise CheckpointError(
            f"{checkpointer.path} is damaged ({error}): delete it, and its chain begins anew"
        ) from error
    return done
