"""Lines of sight and footprints, against brute force and shapely."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm
from shapely import Point, Polygon

from imapper_prob.models.geometry import pack_boxes, sight_clearance
from imapper_prob.models.kernels.intersection import (
    N_DISPLACED,
    add_displaced_depth,
    column_depth,
    footprint_depth,
    marginal_penetration_cost,
)
from imapper_prob.models.kernels.visibility import (
    GAP,
    LINE,
    OCCLUDER,
    SCRATCH32,
    VIEW,
    open_bounds,
    ray_bounds,
    ray_endpoints,
    set_occluder,
    update_clearance,
    visibility_probability,
)
from imapper_prob.models.settings import NOTHING_IN_SIGHT, OPAQUE
from tests.models.reference import Box, clearance
from tests.models.worlds import couch

SINGLE = 1e-5
"""Metres that single precision may differ: coordinates up to 6 m, thin boxes count fivefold."""


def random_boxes(rng: np.random.Generator, n: int) -> np.ndarray:
    low, high = [-2, 1, 0.1, 0.02, 0.02, 0.02, -4], [2, 5, 1.5, 0.8, 0.8, 0.8, 4]
    return rng.uniform(low, high, (n, 7))


def turns_of(boxes: np.ndarray) -> np.ndarray:
    radius = np.linalg.norm(boxes[:, 3:6], axis=1)
    return np.stack([np.cos(boxes[:, 6]), np.sin(boxes[:, 6]), radius], -1)


def compiled_clearance(elevation: float, joints: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """Clearance of the lines of sight to sixteen joints, by the kernel of the chains."""
    occluders, turns = np.empty((len(boxes), OCCLUDER), np.float32), turns_of(boxes)
    for box, turn, occluder in zip(boxes, turns, occluders, strict=True):
        set_occluder(elevation, box, turn, occluder)
    scratch32, lines = np.empty(SCRATCH32, np.float32), np.empty((1, LINE), np.float32)
    views = np.empty((1, VIEW), np.float32)
    ray_endpoints(elevation, np.ascontiguousarray(joints.T)[None], lines, 0)
    ray_bounds(lines, 0, scratch32, views)
    open_bounds(scratch32)
    update_clearance(occluders, 0, len(boxes), lines, views, 0, scratch32)
    return scratch32[GAP : GAP + 16]


def along_the_ray(origin: np.ndarray, point: np.ndarray, box: np.ndarray) -> float:
    s = np.linspace(0, 1, 4001)[:, None]
    q = origin + s * (point - origin) - box[:3]
    c, si = np.cos(box[6]), np.sin(box[6])
    local = np.stack([c * q[:, 0] + si * q[:, 1], -si * q[:, 0] + c * q[:, 1], q[:, 2]], -1)
    lowest = float((np.abs(local) - box[3:6]).max(-1).min())
    return lowest * max(1.0, OPAQUE / box[3:6].min()) if lowest < 0 else lowest


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_clearance_is_the_least_box_function_on_the_segment(seed: int) -> None:
    rng = np.random.default_rng(seed)
    boxes = random_boxes(rng, 4)
    origin = np.array([0.0, 0.0, rng.uniform(0.5, 2.0)])
    points = rng.uniform([-2, 0.5, 0], [2, 6, 2], (16, 3))
    plain = [Box(b[:3], b[3:6], b[6], 0, 0, 0.0) for b in boxes]
    reference = clearance(origin, points, plain)
    brute = [min([NOTHING_IN_SIGHT, *(along_the_ray(origin, p, b) for b in boxes)]) for p in points]
    np.testing.assert_allclose(reference, brute, atol=8e-3)
    compiled = compiled_clearance(origin[2], points, boxes)
    np.testing.assert_allclose(compiled, reference, atol=SINGLE)
    aside = np.array([0.3, -0.2, 0.0])
    boxes[:, :3] += aside
    points[3] = np.nan
    found = sight_clearance(origin + aside, points + aside, boxes)
    np.testing.assert_allclose(np.delete(found, 3), np.delete(reference, 3), atol=SINGLE)
    assert np.isnan(found[3])


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_boxes_out_of_sight_make_no_difference(seed: int) -> None:
    rng = np.random.default_rng(seed)
    boxes = random_boxes(rng, 12)
    joints = rng.uniform([-2, 0.5, 0.5], [2, 6, 1.5]) + rng.normal(0, 0.3, (16, 3))
    everything = sight_clearance([0, 0, 1.4], joints, boxes)
    np.testing.assert_allclose(compiled_clearance(1.4, joints, boxes), everything, atol=SINGLE)


def test_clearance_has_the_sign_of_hidden() -> None:
    boxes = pack_boxes([couch(0.0, 3.0)])
    origin = np.array([0.0, 0.0, 1.5])
    behind, above, before = (0.0, 4.0, 0.2), (0.0, 4.0, 1.4), (0.0, 2.0, 0.2)
    signs = np.sign(sight_clearance(origin, [behind, above, before], boxes))
    np.testing.assert_array_equal(signs, [-1, 1, 1])


def test_a_thin_board_hides_what_is_behind_it() -> None:
    board = np.array([[0.0, 2.0, 1.0, 0.6, 0.01, 0.4, 0.0]])
    through = sight_clearance([0, 0, 1.5], [[0.0, 4.0, 0.5]], board)[0]
    assert through == pytest.approx(-OPAQUE)
    assert visibility_probability(through, 0.04, 0.02) < 0.1


def test_without_furniture_clearance_is_capped() -> None:
    none = np.empty((0, 7))
    assert sight_clearance([0, 0, 1.5], [[0.0, 3.0, 1.0]], none)[0] == NOTHING_IN_SIGHT
    free = compiled_clearance(1.5, np.tile([0.0, 3.0, 1.0], (16, 1)), none)
    np.testing.assert_array_equal(free, np.float32(NOTHING_IN_SIGHT))


def test_p_seen_is_a_step_that_never_reaches_0_or_1() -> None:
    values = [visibility_probability(v, 0.04, 0.02) for v in (-10.0, -0.04, 0.0, 0.04, 10.0)]
    assert values == sorted(values)
    assert values[0] == pytest.approx(0.02)
    assert values[2] == pytest.approx(0.5)
    assert values[-1] == pytest.approx(0.98)


def outline(box: np.ndarray) -> Polygon:
    c, s = np.cos(box[6]), np.sin(box[6])
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * box[3:5]
    return Polygon(corners @ np.array([[c, s], [-s, c]]) + box[:2])


@settings(max_examples=80, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_footprints_meet_exactly_where_shapely_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = random_boxes(rng, 2)
    b[:2] = a[:2] + rng.uniform(-1.5, 1.5, 2)
    b[2], b[5] = a[2], a[5]
    depth = footprint_depth(a, b)
    shared = outline(a).intersection(outline(b)).area
    assert (depth > 1e-9) == (shared > 1e-9)
    if depth > 0:
        # Moving one out by the depth in the right direction must be possible, and no less.
        angles = np.concatenate([a[6] + np.arange(4) * np.pi / 2, b[6] + np.arange(4) * np.pi / 2])
        far, near = [], []
        for angle in angles:
            for factor, result in ((1.001, far), (0.98, near)):
                moved = b.copy()
                moved[:2] += factor * depth * np.array([np.cos(angle), np.sin(angle)])
                result.append(outline(a).intersection(outline(moved)).area > 1e-9)
        assert not all(far)
        assert all(near)


def test_footprints_at_different_heights_do_not_meet() -> None:
    table_top = np.array([0, 3, 0.72, 0.6, 0.3, 0.02, 0.0])
    seat = np.array([0, 3, 0.22, 0.3, 0.3, 0.22, 0.0])
    assert footprint_depth(table_top, seat) == 0.0


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_column_depth_is_the_distance_to_the_outline(seed: int) -> None:
    rng = np.random.default_rng(seed)
    box = random_boxes(rng, 1)[0]
    x, y = box[:2] + rng.uniform(-0.8, 0.8, 2)
    shape, point = outline(box), Point(x, y)
    expected = shape.exterior.distance(point) if shape.contains(point) else 0.0
    depth = column_depth(x, y, -9.0, 9.0, box, turns_of(box[None])[0])
    assert depth == pytest.approx(expected, abs=1e-9)
    assert column_depth(x, y, 10.0, 11.0, box, turns_of(box[None])[0]) == 0.0


@given(width=st.floats(0.4, 2.4), sunk=st.floats(-0.1, 0.15))
def test_who_sits_too_low_is_as_deep_in_any_seat(width: float, sunk: float) -> None:
    seat = np.array([0.0, 3.0, 0.22, width / 2, 0.4, 0.22, 0.0])
    thigh = 0.44 - sunk
    depth = column_depth(0.0, 3.0, thigh, thigh + 0.1, seat, turns_of(seat[None])[0])
    assert depth == pytest.approx(max(sunk, 0.0), abs=1e-12)


def cost_of_crossing(depths: list[float], *, spread: float, unit: float) -> float:
    sums = np.zeros(N_DISPLACED)
    for depth in depths:
        add_displaced_depth(depth, spread, sums)
    return marginal_penetration_cost(sums, unit)


@settings(max_examples=60, deadline=None)
@given(
    depths=st.lists(st.floats(0.0, 0.25), max_size=12),
    spread=st.floats(0.05, 0.4),
    unit=st.floats(0.0, 6.0),
)
def test_the_cost_of_crossing_is_the_mean_over_where_furniture_may_stand(
    depths: list[float], spread: float, unit: float
) -> None:
    cost = cost_of_crossing(depths, spread=spread, unit=unit)
    edges = np.linspace(0, 1, 20001)
    away = np.maximum(0.0, norm.ppf(0.5 * (edges[1:] + edges[:-1])) * spread)
    deep = np.maximum(0.0, np.subtract.outer(depths, away)).sum(0) if depths else 0 * away
    mean = np.exp(-unit * deep).mean()
    # Four nodes in the upper half: probabilities in steps of an eighth, half a step off at most.
    assert np.exp(-cost) == pytest.approx(mean, abs=1 / 16)
    assert 0.0 <= cost <= unit * sum(depths) + 1e-12


def test_furniture_that_stands_where_it_is_said_to_costs_every_metre() -> None:
    depths = [0.1, 0.4, 0.2]
    assert cost_of_crossing(depths, spread=0.0, unit=4.0) == pytest.approx(4.0 * 0.7)
    # That all of it stands out of the way: half of the upper half's last quarter.
    assert cost_of_crossing([0.3] * 100, spread=0.2, unit=50.0) == pytest.approx(np.log(8))


def test_walking_through_the_middle_costs_more_than_furniture_can_be_off() -> None:
    """Beyond the farthest node every metre and frame counts in full again."""
    deeper = [cost_of_crossing([d] * 10, spread=0.2, unit=4.0) for d in (0.5, 0.6)]
    assert deeper[1] - deeper[0] == pytest.approx(4.0, rel=1e-6)
