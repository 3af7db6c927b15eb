"""The scripts beside the program: they can be loaded, and what they take apart still fits."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest

from imapper_prob.models.posterior import empty_state, terms
from imapper_prob.models.problem import Problem
from tests.models import worlds

FOLDER = Path(__file__).parents[1] / "benchmarks"
SCRIPTS = sorted(path.stem for path in FOLDER.glob("*.py"))


@pytest.fixture(autouse=True)
def _beside(monkeypatch: pytest.MonkeyPatch) -> None:
    """Scripts find each other as they do when they are run."""
    monkeypatch.syspath_prepend(str(FOLDER))


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_can_be_loaded(name: str) -> None:
    assert importlib.import_module(f"benchmarks.{name}").__doc__


def test_frames_cut_from_a_problem_are_a_problem() -> None:
    """Every field by frame is cut: of nothing but the frames in the middle, each has its cost."""
    preference = importlib.import_module("benchmarks.preference")
    problem = worlds.problem(120)
    cut, begin = preference.around(problem, 50, 60)
    lengths = {name: len(getattr(cut, name)) for name in _by_frame(problem)}
    assert set(lengths.values()) == {cut.n_frames}
    assert cut.n_frames < problem.n_frames
    assert cut.path_starts.tolist() == [True] + [False] * (cut.n_frames - 1)
    np.testing.assert_array_equal(cut.keypoints[0], problem.keypoints[begin])
    assert all(np.isfinite(value) for value in terms(cut, empty_state(cut)).values())


def _by_frame(problem: Problem) -> list[str]:
    """Fields that begin with the frames, of whose number nothing else is."""
    arrays = {n: v for n, v in problem._asdict().items() if isinstance(v, np.ndarray)}
    return [name for name, value in arrays.items() if value.shape[:1] == (problem.n_frames,)]
