"""Simulation-based calibration of scenes: the whole of it, and what it would see."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from imapper_prob.models.detector import DetectionModel
from imapper_prob.models.log_posterior import empty_state
from imapper_prob.scenelets.library import built_in_library
from lab.prior import Experiment, draw_state
from lab.sbc import SETTINGS, describe, rank_scene, short_clip

ROOT = Path(__file__).parents[2]
BRIEF = replace(SETTINGS, steps=6000, temperatures=1)
"""Too short for ranks to be spread evenly, but not for their mean, which an error shifts. (That
of depths a forgotten Jacobian of one move shifts by too little: see tests/sampling/test_joint.)"""


@cache
def experiment() -> Experiment:
    return short_clip(built_in_library(), every=4)


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


def ranks_exchanged(seed: int) -> dict[str, int]:
    """With what is hidden and what is seen exchanged when detections are drawn."""
    right = DetectionModel.draw

    def draw(self, rng, pixels, hidden, **options):  # type: ignore[no-untyped-def]
        return right(self, rng, pixels, ~hidden, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(DetectionModel, "draw", draw)
        return rank_scene(experiment(), seed, BRIEF).ranks


def shift(name: str, found: Sequence[dict[str, int]]) -> float:
    """By how many standard errors the mean rank of something is off the middle."""
    share = np.array([own[name] for own in found]) / SETTINGS.draws
    return float((share.mean() - 0.5) / (share.std() / np.sqrt(len(share))))


@pytest.mark.slow
def test_an_error_shifts_ranks() -> None:
    """Others are seen by ``tests/sampling/test_joint.py``, for less."""
    seeds = range(100)
    wrong = shift("log-likelihood", [ranks_exchanged(seed) for seed in seeds])
    assert abs(wrong) > 4.2
    right = [rank_scene(experiment(), seed, BRIEF).ranks for seed in seeds]
    assert abs(shift("log-likelihood", right)) < 3.5


@pytest.mark.slow
def test_ranks_of_true_scenes_are_uniform() -> None:
    """Fifty data sets; interrupted, it goes on when run again.

    p-values are of so many: they see an error that shifts a quantity by half of its posterior
    spread. The two hundred of ``docs/research/calibration_ranks.md`` see a fourth.
    """
    folder = ROOT / "out" / "sbc"
    command = [sys.executable, "-m", "lab.sbc", str(folder), "--count"]
    subprocess.run([*command, "2"], cwd=ROOT, check=False)
    first = {path: path.stat().st_mtime_ns for path in folder.rglob("*.json")}
    done = subprocess.run([*command, "50"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    files = {path: path.stat().st_mtime_ns for path in folder.rglob("*.json")}
    assert len(first) >= 2
    assert first.items() <= files.items()
    assert len(files) >= 100
