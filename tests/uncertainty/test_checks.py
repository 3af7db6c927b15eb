"""Checks of a result: each is alarmed by what it is for, and by nothing that is right."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from imapper_prob.models.calibrated import calibrated
from imapper_prob.models.log_posterior import State
from imapper_prob.models.problem import Problem, pack_problem
from imapper_prob.models.scene import Clip
from imapper_prob.models.skeleton import LKNE, PELV, RKNE, THRX
from imapper_prob.solver.detections import elsewhere_frames
from imapper_prob.solver.fits import Fits, best_fits
from imapper_prob.uncertainty.checks import (
    Check,
    alarms,
    camera,
    checks_of,
    elsewhere,
    from_json,
    height,
    named,
    prediction,
    resemblance,
    slope,
    to_json,
    upright,
)
from imapper_prob.uncertainty.summary import check_table, describe
from lab.prior import draw_state
from tests.models import worlds
from tests.models.worlds import CAMERA
from tests.runs import small_posterior

PHI = worlds.camera_prior().mean
FRAMES = 120


def away_and_back(n_frames: int = FRAMES) -> np.ndarray:
    """(T, 16, 3) joints in the world of somebody who walks from 3 m to 7 m and back."""
    joints = np.array(worlds.walk(n_frames))
    joints[..., 1] += (2.0 * np.sin(np.linspace(0, 6, n_frames)) + 1.0)[:, None]
    return joints


def seen(joints: np.ndarray) -> tuple[Clip, Problem]:
    """The clip of these joints, and its problem with a path that knows them."""
    clip = worlds.clip_of(joints, np.random.default_rng(0))
    path = worlds.path_of(joints)
    return clip, pack_problem(clip, path, worlds.camera_prior(), worlds.library())


CLIP, PROBLEM = seen(away_and_back())


def cameras(*, pitch: float = 0.0, elevation: float = 1.0, roll: float = 0.0) -> np.ndarray:
    """(30, 5) draws of a camera about the true one, turned by degrees and raised by a factor."""
    rng = np.random.default_rng(1)
    draws = PHI + np.array([0.01, 0.02, 0.02, 0.02, 0.005]) * rng.standard_normal((30, 5))
    draws[:, 0] += np.radians(pitch)
    draws[:, 1] *= elevation
    draws[:, 4] += np.radians(roll)
    return draws


def test_nothing_is_alarmed_by_the_right_camera() -> None:
    draws = cameras()
    for check in (
        upright(CLIP, PROBLEM, draws),
        height(PROBLEM, draws, fps=CLIP.fps),
        slope(PROBLEM, draws, fps=CLIP.fps),
        camera(CLIP.camera, draws),
    ):
        assert not check.alarmed, check
        assert abs(check.value) < 0.6 * check.limit
        assert alarms([check]) == ()


@pytest.mark.parametrize("pitch", [-45.0, -30.0, 30.0, 45.0])
def test_people_who_lean_with_the_world_alarm(pitch: float) -> None:
    check = upright(CLIP, PROBLEM, cameras(pitch=pitch))
    assert check.alarmed
    assert check.value == pytest.approx(abs(pitch), abs=3.0)
    assert "camera cannot be right" in check.sentence
    assert "--pitch" in check.sentence
    assert upright(CLIP, PROBLEM, cameras(roll=pitch)).alarmed


def test_a_body_upside_down_is_called_that() -> None:
    track = CLIP.tracks[0]
    clip = replace(CLIP, tracks=(replace(track, poses=track.poses * [1.0, 1.0, -1.0]),))
    check = upright(clip, PROBLEM, cameras())
    assert check.alarmed
    assert "upside down" in check.sentence


def test_who_sits_or_bends_does_not_speak_of_the_vertical() -> None:
    track = CLIP.tracks[0]
    for joints in ([RKNE, LKNE], [THRX]):
        poses = np.array(track.poses)
        ahead = np.linalg.norm(poses[:, joints], axis=-1)
        poses[:, joints] = 0.0
        poses[:, joints, 1] = ahead
        sitting = replace(CLIP, tracks=(replace(track, poses=poses),))
        check = upright(sitting, PROBLEM, cameras(pitch=45.0))
        assert math.isnan(check.value)
        assert not check.alarmed
    # Who lies for half of the clip is on their feet in the other half.
    poses = np.array(track.poses)
    poses[: FRAMES // 2] = poses[: FRAMES // 2][..., [2, 1, 0]]
    assert not upright(
        replace(CLIP, tracks=(replace(track, poses=poses),)), PROBLEM, cameras()
    ).alarmed


@pytest.mark.parametrize(("by", "word"), [(0.6, "float above"), (-0.6, "below")])
def test_feet_off_the_floor_alarm(by: float, word: str) -> None:
    check = height(PROBLEM, cameras(elevation=1 + by / 1.5), fps=CLIP.fps)
    assert check.alarmed
    assert check.value == pytest.approx(by, abs=0.1)
    assert word in check.sentence


def test_unseen_feet_say_nothing() -> None:
    unseen = PROBLEM._replace(used=np.zeros_like(PROBLEM.used))
    for check in (height, slope):
        said = check(unseen, cameras(elevation=3.0, pitch=40.0), fps=CLIP.fps)
        assert math.isnan(said.value)
        assert not said.alarmed


@pytest.mark.parametrize(("pitch", "word"), [(15.0, "15° lower"), (-15.0, "15° higher")])
def test_a_floor_that_slopes_alarms_and_says_by_how_much(pitch: float, word: str) -> None:
    check = slope(PROBLEM, cameras(pitch=pitch), fps=CLIP.fps)
    assert check.alarmed
    assert word in check.sentence


def test_a_slope_is_no_alarm_of_who_stays_at_one_distance() -> None:
    _, problem = seen(worlds.walk(FRAMES))
    assert not slope(problem, cameras(pitch=15.0), fps=10.0).alarmed


@pytest.mark.parametrize("moved", [{"pitch": 15.0}, {"elevation": 3.0}, {"elevation": 1 / 3}])
def test_a_camera_that_is_not_where_it_was_said_to_be_alarms(moved: dict[str, float]) -> None:
    check = camera(CLIP.camera, cameras(**moved))
    assert check.alarmed
    assert f"{CLIP.camera.elevation:.2f} m" in check.sentence
    near = camera(CLIP.camera, cameras(pitch=5.0, elevation=1.2))
    assert not near.alarmed
    assert f"{CLIP.camera.elevation:.2f} m" in near.sentence
    assert "near enough" in near.sentence


def test_no_angle_of_the_camera_is_less_than_nothing() -> None:
    level = replace(CLIP.camera, pitch=-0.001, roll=-0.002)
    check = camera(level, np.tile([-0.003, level.elevation, 0.0, 0.0, -0.001], (9, 1)))
    assert "-0°" not in check.sentence
    assert "a pitch of 0° and a roll of 0°" in check.sentence


def predicted(seed: int, *, moved: float = 0.0, nats: float = 0.0) -> Check:
    """Of detections drawn from a scene with scenelets, then moved by pixels."""
    rng = np.random.default_rng(seed)
    experiment = worlds.experiment(30)
    problem = experiment.problem
    state = draw_state(rng, problem)
    while not state.n_scenelets:
        state = draw_state(rng, problem)
    observed = experiment.observed(rng, state).problem
    observed = observed._replace(
        keypoints=observed.keypoints + moved, stays=np.array([[0.0, 30.0, nats]])
    )
    observed = observed._replace(lowered=np.zeros_like(observed.lowered))
    return prediction(observed, [state], CAMERA, rng=rng)


def test_detections_of_the_model_are_predicted_as_often_as_said() -> None:
    """The probability is even, for the data are the model's; it was doubled, to 1 at most."""
    values = np.array([predicted(seed).value / 2 for seed in range(80)])
    assert np.mean(values) == pytest.approx(0.375, abs=0.08)
    assert np.mean(values < 0.25) == pytest.approx(0.25, abs=0.15)
    assert np.mean(values < 0.05) < 0.13


def test_detections_elsewhere_are_not_predicted() -> None:
    check = predicted(1, moved=150.0)
    assert check.alarmed
    assert "joints" in check.sentence


def test_somebody_on_air_is_not_predicted() -> None:
    assert not predicted(1, nats=2.0).alarmed
    check = predicted(1, nats=9.0)
    assert check.alarmed
    assert check.value == pytest.approx(2 * math.exp(-9.0))
    assert "off their feet" in check.sentence


def test_what_the_library_does_not_know_alarms() -> None:
    known = np.random.default_rng(0).normal(-0.3, 0.2, 200)
    assert not resemblance(known, fps=10.0).alarmed
    strange = np.array(known)
    strange[:120] += 3.0
    check = resemblance(strange, fps=10.0)
    assert check.alarmed
    assert check.value == pytest.approx(0.6)
    assert "60 % of the clip" in check.sentence
    # Such frames come together: a little more than a third of 13 s is nothing rare.
    third = np.where(np.arange(130) < 46, 2.0, -0.3)
    assert not resemblance(third, fps=10.0).alarmed
    # In a second nothing is proved, and frames of which nothing is known do not count.
    assert not resemblance(strange[110:128], fps=10.0).alarmed
    strange[:120] = np.nan
    assert not resemblance(strange, fps=10.0).alarmed
    nothing = resemblance(np.full(20, np.nan), fps=10.0)
    assert math.isnan(nothing.value)
    assert not nothing.alarmed


def test_a_best_fit_is_counted_from_what_the_right_one_costs() -> None:
    """Costs that are drawn of the errors themselves are 0 on average, in all frames covered."""
    rng = np.random.default_rng(3)
    problem = PROBLEM
    depth = np.exp(problem.path_centre[:, 1])
    loose = problem.fx * problem.pose_tolerance / depth[:, None]
    variance = problem.error_scale[..., 1] ** 2 + loose**2
    dof = problem.error_dof[..., 1]
    squared = np.expm1(-2 / dof * np.log1p(-rng.random(dof.shape)))
    each = np.log(variance) + (dof / 2 + 1) * np.log1p(squared)
    weight = problem.used * problem.confidence_density.argmax(-1)
    centres = np.arange(3, FRAMES - 2)
    length = int(problem.lengths[0])
    frames = centres[:, None] - length // 2 + np.arange(length)
    right = (each * weight)[frames].sum((1, 2)) / weight[frames].sum((1, 2))
    cost = np.stack([right + 5.0, right, right + 9.0], -1)
    found = best_fits(problem, Fits(centres, np.zeros((len(centres), 3, 3)), cost))
    assert np.isfinite(found).all()
    # The best of the windows over each frame, so a little below.
    assert -0.5 < found.mean() < 0.0
    worse = best_fits(problem, Fits(centres, np.zeros((len(centres), 3, 3)), cost + 2.0))
    np.testing.assert_allclose(worse, found + 2.0)
    cost[:50] = np.inf
    used = np.array(problem.used)
    used[100] = False
    found = best_fits(problem._replace(used=used), Fits(centres, np.zeros((1, 3, 3)), cost))
    assert np.isnan(found[[0, 40, 100]]).all()
    assert np.isfinite(found[[60, 99, 101]]).all()


def spoiled(frames: slice) -> Clip:
    """The clip with all detections of some frames 700 pixels aside."""
    track = CLIP.tracks[0]
    points = np.array(track.keypoints)
    points[frames] += (-700.0, -200.0)
    return replace(CLIP, frame_ids=CLIP.frame_ids + 5, tracks=(replace(track, keypoints=points),))


def test_frames_elsewhere_are_named() -> None:
    assert not elsewhere(CLIP, elsewhere_frames(CLIP)).alarmed
    clip = spoiled(slice(60, 72))
    away = elsewhere_frames(clip)
    assert away[0].sum() == 12
    check = elsewhere(clip, away)
    assert check.alarmed
    assert check.value == 12
    assert "frames 65-76:" in check.sentence
    assert named([12, 13, 14, 70]) == "12-14, 70"
    assert named([]) == "none"


def test_checks_survive_as_text() -> None:
    checks = (
        Check("a", 1.5, 2.0, False, "Fine – 1°."),
        Check("b", math.nan, math.nan, True, 'Not "fine".'),
    )
    text = to_json(checks)
    assert "NaN" not in text
    first, second = from_json(text)
    assert first == checks[0]
    assert (second.name, second.alarmed, second.sentence) == ("b", True, 'Not "fine".')
    assert math.isnan(second.value)
    assert alarms(checks) == ('Not "fine".',)
    assert check_table(checks).row_count == 2


def test_a_path_is_the_pelvis(rng: np.random.Generator) -> None:
    """Heights are those of the world that the joints were made in."""
    joints = away_and_back()
    _, problem = seen(joints)
    lower = joints[..., 2].min(1) - calibrated("ankle.height")
    value = height(problem, np.tile(PHI, (2, 1)), fps=10.0).value
    assert value == pytest.approx(float(np.median(lower)), abs=0.02)
    assert problem.poses[:, PELV].max() == 0.0


def test_a_recording_says_alarms_first() -> None:
    from types import SimpleNamespace

    samples = SimpleNamespace(shape=(2, 3), walked=None)
    told = describe(CLIP, samples, verdict="Good.", alarms=["It cannot be."])  # type: ignore[arg-type]
    assert told.startswith("**It cannot be.**")
    assert "Good." in told


def test_checks_are_of_all_draws() -> None:
    run = small_posterior()
    problem, states = run.solution.problem, run.samples.states

    def found(drawn: list[State]) -> dict[str, Check]:
        made = checks_of(
            run.clip, problem, drawn, run.solution.best_fits, rng=np.random.default_rng(0)
        )
        return {check.name: check for check in made}

    def pitched(state: State, by: float) -> State:
        camera = state.camera + np.array([by, 0.0, 0.0, 0.0, 0.0])
        return replace(state, camera=camera)

    right = found(list(states))
    assert not right["camera"].alarmed
    assert not right["upright"].alarmed
    wrong = found([pitched(state, 0.7) for state in states])
    assert wrong["camera"].alarmed
    assert wrong["upright"].alarmed
    # Half of the draws, the later ones, count as much as the others.
    half = len(states) // 2
    partly = found([*states[:half], *(pitched(state, 0.7) for state in states[half:])])
    assert right["camera"].value < partly["camera"].value < wrong["camera"].value
    # Frames whose detections the problem lacks are those in which the detector was elsewhere.
    used = problem.used.copy()
    used[10:14] = False
    problem = problem._replace(used=used)
    assert right["elsewhere"].value == 0
    assert found(list(states))["elsewhere"].value == 4
