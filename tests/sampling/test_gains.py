"""Gains are differences of the model's own terms, and sums are over every sequence there is."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.testing import assert_allclose

from imapper_prob.models.log_posterior import State, empty_state, evaluate, motion
from imapper_prob.models.skeleton import PELV
from imapper_prob.sampling.gains import (
    expected_placement,
    frames_left_of,
    gains_about,
    gains_of,
    sequences_of,
    static_pelvis_on_floor,
)
from imapper_prob.sampling.jit import compiled
from imapper_prob.sampling.learning import learn
from imapper_prob.sampling.redraws import set_placement
from imapper_prob.sampling.reference import NONE_BEFORE, Reference
from imapper_prob.sampling.reference_placement import placement_centre
from imapper_prob.sampling.visits import Visits
from tests.models import worlds
from tests.sampling.scenes import random_gains

N_FRAMES = 16
BARE = worlds.problem(N_FRAMES, scenelets=worlds.library(objects=False))


def gain_by_frame(state: State) -> np.ndarray:
    """Log-likelihood of detections, with the sides that explain each frame better, over that of
    free poses."""
    weight = BARE.frame_weight * BARE.likelihood
    seen, free = (evaluate(BARE, of)[2][:, :2].max(1) for of in (state, empty_state(BARE)))
    difference: np.ndarray = weight * (seen - free + BARE.free_cost)
    return difference


@compiled
def placed_as_expected(reference: Reference, scenelet: int, start: int) -> tuple[float, np.ndarray]:
    """Log size and placement of a scenelet that none is before."""
    placement, before, where = np.empty(3), np.empty((2, 4)), np.empty((2, 4))
    camera = reference.library_camera
    placement_centre(reference, camera, scenelet, start, NONE_BEFORE, before, where)
    set_placement(reference, camera, scenelet, where[0], placement)
    return where[0, 3], placement


def test_a_gain_is_what_the_model_says_of_detections() -> None:
    """At a size that is no worse than the mean, and about as good as the best of many."""
    gains, static, empty = gains_of(BARE), static_pelvis_on_floor(BARE), empty_state(BARE)
    for scenelet, start in ((0, 0), (1, 4), (2, 10)):
        placement = np.array(expected_placement(BARE, static, scenelet, start))
        covered = slice(start, start + int(BARE.lengths[scenelet]))
        deviations = np.array([gains.sizes[start, scenelet] / BARE.size_spread, 0, -1, 1])
        deviations = np.append(deviations, np.linspace(-3, 3, 61))
        found = [
            gain_by_frame(empty.with_item(scenelet, start, placement, n * BARE.size_spread))
            for n in deviations
        ]
        values = np.array([more[covered].sum() for more in found]) - 0.5 * deviations**2
        assert gains.values[start, scenelet] == pytest.approx(values[0], abs=1e-3)
        assert abs(values[0]) > 0.2
        assert values[0] > values[1:4].max() - 1e-3
        assert values[0] > values.max() - 0.5


def test_scenelets_stand_on_the_static_path() -> None:
    static, empty = static_pelvis_on_floor(BARE), empty_state(BARE)
    x, y, yaw = expected_placement(BARE, static, 1, 4)
    middle = 4 + int(BARE.lengths[1]) // 2
    there = motion(BARE, empty.with_item(1, 4, np.array([x, y, yaw])))[middle, PELV]
    assert_allclose([there[0] / there[1], np.log(there[1])], static[middle], atol=1e-6)


def test_no_scenelet_reaches_into_the_next_persons_frames() -> None:
    starts = np.array(BARE.path_starts)
    starts[9] = True
    problem = BARE._replace(path_starts=starts)
    gains, frames_left = gains_of(problem).values, frames_left_of(problem)
    assert frames_left[[0, 8, 9, N_FRAMES]].tolist() == [9, 1, N_FRAMES - 9, 0]
    fits = problem.lengths <= frames_left[:-1, None]
    assert (np.isfinite(gains) == fits).all()
    assert (sequences_of(problem, gains).scenelets[:-1][~fits] == 0).all()


def test_gains_are_judged_again_where_scenelets_are_expected() -> None:
    static, empty = gains_of(BARE), empty_state(BARE)
    visits = Visits()
    for scenelet, start in ((0, 0), (1, 4), (2, 10)):
        x, y, yaw = expected_placement(BARE, static_pelvis_on_floor(BARE), scenelet, start)
        for _ in range(40):
            visits.note(empty.with_item(scenelet, start, np.array([x + 0.1, 1.05 * y, yaw + 0.2])))
    reference = learn(BARE, static, np.ones((3, 3)), visits)
    gains = gains_about(BARE, static.values, reference)
    assert (np.isfinite(gains) == np.isfinite(static.values)).all()
    for scenelet, start in ((0, 0), (1, 4), (2, 10), (1, 2)):
        size, placement = placed_as_expected(reference, scenelet, start)
        covered = slice(start, start + int(BARE.lengths[scenelet]))
        there = gain_by_frame(empty.with_item(scenelet, start, placement, size))
        gain = there[covered].sum() - 0.5 * (size / BARE.size_spread) ** 2
        assert gains[start, scenelet] == pytest.approx(gain, abs=1e-3)
        assert abs(gains[start, scenelet] - static.values[start, scenelet]) > 0.01


def test_hopeless_scenelets_are_not_judged_again() -> None:
    static = gains_of(BARE)
    static.values[4, 1] = static.values[4].max() - 20.0
    visits = Visits()
    x, y, yaw = expected_placement(BARE, static_pelvis_on_floor(BARE), 0, 0)
    visits.note(empty_state(BARE).with_item(0, 0, np.array([x, 1.1 * y, yaw])))
    gains = gains_about(BARE, static.values, learn(BARE, static, np.ones((3, 3)), visits))
    assert gains[4, 1] == static.values[4, 1]
    assert gains[4, 0] != static.values[4, 0]


def test_without_a_likelihood_nothing_gains() -> None:
    gains = gains_of(BARE._replace(likelihood=0.0)).values
    assert (gains[np.isfinite(gains)] == 0).all()


def sequences(start: int, lengths: np.ndarray) -> Iterator[list[tuple[int, int]]]:
    """Every sequence of (scenelet, start) from a frame on."""
    yield []
    for begin in range(start, N_FRAMES):
        for scenelet, length in enumerate(lengths.tolist()):
            if begin + length <= N_FRAMES:
                for rest in sequences(begin + length, lengths):
                    yield [(scenelet, begin), *rest]


@pytest.mark.parametrize("end", [0, 3, 9])
def test_probabilities_are_shares_of_all_sequences(end: int) -> None:
    gains = 5 * random_gains(BARE).values
    rates = np.array([0.2, 0.5, 0.3])
    problem = BARE._replace(log_rate=np.log(rates) - 3.0)  # only ratios of rates count
    found = sequences_of(problem, gains)
    first = np.zeros((N_FRAMES, 3))
    none = total = 0.0
    for sequence in sequences(end, np.asarray(problem.lengths)):
        weight = np.prod([rates[s] * np.exp(0.7 * gains[t, s]) for s, t in sequence])
        total += weight
        if sequence:
            first[sequence[0][1], sequence[0][0]] += weight
        else:
            none += weight
    survival = np.exp(found.survival - found.survival[end])
    begins = survival[:-1, None] * found.hazard[:-1, None] * found.scenelets[:-1]
    assert_allclose(begins[end:], first[end:] / total, rtol=1e-9)
    assert survival[-1] == pytest.approx(none / total)
