"""The published energy: its printed equations by hand, and all of it against a slow reference."""

from __future__ import annotations

from dataclasses import fields, replace

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from imapper_prob.models.errors import InputError
from imapper_prob.models.geometry import sight_clearance
from imapper_prob.models.log_posterior import (
    Incremental,
    State,
    empty_state,
    log_posterior,
    motion,
    state_camera,
    terms,
)
from imapper_prob.models.problem import Problem
from imapper_prob.models.published_energy import (
    FARTHEST,
    depth_of_motion,
    hidden_distance,
    occlusion_cost,
    overlaps,
    signed_distance,
)
from imapper_prob.models.published_terms import PaperEnergy, paper_energy
from imapper_prob.models.scene import SceneObject
from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.models.settings import ModelSettings, PaperWeights
from imapper_prob.models.skeleton import DETECTED, LANK, LKNE, LWRI, NECK, PELV, RANK, RKNE
from tests.models import paper_reference, worlds

ALL_ONE = PaperWeights(1.0, 1.0, 1.0, 1.0, 1.0)
AHEAD = np.array([0.0, 4.0, 0.0])
CAP = FARTHEST


def energy(
    problem: Problem,
    state: State,
    *,
    confidence: float = 0.9,
    weights: PaperWeights | None = ALL_ONE,
) -> PaperEnergy:
    """With one confidence for all joints, and unweighted unless asked otherwise."""
    confidences = np.full((problem.n_frames, 16), confidence)
    return paper_energy(problem._replace(confidences=confidences), state, weights=weights)


def seen_exactly(problem: Problem, state: State) -> Problem:
    """The problem with detections where the state's joints project to."""
    pitch, elevation, log_focal, _, roll = state.camera
    camera = worlds.CAMERA.posed(
        pitch=pitch, roll=roll, elevation=elevation, focal_scale=float(np.exp(log_focal))
    )
    return problem._replace(keypoints=camera.project(motion(problem, state)))


def standing_on(furniture: SceneObject) -> Library:
    """One scenelet of somebody who stands still where the furniture is."""
    joints = np.repeat(worlds.POSE[None], 6, 0) + np.array([0.0, 0.0, worlds.PELVIS_HEIGHT])
    return Library("one", (Scenelet("stand", "stand", joints, (furniture,)),))


def packed(*rows: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Boxes (x, y, z, half sides, yaw), and cosine and sine of their yaws."""
    boxes = np.array(rows, float).reshape(-1, 7)
    return boxes, np.stack([np.cos(boxes[:, 6]), np.sin(boxes[:, 6])], -1)


def one_frame(problem: Problem) -> Problem:
    """The problem of the first frame alone; no scenelet fits in it."""
    by_frame = (
        "keypoints", "used", "confidence_density", "error_scale", "error_dof",
        "path_centre", "path_scale", "path_starts", "path_stay", "lift", "poses", "path_facing",
        "free_cost",
    )  # fmt: skip
    cut = {name: getattr(problem, name)[:1] for name in by_frame}
    density = np.ascontiguousarray(problem.static_density[:, :1])
    return problem._replace(**cut, static_density=density)


# --- L_r


@pytest.mark.parametrize("camera", [(0.0, 0.0, 0.0, 0.0, 0.0), (0.05, 0.2, 0.1, -0.05, 0.04)])
def test_reprojection_of_exact_detections_costs_nothing(
    camera: tuple[float, ...],
) -> None:
    problem = worlds.problem()
    state = empty_state(problem).with_item(1, 5, AHEAD, 0.03)
    state = replace(state, camera=state.camera + camera)
    seen = seen_exactly(problem, state)
    assert energy(seen, state).terms["reprojection"] == pytest.approx(0.0, abs=1e-20)


def test_reprojection_is_squared_and_weighted_by_confidence() -> None:
    problem = worlds.problem()
    state = empty_state(problem)
    problem = seen_exactly(problem, state)
    keypoints = problem.keypoints.copy()
    keypoints[3, LWRI] += (0.03 * problem.fx, -0.04 * problem.fy)  # .05 of normalised image
    confidences = np.full((20, 16), 0.9)
    confidences[3, LWRI] = 0.4
    seen = problem._replace(keypoints=keypoints, confidences=confidences)
    result = paper_energy(seen, state, weights=ALL_ONE)
    assert result.terms["reprojection"] == pytest.approx(0.4 * 0.05**2)
    assert result.by_frame["reprojection"][3] == pytest.approx(0.4 * 0.05**2)


def test_no_term_depends_on_the_resolution_of_the_image() -> None:
    problem = worlds.problem()
    state = empty_state(problem).with_item(1, 5, AHEAD)
    half = problem._replace(
        fx=problem.fx / 2, fy=problem.fy / 2, cx=problem.cx / 2, cy=problem.cy / 2,
        keypoints=problem.keypoints / 2,
    )  # fmt: skip
    before = energy(problem, state).terms
    assert before["reprojection"] > 0.01
    assert energy(half, state).terms == pytest.approx(before, rel=1e-12)


# --- L_o


@pytest.mark.parametrize(
    ("distance", "confidence", "cost"),
    [
        (0.05, 0.6, 0.0),  # sure, in sight
        (0.3, 0.2, 0.0081),  # .3^2 x .3^2
        (0.4, 0.0, 0.04),  # .5^2 x .4^2
        (2.0, 0.4, 0.04),  # .1^2 x 2^2
        (0.7, 0.5, 0.0),
        (-0.3, 0.2, 0.0),  # unsure and hidden
        (-0.3, 0.9, 0.0),  # sure and hidden: detectors are often sure of what they cannot see
    ],
)
def test_occlusion_cost_by_hand(distance: float, confidence: float, cost: float) -> None:
    assert occlusion_cost(distance, confidence) == pytest.approx(cost, abs=1e-15)


def distance_to_hidden(point: tuple[float, float, float], *rows: tuple[float, ...]) -> float:
    return float(hidden_distance(1.0, *point, *packed(*rows), np.empty(9)))


WALL = (0.0, 2.5, 1.0, 1.0, 0.5, 5.0, 0.0)
"""2 m wide, 2 to 3 m before a camera 1 m above the floor."""


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        ((2.0, 2.0, 1.0), 2 / np.sqrt(5)),  # to the plane x = y / 2, at (1.2, 2.4)
        ((0.2, 1.7, 1.0), 0.3),  # to the front
        ((0.9, 1.5, 1.0), 0.5),
        ((1.3, 1.6, 1.0), 0.5),  # to the front's edge at (1, 2)
        ((0.0, 2.5, 1.0), 0.0),  # inside
        ((1.9, 4.0, 1.0), 0.0),  # behind
        ((-2.4, 4.0, 1.0), 0.4 * 2 / np.sqrt(5)),
        ((9.0, 2.0, 1.0), CAP),
        ((0.0, -0.5, 1.0), CAP),  # behind the camera
    ],
)
def test_distance_to_what_a_wall_hides_by_hand(
    point: tuple[float, float, float], expected: float
) -> None:
    assert distance_to_hidden(point, WALL) == pytest.approx(expected, abs=1e-12)
    # From above, and of two walls the nearer.
    turned = (2.5, 0.0, 1.0, 1.0, 0.5, 5.0, np.pi / 2)
    assert distance_to_hidden((point[1], -point[0], point[2]), turned) == pytest.approx(
        expected, abs=1e-9
    )
    far = (-20.0, 20.0, 1.0, 0.1, 0.1, 0.1, 0.0)
    assert distance_to_hidden(point, far, WALL) == pytest.approx(expected, abs=1e-12)


def test_nothing_hides_nothing() -> None:
    assert distance_to_hidden((0.0, 4.0, 1.0)) == CAP


def test_distance_to_the_hidden_is_that_of_the_reference() -> None:
    rng, eye = np.random.default_rng(0), np.array([0.0, 0.0, 1.0])
    for _ in range(100):
        centre = rng.uniform((-3, 0.5, 0), (3, 5, 1.5))
        half, yaw = rng.uniform(0.05, 1, 3), rng.uniform(-3, 3)
        point = rng.uniform((-3, 0.5, 0), (3, 6, 2))
        found = distance_to_hidden(point, (*centre, *half, yaw))
        expected = paper_reference.visibility(eye, point, [paper_reference.Box(centre, half, yaw)])
        assert found == pytest.approx(expected, abs=2e-3)
        hidden = sight_clearance(eye, point, [(*centre, *half, yaw)]) < 0
        assert hidden == (found < 1e-9)


@pytest.mark.parametrize("confidence", [0.0, 0.3, 1.0])
def test_without_objects_every_unsure_joint_costs_the_cap(confidence: float) -> None:
    """The paper's distance to an empty volume is undefined."""
    problem = worlds.problem()
    result = energy(problem, empty_state(problem), confidence=confidence)
    expected = len(DETECTED) * max(0.5 - confidence, 0.0) ** 2 * CAP**2
    np.testing.assert_allclose(result.by_frame["occlusion"], expected)


def test_what_a_detector_lost_counts_as_unsure() -> None:
    problem = worlds.problem()
    used = problem.used.copy()
    used[4, [RANK, LANK]] = False
    result = energy(problem._replace(used=used), empty_state(problem), confidence=1.0)
    assert result.by_frame["occlusion"][4] == pytest.approx(2 * 0.25 * CAP**2)
    assert result.terms["occlusion"] == pytest.approx(2 * 0.25 * CAP**2)


def test_synthesised_joints_have_no_say() -> None:
    problem = worlds.problem()
    state = empty_state(problem).with_item(1, 5, AHEAD)
    plain, doubted = np.full((2, 20, 16), 0.9)
    doubted[:, [PELV, NECK]] = 0.1
    first, second = (paper_energy(problem._replace(confidences=c), state) for c in (plain, doubted))
    assert first.terms == second.terms


def test_a_couch_before_unsure_legs_pays_and_before_sure_ones_costs_nothing() -> None:
    problem = worlds.problem(6)
    confidences = np.ones((2, 6, 16))
    confidences[0][:, [RANK, LANK]] = 0.0

    def cost(sure: bool, yaw: float) -> float:
        state = empty_state(problem).with_item(1, 0, np.array([0.0, 4.0, yaw]))
        seen = problem._replace(confidences=confidences[int(sure)])
        return paper_energy(seen, state).terms["occlusion"]

    before, behind = 0.0, np.pi  # the couch stands .6 m at the person's back
    assert 0.0 < cost(False, behind) <= 12 * 0.25 * CAP**2
    assert cost(False, before) == 0.0
    assert cost(True, behind) == cost(True, before) == 0.0


# --- L_s


@pytest.mark.parametrize("placement", [AHEAD, np.array([0.4, 7.0, 2.0])])
def test_smoothness_is_the_squared_step_of_the_pelvis(placement: np.ndarray) -> None:
    problem = worlds.problem(6)
    drifting = energy(problem, empty_state(problem).with_item(2, 0, placement))
    np.testing.assert_allclose(drifting.by_frame["smoothness"], [0] + [0.05**2] * 5, atol=1e-15)
    still = energy(problem, empty_state(problem).with_item(1, 0, placement))
    assert still.terms["smoothness"] == pytest.approx(0.0, abs=1e-15)


def test_smoothness_ties_scenelets_to_each_other() -> None:
    problem = worlds.problem(12)
    state = (
        empty_state(problem).with_item(1, 0, AHEAD).with_item(1, 6, np.add(AHEAD, (0.3, 0.4, 0)))
    )
    result = energy(problem, state).by_frame["smoothness"]
    assert result[6] == pytest.approx(0.25)
    assert result.sum() == pytest.approx(0.25)


# --- L_c


SQUARE = (0.0, 0.0, 0.5, 0.5, 0.5, 0.5, 0.0)
"""A metre wide and deep."""
CHAIR, TABLE = 0, 1


def collision(*things: tuple[int, float, list[tuple[float, ...]]]) -> float:
    """L_c of objects: label, yaw and boxes of each."""
    owner = [(k, 0, label) for k, (label, _, rows) in enumerate(things) for _ in rows]
    yaws = [yaw for _, yaw, rows in things for _ in rows]
    boxes, turns = packed(*(row for _, _, rows in things for row in rows))
    return float(overlaps(boxes, turns, np.array(owner), np.array(yaws), 0.6))


def test_intersection_by_hand() -> None:
    """Depth in a square metre is a pyramid half a metre high: 1/6 m^3."""
    beside = (0.5, *SQUARE[1:])
    one = (CHAIR, 0.0, [SQUARE])
    assert collision(one, (TABLE, 0.0, [SQUARE])) == pytest.approx(2 / 6, rel=1e-2)
    # Half of each is in half of the other.
    assert collision(one, (TABLE, 0.0, [beside])) == pytest.approx(2 / 12, rel=1e-2)
    apart = (1.0, *SQUARE[1:])
    assert collision(one, (TABLE, 0.0, [apart])) == 0.0
    # Of three, every pair counts once.
    three = collision(one, (TABLE, 0.0, [SQUARE]), (2, 0.0, [SQUARE]))
    assert three == pytest.approx(3 * 2 / 6, rel=1e-2)
    # At another height: it is a matter of the floor plan.
    above = (*SQUARE[:2], 3.0, *SQUARE[3:])
    assert collision(one, (TABLE, 0.0, [above])) == pytest.approx(2 / 6, rel=1e-2)


@pytest.mark.parametrize(
    ("label", "yaw", "counts"),
    [(CHAIR, 0.0, False), (CHAIR, 0.5, False), (CHAIR, np.pi / 2, True), (TABLE, 0.0, True)],
)
def test_only_the_same_label_in_the_same_orientation_is_spared(
    label: int, yaw: float, counts: bool
) -> None:
    """Printed: labels differ *and* orientations differ, which would spare a chair in a table."""
    found = collision((CHAIR, 0.0, [SQUARE]), (label, yaw, [(*SQUARE[:6], yaw)]))
    assert (found > 0.1) == counts


def test_a_footprint_is_a_union() -> None:
    """What two cuboids of an object share is not counted twice."""
    once = collision((CHAIR, 0.0, [SQUARE]), (TABLE, 0.0, [SQUARE]))
    twice = collision((CHAIR, 0.0, [SQUARE, SQUARE]), (TABLE, 0.0, [SQUARE, SQUARE]))
    assert twice == pytest.approx(once)


# --- L_m


def in_square(pelvis: float, left: float, right: float, *rows: tuple[float, ...]) -> float:
    """L_m of a frame whose three joints are at these x, y = 0, among boxes."""
    joints = np.full((1, 3, 16), 50.0)
    joints[0, 1:] = 0.0
    joints[0, 0, [PELV, LKNE, RKNE]] = pelvis, left, right
    return float(depth_of_motion(joints, 0, *packed(*(rows or (SQUARE,)))))


def test_motion_by_hand() -> None:
    assert in_square(0.0, 0.2, -0.3) == pytest.approx(0.2)  # depths .5, .3, .2
    assert in_square(0.0, 0.2, 0.6) == 0.0  # who sits has a knee outside
    assert in_square(9.0, 9.0, 9.0) == 0.0  # the printed sign would reward this
    # Every joint asks for the object it is deepest in.
    other = (1.0, *SQUARE[1:])
    assert in_square(0.0, 0.9, 0.6, SQUARE, other) == pytest.approx(0.1)
    assert float(depth_of_motion(np.zeros((1, 3, 16)), 0, *packed())) == 0.0


def test_signed_distance_by_hand() -> None:
    (box,), (turn,) = packed((1.0, 0.0, 0.5, 1.0, 0.25, 0.5, 0.0))
    for x, y, expected in ((1.0, 0.0, -0.25), (1.9, 0.0, -0.1), (2.3, 0.65, 0.5), (1.0, 1.0, 0.75)):
        assert signed_distance(x, y, box, turn) == pytest.approx(expected)


def test_furniture_counts_while_it_is_in_use() -> None:
    problem = worlds.problem(span=0.0, scenelets=standing_on(worlds.couch()))
    state = empty_state(problem).with_item(0, 7, AHEAD)
    cost = energy(problem, state).by_frame["motion"]
    # The knees are .4 m before the edge of a couch .8 m deep, and stand in its middle.
    np.testing.assert_allclose(cost[7:13], 0.4)
    assert (cost > 0.3).all()


# --- All of it


@pytest.mark.parametrize("seed", range(6))
def test_every_term_is_that_of_the_reference(seed: int) -> None:
    rng, problem = np.random.default_rng(seed), worlds.problem(14, seed=seed)
    state = empty_state(problem)
    for scenelet, start in ((0, 0), (2, 7)):
        placement = np.array([0.0, 4.0, 0.0]) + rng.uniform((-1, -1, -3), (1, 1, 3))
        state = state.with_item(scenelet, start, placement, 0.1 * rng.uniform(-1, 1))
    state = replace(state, camera=state.camera + 0.05 * rng.uniform(-1, 1, 5))
    used = problem.used & (rng.random(problem.used.shape) > 0.1)
    problem = problem._replace(confidences=rng.random(problem.used.shape), used=used)
    expected = paper_reference.reference(
        problem, worlds.library(), state_camera(worlds.CAMERA, state), state
    )
    found = paper_energy(problem, state, weights=ALL_ONE).terms
    for name, value in expected.items():
        tolerance = {"collision": 2e-2, "occlusion": 2e-3}.get(name, 1e-9)
        assert found[name] == pytest.approx(value, rel=tolerance, abs=1e-3 * tolerance), name


@settings(max_examples=20)
@given(
    shift=st.tuples(st.floats(-5, 5), st.floats(-5, 5)),
    turn=st.floats(-7, 7),
    apart=st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-3, 3)),
)
def test_the_world_has_no_preferred_place(
    shift: tuple[float, float], turn: float, apart: tuple[float, float, float]
) -> None:
    """Smoothness and intersections stay when everything is moved together on the floor."""
    problem = worlds.problem(12)
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    first, second = np.zeros(3), np.array(apart)
    costs = []
    for a, b in ((first, second), (first @ rotation, second @ rotation)):
        moved = np.array([*shift, turn]) if a is not first else 0.0
        state = empty_state(problem).with_item(0, 0, a + moved).with_item(2, 6, b + moved)
        values = energy(problem, state).terms
        costs.append([values[name] for name in ("smoothness", "collision", "motion")])
    np.testing.assert_allclose(costs[0], costs[1], atol=1e-9)


def test_terms_are_weighted_and_add_up() -> None:
    problem = worlds.problem()
    state = empty_state(problem).with_item(0, 2, AHEAD)
    state = state.with_item(2, 10, np.array([0.2, 3.5, 0.1]))
    bare = energy(problem, state, confidence=0.2)
    assert all(value > 1e-3 for value in bare.terms.values())
    weights = PaperWeights(2.0, 3.0, 5.0, 7.0, 11.0)
    weighted = energy(problem, state, confidence=0.2, weights=weights)
    factors = {"reprojection": 2, "occlusion": 3, "smoothness": 5, "collision": 7, "motion": 11}
    expected = {k: f * bare.terms[k] for k, f in factors.items()}
    assert weighted.terms == pytest.approx(expected)
    assert weighted.total == pytest.approx(sum(weighted.terms.values()))
    by_frame = {name: values.sum() for name, values in weighted.by_frame.items()}
    assert by_frame == pytest.approx({k: weighted.terms[k] for k in factors if k != "collision"})


def test_default_weights_are_those_of_the_released_program() -> None:
    problem = worlds.problem()
    state = empty_state(problem).with_item(0, 2, AHEAD)
    bare, default = energy(problem, state), energy(problem, state, weights=None)
    assert default.total == pytest.approx(
        bare.terms["reprojection"] + bare.terms["occlusion"] + 0.05 * bare.terms["smoothness"]
        + bare.terms["collision"] + 0.5 * bare.terms["motion"]
    )  # fmt: skip


@pytest.mark.parametrize("confidence", [0.0, 1.0])
@pytest.mark.parametrize(
    "placement", [(0.0, 4.0, 0.0), (0.0, -2.0, 1.0), (0.0, 0.0, 0.0), (50.0, 80.0, 9.0)]
)
def test_finite_in_odd_places(placement: tuple[float, float, float], confidence: float) -> None:
    """Behind the camera, around it, far away; two scenelets with coincident objects."""
    problem = worlds.problem()
    state = empty_state(problem)
    state = state.with_item(0, 2, np.array(placement)).with_item(2, 10, np.array(placement))
    result = energy(problem, state, confidence=confidence)
    assert np.isfinite(list(result.terms.values())).all()
    assert min(result.terms.values()) >= 0
    assert result.terms["collision"] > 0.3


def test_finite_for_no_objects_no_detections_and_one_frame() -> None:
    bare = worlds.problem(scenelets=worlds.library(objects=False))
    nothing_seen = bare._replace(used=np.zeros_like(bare.used))
    state = empty_state(bare).with_item(0, 2, AHEAD)
    assert energy(bare, state).terms["collision"] == 0.0
    unseen = energy(nothing_seen, state).terms
    assert unseen["reprojection"] == 0.0
    assert unseen["occlusion"] == pytest.approx(20 * len(DETECTED) * 0.25 * CAP**2)
    alone = one_frame(worlds.problem())
    result = energy(alone, empty_state(alone))
    assert result.terms["smoothness"] == 0.0
    assert np.isfinite(result.total)
    assert result.by_frame["reprojection"].shape == (1,)


def test_impossible_states_cost_infinitely_much() -> None:
    problem = worlds.problem()
    state = empty_state(problem)
    overlapping = state.with_item(0, 3, AHEAD).with_item(1, 8, AHEAD)
    below = replace(state, camera=state.camera * (1, 0, 1, 1, 1))
    for impossible in (overlapping, state.with_item(0, 15, AHEAD), below):
        result = energy(problem, impossible)
        assert result.total == np.inf
        assert result.total == np.inf
        assert set(result.terms) == {f.name for f in fields(PaperWeights)}
        assert set(result.by_frame) == set(result.terms) - {"collision"}


def test_it_can_be_sampled_from() -> None:
    """The preset's log-posterior: priors as ever, and so many nats a unit of energy."""
    default = worlds.problem()
    problem = worlds.problem(settings=ModelSettings(energy="paper", paper_nats=30.0))
    state = empty_state(problem).with_item(0, 2, AHEAD, 0.02).with_item(2, 10, AHEAD + 0.3)
    found, before = terms(problem, state), terms(default, state)
    for name in ("camera", "assignment", "placement", "path"):
        assert found[name] == before[name]
    published = paper_energy(problem, state)
    for name, value in published.terms.items():
        assert found[name] == pytest.approx(-30.0 * value), name
    assert log_posterior(problem, state) == pytest.approx(sum(found.values()))
    assert published.terms == paper_energy(default, state).terms


def test_the_preset_has_one_evaluation_and_a_name() -> None:
    problem = worlds.problem(settings=ModelSettings(energy="paper"))
    with pytest.raises(ValueError, match="no incremental"):
        Incremental(problem, empty_state(problem))
    with pytest.raises(InputError, match="default or paper"):
        ModelSettings(energy="papers")
