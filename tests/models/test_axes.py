"""Points in the axes of the camera and of boxes: the kernels against the classes in numpy."""

from __future__ import annotations

import math

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from imapper_prob.models.geometry import pack_boxes
from imapper_prob.models.jit import compiled
from imapper_prob.models.kernels.axes import (
    camera_pose,
    corner_of,
    point_to_camera,
    rotated,
    rotated_back,
    vector_to_camera,
)
from imapper_prob.models.scene import Cuboid, Placement, SceneObject
from imapper_prob.models.settings import NEAREST
from tests.models.worlds import CAMERA

LENGTHS = st.floats(-10, 10)
POINTS = st.tuples(LENGTHS, LENGTHS, LENGTHS)
ANGLES = st.floats(-1, 1)


@compiled
def converted(camera: np.ndarray, x: float, y: float, z: float) -> np.ndarray:
    """A point, then a vector, in camera axes."""
    pose = camera_pose(camera)
    return np.array([point_to_camera(pose, x, y, z), vector_to_camera(pose, x, y, z)])


@compiled
def there_and_back(c: float, s: float, x: float, y: float) -> np.ndarray:
    away = rotated(c, s, x, y)
    return np.array([away, rotated_back(c, s, away[0], away[1])])


@compiled
def corners(box: np.ndarray, turn: np.ndarray, margin: float) -> np.ndarray:
    found = np.empty((4, 2))
    for corner in range(4):
        found[corner] = corner_of(box, turn, corner, margin)
    return found


@given(POINTS, ANGLES, ANGLES, st.floats(0.5, 3))
def test_points_are_seen_as_by_a_camera(
    at: tuple[float, float, float], pitch: float, roll: float, elevation: float
) -> None:
    camera = CAMERA.posed(pitch=pitch, roll=roll, elevation=elevation)
    point, vector = converted(np.array([pitch, elevation, 0.3, 0.2, roll]), *at)
    right, depth, up = camera.to_camera(at)
    assert point == pytest.approx([right, max(depth, NEAREST), up], abs=1e-12)
    assert vector == pytest.approx(at @ camera.rotation, abs=1e-12)


@given(LENGTHS, LENGTHS, st.floats(-4, 4))
def test_a_placement_rotates_alike(x: float, y: float, yaw: float) -> None:
    away, back = there_and_back(math.cos(yaw), math.sin(yaw), x, y)
    assert away == pytest.approx(Placement(0.0, 0.0, yaw).apply([x, y, 0.0])[:2], abs=1e-12)
    assert back == pytest.approx([x, y], abs=1e-12)


@given(LENGTHS, LENGTHS, st.floats(-4, 4), st.floats(0, 1))
def test_corners_are_those_of_a_footprint(x: float, y: float, yaw: float, margin: float) -> None:
    def seat(side: float) -> SceneObject:
        size = np.array([1.6, 0.8, 0.4]) + side
        return SceneObject("seat", Placement(x, y, yaw), (Cuboid("seat", np.zeros(3), size),))

    turn = np.array([math.cos(yaw), math.sin(yaw)])
    found = corners(pack_boxes([seat(0.0)])[0], turn, margin)
    # The footprint is in the order of its edge.
    assert found[[0, 1, 3, 2]] == pytest.approx(seat(2 * margin).footprint, abs=1e-12)
