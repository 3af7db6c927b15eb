"""The image of a pelvis gives the place of a person, and the moves that rely on it keep it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from imapper_prob.models.camera import Camera
from imapper_prob.models.log_posterior import State, empty_state
from imapper_prob.sampling.image_pelvis import (
    log_image_jacobian,
    middle_heights,
    place_from_image,
    project_pelvis,
)
from tests.models import worlds
from tests.sampling.scenes import SceneMove, moves_of

PROBLEM = worlds.problem(20)
COMPENSATED = SceneMove(moves_of(PROBLEM), "camera-compensated")


def camera_of(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.array([*rng.normal((-0.1, 1.3, 0, 0, 0), (0.1, 0.2, 0.1, 0.1, 0.05))])


def state_of(seed: int) -> State:
    rng = np.random.default_rng(seed)
    state = empty_state(PROBLEM)
    for scenelet, start in ((0, 0), (2, 8), (1, 14)):
        x, y, yaw = rng.normal((0, 4, 0), (0.5, 0.5, 1))
        state = state.with_item(scenelet, start, np.array([x, y, yaw]), rng.normal(0, 0.1))
    return state


@hypothesis_settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_placing_inverts_projecting(seed: int) -> None:
    rng = np.random.default_rng(seed)
    camera, height = camera_of(seed), rng.uniform(0.2, 1.0)
    x, y, size = rng.normal((0, 4, 0), (0.5, 0.5, 0.1))
    found = place_from_image(camera, project_pelvis(camera, x, y, size, height), height)
    np.testing.assert_allclose(found, (x, y, size), rtol=1e-9, atol=1e-9)


def test_the_image_of_a_pelvis_is_what_the_camera_sees() -> None:
    camera, height = camera_of(3), 0.55
    pitch, elevation, focal, body, roll = camera.tolist()
    seen = Camera(
        1920, 1080, np.exp(focal), np.exp(focal), 0.0, 0.0,
        pitch=pitch, roll=roll, elevation=elevation,
    )  # fmt: skip
    right, up, apparent = project_pelvis(camera, 0.4, 3.5, 0.07, height)
    pelvis = np.array([0.4, 3.5, np.exp(body + 0.07) * height])
    np.testing.assert_allclose(seen.project(pelvis), (right, -up))
    depth = seen.to_camera(pelvis)[1]
    assert apparent == pytest.approx(np.exp(focal + body + 0.07) / depth)


@hypothesis_settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_log_image_jacobian_is_that_of_the_projection(seed: int) -> None:
    rng = np.random.default_rng(seed)
    camera, height = camera_of(seed), rng.uniform(0.2, 1.0)
    where = rng.normal((0, 4, 0), (0.5, 0.5, 0.1))

    def seen(at: np.ndarray) -> np.ndarray:
        right, up, apparent = project_pelvis(camera, *at, height)
        return np.array([right, up, np.log(apparent)])

    step = 1e-5
    derivative = np.stack([seen(where + d) - seen(where - d) for d in step * np.eye(3)]) / 2 / step
    expected = np.log(abs(np.linalg.det(derivative)))
    apparent = project_pelvis(camera, *where, height)[2]
    assert log_image_jacobian(camera, apparent, where[2]) == pytest.approx(expected, abs=1e-6)


def test_nobody_stands_above_the_horizon_or_behind_the_camera() -> None:
    camera = np.array([0.0, 1.5, 0.0, 0.0, 0.0])
    assert np.isnan(project_pelvis(camera, 0.0, -2.0, 0.0, 0.5)[2])
    right, _, apparent = project_pelvis(camera, 0.0, 4.0, 0.0, 0.5)
    assert np.isnan(place_from_image(camera, (right, 0.5, apparent), 0.5)[2])


@hypothesis_settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_compensated_scenelets_keep_their_image(seed: int) -> None:
    state = state_of(seed)
    proposal = COMPENSATED.propose(np.random.default_rng(seed), state)
    assume(proposal is not None)
    heights = middle_heights(PROBLEM)[state.items[:, 0]]
    images = [
        [project_pelvis(s.camera, x, y, size, h) for (x, y, _), size, h in rows(s, heights)]
        for s in (state, proposal.state)
    ]
    np.testing.assert_allclose(images[1], images[0], rtol=1e-8, atol=1e-10)
    np.testing.assert_array_equal(proposal.state.placements[:, 2], state.placements[:, 2])
    jacobians = [
        sum(log_image_jacobian(s.camera, k[2], size) for k, size in zip(own, s.sizes, strict=True))
        for s, own in zip((state, proposal.state), images, strict=True)
    ]
    assert proposal.log_ratio == pytest.approx(jacobians[0] - jacobians[1], abs=1e-8)


def rows(state: State, heights: np.ndarray) -> zip:
    return zip(state.placements, state.sizes, heights, strict=True)
