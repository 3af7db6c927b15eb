"""Simulation-based calibration of scenes: the whole of it, and what it would see."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from imapper_prob.config import SampleSettings
from imapper_prob.models.log_posterior import empty_state
from imapper_prob.sampling.chain import Setup
from imapper_prob.scenelets.library import built_in_library
from imapper_prob.solver.solver import Solution
from lab import sbc
from lab.prior import Experiment, draw_state
from lab.sbc import SETTINGS, describe, rank_scene, short_clip

ROOT = Path(__file__).parents[2]
BRIEF = replace(SETTINGS, steps=6000, temperatures=1)
"""Too short for ranks to be spread evenly, but not for their mean, which an error shifts."""


@cache
def experiment() -> Experiment:
    return short_clip(built_in_library(), every=4)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_ranks() -> None:
    short = replace(SETTINGS, steps=300)
    one, other = (rank_scene(experiment(), 3, short) for _ in range(2))
    assert one.ranks == other.ranks
    assert one.ranks != rank_scene(experiment(), 4, short).ranks
    assert all(0 <= rank <= SETTINGS.draws for rank in one.ranks.values())
    assert one.ranks.keys() == one.effective.keys()


def test_a_prior_scene_leaves_something_to_ask() -> None:
    """Scenes of the design have none, one and two scenelets, with all kinds of furniture."""
    problem, library = experiment().problem, experiment().library
    rng = np.random.default_rng(0)
    scenes = [describe(problem, library, draw_state(rng, problem)) for _ in range(300)]
    for count in (0, 1, 2):
        assert sum(s["scenelets"] == count for s in scenes) > 10
    assert {s["first scenelet"] for s in scenes} == {-np.inf, *range(len(library))}
    assert 10 < sum(s["a couch"] for s in scenes) < 290
    nothing = describe(problem, library, empty_state(problem))
    assert nothing["first object along"] == nothing["first size"] == -np.inf


def ranks_of_pitch(*, off: float) -> list[int]:
    """With ``off`` deviations added to the mean of the prior of pitch when chains are run."""
    right = sbc.setup_of

    def setup_of(solution: Solution, settings: SampleSettings) -> Setup:
        found = right(solution, settings)
        problem = found.problem
        mean = problem.camera_mean.copy()
        mean[0] += off / np.sqrt(problem.camera_precision[0, 0])
        return replace(found, problem=problem._replace(camera_mean=mean))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sbc, "setup_of", setup_of)
        return [rank_scene(experiment(), seed, BRIEF).ranks["pitch"] for seed in range(12)]


@pytest.mark.slow
def test_a_wrong_prior_shifts_ranks() -> None:
    """Smaller errors are seen by ``tests/sampling/test_joint.py``, for less."""
    standard_error = np.sqrt(1 / 12 / 12)
    for off, is_seen in ((0.0, False), (2.0, True)):
        mean = np.mean(ranks_of_pitch(off=off)) / SETTINGS.draws
        assert (abs(mean - 0.5) > 4.2 * standard_error) == is_seen, (off, mean)


@pytest.mark.slow
def test_ranks_of_true_scenes_are_uniform() -> None:
    """Thirty data sets; interrupted, it goes on when run again.

    p-values are of so many: they see an error that shifts a quantity by two thirds of its posterior
    spread. The two hundred of ``docs/research/calibration_ranks.md`` see a fourth.
    """
    folder = ROOT / "out" / "sbc"
    command = [sys.executable, "-m", "lab.sbc", str(folder), "--count"]
    subprocess.run([*command, "2"], cwd=ROOT, check=False)
    first = {path: path.stat().st_mtime_ns for path in folder.rglob("*.json")}
    done = subprocess.run([*command, "30"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    files = {path: path.stat().st_mtime_ns for path in folder.rglob("*.json")}
    assert len(first) >= 2
    assert first.items() <= files.items()
    assert len(files) >= 30
