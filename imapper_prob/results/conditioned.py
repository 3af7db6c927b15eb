"""Condition a posterior on statements, by reweighting its draws or by continued chains."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from imapper_prob.config import MOST_STEPS, SampleSettings
from imapper_prob.models.errors import InputError, require_whole
from imapper_prob.models.log_posterior import State
from imapper_prob.models.problem import labels_of
from imapper_prob.models.scenelet import Library
from imapper_prob.models.statement_rows import check_statements, tell
from imapper_prob.models.statements import Statement
from imapper_prob.progress import Progress
from imapper_prob.results.posterior import Posterior
from imapper_prob.samplers.reweighting import reweigh
from imapper_prob.sampling.actors import JointProblem, join_actors
from imapper_prob.sampling.conditioning import (
    Evidence,
    Told,
    continued,
    denied,
    reweighted,
    statement_values,
    with_statements,
)
from imapper_prob.scenelets.library import load_library
from imapper_prob.solver.actors import solve_actors
from imapper_prob.solver.solver import Solution
from imapper_prob.uncertainty.stored import StoredSource, library_digest

__all__ = ["conditioned"]

_PART: Final = 4
"""Continued chains make 1/4 of the run's steps, because they start from draws."""
_BURN_IN: Final = 0.2
"""Share of their steps that is not kept; chosen, half of what other chains need."""
_LEAST: Final = 20
"""Least number of their steps."""


def conditioned(
    posterior: Posterior,
    statements: Sequence[Statement],
    *,
    library: Library | None = None,
    steps: int | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> Posterior:
    """See :meth:`imapper_prob.results.posterior.Posterior.given`.

    Parameters
    ----------
    posterior : Posterior
    statements : sequence of Statement
    library : Library, optional
    steps : int, optional
    workers : int
    progress : callable, optional

    Returns
    -------
    Posterior

    Raises
    ------
    InputError
        The statements are impossible for the clip, or the library is another one.
    """
    begun = time.perf_counter()
    require_whole("workers", workers, least=1)
    if steps is not None:
        require_whole("steps", steps, least=1, most=MOST_STEPS)
    if not statements:
        raise InputError("no statement: name one at least")
    source, samples, clip = posterior.solution, posterior.samples, posterior.clip
    known = _full_library(posterior, library)
    before = Told(()) if posterior.told is None else posterior.told
    earlier = before.statements
    labels = labels_of(known)
    check_statements(statements, clip, labels)
    everything = (*earlier, *statements)
    check_statements(everything, clip, labels)
    values = statement_values(tell(source.problem, statements, clip, labels), samples.states)
    found = reweigh(values.reshape(samples.shape))
    seed = np.random.SeedSequence(posterior.config.seed, spawn_key=(len(everything),))
    if denied(source.problem, samples.states, statements=statements, clip=clip, labels=labels):
        # No draw agrees with a statement, so all weights are those of chance, and tell nothing.
        found = replace(found, effective=0.0)
    if found.good:
        chosen = reweighted(
            samples,
            found,
            values=values,
            settings=posterior.config.sample,
            rng=np.random.default_rng(seed),
        )
        told = replace(source, problem=tell(source.problem, everything, clip, labels))  # type: ignore[type-var]
        evidence = Evidence(
            found.log_ratio, found.error, found.effective, len(samples.states), "reweighted"
        )
        seconds = {**posterior.seconds, "being told": time.perf_counter() - begun}
        # Statements that none of the draws agreed with, none of the chosen ones agrees with.
        said = Told(everything, evidence, before.denied, before.steps)
        return Posterior(told, chosen, posterior.config, seconds=seconds, told=said)
    solved = _solved(posterior, known, progress)
    if isinstance(source, StoredSource):
        samples = replace(samples, states=_renumbered(samples.states, source.library, known))
    problem = tell(solved.problem, everything, clip, labels)
    whole = before.steps or posterior.config.sample.steps
    settings = _shorter(
        posterior.config.sample, max(_LEAST, whole // _PART) if steps is None else steps
    )
    fresh = np.r_[np.zeros(len(earlier)), np.ones(len(statements))]
    drawn, evidence = continued(
        solved, samples, problem=problem, fresh=fresh, found=found, settings=settings,
        seed=seed, workers=workers, progress=progress,
    )  # fmt: skip
    nowhere = denied(solved.problem, drawn.states, statements=everything, clip=clip, labels=labels)
    return Posterior(
        with_statements(solved, problem),
        drawn,
        replace(posterior.config, sample=settings),
        seconds={**posterior.seconds, "being told": time.perf_counter() - begun},
        told=Told(everything, evidence, nowhere, whole),
    )


def _full_library(posterior: Posterior, library: Library | None) -> Library:
    """The whole library of a posterior, whose file keeps only a part: as given, or from
    settings."""
    source = posterior.solution
    if not isinstance(source, StoredSource):
        return source.library
    known = load_library(posterior.config.library) if library is None else library
    if known.digest != library_digest(source):
        raise InputError(
            f"library {known.name}: is not the one that clip {posterior.clip.name} was sampled "
            "with; name that one"
        )
    return known


def _solved(
    posterior: Posterior, library: Library, progress: Progress | None
) -> Solution | JointProblem:
    """The solution that chains continue from; a run opened from its folder is solved again."""
    source = posterior.solution
    if isinstance(source, Solution | JointProblem):
        return source
    settings = posterior.config.settings
    solutions = solve_actors(posterior.clip, library, settings=settings, progress=progress)
    return solutions[0] if len(solutions) == 1 else join_actors(solutions)


def _renumbered(states: Sequence[State], part: Library, whole: Library) -> tuple[State, ...]:
    """Convert states from a part of a library to the whole library."""
    number = {scenelet.name: n for n, scenelet in enumerate(whole)}
    of_part = np.array([number[scenelet.name] for scenelet in part], np.int64)
    return tuple(
        State(
            s.camera,
            np.stack([of_part[s.items[:, 0]], s.items[:, 1]], -1),
            s.placements,
            s.sizes,
            s.latent,
        )
        for s in states
    )


def _shorter(settings: SampleSettings, steps: int) -> SampleSettings:
    asked = replace(settings, steps=steps, burn_in=_BURN_IN, last_step=0, draws=1)
    return replace(asked, draws=min(settings.draws, asked.most_draws))
