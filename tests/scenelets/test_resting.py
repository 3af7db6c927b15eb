"""Perching, leaning on an arm, and slouching: what carries touches what it is carried by."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from imapper_prob.models.skeleton import (
    BONE_LENGTHS,
    HEAD,
    LANK,
    LWRI,
    PELV,
    RANK,
    RELB,
    RKNE,
    RWRI,
    THRX,
)
from imapper_prob.scenelets.plausibility import faults
from imapper_prob.scenelets.procedural import resting
from imapper_prob.scenelets.procedural.body import ANKLE_HEIGHT, TRUNK, Recipe
from imapper_prob.scenelets.procedural.seated import HIP_ABOVE_SEAT
from tests.scenelets.drawing import draws, knee_flexion, surface, within

Array = NDArray[np.float64]

PERCHED: dict[str, Recipe] = {
    f"on the edge of {kind}": resting.perch_on(kind)
    for kind in ("chair", "stool", "bench", "couch", "bed")
}
ON_REST: dict[str, Recipe] = {
    f"on the arm of {kind}": resting.lean_on_armrest(kind)
    for kind in ("chair", "couch", "armchair")
}
SLOUCHED: dict[str, Recipe] = {
    f"slid forward in {kind}": resting.slouch_on(kind) for kind in ("chair", "couch", "armchair")
}
SEATED = (
    PERCHED
    | ON_REST
    | SLOUCHED
    | {
        "head on hand": resting.lean_on_table,
        "on one hand": resting.lean_on_bed,
        "on both hands": resting.lean_back_on_bed,
    }
)
RECIPES = SEATED | {"on the edge of a table": resting.perch_on_table}


@pytest.mark.parametrize("name", RECIPES)
def test_people_can_do_it(name: str) -> None:
    drawn = draws(RECIPES[name], 20)
    assert sum(not faults(d.joints, d.objects, fps=10.0) for d in drawn) >= 18
    for joints, _ in drawn:
        assert 15 <= len(joints) <= 20
        for (a, b), length in BONE_LENGTHS.items():
            bone = np.linalg.norm(joints[:, a] - joints[:, b], axis=-1)
            np.testing.assert_allclose(bone, length, atol=1e-9)


@pytest.mark.parametrize("name", SEATED)
def test_hips_are_on_the_seat_and_feet_on_the_floor(name: str) -> None:
    for joints, (piece, *_) in draws(SEATED[name], 30):
        low, high = surface(piece)
        pelvis = within(piece, joints[:, PELV])
        assert np.all((pelvis[:, :2] > low[:2]) & (pelvis[:, :2] < high[:2]))
        np.testing.assert_allclose(pelvis[:, 2] - high[2], HIP_ABOVE_SEAT)
        np.testing.assert_allclose(joints[:, [RANK, LANK], 2], ANKLE_HEIGHT, atol=1e-6)


@pytest.mark.parametrize("name", PERCHED)
def test_who_perches_is_on_the_edge_with_a_straight_leg(name: str) -> None:
    for joints, (piece,) in draws(PERCHED[name], 40):
        front = 0.20 if piece.label == "bed" else surface(piece)[1][1]
        assert 0.01 < front - joints[0, PELV, 1] < 0.08
        assert 20 < knee_flexion(joints)[0].min() < 65
        assert joints[0, [RANK, LANK], 1].max() > front + 0.35


def test_who_perches_on_a_table_stands_on_one_foot_at_least() -> None:
    hanging = []
    for joints, (table,) in draws(resting.perch_on_table, 60):
        edge, top = table.bounds[1, 1:]
        pelvis = joints[:, PELV]
        assert np.all(np.abs(pelvis[:, 1] - edge) < 0.05)
        assert np.all((pelvis[:, 2] > top + 0.03) & (pelvis[:, 2] < top + 0.10))
        assert joints[0, LANK, 2] == pytest.approx(ANKLE_HEIGHT)
        assert knee_flexion(joints)[0, 1] < 35
        hanging.append(joints[0, RANK, 2] > 0.2)
        if hanging[-1]:
            assert 50 < knee_flexion(joints)[0, 0] < 100
            assert joints[0, RKNE, 2] > top - 0.05
        else:
            assert joints[0, RANK, 2] == pytest.approx(ANKLE_HEIGHT)
            assert knee_flexion(joints)[0, 0] < 35
    assert 0.2 < np.mean(hanging) < 0.6


def tilt(joints: Array) -> float:
    """Degrees that the trunk is to the right in the first frame, of who faces about +y."""
    return float(np.degrees(np.arcsin((joints[0, THRX] - joints[0, PELV])[0] / TRUNK)))


@pytest.mark.parametrize("name", ON_REST)
def test_a_forearm_is_on_the_rest(name: str) -> None:
    tilts = []
    for joints, (piece,) in draws(ON_REST[name], 40):
        rest = max((c for c in piece.cuboids if c.part == "arm"), key=lambda c: c.centre[0])
        elbow, wrist = (joints[0, j] - rest.centre for j in (RELB, RWRI))
        assert 0.02 < elbow[2] - rest.size[2] / 2 < 0.07
        assert 0.02 < wrist[2] - rest.size[2] / 2 < 0.09
        assert abs(elbow[0]) < rest.size[0] / 2 + 0.02
        assert elbow[1] < rest.size[1] / 2
        tilts.append(tilt(joints))
    assert 0 < min(tilts) < max(tilts) < 35
    assert np.median(tilts) > 8


def test_the_head_is_on_a_hand_and_the_elbow_on_the_table() -> None:
    for joints, (_, table) in draws(resting.lean_on_table, 40):
        low, high = table.bounds
        elbow, left = within(table, joints[0, RELB]), within(table, joints[0, LWRI])
        for point in (elbow, left):
            assert np.all((point[:2] > low[:2]) & (point[:2] < high[:2]))
            assert 0.02 < point[2] - high[2] < 0.08
        # Half a head and the length of a hand.
        assert 0.15 < np.linalg.norm(joints[0, RWRI] - joints[0, HEAD]) < 0.33
        assert 0 < tilt(joints) < 20


def test_straight_arms_carry_on_the_bed() -> None:
    for recipe, hands in ((resting.lean_on_bed, [RWRI]), (resting.lean_back_on_bed, [RWRI, LWRI])):
        for joints, (bed,) in draws(recipe, 40):
            low, high = surface(bed)
            wrists = within(bed, joints[:, hands])
            np.testing.assert_allclose(wrists[..., 2] - high[2], 0.06, atol=0.01)
            assert np.all(wrists[..., :2] > low[:2] - 0.06)
            assert np.all(wrists[..., :2] < high[:2] + 0.06)
            if len(hands) == 1:
                assert 6 < tilt(joints) < 25
            else:
                back = (joints[0, PELV] - joints[0, THRX])[1] / TRUNK
                assert 10 < np.degrees(np.arcsin(back)) < 30


@pytest.mark.parametrize("name", SLOUCHED)
def test_who_slouches_leans_on_the_back_from_afar(name: str) -> None:
    for joints, (piece,) in draws(SLOUCHED[name], 40):
        back = max(c.centre[1] + c.size[1] / 2 for c in piece.cuboids if c.part == "back")
        chest, pelvis = joints[0, THRX, 1] - back, joints[0, PELV, 1] - back
        assert 0.07 < chest < 0.14
        assert 0.28 < pelvis < 0.50
        assert 22 < np.degrees(np.arcsin((pelvis - chest) / TRUNK)) < 50
        assert joints[0, HEAD, 2] > joints[0, THRX, 2] + 0.15
