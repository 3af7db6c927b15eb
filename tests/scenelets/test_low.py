"""Low down with no furniture: everything at the height of a floor that carries it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from imapper_prob.models.skeleton import (
    BONE_LENGTHS,
    HEAD,
    LANK,
    LELB,
    LKNE,
    LWRI,
    PELV,
    RANK,
    RELB,
    RKNE,
    RSHO,
    RWRI,
    THRX,
    facing,
)
from imapper_prob.scenelets.plausibility import faults, floor_faults
from imapper_prob.scenelets.procedural import low
from imapper_prob.scenelets.procedural.body import (
    ANKLE_HEIGHT,
    HIP_HEIGHT,
    THIGH,
    Person,
    Recipe,
    backwards,
)
from imapper_prob.scenelets.procedural.low import KNEE_ON_FLOOR
from imapper_prob.scenelets.procedural.seated import HIP_ABOVE_SEAT
from tests.scenelets.drawing import draws, knee_flexion, legs_apart, spine_from_vertical

Array = NDArray[np.float64]

ON_FLOOR = ("cross-legged", "legs out", "knees up")
STILL: dict[str, Recipe] = {
    way: low.low_down(way) for way in (*ON_FLOOR, "squat", "both knees", "one knee")
}
MOVING: dict[str, Recipe] = {
    "down": low.go_into_squat,
    "up": backwards(low.go_into_squat),
    "picking up": low.pick_up_from_floor,
    "putting down": backwards(low.pick_up_from_floor),
    "bent over": low.bend_over,
}
RECIPES = STILL | MOVING | {"lying": low.lie_on_floor}


@pytest.mark.parametrize("name", RECIPES)
def test_people_can_do_it_without_furniture(name: str) -> None:
    drawn = draws(RECIPES[name], 20)
    assert sum(not faults(d.joints, d.objects, fps=10.0) for d in drawn) >= 18
    for joints, objects in drawn:
        assert objects == ()
        assert 15 <= len(joints) <= 20
        # Elbows and hands, too, are on the floor and not in it.
        assert joints[..., 2].min() > 0.03
        for (a, b), length in BONE_LENGTHS.items():
            bone = np.linalg.norm(joints[:, a] - joints[:, b], axis=-1)
            np.testing.assert_allclose(bone, length, atol=1e-9)


@pytest.mark.parametrize("name", STILL)
def test_legs_do_not_pass_through_each_other(name: str) -> None:
    assert min(legs_apart(d.joints[0]) for d in draws(STILL[name], 60)) > 0.045


@pytest.mark.parametrize("name", ON_FLOOR)
def test_who_sits_on_the_floor_has_the_hips_there(name: str) -> None:
    for joints, _ in draws(STILL[name], 40):
        np.testing.assert_allclose(joints[:, PELV, 2], HIP_ABOVE_SEAT)
        assert joints[0, HEAD, 2] > 0.7
        ankles, knees = joints[0, [RANK, LANK], 2], joints[0, [RKNE, LKNE], 2]
        assert np.all((ankles > 0.04) & (ankles < ANKLE_HEIGHT + 0.01))
        flexion = knee_flexion(joints)[0]
        if name == "cross-legged":
            assert knees.max() < 0.20
            assert flexion.min() > 120
        elif name == "legs out":
            assert flexion.min() < 40
            assert knees.min() < 0.25
        else:
            assert knees.min() > 0.35
            assert np.all((flexion > 95) & (flexion < 140))


def test_who_sits_on_the_floor_leans_on_the_hands_or_not() -> None:
    for way in ("legs out", "knees up"):
        wrists = np.array([d.joints[0, [RWRI, LWRI], 2] for d in draws(STILL[way], 60)])
        behind = (wrists < 0.07).all(1)
        assert 0.1 < behind.mean() < 0.75
        np.testing.assert_allclose(wrists[behind], 0.06, atol=0.01)


def test_a_squat_is_deep_and_balanced() -> None:
    on_toes = []
    for joints, _ in draws(low.low_down("squat"), 80):
        pose = joints[0]
        feet, knees = pose[[RANK, LANK]], pose[[RKNE, LKNE]]
        # Nobody squats at the height of a chair: hips are then at .55.
        assert 0.22 < pose[PELV, 2] < 0.45
        assert np.all((knees[:, 2] > 0.25) & (knees[:, 2] < 0.55))
        assert knee_flexion(joints).max() > 115
        on_toes.append(feet[:, 2].max() > ANKLE_HEIGHT + 0.02)
        # The body is over the feet: heels are 5 cm behind the ankles, toes before them.
        middle = pose[:, 1].mean()
        assert feet[:, 1].min() - 0.05 < middle < feet[:, 1].max() + 0.20
        if not on_toes[-1]:
            shins = knees - feet
            tilt = np.degrees(np.arctan2(shins[:, 1], shins[:, 2]))
            assert np.all((tilt > 5) & (tilt < 42))
    assert 0.3 < np.mean(on_toes) < 0.7


@pytest.mark.parametrize("way", ["both knees", "one knee"])
def test_knees_and_feet_of_who_kneels_are_on_the_floor(way: str) -> None:
    on_heels = []
    for joints, _ in draws(low.low_down(way), 60):
        pose = joints[0]
        kneeling = [(RKNE, RANK), (LKNE, LANK)] if way == "both knees" else [(RKNE, RANK)]
        for knee, ankle in kneeling:
            assert pose[knee, 2] == pytest.approx(KNEE_ON_FLOOR, abs=0.02)
            assert 0.04 < pose[ankle, 2] < 0.15
            assert pose[ankle, 1] < pose[knee, 1] - 0.35
        if way == "one knee":
            assert pose[LANK, 2] == pytest.approx(ANKLE_HEIGHT)
            assert pose[LANK, 1] > pose[RKNE, 1] - 0.06
            assert pose[LKNE, 2] > 0.4
        hips = pose[PELV, 2]
        on_heels.append(hips < 0.36)
        assert (0.25 if on_heels[-1] else 0.42) < hips < KNEE_ON_FLOOR + THIGH
        assert spine_from_vertical(joints)[0] < 30
    assert 0.1 < np.mean(on_heels) < 0.7


@pytest.mark.parametrize("upward", [False, True])
def test_who_squats_goes_all_the_way_on_the_same_feet(upward: bool) -> None:
    recipe = backwards(low.go_into_squat) if upward else low.go_into_squat
    for joints, _ in draws(recipe, 20):
        high, deep = (joints[-1], joints[0]) if upward else (joints[0], joints[-1])
        assert high[PELV, 2] > HIP_HEIGHT - 0.06
        assert deep[PELV, 2] < 0.40
        np.testing.assert_allclose(joints[:, [RANK, LANK], 2], ANKLE_HEIGHT, atol=0.003)
        feet = joints[:, [RANK, LANK], :2]
        assert np.abs(feet - feet[:1]).max() < 0.01
        # Nobody waits half-way.
        between = (joints[:, PELV, 2] > 0.45) & (joints[:, PELV, 2] < 0.75)
        assert between.sum() <= 6


@pytest.mark.parametrize("reverse", [False, True])
def test_hands_go_to_the_floor_and_come_up(reverse: bool) -> None:
    deepest = []
    recipe = backwards(low.pick_up_from_floor) if reverse else low.pick_up_from_floor
    for joints, _ in draws(recipe, 40):
        wrists = joints[:, [RWRI, LWRI], 2].min(1)
        assert 0.05 < wrists.min() < 0.32
        up = joints[0 if reverse else -1]
        assert up[PELV, 2] > 0.80
        assert up[[RWRI, LWRI], 2].max() > 0.80
        assert spine_from_vertical(joints).max() > 38
        assert spine_from_vertical(up[None])[0] < 15
        deepest.append(joints[:, PELV, 2].min())
    # Some stoop, and some bend their knees.
    assert min(deepest) < 0.52
    assert max(deepest) > 0.55


def test_who_is_bent_over_stays_so_or_comes_to_it() -> None:
    stayed = []
    for joints, _ in draws(low.bend_over, 60):
        assert joints[-1, [RWRI, LWRI], 2].min() < 0.45
        assert spine_from_vertical(joints)[-1] > 40
        stayed.append(spine_from_vertical(joints)[0] > 40)
    assert 0.4 < np.mean(stayed) < 0.8


def test_who_lies_on_the_floor_lies_flat() -> None:
    on_side = []
    for joints, _ in draws(low.lie_on_floor, 40):
        trunk = joints[0, [PELV, THRX, HEAD], 2]
        assert 0.05 < trunk.min() < trunk.max() < 0.24
        assert np.all((joints[0, [RANK, LANK], 2] > 0.04) & (joints[0, [RANK, LANK], 2] < 0.16))
        assert joints[0, [RELB, LELB, RWRI, LWRI], 2].min() > 0.03
        on_side.append(abs(joints[0, RSHO, 2] - joints[0, THRX, 2]) > 0.1)
        yaw = facing(joints[0])
        down = (joints[0, [RANK, LANK]].mean(0) - joints[0, HEAD])[:2]
        assert down @ [-np.sin(yaw), np.cos(yaw)] > 0.8 * np.linalg.norm(down)
    assert 0.15 < np.mean(on_side) < 0.65


def test_a_foot_that_lies_may_be_lower_than_one_that_stands() -> None:
    kneels = low.low_down("both knees")(np.random.default_rng(2), Person(1.70)).joints.copy()
    assert floor_faults(kneels) == []
    kneels[:, [RANK, LANK], 2] = 0.03
    assert floor_faults(kneels) == []
    kneels[3, RANK, 2] = 0.005
    assert [f for f in floor_faults(kneels) if "RANK" in f and "too low in frame 3" in f]
