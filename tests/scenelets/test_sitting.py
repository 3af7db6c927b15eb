"""Sitting, sitting down and lying: on the furniture, not in it, as people do."""

from __future__ import annotations

from dataclasses import replace

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from numpy.typing import NDArray

from imapper_prob.models.scene import Placement
from imapper_prob.models.skeleton import (
    BONE_LENGTHS,
    HEAD,
    LANK,
    LHIP,
    LKNE,
    LSHO,
    LWRI,
    PELV,
    RANK,
    RHIP,
    RKNE,
    RSHO,
    RWRI,
    THRX,
    facing,
)
from imapper_prob.scenelets.plausibility import faults
from imapper_prob.scenelets.procedural import furniture, lying, sitting
from imapper_prob.scenelets.procedural.body import Person, Recipe, Trunk, backwards
from imapper_prob.scenelets.procedural.seated import (
    HIP_ABOVE_SEAT,
    SeatedPose,
    at_table,
    draw_seated,
    seat_of,
)
from imapper_prob.scenelets.procedural.sitting import approach, sit_down, sit_still
from tests.scenelets.drawing import draws, legs_apart, surface, within

Array = NDArray[np.float64]

KINDS = ("chair", "office-chair", "armchair", "couch", "stool", "bench", "bed")
STILL: dict[str, Recipe] = {
    **{f"on {kind}": sitting.sit(kind) for kind in KINDS},
    **{f"turned on {kind}": sitting.sit_turned(kind) for kind in KINDS},
    **{f"on {kind} by a shelf": sitting.sit_beside_shelf(kind) for kind in ("chair", "couch")},
    "at a table": sitting.sit_at_table,
    "at a desk": sitting.sit_at_desk,
    "at a low table": sitting.sit_at_low_table,
}
DOWN: dict[str, Recipe] = {
    **{f"down on {kind}": sitting.sit_down_on(kind) for kind in KINDS},
    "down at a table": sitting.sit_down_at_table,
}
UP: dict[str, Recipe] = {
    **{f"up from {kind}": backwards(sitting.sit_down_on(kind)) for kind in KINDS},
    "up from a table": backwards(sitting.sit_down_at_table),
}
LYING: dict[str, Recipe] = {"on a bed": lying.lie_on_bed, "on a couch": lying.lie_on_couch}
RECIPES = STILL | DOWN | UP | LYING


@pytest.mark.parametrize("name", RECIPES)
def test_people_can_do_it(name: str) -> None:
    drawn = draws(RECIPES[name], 20)
    possible = [not faults(d.joints, d.objects, fps=10.0) for d in drawn]
    # More than 95 of 100 draws pass; three failures in twenty would be one in forty.
    assert sum(possible) >= 18
    for joints, _ in drawn:
        assert 15 <= len(joints) <= 20
        for (a, b), length in BONE_LENGTHS.items():
            bone = np.linalg.norm(joints[:, a] - joints[:, b], axis=-1)
            np.testing.assert_allclose(bone, length, atol=1e-9)


@pytest.mark.parametrize("name", STILL)
def test_hips_are_on_the_seat(name: str) -> None:
    for joints, (piece, *_) in draws(STILL[name], 30):
        low, high = surface(piece)
        pelvis = within(piece, joints[:, PELV])
        assert np.all(pelvis[:, :2] > low[:2])
        assert np.all(pelvis[:, :2] < high[:2])
        np.testing.assert_allclose(pelvis[:, 2] - high[2], HIP_ABOVE_SEAT)


@pytest.mark.parametrize("kind", ["chair", "couch"])
def test_people_sit_where_those_of_i3db_do(kind: str) -> None:
    drawn = draws(sitting.sit(kind), 400, person=Person(1.70))
    across, ahead = np.array([d.joints[8, PELV, :2] for d in drawn]).T
    # Chairs and couches together: .09 m before the middle.
    assert 0.06 < ahead.mean() < 0.12
    if kind == "couch":
        # Measured: .28 (six sittings), and as often on one side as on the other.
        assert 0.20 < np.sqrt((across**2).mean()) < 0.36
        assert abs(across.mean()) < 4 * 0.3 / np.sqrt(400)
    else:
        assert np.abs(across).max() < 0.08
    yaw = np.abs(np.degrees([facing(d.joints[8]) for d in drawn]))
    # Measured: median 4 degrees and 90 % within 11; the errors of both quantiles of 400
    # normal numbers are below half a degree.
    assert 2.5 < np.median(yaw) < 5.5
    assert 7.5 < np.quantile(yaw, 0.9) < 12.5


@pytest.mark.parametrize("kind", ["armchair", "couch"])
def test_feet_are_before_a_couch_not_below_it(kind: str) -> None:
    for recipe in (sitting.sit(kind), sitting.sit_turned(kind)):
        for joints, (piece, *_) in draws(recipe, 60):
            feet = within(piece, joints[0, [RANK, LANK]])
            low = feet[feet[:, 2] < 0.15]
            assert low[:, 1].min() > surface(piece)[1][1] + 0.05


@pytest.mark.parametrize("kind", ["chair", "stool", "couch"])
def test_the_turned_are_turned(kind: str) -> None:
    yaw = np.degrees([facing(d.joints[8]) for d in draws(sitting.sit_turned(kind), 60)])
    assert np.abs(yaw).min() > 5
    assert 25 < np.abs(yaw).max() < 50
    assert 10 < (yaw > 0).sum() < 50


def test_sitters_lean_back_and_forward_and_move_their_legs() -> None:
    joints = np.array([d.joints[8] for d in draws(sitting.sit("chair"), 200)])
    yaw = facing(joints)
    ahead = np.stack([-np.sin(yaw), np.cos(yaw)], -1)
    across = np.stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)], -1)
    spine = joints[:, THRX] - joints[:, PELV]
    lean = np.degrees(np.arctan2((spine[:, :2] * ahead).sum(-1), spine[:, 2]))
    assert 0.1 < (lean < -7).mean() < 0.6
    assert 0.1 < (lean > 18).mean() < 0.4
    assert lean.max() < 40
    feet = ((joints[:, [RANK, LANK]] - joints[:, [PELV]])[..., :2] * ahead[:, None]).sum(-1)
    assert (feet < 0.33).mean() > 0.05  # tucked in
    assert (feet > 0.53).mean() > 0.05  # stretched out
    right, left = joints[:, RANK], joints[:, LANK]
    crossed = (right * across).sum(-1) < (left * across).sum(-1)
    raised = right[:, 2] > 0.15
    assert 0.02 < (crossed & ~raised).mean() < 0.2  # at the ankles
    assert 0.05 < (crossed & raised).mean() < 0.3  # one leg over the other


def test_legs_do_not_pass_through_each_other() -> None:
    for kind in ("stool", "couch"):
        for joints, _ in draws(sitting.sit(kind), 100):
            # A shin against a calf: half of either, pressed together.
            assert legs_apart(joints[0]) > 0.06


def test_hands_are_on_the_armrests_there_are() -> None:
    on_rest = []
    for joints, (piece, *_) in draws(sitting.sit("armchair"), 100):
        arms = [c for c in piece.cuboids if c.part == "arm"]
        for wrist, arm in ((RWRI, arms[1]), (LWRI, arms[0])):
            offset = joints[8, wrist] - arm.centre
            above = offset[2] - arm.size[2] / 2
            on_rest.append(bool(np.all(np.abs(offset[:2]) < arm.size[:2] / 2) and above < 0.08))
    # A third of those who do not lean forward.
    assert 0.15 < np.mean(on_rest) < 0.5


@pytest.mark.parametrize("recipe", [sitting.sit_at_table, sitting.sit_at_desk])
def test_hands_are_on_the_desk_and_knees_under_it(recipe: Recipe) -> None:
    for joints, (_, table) in draws(recipe, 60):
        (x0, y0, _), (x1, y1, top) = table.bounds
        right = within(table, joints[:, RWRI])
        assert np.all((right[:, 2] > top + 0.02) & (right[:, 2] < top + 0.12))
        assert np.all((right[:, 0] > x0) & (right[:, 0] < x1))
        assert np.all((right[:, 1] > y0) & (right[:, 1] < y1))
        knees = within(table, joints[:, [RKNE, LKNE]])
        assert np.all(knees[..., 2] < top - 0.04)
        low, high = furniture.knee_room(table)
        assert np.all((knees[..., 0] > low) & (knees[..., 0] < high))


def test_companions_are_within_reach() -> None:
    for name in ("on chair by a shelf", "on couch by a shelf", "at a low table"):
        for joints, (_, companion) in draws(STILL[name], 40):
            low, high = companion.bounds[:, :2]
            local = within(companion, joints[8])[:, :2]
            gap = np.maximum(np.maximum(low - local, local - high), 0.0)
            assert np.linalg.norm(gap, axis=-1).min() < 1.0


@pytest.mark.parametrize("name", DOWN)
def test_who_sits_down_begins_on_the_feet_and_ends_on_the_seat(name: str) -> None:
    for joints, (piece, *_) in draws(DOWN[name], 20):
        hips = (joints[:, RHIP] + joints[:, LHIP]) / 2
        feet = (joints[:, RANK] + joints[:, LANK]) / 2
        assert hips[0, 2] > 0.82
        assert np.linalg.norm((hips - feet)[0, :2]) < 0.35
        height = surface(piece)[1][2]
        assert hips[-1, 2] - height == pytest.approx(HIP_ABOVE_SEAT, abs=0.005)
        # Half-way down the trunk bends forward.
        spine = joints[:, THRX] - joints[:, PELV]
        lean = np.degrees(np.arccos(spine[:, 2] / np.linalg.norm(spine, axis=-1)))
        assert 20 < lean.max() < 50
        assert lean[0] < 10


def test_standing_up_is_sitting_down_played_backwards() -> None:
    recipe = sitting.sit_down_on("couch")
    down, up = (draw(np.random.default_rng(3), Person(1.7)) for draw in (recipe, backwards(recipe)))
    np.testing.assert_array_equal(down.joints, up.joints[::-1])


def test_some_walk_to_their_seat_and_some_stand_before_it() -> None:
    drawn = draws(sitting.sit_down_on("chair"), 80)
    walked = np.array(
        [np.linalg.norm((j[0] - j[-1])[[RANK, LANK], :2], axis=-1).mean() for j, _ in drawn]
    )
    assert 0.1 < (walked < 0.01).mean() < 0.45
    assert walked.max() > 0.35
    turned = np.degrees([abs(facing(j[0])) for j, _ in drawn])
    assert turned.max() > 110


@given(
    distance=st.floats(0.05, 0.8),
    bearing=st.floats(0.1, np.pi) | st.floats(-np.pi, -0.1),
    yaw=st.floats(-0.7, 0.7),
)
def test_an_approach_goes_forward_and_ends_back_to_the_seat(
    distance: float, bearing: float, yaw: float
) -> None:
    end = Placement(0.1, 0.5, yaw)
    route = approach(end, distance=distance, bearing=bearing, arrival=0.9)
    x, y, heading = route(np.array([0.0, 0.05, 0.9, 1.5])).T
    np.testing.assert_allclose([x[2:], y[2:], heading[2:]], [[0.1] * 2, [0.5] * 2, [yaw] * 2])
    assert np.hypot(x[0] - 0.1, y[0] - 0.5) == pytest.approx(distance)
    ahead = np.array([-np.sin(heading[0]), np.cos(heading[0])])
    step = np.array([x[1] - x[0], y[1] - y[0]])
    assert step @ ahead == pytest.approx(np.linalg.norm(step), rel=1e-6)
    assert abs(heading[0] - yaw) < np.pi


@given(
    yaw=st.floats(-np.pi, np.pi),
    offset=st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)),
)
def test_offsets_from_the_pelvis_are_those_of_the_trunk(
    yaw: float, offset: tuple[float, float, float]
) -> None:
    seat = seat_of(furniture.stool(np.random.default_rng(0)))
    pose = replace(draw_seated(np.random.default_rng(0), seat), yaw=yaw)
    trunk = Trunk.of(pose.pelvis[None], yaw)
    (back,) = pose.from_pelvis(trunk.at_pelvis([offset, offset])[:, 0])
    np.testing.assert_allclose(back, offset, atol=1e-12)


def test_a_seat_is_what_its_piece_offers() -> None:
    rng = np.random.default_rng(2)
    couch = furniture.couch(rng, seats=2)
    seat, bed_edge = seat_of(couch), seat_of(furniture.bed(rng), edge=0.2)
    assert seat.closed
    assert seat.deep
    assert len(seat.arms) == 2
    assert seat.front == pytest.approx(couch.bounds[1, 1])
    assert seat.back == pytest.approx(surface(couch)[0][1])
    assert bed_edge.front == 0.2
    assert bed_edge.back == -np.inf
    assert not seat_of(furniture.stool(rng)).closed


def seated(seed: int = 0) -> SeatedPose:
    rng = np.random.default_rng(seed)
    return draw_seated(rng, seat_of(furniture.chair(rng, arms=False)), upright=True)


def test_sitting_down_ends_in_the_pose_that_was_asked_for() -> None:
    times = np.arange(0.0, 2.4, 0.1)
    pose = replace(seated(), twist=0.0)
    feet = pose.ankles[:, :2].mean(0)
    end = Placement(float(feet[0]), float(feet[1]), pose.yaw)
    route = approach(end, distance=0.3, bearing=1.0, arrival=0.9)
    joints = sit_down(np.random.default_rng(1), pose, times, route=route, arrival=0.9)
    still = sit_still(np.random.default_rng(1), pose, times)
    np.testing.assert_allclose(joints[-1], still[-1], atol=0.04)  # breath and looking about
    np.testing.assert_allclose(joints[-1, [RANK, LANK]], pose.ankles, atol=1e-6)


def test_table_hands_follow_the_table() -> None:
    for seed in range(20):
        pose = at_table(np.random.default_rng(seed), seated(seed), edge=0.35, top=0.74)
        trunk = Trunk.of(pose.pelvis[None], pose.yaw)
        right, _ = trunk.at_pelvis(pose.hands)[0]
        assert right[2] == pytest.approx(0.79)
        assert 0.38 < right[1] < 0.52


@pytest.mark.parametrize("name", LYING)
def test_sleepers_lie_on_their_bed_from_end_to_end(name: str) -> None:
    for joints, (piece,) in draws(LYING[name], 40):
        low, high = surface(piece)
        local = within(piece, joints)
        assert np.all(local[:, [PELV, THRX, HEAD, RHIP, LHIP], :2] > low[:2])
        assert np.all(local[:, [PELV, THRX, HEAD, RHIP, LHIP], :2] < high[:2])
        assert np.all(local[:, [RANK, LANK], :2] > low[:2] - 0.1)
        assert np.all(local[:, [RANK, LANK], :2] < high[:2] + 0.1)
        assert 0.05 < joints[0, PELV, 2] - high[2] < 0.22
        assert np.ptp(joints[0, [PELV, THRX, HEAD], 2]) < 0.15
        # Feet are where the lying body faces.
        yaw = facing(joints[0])
        down = (joints[0, [RANK, LANK]].mean(0) - joints[0, HEAD])[:2]
        assert down @ [-np.sin(yaw), np.cos(yaw)] > 0.8 * np.linalg.norm(down)
        if piece.label == "bed":
            assert local[0, HEAD, 1] < local[0, PELV, 1]


def test_sleepers_lie_on_the_back_and_on_the_side() -> None:
    drawn = draws(lying.lie_on_bed, 60)
    tilt = np.array([abs(j[0, RSHO, 2] - j[0, LSHO, 2]) for j, _ in drawn])
    on_side = tilt > 0.2
    assert 15 < on_side.sum() < 45
    assert tilt[~on_side].max() < 0.01
