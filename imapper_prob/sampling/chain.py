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
from imapper_prob.models.log_posterior import (
    Incremental,
    State,
    empty_state,
    log_posterior,
    target_of,
)
from imapper_prob.models.problem import Problem
from imapper_prob.samplers.chains import Report
from imapper_prob.samplers.checkpoint import Checkpointer, CheckpointError
from imapper_prob.samplers.reversible_jump import AcceptanceTable, ChainState, Mixture, Move, step
from imapper_prob.samplers.tempering import (
    LadderSummary,
    Parts,
    TemperingState,
    power_ladder,
    start,
    temper,
)
from imapper_prob.sampling.actors import JointProblem
from imapper_prob.sampling.camera_moves import (
    AdaptedCameraWalk,
    CameraWalk,
    CompensatedCameraWalk,
    DepthScale,
    FocalScale,
)
from imapper_prob.sampling.checkpoints import ChainProgress
from imapper_prob.sampling.learning import learn
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
from imapper_prob.sampling.proposals import Candidates, Proposals
from imapper_prob.sampling.reference import Reference, draw_scene, log_reference
from imapper_prob.sampling.reference_moves import SceneRedraw, StretchRedraw
from imapper_prob.sampling.replace_moves import Refurnish, Replace, ReplaceAndShift
from imapper_prob.sampling.schedule import (
    burn_in_of,
    draws_of,
    end_of,
    learning_of,
    piece_of,
    trace_of,
)
from imapper_prob.sampling.visits import Visits, camera_shape

__all__ = [
    "Chain",
    "SceneTracker",
    "Setup",
    "run_chain",
    "scene_moves",
    "starts_of",
    "tempering_split",
]


def tempering_split(problem: Problem, reference: Reference | None, state: State) -> Parts:
    """The reference's log density and what the posterior's is beyond it; all without one."""
    return _split(reference, state, log_posterior(problem, state))


def _split(reference: Reference | None, state: State, log_density: float) -> Parts:
    if reference is None:
        return Parts(0.0, log_density)
    log_prior = log_reference(
        reference, state.camera, state.items, state.placements, state.sizes
    )  # fmt: skip
    return Parts(log_prior, log_density - log_prior if math.isfinite(log_prior) else 0.0)


class SceneTracker:
    """What :func:`tempering_split` says, worked out from where a chain stands.

    Values depend by some 1e-6 nats on how the chain came to where it is, because what moves by
    nanometres is not looked at again. Chains that are to be repeated exactly from the middle
    begin with a new tracker there.

    Parameters
    ----------
    problem : Problem
        Not with the published energy, which has no incremental evaluation.
    reference : Reference or None
    state : State
        Where the chain stands.
    """

    def __init__(self, problem: Problem, reference: Reference | None, state: State) -> None:
        self._incremental = Incremental(problem, state)
        self._reference = reference
        self._last: State | None = None

    def __call__(self, state: State) -> Parts:
        """The parts of ``state``; the chain stays where it is."""
        if state is self._incremental.state:
            return _split(self._reference, state, sum(self._incremental.parts))
        self._last = state
        return _split(self._reference, state, sum(self._incremental.propose(state)))

    def move(self, state: State) -> None:
        """The chain has gone to ``state``."""
        if state is self._incremental.state:
            return
        if state is not self._last:
            self._incremental.propose(state)
        self._incremental.accept()
        self._last = None


def tracker_of(
    problem: Problem, reference: Reference | None = None
) -> Callable[[State], SceneTracker] | None:
    """What makes trackers of chains; None where every state is evaluated as a whole."""
    if not target_of(problem).incremental:
        return None
    return partial(SceneTracker, problem, reference)


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


_REDRAWN = 0.6
"""How often a stretch is drawn anew from the reference, over all moves but these and the adapted
walk together; whole scenes half as often. Chosen."""


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


def scene_moves(
    setup: Setup, reference: Reference | None = None, shape: Array | None = None
) -> Mixture[State]:
    """The moves and how often each is tried.

    Births and deaths are refused far more often than walks, so they are tried more often
    than their share of the accepted moves suggests. Exchanges for a scenelet of similar motion
    lead to what nobody has met, a few nats at a time. From a ``reference`` scenes and stretches are
    drawn anew; with a ``shape`` (5, 5), see :func:`imapper_prob.sampling.visits.camera_shape`,
    camera and body walk in it.
    """
    problem = setup.problem
    proposals = Proposals(problem, setup.candidates)
    factor = np.linalg.cholesky(np.linalg.inv(problem.camera_precision))
    kinds = furniture_kinds(problem)
    weighted: list[tuple[Move[State], float]] = [
        (Birth(proposals), 0.09),
        (Death(proposals), 0.09),
        (ReplaceNearby(proposals), 0.04),
        (Replace(proposals), 0.10),
        (ReplaceAndShift(proposals), 0.05),
        (ReplaceSimilar(problem, setup.similarity), 0.4),
        (Refurnish(proposals, kinds), 0.08),
        (Shift(problem), 0.06),
        (PlacementWalk(), 0.3),
        (CameraWalk(factor), 0.03),
        (CompensatedCameraWalk(problem, factor), 0.07),
        (DepthScale(), 0.06),
        (FocalScale(float(np.linalg.norm(factor[2]))), 0.04),
        (PathRefresh(), 0.05),
    ]
    if shape is not None:
        weighted.append((AdaptedCameraWalk(problem, shape), 0.4))
    if reference is not None:
        weighted += [(SceneRedraw(reference), _REDRAWN / 2), (StretchRedraw(reference), _REDRAWN)]
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
    which references and the shape of the camera's walk are learnt; then all of them stay. Only
    draws of the posterior itself are kept, and none of the burn-in. With a ``keeper`` the chain
    goes on from its checkpoint, if there is one, a finished chain's too. It stops after ``end``
    rounds, that of the settings if not given; see :mod:`imapper_prob.sampling.schedule` for where
    it may.
    """
    settings = setup.settings
    end = end_of(settings) if end is None else end
    burn_in, keep, mark = burn_in_of(settings), draws_of(settings), trace_of(settings)
    learning = learning_of(settings)
    done = None if keeper is None else _resumed(keeper, setup)
    if done is None and isinstance(starts, ChainProgress):
        done = starts
    learnt = _learnt(setup, [] if done is None else done.visits[:-1])
    if done is None:
        assert not isinstance(starts, ChainProgress)
        betas = power_ladder(settings.temperatures) if settings.temperatures > 1 else (1.0,)
        coldest_first = [starts[min(k, len(starts) - 1)] for k in range(len(betas))]
        position = start(coldest_first[::-1], target=learnt.target, betas=betas)
        done = ChainProgress.begin(rng.spawn(len(betas) + 1), position)
    crossover = TimeCrossover(setup.problem)
    finished = True
    while done.position.rounds < end and finished:
        now = done.position.rounds
        adapt = now < burn_in
        if now in learning.ends:
            learnt = _learnt(setup, done.visits[:-1])
            done.position = _anew(done.position, learnt)
        # A piece begins with new trackers, as a chain does that goes on from a checkpoint.
        stops = (*learning.ends, burn_in, settings.rounds, end)
        last = next(stop for stop in stops if now < stop)
        piece = min(piece_of(settings), min(last, end) - now)
        rounds = temper(
            done.rngs,
            done.position,
            target=learnt.target,
            kernel=partial(step, mixture=learnt.mixture),
            steps_per_swap=settings.swap_every,
            adapt=adapt,
            crossover=crossover,
            track=learnt.track,
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


@dataclass(frozen=True)
class _Learnt:
    """What a chain moves with, as far as it has learnt."""

    problem: Problem
    reference: Reference | None
    mixture: Mixture[State]

    def target(self, state: State) -> Parts:
        """The log density in two parts."""
        return tempering_split(self.problem, self.reference, state)

    @property
    def track(self) -> Callable[[State], SceneTracker] | None:
        """What makes trackers."""
        return tracker_of(self.problem, self.reference)

    @property
    def independent(self) -> Callable[[np.random.Generator], State] | None:
        """Draws from the reference."""
        return None if self.reference is None else partial(draw_scene, self.reference)


def _learnt(setup: Setup, noted: Sequence[Visits]) -> _Learnt:
    """Of what the chains have noted last, or this one alone; of the solver's scenes at first."""
    if not noted:
        visits = Visits()
        for state in setup.staged:
            visits.note(state)
    else:
        own = len(noted) - 1
        visits = setup.known[own] if own < len(setup.known) else noted[own]
    reference = None
    if setup.settings.temperatures > 1:
        reference = learn(setup.problem, setup.candidates, setup.similarity, visits)
    return _Learnt(setup.problem, reference, scene_moves(setup, reference, camera_shape(visits)))


def _anew(position: TemperingState[State], learnt: _Learnt) -> TemperingState[State]:
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
