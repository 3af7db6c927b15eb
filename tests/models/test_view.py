"""The map between the floor and the view: inverse, Jacobian, and one map in both its forms."""

from __future__ import annotations

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from imapper_prob.models.camera import Camera, floor_edges
from imapper_prob.models.view import floor_point, log_area, seen_point, to_floor, to_view

ASIDE, AHEAD = st.floats(-20, 20), st.floats(0.05, 50)


@given(x=ASIDE, y=AHEAD)
def test_there_and_back(x: float, y: float) -> None:
    bearing, log_depth = seen_point(x, y)
    assert floor_point(bearing, log_depth) == pytest.approx((x, y))
    where = to_view([[x, y, 0.4], [2 * x, y, -1.0]], [0.1, 0.2])
    assert where[0] == pytest.approx([bearing, log_depth, 0.4, 0.1])
    placements, sizes = to_floor(where)
    np.testing.assert_allclose(placements, [[x, y, 0.4], [2 * x, y, -1.0]])
    np.testing.assert_array_equal(sizes, [0.1, 0.2])


@given(x=ASIDE, y=AHEAD)
def test_the_area_is_that_of_small_steps(x: float, y: float) -> None:
    bearing, log_depth = seen_point(x, y)
    step = 1e-6
    sides = [
        np.subtract(
            floor_point(bearing + a * step, log_depth + b * step),
            floor_point(bearing - a * step, log_depth - b * step),
        )
        for a, b in ((1, 0), (0, 1))
    ]
    area = abs(np.linalg.det(sides)) / (2 * step) ** 2
    assert np.exp(log_area(log_depth)) == pytest.approx(area, rel=1e-6)


def test_behind_the_camera_nothing_is_seen() -> None:
    with np.errstate(invalid="ignore"):
        assert np.isnan(to_view([1.0, -2.0, 0.0], 0.0)[1])


@given(pitch=st.floats(-1.2, 0.3), roll=st.floats(-0.4, 0.4))
def test_edges_of_the_floor_in_sight_are_edges_of_the_image(pitch: float, roll: float) -> None:
    camera = Camera(1280, 720, 900.0, 950.0, 600.0, 380.0, pitch, roll, 1.4)
    reach, size = 8.0, (1280, 720)
    edges = floor_edges(camera, reach=reach)
    for ends in edges:
        points = ends[0] + np.linspace(0, 1, 7)[:, None] * (ends[1] - ends[0])
        pixels = camera.project(np.column_stack([points, np.zeros(7)]))
        across = [np.abs(pixels[:, k] - edge).max() for k in (0, 1) for edge in (0, size[k])]
        assert min(across) < 0.01
        assert (pixels > -0.01).all()
        assert (pixels < np.array(size) + 0.01).all()
    # Every other pixel of the border is above the horizon, or farther away.
    part = np.linspace(0, 1, 200)[:, None]
    corners = np.array([(0, 0), (1280, 0), (1280, 720), (0, 720)], float)
    border = [a + part * (b - a) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)]
    rays = camera.rays(np.concatenate(border)) @ camera.rotation.T
    down = rays[:, 2] < 0
    hits = rays[down, :2] * (1.4 / -rays[down, 2:])
    for hit in hits[np.linalg.norm(hits, axis=1) < reach]:
        assert min(_gap(hit, *ends) for ends in edges) < 1e-6


def _gap(point: np.ndarray, first: np.ndarray, last: np.ndarray) -> float:
    """Distance of a point from a line between two ends, metres."""
    way = last - first
    part = np.clip((point - first) @ way / (way @ way), 0, 1)
    return float(np.linalg.norm(point - first - part * way))


def test_a_level_camera_sees_the_floor_up_to_its_sides() -> None:
    camera = Camera(1000, 800, 500.0, 500.0, 500.0, 400.0, elevation=1.0)
    right, near, left = floor_edges(camera, reach=10.0)
    np.testing.assert_allclose(right, [(10.0, 10.0), (1.25, 1.25)])
    np.testing.assert_allclose(near, [(1.25, 1.25), (-1.25, 1.25)])
    np.testing.assert_allclose(left, [(-1.25, 1.25), (-10.0, 10.0)])
