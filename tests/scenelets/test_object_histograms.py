"""The grid of furniture around a person."""

from __future__ import annotations

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from imapper_prob.models.scene import SceneObject
from imapper_prob.models.scenelet import Scenelet
from imapper_prob.scenelets.charness import CELL, EDGES, categories, object_histograms
from imapper_prob.scenelets.frames import mirrored
from tests.scenelets.motions import box, standing


def histogram(*objects: SceneObject, label: str = "chair") -> NDArray[np.float64]:
    (grid,) = object_histograms([Scenelet("one", "stand", standing(), objects)], [label])
    return grid[0]


def test_an_object_that_fills_a_cell() -> None:
    expected = np.zeros((5, 5))
    expected[2, 2] = 1.0
    assert_allclose(histogram(box("chair")), expected, atol=1e-12)


def test_rows_go_forward_and_columns_to_the_right() -> None:
    assert histogram(box("chair", y=2 * CELL))[4, 2] == pytest.approx(1.0)
    assert histogram(box("chair", x=-2 * CELL))[2, 0] == pytest.approx(1.0)


def test_overlap_is_a_part_of_the_smaller_area() -> None:
    # A small thing wholly within a cell fills it as far as anybody can say.
    assert histogram(box("chair", side=0.2))[2, 2] == pytest.approx(1.0)
    # A large thing covers the middle cell whole and half of each neighbour.
    assert_allclose(histogram(box("chair", side=1.0))[2, 1:4], [0.5, 1.0, 0.5], atol=1e-12)


def test_a_turned_footprint_is_clipped_exactly() -> None:
    # A square of diagonal 1 m standing on its corner: an octagon's worth is in the cell.
    grid = histogram(box("chair", yaw=np.pi / 4, side=np.sqrt(0.5)))
    corner = 2 * (0.5 - CELL / 2) ** 2 / 2  # a triangle beyond each side of the cell
    assert grid[2, 2] == pytest.approx((0.5 - 4 * corner) / CELL**2)


def test_the_fullest_object_counts() -> None:
    both = histogram(box("chair"), box("chair", x=0.3))
    assert_allclose(both, np.maximum(histogram(box("chair")), histogram(box("chair", x=0.3))))


def test_categories_are_kept_apart() -> None:
    scenelets = [
        Scenelet("one", "stand", standing(), (box("chair"), box("table", y=0.5))),
        Scenelet("two", "stand", standing(), ()),
    ]
    assert categories(scenelets) == ("chair", "table")
    grids = object_histograms(scenelets, ["table", "shelf"])
    assert grids.shape == (2, 2, 5, 5)
    assert grids[0, 0, 3, 2] == pytest.approx(1.0)
    assert grids[0, 1].max() == 0.0
    assert grids[1].max() == 0.0


@given(x=st.floats(-1, 1), y=st.floats(-1, 1), yaw=st.floats(-3, 3), side=st.floats(0.05, 0.6))
def test_nothing_is_lost_or_counted_twice(x: float, y: float, yaw: float, side: float) -> None:
    # Shares of the smaller area add up to the footprint where the grid covers all of it.
    piece = box("chair", x=x, y=y, yaw=yaw, side=side)
    if np.abs(piece.footprint).max() > EDGES[-1]:
        return
    smaller = min(side**2, CELL**2)
    assert histogram(piece).sum() * smaller == pytest.approx(side**2)


@given(x=st.floats(-1, 1), y=st.floats(-1, 1), yaw=st.floats(-3, 3))
def test_the_mirror_image_has_the_mirrored_grid(x: float, y: float, yaw: float) -> None:
    scenelet = Scenelet("one", "stand", standing(), (box("chair", x=x, y=y, yaw=yaw, side=0.4),))
    grids = object_histograms([scenelet, mirrored(scenelet, "two")], ["chair"])
    assert_allclose(grids[1, 0], grids[0, 0, :, ::-1], atol=1e-9)
