"""One reversible-jump chain over scenes, as a task that any process can run."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from imapper_prob.config import SampleSettings
from imapper_prob.models.posterior import State, log_posterior
from imapper_prob.models.problem import Problem
from imapper_prob.samplers.chains import Report
from imapper_prob.samplers.checkpoint import Keeper
from imapper_prob.samplers.kernel import Mixture
from imapper_prob.samplers.reversible_jump import AcceptanceTable, sample
from imapper_prob.sampling.checkpoints import Progress
from imapper_prob.sampling.moves import (
    Birth,
    CameraWalk,
    Death,
    DepthScale,
    Exchange,
    PathRefresh,
    PlacementWalk,
    Shift,
    Swap,
)
from imapper_prob.sampling.proposals import Candidates, Proposals
from imapper_prob.sampling.refurnish import Refurnish
from imapper_prob.staged.candidates import furniture_kinds

__all__ = ["Chain", "Setup", "run_chain", "scene_moves"]

Array = NDArray[np.float64]

_ANNEALING = (0.3, 0.45, 0.65, 1.0)
"""Powers of the posterior during burn-in, equally long each."""
_REPORT_EVERY = 200
"""Steps between two progress reports; a fraction of a second."""


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
    """

    problem: Problem
    candidates: Candidates
    similarity: Array
    settings: SampleSettings


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
        Over the steps at the posterior itself.
    finished : bool
        Whether it ran all its steps.
    """

    states: tuple[State, ...]
    log_posterior: Array
    trace: Array
    acceptance: AcceptanceTable
    finished: bool


def scene_moves(setup: Setup) -> Mixture[State]:
    """The moves and how often each is tried.

    Births and deaths are refused far more often than walks, so they are tried more often
    than their share of the accepted moves suggests.
    """
    problem = setup.problem
    proposals = Proposals(problem, setup.candidates)
    factor = np.linalg.cholesky(np.linalg.inv(problem.camera_precision))
    weighted = (
        (Birth(proposals), 0.12),
        (Death(proposals), 0.12),
        (Swap(proposals), 0.14),
        (Exchange(problem, setup.similarity), 0.10),
        (Refurnish(problem, setup.similarity, furniture_kinds(problem)), 0.06),
        (Shift(problem), 0.06),
        (PlacementWalk(), 0.22),
        (CameraWalk(factor), 0.05),
        (DepthScale(), 0.05),
        (PathRefresh(), 0.08),
    )
    return Mixture([move for move, _ in weighted], [weight for _, weight in weighted])


def run_chain(
    setup: Setup,
    start: State,
    rng: np.random.Generator,
    report: Report,
    keeper: Keeper | None = None,
) -> Chain:
    """Run a chain from ``start``; asked to stop, it returns what it has.

    The burn-in is annealed: it goes from a flattened posterior to the posterior itself, so
    that chains leave the scene they started from. None of its draws is kept. With a
    ``keeper`` the chain goes on from its checkpoint, if there is one.
    """
    settings = setup.settings
    burn_in = int(settings.steps * settings.burn_in)
    keep = set(np.linspace(burn_in, settings.steps - 1, settings.draws).round().astype(int))
    mark = set(np.linspace(0, settings.steps - 1, settings.draws).round().astype(int))
    mixture = scene_moves(setup)
    stages = np.linspace(0, burn_in, len(_ANNEALING) + 1).round().astype(int)
    ends = [*zip(_ANNEALING, stages[1:], strict=True), (1.0, settings.steps)]
    saved = keeper.load() if keeper is not None else None
    done = Progress(rng, start) if saved is None else Progress.of(saved)
    finished = True
    for power, end in ends:
        if done.steps >= end or not finished:
            continue
        target = partial(_flattened, setup.problem, power)
        for at, info in sample(done.rng, done.state, log_density_fn=target, mixture=mixture):
            done.state = at.state
            if power == 1.0:
                done.acceptance.record(info)
            if done.steps in keep:
                done.states.append(at.state)
                done.values.append(at.log_density)
            if done.steps in mark:
                done.trace.append(at.log_density / power)
            asked = done.steps % _REPORT_EVERY == 0
            done.steps += 1
            finished = not asked or report(done.steps / settings.steps)
            if asked and keeper is not None:
                keeper.offer(done.snapshot)
            if done.steps == end or not finished:
                break
    if keeper is not None:
        keeper.save(done.snapshot())
    states, values = done.states, done.values
    if not states:
        # Stopped during burn-in: the last state is all there is.
        states, values = [done.state], [log_posterior(setup.problem, done.state)]
    return Chain(tuple(states), np.array(values), np.array(done.trace), done.acceptance, finished)


def _flattened(problem: Problem, power: float, state: State) -> float:
    return power * log_posterior(problem, state)
