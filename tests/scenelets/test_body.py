"""Inverse kinematics, walking and timing of the procedural body."""

from __future__ import annotations

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from hypothesis.extra.numpy import arrays

from imapper_prob.models.scene import Placement
from imapper_prob.models.skeleton import LANK, PELV, RANK, facing, minimum_jerk
from imapper_prob.scenelets.procedural.body import ANKLE_HEIGHT, Trunk, pose_body, two_bones
from imapper_prob.scenelets.procedural.gait import (
    GATHER,
    Gait,
    arc,
    settle,
    starting,
    steady,
    stopping,
    walk_along,
)

points = arrays(float, (3,), elements=st.floats(-2, 2))


@given(root=points, target=points, pole=points)
def test_limbs_keep_their_bones_and_reach_as_far_as_they_can(
    root: np.ndarray, target: np.ndarray, pole: np.ndarray
) -> None:
    offset = target - root
    distance = float(np.linalg.norm(offset))
    if distance < 1e-3 or np.linalg.norm(np.cross(offset, pole)) < 1e-3:
        return  # no direction to bend to
    middle, end = two_bones(root, target, pole, upper=0.42, lower=0.40)
    assert np.linalg.norm(middle - root) == pytest.approx(0.42)
    assert np.linalg.norm(end - middle) == pytest.approx(0.40)
    if 0.25 < distance < 0.81:
        np.testing.assert_allclose(end, target, atol=1e-9)
    assert (middle - root) @ pole >= ((end - root) @ pole) * (middle - root) @ (end - root) / (
        (end - root) @ (end - root)
    )


@given(yaw=st.floats(-3, 3), lean=st.floats(-0.5, 1.0), tilt=st.floats(-0.3, 0.3))
def test_a_body_faces_where_its_pelvis_does(yaw: float, lean: float, tilt: float) -> None:
    trunk = Trunk.of([[1.0, 2.0, 0.9]], yaw, lean=lean, tilt=tilt)
    targets = trunk.at_pelvis(np.array([[0.1, 0.0, -0.8], [-0.1, 0.0, -0.8]]))
    joints = pose_body(trunk, ankles=targets, wrists=trunk.shoulders - (0.0, 0.0, 0.5))
    assert np.cos(facing(joints[0]) - yaw) > np.cos(0.2)


def test_minimum_jerk_starts_and_ends_at_rest() -> None:
    s = np.linspace(-0.5, 1.5, 2001)
    w = minimum_jerk(s)
    assert w[0] == 0
    assert w[-1] == 1
    assert np.all(np.diff(w) >= 0)
    # The greatest speed of a minimum-jerk movement is 15/8 of the mean.
    assert np.gradient(w, s).max() == pytest.approx(1.875, rel=1e-4)


@given(speed=st.floats(0.4, 1.3), curvature=st.floats(-1.5, 1.5))
def test_an_arc_is_walked_at_its_speed_and_heading(speed: float, curvature: float) -> None:
    times = np.linspace(0, 2, 401)
    x, y, yaw = arc(steady(speed), curvature)(times).T
    vx, vy = np.gradient(x, times)[1:-1], np.gradient(y, times)[1:-1]
    np.testing.assert_allclose(np.hypot(vx, vy), speed, rtol=1e-3)
    np.testing.assert_allclose(np.cos(np.arctan2(-vx, vy) - yaw[1:-1]), 1.0, atol=1e-4)


@given(speed=st.floats(0.4, 1.4), at=st.floats(-0.5, 0.8))
def test_a_start_is_a_stop_backwards(speed: float, at: float) -> None:
    times = np.linspace(-1, 3, 801)
    walked = starting(speed, at=at)(times)
    rate = np.gradient(walked, times)
    assert np.all(walked[times <= at] == 0)
    assert np.all(np.diff(walked) >= 0)
    np.testing.assert_allclose(rate[times > at + GATHER + 0.01], speed, rtol=1e-6)
    assert np.abs(np.gradient(rate, times)).max() < 1.6 * speed / GATHER
    np.testing.assert_allclose(stopping(speed, by=-at)(-times), -walked)


def test_feet_stand_while_they_carry() -> None:
    times = np.arange(300) / 100
    for speed, step_time in ((0.4, 0.75), (0.5, 0.4), (1.3, 0.5)):
        route = arc(steady(speed), 0.5)
        walk = walk_along(route, times, Gait(step_time=step_time, phase=0.1, lean=0.0))
        low = walk.ankles[..., 2] < ANKLE_HEIGHT + 0.01
        slide = np.linalg.norm(np.diff(walk.ankles[..., :2], axis=0), axis=-1)
        # At 100 frames a second a foot that goes along would move by 4 mm or more a frame.
        assert slide[low[1:] & low[:-1]].max() < 0.001
        assert low.any(1).all()


def test_a_walk_alternates_its_feet() -> None:
    times = np.arange(60) / 30
    walk = walk_along(arc(steady(1.0), 0.0), times, Gait(step_time=0.5, phase=0.1, lean=0.05))
    joints = pose_body(walk.trunk, ankles=walk.ankles, wrists=walk.wrists)
    lifted = joints[:, [RANK, LANK], 2] > ANKLE_HEIGHT + 0.01
    assert not lifted.all(1).any()
    assert lifted.any(0).all()
    assert joints[-1, PELV, 1] - joints[0, PELV, 1] == pytest.approx(times[-1], abs=0.05)


def test_who_has_arrived_stands_still() -> None:
    route = settle(Placement(0.0, -0.5, 1.0), Placement(0.0, 0.0, 0.0), arrival=0.8)
    times = np.linspace(2.5, 3.5, 11)
    walk = walk_along(route, times, Gait(step_time=0.33, phase=0.0, lean=0.0))
    np.testing.assert_allclose(walk.ankles - walk.ankles[:1], 0.0, atol=1e-12)
    np.testing.assert_allclose(walk.ankles[..., 2], ANKLE_HEIGHT)
