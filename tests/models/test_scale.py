"""One eye sees no size: a smaller room, with smaller people and furniture, looks the same nearer.

So nothing but the priors of body and camera may say how large it is. Whatever else does – steps in
metres beside people in bodies, furniture in metres – pulls people towards or away from the camera.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imapper_prob.models.kernels.path import pose_jump
from imapper_prob.models.log_posterior import State, empty_state, terms
from imapper_prob.models.problem import Problem
from imapper_prob.models.settings import NOTHING_IN_SIGHT
from tests.models import worlds

_LOOK_ALIKE = ("assignment", "path", "free_pose", "smoothness", "collision", "motion", "ground")
FACTORS = st.floats(0.7, 1.4)


def _furnished(problem: Problem) -> State:
    """Two couches in each other, and somebody who walks through one of them."""
    state = empty_state(problem).with_item(0, 6, np.array([0.3, 4.3, 0.5]), 0.05)
    return state.with_item(1, 20, np.array([0.5, 4.0, 2.5]), -0.05)


def _scaled(state: State, factor: float) -> State:
    camera = np.array(state.camera)
    camera[1] *= factor
    camera[3] += np.log(factor)
    placements = state.placements * [factor, factor, 1.0]
    return State(camera, state.items, placements, state.sizes, state.latent)


@given(factor=FACTORS)
def test_a_room_as_a_whole_may_have_any_size(factor: float) -> None:
    """With its few lengths in metres scaled as well, nothing but the priors changes."""
    problem = worlds.problem(40)
    like = problem._replace(
        furniture_spread=factor * problem.furniture_spread,
        collision_cost=problem.collision_cost / factor,
        motion_cost=problem.motion_cost / factor,
    )
    state = _furnished(problem)
    before, after = terms(problem, state), terms(like, _scaled(state, factor))
    assert min(abs(before[name]) for name in ("smoothness", "collision", "motion")) > 0.01
    for name in _LOOK_ALIKE:
        assert after[name] == pytest.approx(before[name], rel=1e-6, abs=1e-9), name
    assert after["placement"] == pytest.approx(before["placement"] - 4 * np.log(factor), rel=1e-6)


@given(factor=FACTORS)
def test_furniture_hides_as_much_in_a_room_of_any_size(factor: float) -> None:
    # The cap on clearances is in metres; beside so narrow a step it is never felt.
    problem = worlds.problem(40)._replace(sight_width=NOTHING_IN_SIGHT / 100)
    like = problem._replace(sight_width=factor * problem.sight_width)
    state = _furnished(problem)
    before, after = terms(problem, state)["detections"], terms(like, _scaled(state, factor))
    assert before < terms(problem, empty_state(problem))["detections"] - 0.1
    assert after["detections"] == pytest.approx(before, rel=1e-4)


@given(factor=FACTORS)
def test_a_jump_costs_the_same_whatever_the_size_of_the_body(factor: float) -> None:
    joints = np.random.default_rng(0).normal(0.0, 0.3, (2, 3, 16))
    cost = pose_jump(joints, 0, 1, 0.07)
    assert pose_jump(factor * joints, 0, 1, factor * 0.07) == pytest.approx(cost, rel=1e-9)
