"""What scenelets are worth alone: as the log-posterior says, and so are the derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from imapper_prob.models.log_posterior import State, empty_state, terms
from imapper_prob.models.problem import Problem
from imapper_prob.models.single_scenelet import REACH, STEPS, expand, judge
from tests.models import worlds

PROBLEM = worlds.problem(30, scenelets=worlds.mixed_library())._replace(
    stays=np.array([[5.0, 20.0, 3.0]])
)
ITEMS = np.array([[0, 4], [3, 12], [5, 0], [1, 24]])
WHERE = np.array([[-0.1, 1.4, 0.1, 0.02], [0.0, 1.35, -0.2, 0.0]] * 2)


def placed(item: np.ndarray, where: np.ndarray) -> State:
    bearing, log_depth, yaw, size = where
    depth = np.exp(log_depth)
    return empty_state(PROBLEM).with_item(*item, np.array([bearing * depth, depth, yaw]), size)


def value(problem: Problem, item: np.ndarray, where: np.ndarray) -> np.ndarray:
    """What tempering keeps and what it flattens, over the empty scene, but for the stay."""
    bare = problem._replace(stays=problem.stays[:0])
    result = []
    for state in (placed(item, where), empty_state(problem)):
        nats = terms(bare, state)
        kept = nats["camera"] + nats["placement"] + nats["path"]
        result.append(np.array([kept, sum(nats.values()) - kept]))
    return result[0] - result[1] + np.array([2 * where[1], 0.0])


def test_values_are_those_of_the_log_posterior() -> None:
    values, beside = judge(PROBLEM, ITEMS, WHERE)
    for item, where, found in zip(ITEMS, WHERE, values, strict=True):
        np.testing.assert_allclose(found, value(PROBLEM, item, where), atol=1e-4)
    assert beside.shape == (4, 2, REACH)
    # The third begins with the clip, the last one ends with it.
    assert not beside[2, 0].any()
    assert not beside[3, 1].any()


def test_derivatives_are_those_of_the_values() -> None:
    found = expand(PROBLEM, ITEMS, WHERE, rounds=0)
    np.testing.assert_array_equal(found.where, WHERE)
    for i, (item, where) in enumerate(zip(ITEMS, WHERE, strict=True)):
        for k, step in enumerate(STEPS):
            more, less = (value(PROBLEM, item, where + sign * step) for sign in (1, -1))
            np.testing.assert_allclose(found.gradients[i, :, k], (more - less) / 2, atol=1e-3)
            bend = more + less - 2 * value(PROBLEM, item, where)
            np.testing.assert_allclose(found.hessians[i, :, k, k], bend, atol=1e-3)
        np.testing.assert_allclose(found.hessians[i], found.hessians[i].transpose(0, 2, 1))


def test_scenelets_are_moved_to_where_they_are_worth_more() -> None:
    before, _ = judge(PROBLEM, ITEMS, WHERE)
    found = expand(PROBLEM, ITEMS, WHERE, rounds=2)
    gained = found.values.sum(1) - before.sum(1)
    assert (gained >= 0).all()
    assert gained.max() > 1


def test_what_is_outside_the_support_is_worth_nothing() -> None:
    values, _ = judge(PROBLEM, np.array([[0, 28]]), WHERE[:1])
    assert values[0, 0] == -np.inf
    found = expand(PROBLEM, np.array([[0, 28]]), WHERE[:1])
    assert found.values[0, 0] == pytest.approx(-np.inf)
