"""Draws of a posterior given statements, from draws of the posterior without them.

If enough draws agree with the statements, draws are weighted and resampled. If few do, some draws
are annealed (:mod:`imapper_prob.samplers.reweighting`) with the moves of chains, and new chains
start from the results. Both methods estimate the evidence of the statements.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.config import SampleSettings
from imapper_prob.models.furniture_statements import ObjectAt
from imapper_prob.models.log_posterior import State, terms
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import Clip
from imapper_prob.models.statement_rows import log_by_chance, tell
from imapper_prob.models.statements import Statement, describe
from imapper_prob.progress import Progress
from imapper_prob.samplers.reweighting import Reweighted, anneal, families_of, resample
from imapper_prob.samplers.tempering import POSTERIOR
from imapper_prob.samplers.verdict import Verdict
from imapper_prob.sampling.actors import JointProblem
from imapper_prob.sampling.chain import Setup, tempered
from imapper_prob.sampling.sample import Samples, judge_draws, sample_scenes, setup_of
from imapper_prob.sampling.steps import SceneChain
from imapper_prob.sampling.visits import Visits
from imapper_prob.solver.solver import Solution

__all__ = [
    "Evidence",
    "Told",
    "continued",
    "denied",
    "reweighted",
    "statement_values",
    "with_statements",
]

Array = NDArray[np.float64]
_PARTICLES: Final = 64
"""Number of draws that are annealed; chosen."""
_STEPS: Final = 120
"""Steps of each draw at each power; chosen where the evidence is known, see
tests/sampling/test_told.py: with 60 it comes out too low by more than twice its error, with 120 by
about one."""


@dataclass(frozen=True)
class Evidence:
    """The evidence of statements given the clip.

    Parameters
    ----------
    log_ratio : float
        Log density of the statements given the clip, which is the log of the factor by which the
        evidence grows. Nats; for measurements, in their units.
    error : float
        Standard error of ``log_ratio``, nats. If statements are very surprising, a resampled
        ``log_ratio`` is rather too low, by up to about this error.
    effective : float
        Effective number of draws that agreed with the statements.
    draws : int
        Number of all draws.
    method : str
        ``"reweighted"`` or ``"resampled"``.
    """

    log_ratio: float
    error: float
    effective: float
    draws: int
    method: str

    @property
    def text(self) -> str:
        """The evidence in a sentence.

        Examples
        --------
        >>> from imapper_prob.sampling.conditioning import Evidence
        >>> Evidence(-0.7, 0.05, 610.0, 1600, "reweighted").text
        'Log evidence ratio -0.70 ± 0.05 nats; 610 of 1600 draws agreed: reweighted.'
        """
        return (
            f"Log evidence ratio {self.log_ratio:.2f} ± {self.error:.2f} nats; "
            f"{self.effective:.0f} of {self.draws} draws agreed: {self.method}."
        )


@dataclass(frozen=True)
class Told:
    """The statements that a posterior was conditioned on.

    Parameters
    ----------
    statements : tuple of Statement
        All statements.
    evidence : Evidence, optional
        Evidence of the last statements; None if chains had them from the start.
    denied : tuple of str
        Statements that no draw agrees with, and how improbable; they count as answers by chance.
    steps : int, optional
        Steps of the chains that continued chains began from; None if none were continued.
    """

    statements: tuple[Statement, ...]
    evidence: Evidence | None = None
    denied: tuple[str, ...] = ()
    steps: int | None = None

    @property
    def text(self) -> str:
        """Statements and evidence in a sentence or two.

        Examples
        --------
        >>> from imapper_prob.sampling.conditioning import Told
        >>> Told((im.Measured("height", 1.6, 0.02),)).text
        'Given: height 1.6 ± 0.02 m.'
        """
        said = [f"Given: {', '.join(describe(s) for s in self.statements)}."]
        if self.evidence is not None:
            said.append(self.evidence.text)
        if self.denied:
            said.append(f"No scene was found with {', nor with '.join(self.denied)}.")
        return " ".join(said)


def statement_values(problem: Problem, states: Sequence[State]) -> Array:
    """(N,) log-likelihood of all statements of a problem, nats.

    Parameters
    ----------
    problem : Problem
    states : sequence of N State

    Returns
    -------
    (N,) float
    """
    # Without detections, which the statements do not depend on and which take most of the time.
    alone = problem._replace(likelihood=0.0)
    return np.array([terms(alone, state)["given"] for state in states])


def denied(
    problem: Problem,
    states: Sequence[State],
    *,
    statements: Sequence[Statement],
    clip: Clip,
    labels: Sequence[str],
) -> tuple[str, ...]:
    """Statements that are true in no state, in a few words each, with their log density.

    Parameters
    ----------
    problem : Problem
    states : sequence of State
    statements : sequence of Statement
    clip : Clip
    labels : sequence of C str
        Furniture labels of the whole library, by category number.

    Returns
    -------
    tuple of str
        Statements whose density in no state exceeds twice that of an answer by chance. With doubts
        above .4 the limit is half way, in nats, from such an answer to a certain one.
    """
    found = []
    for statement in statements:
        chance = log_by_chance(statement, clip)
        if chance is None:
            continue
        values = statement_values(tell(problem, [statement], clip, labels), states)
        limit = chance + math.log(2.0)
        if not isinstance(statement, ObjectAt):
            certain = math.log1p(-math.exp(chance))
            limit = min(limit, 0.5 * (chance + certain))
        if values.max() < limit:
            found.append(f"{describe(statement)} (log density {values.max():.1f}, as by chance)")
    return tuple(found)


def with_statements(source: Solution | JointProblem, problem: Problem) -> Solution | JointProblem:
    """Replace the problem of a source of draws by that of the same clip with statements.

    Parameters
    ----------
    source : Solution or JointProblem
    problem : Problem

    Returns
    -------
    Solution or JointProblem
    """
    return replace(source, problem=problem)


def reweighted(
    samples: Samples,
    found: Reweighted,
    *,
    values: Array,
    settings: SampleSettings,
    rng: np.random.Generator,
) -> Samples:
    """Resample draws by weight, about as many as are effective.

    Parameters
    ----------
    samples : Samples
    found : Reweighted
        Weights of the draws.
    values : (N,) float
        Log-likelihood of the statements, nats.
    settings : SampleSettings
    rng : numpy.random.Generator

    Returns
    -------
    Samples
        Draws keep their order and are split into as many chains as before, so a disagreement of
        chains persists.
    """
    chains, draws = samples.shape
    kept = max(2, min(draws, int(found.effective) // chains))
    chosen = resample(found.weights.ravel(), kept * chains, rng)
    states = tuple(samples.states[n] for n in chosen)
    objects = tuple(samples.objects[n] for n in chosen)
    log_posterior = (samples.log_posterior.ravel() + values)[chosen].reshape(chains, kept)
    judged = judge_draws(states, log_posterior, objects, radius=settings.layout_radius, rng=rng)
    return replace(
        samples,
        states=states,
        log_posterior=log_posterior,
        objects=objects,
        layouts=judged.layouts,
        probabilities=judged.probabilities,
        walked=None,
        verdict=_verdict_of_chosen(samples.verdict, judged.verdict, len(states)),
    )


def _verdict_of_chosen(before: Verdict, judged: Verdict, count: int) -> Verdict:
    """Verdict on resampled draws, which is never better than that on the original ones."""
    said = f"{count} draws chosen by weight. {judged.text}"
    if before.good:
        return judged._replace(text=said)
    text = f"{said} They were chosen of draws that are: {before.text}"
    return Verdict(False, max(judged.more_draws, before.more_draws), None, text)


def continued(
    source: Solution | JointProblem,
    samples: Samples,
    *,
    problem: Problem,
    fresh: Array,
    found: Reweighted,
    settings: SampleSettings,
    seed: np.random.SeedSequence,
    workers: int = 1,
    progress: Progress | None = None,
) -> tuple[Samples, Evidence]:
    """Condition draws on statements by annealing, and run chains from the results.

    Parameters
    ----------
    source : Solution or JointProblem
        With the library that the draws refer to.
    samples : Samples
        Draws without the statements.
    problem : Problem
        Problem with all statements.
    fresh : (G,) float
        1 for statements that are new to the draws, else 0.
    found : Reweighted
        How far the draws agree with the statements.
    settings : SampleSettings
        Settings of the new chains.
    seed : numpy.random.SeedSequence
    workers : int
    progress : callable, optional

    Returns
    -------
    Samples, Evidence
    """
    anneal_seed, chain_seed = seed.spawn(2)
    told = with_statements(source, problem)
    setup = setup_of(told, settings)
    chosen = _evenly(samples, _PARTICLES)
    families = families_of(*samples.shape)[chosen]
    advance = _Advance(setup, fresh, _noted(samples.states))
    alone = problem._replace(given_power=fresh, likelihood=0.0)
    annealed = anneal(
        np.random.default_rng(anneal_seed),
        [samples.states[n] for n in chosen],
        families,
        log_factor=lambda state: float(terms(alone, state)["given"]),
        advance=advance,
        on_power=None if progress is None else partial(progress, "being told"),
    )
    # Unsorted: sorting by log-posterior would start all chains in the same mode.
    pool = annealed.states
    starts = [
        [pool[chain % len(pool)], *pool[chain + settings.chains :: settings.chains]]
        for chain in range(settings.chains)
    ]
    drawn = sample_scenes(
        told, settings, seed=chain_seed, workers=workers, starts=starts, progress=progress
    )
    evidence = Evidence(
        annealed.log_ratio, annealed.error, found.effective, len(samples.states), "resampled"
    )
    return drawn, evidence


def _evenly(samples: Samples, count: int) -> NDArray[np.int64]:
    """Indices of evenly spaced draws, equally many of each chain."""
    chains, draws = samples.shape
    own = np.unique(np.linspace(0, draws - 1, max(1, count // chains)).round().astype(np.int64))
    return (np.arange(chains)[:, None] * draws + own).ravel()


def _noted(states: Sequence[State]) -> Visits:
    visits = Visits()
    for state in states:
        visits.note(state)
    return visits


class _Advance:
    """Moves a state with the moves of chains, at a given power of the new statements."""

    def __init__(self, setup: Setup, fresh: Array, visits: Visits) -> None:
        self._problem, self._fresh = setup.problem, fresh
        self._moves = tempered(setup, visits).moves

    def __call__(self, rng: np.random.Generator, state: State, power: float) -> State:
        powers = np.where(self._fresh > 0, power, 1.0)
        chain = SceneChain(self._problem._replace(given_power=powers), self._moves, state)
        return chain.advance(rng, POSTERIOR, _STEPS)[0].state
