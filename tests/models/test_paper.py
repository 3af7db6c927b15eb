"""The published energy: known values, mended misprints, and finite everywhere."""

from __future__ import annotations

from dataclasses import fields, replace

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from imapper_prob.models.batched.tensors import to_tensors
from imapper_prob.models.energy.paper import SURE_BUT_HIDDEN, PaperWeights, occlusion_cost
from imapper_prob.models.errors import InputError
from imapper_prob.models.geometry import NOTHING_IN_SIGHT
from imapper_prob.models.incremental import Incremental
from imapper_prob.models.paper_energy import PaperEnergy, paper_energy
from imapper_prob.models.posterior import State, empty_state, log_posterior, motion, terms
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import SceneObject
from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.models.settings import ModelSettings
from imapper_prob.models.skeleton import DETECTED, LANK, LWRI, NECK, PELV, RANK
from tests.models import worlds

ALL_ONE = PaperWeights(1.0, 1.0, 1.0, 1.0, 1.0)
AHEAD = np.array([0.0, 4.0, 0.0])
CAP = NOTHING_IN_SIGHT
CLEARANCE = st.floats(0.0, 3.0)
CONFIDENCE = st.floats(0.0, 1.0)


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


def one_frame(problem: Problem) -> Problem:
    """The problem of the first frame alone; no scenelet fits in it."""
    by_frame = (
        "keypoints", "used", "confidence_density", "error_scale", "error_dof",
        "path_centre", "path_scale", "path_starts", "lift", "poses", "path_facing", "free_cost",
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


def test_occlusion_cost_at_known_places() -> None:
    assert occlusion_cost(0.05, 0.0) == pytest.approx(0.05)
    assert occlusion_cost(0.05, 0.6) == pytest.approx(0.02)
    assert occlusion_cost(9.0, 0.0) == CAP
    assert occlusion_cost(-0.05, 1.0) == pytest.approx(0.05 * SURE_BUT_HIDDEN)
    assert occlusion_cost(-9.0, 1.0) == pytest.approx(CAP * SURE_BUT_HIDDEN)


@given(clearance=CLEARANCE, confidence=CONFIDENCE)
def test_occlusion_cost_is_asymmetric_and_bounded(clearance: float, confidence: float) -> None:
    in_the_open = occlusion_cost(clearance, confidence)
    hidden = occlusion_cost(-clearance, confidence)
    assert 0 <= hidden <= CAP * SURE_BUT_HIDDEN
    assert 0 <= in_the_open <= CAP
    # What fits costs nothing; a sure joint that is hidden costs less than the opposite.
    assert occlusion_cost(clearance, 1.0) == 0 == occlusion_cost(-clearance, 0.0)
    opposite = occlusion_cost(clearance, 1 - confidence)
    assert hidden == pytest.approx(SURE_BUT_HIDDEN * opposite, abs=1e-12)


@given(
    clearances=st.tuples(st.floats(-3, 3), st.floats(-3, 3)),
    confidences=st.tuples(CONFIDENCE, CONFIDENCE),
)
def test_occlusion_cost_is_monotone(
    clearances: tuple[float, float], confidences: tuple[float, float]
) -> None:
    near, far = sorted(clearances, key=abs)
    if near * far > 0:
        assert occlusion_cost(near, confidences[0]) <= occlusion_cost(far, confidences[0])
    low, high = sorted(confidences)
    outside = abs(clearances[0])
    assert occlusion_cost(outside, high) <= occlusion_cost(outside, low)
    assert occlusion_cost(-outside, high) >= occlusion_cost(-outside, low)


def test_a_sure_hidden_joint_costs_less_than_an_unsure_one_in_the_open() -> None:
    """On i3DB confidences below .5 speak for hidden by 1.3 nats, those above for seen by .6."""
    assert pytest.approx(0.6 / 1.3, abs=0.06) == SURE_BUT_HIDDEN


@pytest.mark.parametrize("confidence", [0.0, 0.3, 1.0])
def test_without_objects_every_unsure_joint_costs_the_cap(confidence: float) -> None:
    """The paper's distance to an empty volume is undefined."""
    problem = worlds.problem()
    result = energy(problem, empty_state(problem), confidence=confidence)
    expected = len(DETECTED) * (1 - confidence) * CAP
    np.testing.assert_allclose(result.by_frame["occlusion"], expected)


def test_what_a_detector_lost_counts_as_unsure() -> None:
    problem = worlds.problem()
    used = problem.used.copy()
    used[4, [RANK, LANK]] = False
    result = energy(problem._replace(used=used), empty_state(problem), confidence=1.0)
    assert result.by_frame["occlusion"][4] == pytest.approx(2 * CAP)
    assert result.terms["occlusion"] == pytest.approx(2 * CAP)


def test_synthesised_joints_have_no_say() -> None:
    problem = worlds.problem()
    state = empty_state(problem).with_item(1, 5, AHEAD)
    plain, doubted = np.full((2, 20, 16), 0.9)
    doubted[:, [PELV, NECK]] = 0.1
    first, second = (paper_energy(problem._replace(confidences=c), state) for c in (plain, doubted))
    assert first.terms == second.terms


def test_a_couch_before_unsure_legs_pays_and_before_sure_ones_costs() -> None:
    problem = worlds.problem(6)
    confidences = np.ones((2, 6, 16))
    confidences[0][:, [RANK, LANK]] = 0.0

    def cost(sure: bool, yaw: float) -> float:
        state = empty_state(problem).with_item(1, 0, np.array([0.0, 4.0, yaw]))
        seen = problem._replace(confidences=confidences[int(sure)])
        return paper_energy(seen, state).terms["occlusion"]

    before, behind = 0.0, np.pi  # the couch stands .6 m at the person's back
    assert cost(False, behind) == pytest.approx(12 * CAP)
    assert cost(False, before) < 0.5 * cost(False, behind)
    assert cost(True, behind) == pytest.approx(0.0)
    assert cost(True, before) > 0.1


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


def test_collision_is_the_depth_of_objects_in_each_other() -> None:
    """A chair .7 m before a couch, of the same parts (.8 m deep seats, backs at .35 m)."""
    problem = worlds.problem()
    state = empty_state(problem).with_item(0, 2, AHEAD)
    # The couch is at (0, -.6) of its scenelet, the chair at (.2, -.6).
    state = state.with_item(2, 10, np.add(AHEAD, (-0.2, 0.7, 0.0)))
    in_seat, back_in_seat = 0.4 + 0.4 - 0.7, 0.4 + 0.075 - 0.35
    collision = energy(problem, state).terms["collision"]
    assert collision == pytest.approx(in_seat + back_in_seat)
    exact = terms(problem._replace(furniture_spread=0.0), state)["collision"]
    assert collision == pytest.approx(-exact / problem.collision_cost)
    # Pieces that may each be .2 m off are apart at two of the nodes of (15), one time in four.
    assert -terms(problem, state)["collision"] == pytest.approx(-np.log(0.25), abs=1e-2)


def test_one_object_seen_twice_does_not_collide() -> None:
    problem = worlds.problem()
    once = empty_state(problem).with_item(0, 2, AHEAD)
    assert energy(problem, once.with_item(1, 10, AHEAD)).terms["collision"] == 0.0
    turned = np.add(AHEAD, (0.0, 0.0, 2.0))  # another couch, then
    assert energy(problem, once.with_item(1, 10, turned)).terms["collision"] > 0.1


# --- L_m


def test_walking_through_furniture_costs_and_walking_far_from_it_is_not_rewarded() -> None:
    """The printed L_m adds signed distances; its negative part is meant."""
    problem = worlds.problem(12)
    state = empty_state(problem).with_item(0, 0, AHEAD)  # its couch is at (0, 3.4)
    inside = state.with_item(1, 6, np.array([0.0, 3.4, 0.0]))
    result = energy(problem, inside)
    # Shins stand in a seat of 1.6 x .8 m, .338 m below its top, .4 m from its nearest side.
    np.testing.assert_allclose(result.by_frame["motion"], [0] * 6 + [0.338] * 6)
    exact = terms(problem._replace(furniture_spread=0.0), inside)["motion"]
    per_metre = problem.motion_cost * problem.frame_weight
    assert result.terms["motion"] == pytest.approx(-exact / per_metre)
    for far in (6.0, 60.0):
        away = state.with_item(1, 6, np.array([0.0, far, 0.0]))
        assert energy(problem, away).terms["motion"] == 0.0


def test_a_scenelet_uses_its_objects_only_while_it_lasts() -> None:
    """With the printed max(t, n_l) in eta_t it would cover every later frame too."""
    problem = worlds.problem(span=0.0, scenelets=standing_on(worlds.couch()))
    state = empty_state(problem).with_item(0, 7, AHEAD)
    cost = energy(problem, state).by_frame["motion"]
    covered = np.zeros(20, bool)
    covered[7:13] = True
    assert (cost[covered] == 0).all()
    assert (cost[~covered] > 0.2).all()


# --- All of it


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
    bare = energy(problem, state)
    assert all(value > 0.01 for value in bare.terms.values())
    weighted = energy(problem, state, weights=PaperWeights(2.0, 3.0, 5.0, 7.0, 11.0))
    factors = {"reprojection": 2, "occlusion": 3, "smoothness": 5, "collision": 7, "motion": 11}
    assert weighted.terms == pytest.approx({k: f * bare.terms[k] for k, f in factors.items()})
    assert weighted.total == pytest.approx(sum(weighted.terms.values()))
    assert weighted.log_density == -weighted.total
    by_frame = {name: values.sum() for name, values in weighted.by_frame.items()}
    assert by_frame == pytest.approx({k: weighted.terms[k] for k in factors if k != "collision"})


def test_default_weights_are_those_of_the_released_program() -> None:
    problem = worlds.problem()
    state = empty_state(problem).with_item(0, 2, AHEAD)
    bare, default = energy(problem, state), energy(problem, state, weights=None)
    assert default.total == pytest.approx(
        bare.terms["reprojection"] + bare.terms["occlusion"] + 0.05 * bare.terms["smoothness"]
        + 20 * bare.terms["collision"] + 10 * bare.terms["motion"]
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
    assert result.terms["collision"] > 0.5


def test_finite_for_no_objects_no_detections_and_one_frame() -> None:
    bare = worlds.problem(scenelets=worlds.library(objects=False))
    nothing_seen = bare._replace(used=np.zeros_like(bare.used))
    state = empty_state(bare).with_item(0, 2, AHEAD)
    assert energy(bare, state).terms["collision"] == 0.0
    unseen = energy(nothing_seen, state).terms
    assert unseen["reprojection"] == 0.0
    assert unseen["occlusion"] == pytest.approx(20 * len(DETECTED) * CAP)
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
        assert result.log_density == -np.inf
        assert set(result.terms) == {f.name for f in fields(PaperWeights)}
        assert set(result.by_frame) == set(result.terms) - {"collision"}


def test_it_can_be_sampled_from() -> None:
    """The preset's log-posterior: priors as ever, and so many nats a unit of energy."""
    default = worlds.problem()
    problem = worlds.problem(settings=ModelSettings(energy="paper", paper_nats=30.0))
    state = empty_state(problem).with_item(0, 2, AHEAD, 0.02).with_item(2, 10, AHEAD + 0.3)
    found, before = terms(problem, state), terms(default, state)
    for name in ("camera", "layout", "placement", "path"):
        assert found[name] == before[name]
    published = paper_energy(problem, state)
    for name, value in published.terms.items():
        assert found[name] == pytest.approx(-30.0 * value), name
    assert log_posterior(problem, state) == pytest.approx(sum(found.values()))
    assert published.terms == paper_energy(default, state).terms


def test_the_preset_has_one_executor_and_a_name() -> None:
    problem = worlds.problem(settings=ModelSettings(energy="paper"))
    with pytest.raises(ValueError, match="no incremental"):
        Incremental(problem, empty_state(problem))
    with pytest.raises(ValueError, match="no batched"):
        to_tensors(problem)
    with pytest.raises(InputError, match="default or paper"):
        ModelSettings(energy="papers")
