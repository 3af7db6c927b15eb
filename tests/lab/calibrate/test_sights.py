"""What furniture hides, against what scenelets say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from imapper_prob.models.scene import Cuboid, Placement, SceneObject, Truth
from imapper_prob.models.scenelet import Scenelet
from imapper_prob.models.skeleton import DETECTED
from lab.calibrate.observations import sights_past
from tests.models import worlds

JOINTS = worlds.walk(4, span=0.2)
"""Somebody four metres ahead."""
FRAMES = np.arange(4)
AT_HOME = Placement(0.0, 0.0, 0.0)


def wall(top: float, y: float = 3.0, x: float = 0.0) -> SceneObject:
    """A board across the view, as high as ``top`` metres."""
    board = Cuboid("board", np.array([0.0, 0.0, top / 2]), np.array([3.0, 0.1, top]))
    return SceneObject("shelf", Placement(x, y, 0.0), (board,))


def seen_over(*furniture: SceneObject, gone: np.ndarray | None = None) -> Truth:
    hidden = np.zeros(JOINTS.shape[:2], bool) if gone is None else gone
    return Truth(worlds.CAMERA, furniture, JOINTS, hidden)


def saying(*furniture: SceneObject) -> Scenelet:
    return Scenelet("stand-1", "stand", JOINTS, furniture)


def test_a_true_wall_hides_what_is_below_it_and_a_lower_one_says_less() -> None:
    low, high = 0.6, 1.0
    heights = JOINTS[:, list(DETECTED), 2]
    # The line of sight from 1.5 m, three quarters of the way to the joint.
    over = 1.5 + 0.75 * (heights - 1.5)
    clearance, hidden = sights_past(seen_over(wall(high)), saying(wall(low)), AT_HOME, FRAMES)
    behind, clear = over < high - 0.05, over > high + 0.05
    assert hidden[behind.ravel()].all()
    assert not hidden[clear.ravel()].any()
    missed = (over > low + 0.1) & behind
    assert missed.any()
    assert (clearance[missed.ravel()] > 0).all()


def test_what_something_else_hides_is_left_out() -> None:
    gone = np.zeros(JOINTS.shape[:2], bool)
    gone[:, 8:10] = True  # The head, far above the board.
    clearance, hidden = sights_past(
        seen_over(wall(0.5), gone=gone), saying(wall(0.5)), AT_HOME, FRAMES
    )
    whole, _ = sights_past(seen_over(wall(0.5)), saying(wall(0.5)), AT_HOME, FRAMES)
    left_out = gone[:, list(DETECTED)].sum()
    assert len(whole) - len(clearance) == left_out > 0
    # The same board hides what the same board is in the way of.
    np.testing.assert_array_equal(hidden, clearance < 0)


@pytest.mark.parametrize("x", [1.5, -2.0])
def test_what_stands_for_nothing_says_nothing(x: float) -> None:
    truth = seen_over(wall(1.0))
    assert sights_past(truth, saying(wall(1.0, x=x)), AT_HOME, FRAMES).shape == (2, 0)
    assert sights_past(truth, saying(), AT_HOME, FRAMES).shape == (2, 0)
    bare = replace(truth, objects=())
    assert sights_past(bare, saying(), AT_HOME, FRAMES).shape == (2, 0)


def test_it_is_laid_where_it_is_said() -> None:
    truth = seen_over(wall(1.0))
    moved = saying(wall(1.0, y=1.0))
    direct, _ = sights_past(truth, saying(wall(1.0)), AT_HOME, FRAMES)
    laid, _ = sights_past(truth, moved, Placement(0.0, 2.0, 0.0), FRAMES)
    np.testing.assert_allclose(laid, direct, atol=1e-12)
