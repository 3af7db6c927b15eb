"""Of truth and its rivals: a part of a clip, cut out."""

from __future__ import annotations

import numpy as np

from imapper_prob.models.log_posterior import empty_state, terms
from imapper_prob.models.problem import Problem
from lab.preference import around
from tests.models import worlds


def test_frames_cut_from_a_problem_are_a_problem() -> None:
    """Every field by frame is cut: of nothing but the frames in the middle, each has its cost."""
    problem = worlds.problem(120)
    cut, begin = around(problem, 50, 60)
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
