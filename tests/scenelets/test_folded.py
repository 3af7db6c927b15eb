"""Sitting with legs crossed or folded: on the seat, not through it or each other."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from imapper_prob.models.skeleton import (
    BONE_LENGTHS,
    LANK,
    LHIP,
    LKNE,
    PELV,
    RANK,
    RHIP,
    RKNE,
)
from imapper_prob.scenelets.plausibility import faults
from imapper_prob.scenelets.procedural import folded
from imapper_prob.scenelets.procedural.body import ANKLE_HEIGHT, Recipe
from imapper_prob.scenelets.procedural.seated import HIP_ABOVE_SEAT
from tests.scenelets.drawing import draws, knee_flexion, legs_apart, surface, within

Array = NDArray[np.float64]

CROSSED: dict[str, Recipe] = {
    f"crossed on {kind}": folded.sit_crossed(kind) for kind in ("chair", "couch", "stool", "bench")
}
ON_LEG: dict[str, Recipe] = {
    f"on a leg on {kind}": folded.sit_on_leg(kind) for kind in ("bed", "couch", "chair", "bench")
}
TAILOR: dict[str, Recipe] = {
    f"cross-legged on {kind}": folded.sit_tailor_fashion(kind) for kind in ("bed", "couch")
}
RECIPES = CROSSED | ON_LEG | TAILOR


@pytest.mark.parametrize("name", RECIPES)
def test_people_can_do_it(name: str) -> None:
    drawn = draws(RECIPES[name], 20)
    assert sum(not faults(d.joints, d.objects, fps=10.0) for d in drawn) >= 18
    for joints, _ in drawn:
        assert 15 <= len(joints) <= 20
        assert joints[..., 2].min() > ANKLE_HEIGHT - 1e-6  # feet are on a floor or a seat
        for (a, b), length in BONE_LENGTHS.items():
            bone = np.linalg.norm(joints[:, a] - joints[:, b], axis=-1)
            np.testing.assert_allclose(bone, length, atol=1e-9)


@pytest.mark.parametrize("name", RECIPES)
def test_hips_are_on_the_seat(name: str) -> None:
    for joints, (piece,) in draws(RECIPES[name], 30):
        low, high = surface(piece)
        pelvis = within(piece, joints[:, PELV])
        assert np.all((pelvis[:, :2] > low[:2]) & (pelvis[:, :2] < high[:2]))
        np.testing.assert_allclose(pelvis[:, 2] - high[2], HIP_ABOVE_SEAT)


@pytest.mark.parametrize("name", RECIPES)
def test_legs_are_on_each_other_not_in_each_other(name: str) -> None:
    # Half of a shin and half of a foot, pressed together.
    assert min(legs_apart(d.joints[0]) for d in draws(RECIPES[name], 60)) > 0.045


def hips_frame(pose: Array, point: Array) -> Array:
    """A point as right and ahead of the pelvis, metres, and its height."""
    across = pose[RHIP] - pose[LHIP]
    across = across[:2] / np.linalg.norm(across[:2])
    ahead = np.array([-across[1], across[0]])
    offset = (point - pose[PELV])[:2]
    return np.array([offset @ across, offset @ ahead, point[2]])


@pytest.mark.parametrize("name", CROSSED)
def test_one_leg_is_over_the_other_in_two_ways(name: str) -> None:
    hanging = []
    for joints, _ in draws(CROSSED[name], 60):
        pose = joints[0]
        knee, ankle = hips_frame(pose, pose[RKNE]), hips_frame(pose, pose[RANK])
        other = hips_frame(pose, pose[LKNE])
        assert pose[LANK, 2] == pytest.approx(ANKLE_HEIGHT)
        assert ankle[0] < 0  # beyond the middle
        if ankle[2] < other[2]:  # knee over knee: the shin hangs
            hanging.append(True)
            assert 0.08 < knee[2] - other[2] < 0.20
            assert ankle[2] > 0.15
            assert ankle[0] < other[0]
            assert 60 < knee_flexion(joints)[0, 0] < 110
        else:  # the ankle on the thigh, before the knee or on it
            hanging.append(False)
            thigh = np.linalg.norm(pose[LKNE] - pose[LHIP])
            along = (pose[RANK] - pose[LHIP]) @ (pose[LKNE] - pose[LHIP]) / thigh**2
            assert 0.70 < along < 1.0
            assert knee[0] > 0.18  # the knee out to its side
            assert 100 < knee_flexion(joints)[0, 0] < 130
    assert 0.3 < np.mean(hanging) < 0.8


@pytest.mark.parametrize("name", ON_LEG)
def test_one_leg_is_folded_on_the_seat_and_one_foot_is_down(name: str) -> None:
    for joints, (piece,) in draws(ON_LEG[name], 40):
        top = surface(piece)[1][2]
        ankle, knee = within(piece, joints[0, RANK]), joints[0, RKNE]
        assert 0.03 < ankle[2] - top < 0.09
        assert 0.03 < knee[2] - top < 0.15
        low, high = surface(piece)
        assert np.all((ankle[:2] > low[:2]) & (ankle[:2] < high[:2] + 0.02))
        assert joints[0, LANK, 2] == pytest.approx(ANKLE_HEIGHT)
        right, left = knee_flexion(joints)[0]
        assert 130 < right < 150
        assert 45 < left < 100


@pytest.mark.parametrize("name", TAILOR)
def test_both_shins_are_crossed_on_the_seat(name: str) -> None:
    for joints, (piece,) in draws(TAILOR[name], 40):
        low, high = surface(piece)
        legs = within(piece, joints[0, [RKNE, LKNE, RANK, LANK]])
        assert np.all((legs[:, 2] > high[2] + 0.03) & (legs[:, 2] < high[2] + 0.20))
        # Knees may be a little over the front edge, never in what is behind or beside.
        assert np.all((legs[:, :2] > low[:2] - 0.02) & (legs[:, :2] < high[:2] + 0.12))
        right, left = (hips_frame(joints[0], joints[0, j]) for j in (RANK, LANK))
        assert right[0] < 0 < left[0]
        assert right[1] > left[1] + 0.08
        outer = [hips_frame(joints[0], joints[0, j])[0] for j in (RKNE, LKNE)]
        assert outer[0] > 0.25
        assert outer[1] < -0.25
        assert np.all((knee_flexion(joints) > 120) & (knee_flexion(joints) < 150))


def test_people_sit_on_a_bed_whichever_way_it_is_turned() -> None:
    pieces = [d.objects[0] for d in draws(folded.sit_tailor_fashion("bed"), 60)]
    turns = np.round(np.degrees([p.placement.yaw for p in pieces]))
    assert set(turns) == {0, 90, -90}
    behind = [d for d, turn in zip(draws(folded.sit_tailor_fashion("bed"), 60), turns, strict=True)]
    gaps = [
        within(d.objects[0], d.joints[0, PELV])[1] - surface(d.objects[0])[0][1]
        for d, turn in zip(behind, turns, strict=True)
        if turn == 0
    ]
    # A third and more of those who face its foot lean on the headboard.
    assert 0.2 < np.mean(np.array(gaps) < 0.30) < 0.7
