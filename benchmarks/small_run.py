"""A run that takes a second or two, for benchmarks that make many."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Final

import numpy as np

from imapper_prob.config import Config, SampleSettings
from imapper_prob.demo import demo_clip
from imapper_prob.evaluate.parts import first_part
from imapper_prob.models.scenelet import Library
from imapper_prob.output import write_run
from imapper_prob.results.posterior import Posterior
from imapper_prob.sampling.sample import sample_scenes
from imapper_prob.scenelets.library import load_library
from imapper_prob.staged.solver import Solution, solve

__all__ = [
    "CONFIG",
    "SEED",
    "small_library",
    "small_posterior",
    "small_solution",
    "write_small_run",
]

SEED: Final = 3
CONFIG: Final = Config(
    seed=SEED,
    sample=SampleSettings(
        chains=2, steps=60, temperatures=2, draws=4, ensemble_layouts=1, ensembles=2,
        ensemble_steps=2,
    ),
)  # fmt: skip
"""Far too short to be good; every file has something in it."""


def small_library() -> Library:
    """Somebody who sits at a table, and a few who walk."""
    names = ("sit-couch-table-003", "walk")
    return Library("part", tuple(s for s in load_library() if s.name.startswith(names))[:20])


@cache
def small_solution() -> Solution:
    """Five seconds of the demo, solved."""
    return solve(first_part(demo_clip(), 0.4), small_library())


def small_posterior(*, checkpoints: Path | None = None) -> Posterior:
    """Its draws."""
    samples = sample_scenes(
        small_solution(),
        CONFIG.sample,
        seed=np.random.SeedSequence(SEED),
        checkpoints=checkpoints,
    )
    return Posterior(small_solution(), samples, CONFIG)


def write_small_run(folder: Path) -> None:
    """The folder of a run."""
    write_run(folder, small_posterior(), overwrite=False)
