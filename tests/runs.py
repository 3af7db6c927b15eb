"""A short run on the demo clip, made once for all tests that look at results."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from imapper_prob.api import demo_clip
from imapper_prob.config import Config, SampleSettings
from imapper_prob.evaluate.suite import first_part
from imapper_prob.models.scenelet import Library
from imapper_prob.results.posterior import Posterior
from imapper_prob.sampling.sample import sample_scenes
from imapper_prob.scenelets.library import load_library
from imapper_prob.solver.solver import Solution, solve

SHORT = Config(
    seed=3,
    sample=SampleSettings(
        chains=2, steps=400, draws=40, temperatures=3, ensemble_steps=8,
    ),
)  # fmt: skip
"""Far too short to be good, long enough for every file to have something in it."""
BRIEF = replace(SHORT, sample=replace(SHORT.sample, steps=150, draws=15, ensemble_steps=4))
"""Shorter still, for what is so from the first draw to the last."""


@cache
def half_library() -> Library:
    """Every second scenelet of the built-in library."""
    return Library("half", tuple(load_library())[::2])


@cache
def solution() -> Solution:
    """The staged solution of the demo clip, by half of the library."""
    return solve(demo_clip(), half_library())


@cache
def small_solution() -> Solution:
    """Half the clip by an eighth of the library, for what any scene will do.

    To sample it takes a fourth of the time.
    """
    library = Library("part", tuple(load_library())[::8])
    return solve(first_part(demo_clip(), 0.5), library)


@cache
def posterior() -> Posterior:
    """A short posterior of the demo clip."""
    samples = sample_scenes(solution(), SHORT.sample, seed=np.random.SeedSequence(SHORT.seed))
    return Posterior(solution(), samples, SHORT)


@cache
def small_posterior() -> Posterior:
    """A brief posterior of the small solution."""
    samples = sample_scenes(small_solution(), BRIEF.sample, seed=np.random.SeedSequence(BRIEF.seed))
    return Posterior(small_solution(), samples, BRIEF)
