"""Where furniture stands, against what scenelets say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from imapper_prob.models.scene import Placement, Truth
from imapper_prob.models.scenelet import Scenelet
from lab.calibrate.observations import furniture_errors, observe_seats
from tests.uncertainty.rooms import couch_and_table

SCENE = couch_and_table()
COUCH, TABLE = SCENE.objects
TRUTH = Truth(SCENE.camera, SCENE.objects, SCENE.joints, np.zeros(SCENE.joints.shape[:2], bool))
LAID = Placement(0.3, 4.0, 0.7)


def _saying(x: float, y: float, label: str = "couch", turn: float = 0.0) -> Scenelet:
    """A scenelet that, laid at ``LAID``, has the couch (x, y) off in its own axes, and turned."""
    shift = COUCH.placement.rotation @ (x, y)
    place = replace(COUCH.placement, x=COUCH.placement.x - shift[0], y=COUCH.placement.y - shift[1])
    back = LAID.rotation.T @ np.array([place.x - LAID.x, place.y - LAID.y])
    local = Placement(float(back[0]), float(back[1]), place.yaw - LAID.yaw - turn)
    said = replace(COUCH, label=label, placement=local)
    return Scenelet("sit-1", "sit", SCENE.joints, (said,))


def test_an_error_is_along_the_axes_of_the_true_piece() -> None:
    """The couch is 2 m wide: .4 m aside are a fifth of it."""
    errors = furniture_errors(TRUTH, [(_saying(0.4, -0.15, turn=0.3), LAID)])
    np.testing.assert_allclose(errors, [[0.2, -0.15, 0.3]], atol=1e-12)


def test_a_piece_counts_once_by_its_mean_and_any_seat_is_a_seat() -> None:
    placed = [(_saying(0.4, 0.1), LAID), (_saying(0.0, 0.2, "chair"), LAID)]
    np.testing.assert_allclose(furniture_errors(TRUTH, placed), [[0.1, 0.15, 0.0]], atol=1e-12)


def test_what_is_far_or_of_another_kind_says_nothing() -> None:
    placed = [(_saying(1.2, 0.0), LAID), (_saying(0.0, 0.0, "shelf"), LAID)]
    assert furniture_errors(TRUTH, placed).shape == (0, 3)


def test_a_box_turned_by_a_quarter_has_the_same_axes() -> None:
    turns = (np.pi / 2 + 0.1, 0.3, -np.pi)
    placed = [(_saying(0.0, 0.0, turn=turn), LAID) for turn in turns]
    mean = np.angle(np.exp([0.4j, 1.2j, 0.0]).mean()) / 4
    np.testing.assert_allclose(furniture_errors(TRUTH, placed), [[0.0, 0.0, mean]], atol=1e-12)


def test_how_often_a_seat_has_the_true_label() -> None:
    """Pieces far from any seat, and seats whose label the library lacks, are left out."""
    shares = {"couch": 0.6, "chair": 0.4}
    placed = [(_saying(0.4, 0.1, o), LAID) for o in ("couch", "chair", "couch", "shelf")]
    placed.append((_saying(1.2, 0.0), LAID))
    np.testing.assert_allclose(observe_seats(TRUTH, placed, shares), [[2 / 3, 0.6]])
    assert observe_seats(TRUTH, placed, {"chair": 1.0}).shape == (0, 2)
    assert observe_seats(TRUTH, [], shares).shape == (0, 2)
