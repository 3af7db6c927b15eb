"""Clips by name, stored runs, and digests of the program. (No command of its own.)"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

import imapper_prob as im
from imapper_prob.api import demo_clip, load_clip
from imapper_prob.config import Config, SampleSettings
from imapper_prob.models.scene import Clip
from imapper_prob.models.scenelet import Library
from imapper_prob.results.load import load_posterior
from imapper_prob.results.posterior import Posterior
from imapper_prob.scenelets.library import load_library
from imapper_prob.simulate.clips import simulate_clip

__all__ = ["SHORT_STEPS", "digest", "is_whole", "named_clip", "sampled", "with_steps"]

_SIMULATED = "simulated-"
SHORT_STEPS: Final = 26_000
"""Steps of chains where scores are compared, not probabilities; chosen: many runs then take hours,
not a day."""


def named_clip(name: str) -> Clip:
    """The clip of a command line.

    Parameters
    ----------
    name : str
        ``demo``, ``simulated-N`` for the clip that seed N simulates with the built-in library, or a
        path.

    Returns
    -------
    Clip
    """
    if name == "demo":
        return demo_clip()
    if name.startswith(_SIMULATED) and name[len(_SIMULATED) :].isdecimal():
        rng = np.random.default_rng(int(name[len(_SIMULATED) :]))
        return simulate_clip(rng, load_library())
    return load_clip(name)


def with_steps(steps: int) -> Config:
    """The default settings with the given number of steps, and at most as many draws."""
    few = SampleSettings(steps=steps, draws=1)
    return Config(sample=replace(few, draws=min(SampleSettings().draws, few.most_draws)))


def is_whole(folder: Path) -> bool:
    """Whether a folder holds a complete run; a killed command may have left an incomplete one."""
    return (folder / "posterior.nc").is_file()


def sampled(
    clip: Clip,
    folder: Path,
    *,
    library: Library | None = None,
    seed: int,
    steps: int,
    workers: int,
) -> Posterior:
    """The run of a clip in a folder, computed if it is missing or incomplete."""
    if not is_whole(folder):
        posterior = im.sample(clip, library, rng=seed, workers=workers, config=with_steps(steps))
        posterior.save(folder, overwrite=True)
    return load_posterior(folder)


def digest(*more: Path) -> str:
    """Digest of the program's source and of ``more`` files, by which stored results are named.

    Twelve hexadecimal digits.
    """
    state = hashlib.sha256()
    root = Path(im.__file__).parent
    for folder in (root, root / "models", root / "samplers"):
        for path in sorted(folder.rglob("*.py")):
            state.update(path.read_bytes())
    for path in (root / "models" / "calibrated.toml", *more):
        state.update(path.read_bytes())
    return state.hexdigest()[:12]
