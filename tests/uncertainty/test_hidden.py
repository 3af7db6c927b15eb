"""What hides what, in a room where it can be seen by eye."""

from __future__ import annotations

import numpy as np
import pytest

from imapper_prob.models.errors import InputError
from imapper_prob.models.geometry import pack_boxes, sight_clearance
from imapper_prob.models.skeleton import HEAD, LANK, RANK
from imapper_prob.uncertainty.clusters import object_clusters
from imapper_prob.uncertainty.hidden import cut_by, hidden_joints
from tests.models.worlds import walk
from tests.uncertainty.pieces import piece

ELEVATION = 1.5


def test_the_couch_hides_the_ankles_in_two_draws_of_three() -> None:
    # In front of the person a couch 0.8 m high: it hides what is low, not the head.
    couch, behind = piece("couch", 0, 3, width=4.0), piece("shelf", 0, 6, width=4.0, height=2.0)
    draws = [[couch, behind], [couch], [behind]]
    motions = [walk(5)] * 3
    clusters = object_clusters(draws, np.zeros((1, 3)), radius=0.8)
    found = hidden_joints(draws, motions, [ELEVATION] * 3, clusters)
    of_label = {c.label: k for k, c in enumerate(found.clusters)}
    assert found.probability[:, [RANK, LANK]] == pytest.approx(2 / 3)
    assert not found.probability[:, HEAD].any()
    np.testing.assert_array_equal(found.by_object[of_label["couch"]], found.probability)
    assert not found.by_object[of_label["shelf"]].any()
    hidden = found.behind(of_label["couch"])
    assert hidden["RANK"] == hidden["LANK"] == 5
    assert "HEAD" not in hidden
    assert found.behind("couch") == hidden
    assert found.behind("couch", least=0.7) == {}
    with pytest.raises(InputError, match="a bed; there are: couch, shelf"):
        found.behind("bed")
    assert found.behind(of_label["shelf"]) == {}


def test_two_may_hide_one_joint_together() -> None:
    pair = [piece("couch", 0, 2.5, width=4.0), piece("table", 0, 3.3, width=4.0)]
    clusters = object_clusters([pair], np.zeros((1, 1)), radius=0.8)
    found = hidden_joints([pair], [walk(3)], [ELEVATION], clusters)
    assert found.by_object[:, 0, RANK].tolist() == [1.0, 1.0]
    assert found.probability[0, RANK] == 1.0


def test_what_is_in_no_cluster_hides_all_the_same() -> None:
    couch = piece("couch", 0, 3, width=4.0)
    found = hidden_joints([[couch], []], [walk(3)] * 2, [ELEVATION] * 2, [])
    assert found.by_object.shape == (0, 3, 16)
    assert found.probability[0, RANK] == 0.5


def test_an_empty_room_hides_nothing() -> None:
    found = hidden_joints([[], []], [walk(3)] * 2, [ELEVATION] * 2, [])
    assert found.probability.shape == (3, 16)
    assert not found.probability.any()


def test_lines_of_sight_are_those_of_the_model(rng: np.random.Generator) -> None:
    joints = walk(40) + rng.normal(0, 0.3, (40, 16, 3))
    for _ in range(20):
        x, y, yaw = rng.uniform((-1.5, 1.5, -3), (1.5, 3.5, 3))
        o = piece("couch", x, y, yaw, width=rng.uniform(0.3, 2), height=rng.uniform(0.3, 1.8))
        clearance = sight_clearance((0, 0, ELEVATION), joints, pack_boxes([o]))
        # On the edge rounding decides.
        clear = np.abs(clearance) > 1e-9
        np.testing.assert_array_equal(cut_by(o, joints, ELEVATION)[clear], clearance[clear] < 0)


def test_a_line_along_a_side_is_told_apart() -> None:
    # Straight ahead and level: the line runs along two of the axes of the box.
    joints = np.zeros((1, 16, 3))
    joints[0, :, 1:] = 6.0, ELEVATION
    assert cut_by(piece("shelf", 0, 3, height=2.0), joints, ELEVATION).all()
    assert not cut_by(piece("table", 0, 3, height=0.8), joints, ELEVATION).any()
    assert not cut_by(piece("shelf", 2, 3, height=2.0), joints, ELEVATION).any()
    assert not cut_by(piece("shelf", 0, 8, height=2.0), joints, ELEVATION).any()
