"""The log-posterior: finite where it should be, and a density."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import dblquad
from scipy.stats import norm

from imapper_prob.models.errors import InputError
from imapper_prob.models.log_posterior import State, empty_state, log_posterior, motion, terms
from imapper_prob.models.problem import pack_problem, resample
from imapper_prob.models.settings import ModelSettings
from tests.models import worlds

AHEAD = np.array([0.0, 4.0, 0.0])


def test_joints_of_free_frames_stand_on_the_measured_path() -> None:
    problem = worlds.problem()
    joints = motion(problem, empty_state(problem))
    # Smoothing draws the ends of a walk towards its middle.
    assert np.abs(joints - worlds.walk(20)).max() < 0.15


def test_a_scenelet_poses_its_frames() -> None:
    problem = worlds.problem()
    placement = np.array([0.3, 3.0, np.pi / 2])
    state = empty_state(problem).with_item(1, 5, placement)
    joints = motion(problem, state)
    local = worlds.library()[1].joints
    expected = np.stack([0.3 - local[..., 1], 3.0 + local[..., 0], local[..., 2]], -1)
    np.testing.assert_allclose(joints[5:11], expected, atol=1e-12)


def test_overlapping_or_protruding_scenelets_are_outside_the_support() -> None:
    problem = worlds.problem()
    one = empty_state(problem).with_item(0, 3, AHEAD)
    assert np.isfinite(log_posterior(problem, one))
    assert log_posterior(problem, one.with_item(1, 8, AHEAD)) == -np.inf
    assert np.isfinite(log_posterior(problem, one.with_item(1, 9, AHEAD)))
    assert log_posterior(problem, empty_state(problem).with_item(0, 15, AHEAD)) == -np.inf
    assert log_posterior(problem, empty_state(problem).with_item(0, -1, AHEAD)) == -np.inf


def test_terms_add_up_and_are_finite_in_odd_places() -> None:
    problem = worlds.problem()
    state = empty_state(problem)
    for placement in (AHEAD, [0.0, -2.0, 1.0], [0.0, 0.0, 0.0], [50.0, 80.0, 9.0]):
        placed = state.with_item(0, 2, np.array(placement)).with_item(0, 10, np.array(placement))
        values = terms(problem, placed)
        assert np.isfinite(list(values.values())).all(), (placement, values)
        assert log_posterior(problem, placed) == pytest.approx(sum(values.values()))


def test_one_frame_and_no_detection_are_finite() -> None:
    joints = worlds.walk(8)
    clip = worlds.clip_of(joints, np.random.default_rng(0))
    blind = worlds.Track(
        "blind", np.full((8, 16, 2), np.nan), np.zeros((8, 16)), clip.tracks[0].poses,
        np.zeros(8, bool),
    )  # fmt: skip
    path = worlds.path_of(joints)
    path = worlds.StaticPath(path.estimate, path.lift, path.deviation, path.poses, path.posed)
    clip = worlds.Clip("blind", worlds.CAMERA, 10.0, np.arange(8), (blind,))
    problem = worlds.pack_problem(clip, path, worlds.camera_prior(), worlds.library())
    state = empty_state(problem).with_item(0, 1, AHEAD)
    values = terms(problem, state)
    assert values["detections"] == pytest.approx(0.0, abs=1e-12)
    assert np.isfinite(sum(values.values()))


def test_a_couch_in_the_way_costs_and_one_behind_does_not() -> None:
    def gain(y: float) -> float:
        """What the couch changes in the detections, the scenelet's motion being the same."""
        values = []
        for objects in (True, False):
            problem = worlds.problem(scenelets=worlds.library(objects=objects))
            state = empty_state(problem).with_item(1, 0, np.array([0.0, y, np.pi]))
            values.append(terms(problem, state)["detections"])
        return values[0] - values[1]

    # The walker crosses at 4 m; the couch stands .6 m beyond its scenelet's origin.
    assert gain(2.5) < -0.5
    assert abs(gain(6.0)) < 0.2


def test_prior_of_a_placement_integrates_to_one() -> None:
    """Density of one scenelet's (x, y, yaw) given that it starts the clip, likelihood off."""
    settings = ModelSettings(likelihood=0.0)
    lib = worlds.library(n_frames=6)
    problem = worlds.problem(6, settings=settings, scenelets=lib)
    bare = empty_state(problem)

    def density(x: float, y: float) -> float:
        state = bare.with_item(0, 0, np.array([x, y, 0.7]))
        values = terms(problem, state)
        # Without the density of the size, which is 0.
        of_size = norm.logpdf(0.0, scale=problem.size_spread)
        return float(np.exp(values["placement"] - of_size + values["path"]))

    # The mass lies within 5 standard deviations of log depth and bearing.
    total, _ = dblquad(density, 0.5, 30.0, lambda y: -1.3 * y, lambda y: 1.3 * y, epsabs=1e-4)
    assert total * 2 * np.pi == pytest.approx(1.0, abs=2e-3)


def test_states_do_not_share_memory_and_keep_order() -> None:
    problem = worlds.problem()
    state = empty_state(problem).with_item(2, 10, AHEAD).with_item(1, 2, AHEAD + 1)
    assert state.items.tolist() == [[1, 2], [2, 10]]
    with pytest.raises(ValueError, match="read-only"):
        state.placements[0, 0] = 3.0
    assert state.without_item(0).items.tolist() == [[2, 10]]
    assert isinstance(state, State)


def test_a_clip_shorter_than_every_scenelet_is_refused() -> None:
    with pytest.raises(InputError, match="shortest scenelet"):
        worlds.problem(4)


def test_a_scenelet_of_one_frame_is_refused() -> None:
    """The path goes on from its last two."""
    quick = worlds.Library("quick", (replace(worlds.library(2)[0], fps=100.0),))
    with pytest.raises(InputError, match="10 frames a second; library quick needs at least 100,"):
        worlds.problem(20, scenelets=quick)


@pytest.mark.parametrize("n_frames", [2, 3, 4, 15, 20])
@pytest.mark.parametrize("fps", [8.0, 10.0, 29.97])
def test_the_slowest_film_of_a_motion_has_two_of_its_frames(n_frames: int, fps: float) -> None:
    scenelet = replace(worlds.library(n_frames)[0], fps=fps)
    least = scenelet.slowest_film
    at_least, slower = (
        len(resample(scenelet.joints, fps=fps, to_fps=rate)) for rate in (least, 0.999 * least)
    )
    assert (min(at_least, 2), slower) == (2, 1)


@pytest.mark.parametrize("rate", [5.0, 10.0, 15.0, 25.0, 60.0])
@pytest.mark.parametrize("length", [2, 7, 16])
def test_the_middle_of_a_scenelet_stays_its_middle(length: int, rate: float) -> None:
    joints = np.arange(length)[:, None, None] * np.ones((length, 16, 3))
    made = resample(joints, fps=10.0, to_fps=rate)
    assert made[len(made) // 2, 0, 0] == length // 2


def test_a_person_of_whom_nothing_is_placed_is_known_no_better_than_nobody() -> None:
    """Confidences below the least of a placed joint are as none."""
    joints = worlds.walk(20)
    clip, path = worlds.clip_of(joints, np.random.default_rng(0)), worlds.path_of(joints)
    track = clip.tracks[0]

    def scale(confidence: float) -> np.ndarray:
        confidences = np.array(track.confidences)
        confidences[10:] = confidence
        seen = replace(clip, tracks=(replace(track, confidences=confidences),))
        return pack_problem(seen, path, worlds.camera_prior(), worlds.library()).path_scale

    np.testing.assert_array_equal(scale(0.01), scale(0.0))
    assert (scale(0.03)[10:] > scale(0.0)[10:]).all()


def test_errors_cannot_take_longer_to_change_than_to_be_forgotten() -> None:
    with pytest.raises(InputError, match=r"smoothing_time_depth = 0\.6 must be from 0 to half"):
        ModelSettings(correlation_time_depth=1.0, smoothing_time_depth=0.6)
