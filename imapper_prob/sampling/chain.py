"""One tempered reversible-jump chain over scenes, as a task that any process can run."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from imapper_prob.config import SampleSettings
from imapper_prob.layouts import furniture_kinds
from imapper_prob.models.log_posterior import Incremental, State, empty_state, target_of, terms
from imapper_prob.models.problem import Problem
from imapper_prob.samplers.chains import Report
from imapper_prob.samplers.checkpoint import Checkpointer, CheckpointError
from imapper_prob.samplers.reversible_jump import AcceptanceTable, Mixture, Move, Redraw, step
from imapper_prob.samplers.tempering import LadderSummary, Parts, power_ladder, start, temper
from imapper_prob.sampling.actors import JointProblem
from imapper_prob.sampling.camera_moves import (
    AdaptedCameraWalk,
    CameraWalk,
    CompensatedCameraWalk,
    DepthScale,
    FocalScale,
)
from imapper_prob.sampling.checkpoints import ChainProgress
from imapper_prob.sampling.moves import (
    Birth,
    Death,
    PathRefresh,
    PlacementWalk,
    ReplaceNearby,
    ReplaceSimilar,
    Shift,
    TimeCrossover,
)
from imapper_prob.sampling.pool_kernels import Table
from imapper_prob.sampling.proposals import Candidates, Proposals
from imapper_prob.sampling.redraw import StretchRedraw
from imapper_prob.sampling.replace_moves import Refurnish, Replace, ReplaceAndShift
from imapper_prob.sampling.schedule import (
    burn_in_of,
    draws_of,
    end_of,
    learning_of,
    piece_of,
    trace_of,
)
from imapper_prob.sampling.visits import Visits, camera_shape, table_of

__all__ = [
    "Chain",
    "SceneTracker",
    "Setup",
    "run_chain",
    "scene_moves",
    "starts_of",
    "tempering_split",
]


def tempering_split(problem: Problem, state: State) -> Parts:
    """The log-posterior in what stays as it is and what the other temperatures flatten.

    They flatten the prior odds of scenelets, one in ten thousand, as they flatten what a
    scenelet gains by explaining the clip: otherwise the hot scenes would be empty, and what
    comes from there to the cold ones would know nothing of them. Placements, camera and path
    are left alone, lest hot scenes fill up with scenelets that stand anywhere.
    """
    nats = terms(problem, state)
    kept = nats["camera"] + nats["placement"] + nats["path"]
    return Parts(kept, sum(nats.values()) - kept if math.isfinite(kept) else 0.0)


class SceneTracker:
    """What :func:`split` says, worked out from where a chain stands.

    Values depend by some 1e-6 nats on how the chain came to where it is, because what moves by
    nanometres is not looked at again. Chains that are to be repeated exactly from the middle
    begin with a new tracker there.

    Parameters
    ----------
    problem : Problem
        Not with the published energy, which has no incremental evaluation.
    state : State
        Where the chain stands.
    """

    def __init__(self, problem: Problem, state: State) -> None:
        self._incremental = Incremental(problem, state)
        self._log_rate = problem.log_rate
        self._last: State | None = None

    def __call__(self, state: State) -> Parts:
        """The parts of ``state``; the chain stays where it is."""
        if state is self._incremental.state:
            return self._split(state, *self._incremental.parts)
        self._last = state
        return self._split(state, *self._incremental.propose(state))

    def move(self, state: State) -> None:
        """The chain has gone to ``state``."""
        if state is self._incremental.state:
            return
        if state is not self._last:
            self._incremental.propose(state)
        self._incremental.accept()
        self._last = None

    def _split(self, state: State, log_prior: float, log_likelihood: float) -> Parts:
        odds = float(self._log_rate[state.items[:, 0]].sum())
        return Parts(log_prior - odds, log_likelihood + odds)


def tracker_of(problem: Problem) -> Callable[[State], SceneTracker] | None:
    """What makes trackers of chains; None where every state is evaluated as a whole."""
    return partial(SceneTracker, problem) if target_of(problem).incremental else None


# ------------------------------------------------------------------------------------------------
# Where chains start, and each of their temperatures.


def starts_of(cast: JointProblem, count: int) -> list[tuple[State, ...]]:
    """By chain where its temperatures start, from the posterior itself to the hottest.

    The coldest are far apart on purpose: the best scene, none at all, and the alternatives, worst
    first. The hotter ones are at all that the solver found, the better the colder, so that what is
    worth more than where the coldest started can come to it, stretch by stretch.
    """
    others = list(cast.states[:0:-1]) or [cast.states[0]]
    pool = [cast.states[0], empty_state(cast.problem), *others]
    coldest = [pool[i % len(pool)] for i in range(count)]
    return [(own, *(s for s in cast.states if s is not own)) for own in coldest]


# ------------------------------------------------------------------------------------------------
# One tempered reversible-jump chain over scenes, as a task that any process can run.

Array = NDArray[np.float64]
_REDRAWN = 0.2
"""How often a stretch is drawn anew where there is a table: most of the time of a chain, for it
takes thirty times as long as another move, and most of what changes. Chosen."""


@dataclass(frozen=True)
class Setup:
    """What all chains share.

    Parameters
    ----------
    problem : Problem
    candidates : Candidates
        Where births and swaps look.
    similarity : (L, L) float
        Probabilities of exchanging one scenelet for another.
    settings : SampleSettings
    known : tuple of Visits
        What all chains have noted for each table that is made while they burn in, as far as they
        have come. A chain makes the others of what it has noted itself.
    """

    problem: Problem
    candidates: Candidates
    similarity: Array
    settings: SampleSettings
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


def scene_moves(
    setup: Setup, table: Table | None = None, shape: Array | None = None
) -> Mixture[State]:
    """The moves and how often each is tried.

    Births and deaths are refused far more often than walks, so they are tried more often
    than their share of the accepted moves suggests. With a ``table`` of what the chains have
    visited stretches are drawn anew from it, and with a ``shape`` (5, 5), see
    :func:`imapper_prob.sampling.visits.camera_shape`, camera and body walk in it.
    """
    problem = setup.problem
    proposals = Proposals(problem, setup.candidates)
    factor = np.linalg.cholesky(np.linalg.inv(problem.camera_precision))
    kinds = furniture_kinds(problem)
    weighted: list[tuple[Move[State] | Redraw[State], float]] = [
        (Birth(proposals), 0.09),
        (Death(proposals), 0.09),
        (ReplaceNearby(proposals), 0.04),
        (Replace(proposals), 0.10),
        (ReplaceAndShift(proposals), 0.05),
        (ReplaceSimilar(problem, setup.similarity), 0.06),
        (Refurnish(proposals, kinds), 0.08),
        (Shift(problem), 0.06),
        (PlacementWalk(), 0.18),
        (CameraWalk(factor), 0.03),
        (CompensatedCameraWalk(problem, factor), 0.07),
        (DepthScale(), 0.06),
        (FocalScale(float(np.linalg.norm(factor[2]))), 0.04),
        (PathRefresh(), 0.05),
    ]
    if shape is not None:
        weighted.append((AdaptedCameraWalk(problem, shape), 0.4))
    if table is not None and len(table.items):
        total = sum(weight for _, weight in weighted)
        weighted.append((StretchRedraw(problem, table), _REDRAWN / (1 - _REDRAWN) * total))
    return Mixture([move for move, _ in weighted], [weight for _, weight in weighted])


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

    It starts from the first of ``starts`` at the posterior itself, from the second at the next
    hotter temperature and so on, from the last wherever there are not enough; or it goes on from
    what an earlier call has left.

    While it burns in, the ladder of temperatures adapts, and the chain notes what it visits, from
    which tables of scenelets are made; then both stay. Only draws of the posterior itself are
    kept, and none of the burn-in. With a ``keeper`` the chain goes on from
    its checkpoint, if there is one, a finished chain's too. It stops after ``end`` rounds, that
    of the settings if not given; see :mod:`imapper_prob.sampling.schedule` for where it may.
    """
    settings = setup.settings
    end = end_of(settings) if end is None else end
    burn_in, keep, mark = burn_in_of(settings), draws_of(settings), trace_of(settings)
    target = partial(tempering_split, setup.problem)
    done = None if keeper is None else _resumed(keeper, setup)
    if done is None and isinstance(starts, ChainProgress):
        done = starts
    if done is None:
        assert not isinstance(starts, ChainProgress)
        betas: tuple[float, ...] = (1.0,)
        if settings.temperatures > 1:
            betas = power_ladder(settings.temperatures, hottest=settings.hottest)
        coldest_first = [starts[min(k, len(starts) - 1)] for k in range(len(betas))]
        position = start(coldest_first[::-1], target=target, betas=betas)
        done = ChainProgress.begin(rng.spawn(len(betas) + 1), position)
    advance = partial(
        temper,
        done.rngs,
        target=target,
        steps_per_swap=settings.swap_every,
        crossover=TimeCrossover(setup.problem),
        track=tracker_of(setup.problem),
    )
    # The published energy has no incremental evaluation, without which pools take too long.
    learning = learning_of(settings) if target_of(setup.problem).incremental else None
    mixture = scene_moves(setup, *_learnt(setup, done))
    finished = True
    while done.position.rounds < end and finished:
        now = done.position.rounds
        adapt = now < burn_in
        marks = () if learning is None else learning.ends
        # A piece begins with new trackers, as a chain does that goes on from a checkpoint.
        last = next(stop for stop in (*marks, burn_in, settings.rounds, end) if now < stop)
        piece = min(piece_of(settings), min(last, end) - now)
        kernel = partial(step, mixture=mixture)
        for at in islice(advance(done.position, adapt=adapt, kernel=kernel), piece):
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
            if learning is not None and learning.has(at.position.rounds):
                for beta, rung in zip(at.position.betas, at.position.chains, strict=True):
                    done.visits[-1].note(rung.state, beta)
        if done.position.rounds in marks:
            done.visits.append(Visits())
            mixture = scene_moves(setup, *_learnt(setup, done))
        finished = report(done.position.rounds / end)
        if keeper is not None:
            keeper.offer(done.snapshot)
    if keeper is not None:
        keeper.save(done.snapshot())
    states, values = done.states, done.values
    if not states:
        # Stopped during burn-in: the last state is all there is.
        coldest = done.position.chains[-1]
        states, values = [coldest.state], [coldest.log_density]
    return Chain(
        tuple(states),
        np.array(values),
        np.array(done.trace),
        done.acceptance,
        done.table.summary(),
        finished,
        done,
    )


def _learnt(setup: Setup, done: ChainProgress) -> tuple[Table | None, Array | None]:
    """The table and the shape of what the chains have noted, or this one alone; None where that
    is nothing."""
    made = len(done.visits) - 1
    if made == 0:
        return None, None
    visits = setup.known[made - 1] if made <= len(setup.known) else done.visits[made - 1]
    return table_of(setup.problem, visits) if visits.items else None, camera_shape(visits)


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
