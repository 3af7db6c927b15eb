"""The jump of the pose where a scenelet begins: a body twice as large jumps twice as far."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imapper_prob.models.energy.smoothness import pose_jump
from imapper_prob.models.posterior import State, empty_state, terms
from tests.models import worlds


@given(size=st.floats(0.5, 2.0))
def test_a_jump_costs_the_same_whatever_the_size_of_the_body(size: float) -> None:
    joints = np.random.default_rng(0).normal(0.0, 0.3, (2, 3, 16))
    cost = pose_jump(joints, 0, 1, 0.07)
    assert pose_jump(size * joints, 0, 1, size * 0.07) == pytest.approx(cost, rel=1e-9)


def test_a_smaller_body_does_not_move_more_smoothly() -> None:
    """A person and the room they are seen in, both 20 % smaller, jump as much for their size."""
    problem = worlds.problem(40)
    state = empty_state(problem).with_item(0, 8, np.array([0.3, 4.0, 0.5]))
    camera = np.array(state.camera)
    camera[3] += np.log(0.8)
    smaller = State(
        camera, state.items, state.placements * [0.8, 0.8, 1.0], state.sizes, state.latent
    )
    jumps = terms(problem, state)["smoothness"]
    assert jumps != 0.0
    assert terms(problem, smaller)["smoothness"] == pytest.approx(jumps, rel=1e-6)
