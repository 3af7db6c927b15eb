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
    gains_of,
    room_of,
    sequences_of,
    static_path,
)
from tests.models import worlds
from tests.sampling.scenes import random_gains

N_FRAMES = 16
BARE = worlds.problem(N_FRAMES, scenelets=worlds.library(objects=False))


def test_a_gain_is_what_the_model_says_of_detections() -> None:
    gains, static, empty = gains_of(BARE), static_path(BARE), empty_state(BARE)
    weight, free = BARE.frame_weight * BARE.likelihood, BARE.free_cost

    def by_frame(state: State) -> np.ndarray:
        """Of detections, with the sides that explain each frame better."""
        return weight * evaluate(BARE, state)[2][:, :2].max(1)

    for scenelet, start in ((0, 0), (1, 4), (2, 10)):
        x, y, yaw = expected_placement(BARE, static, scenelet, start)
        there = empty.with_item(scenelet, start, np.array([x, y, yaw]))
        more = by_frame(there) - (by_frame(empty) - weight * free)
        covered = slice(start, start + int(BARE.lengths[scenelet]))
        assert gains[start, scenelet] == pytest.approx(more[covered].sum(), abs=1e-3)
        assert abs(more[covered].sum()) > 0.2


def test_scenelets_stand_on_the_static_path() -> None:
    static, empty = static_path(BARE), empty_state(BARE)
    x, y, yaw = expected_placement(BARE, static, 1, 4)
    middle = 4 + int(BARE.lengths[1]) // 2
    there = motion(BARE, empty.with_item(1, 4, np.array([x, y, yaw])))[middle, PELV]
    assert_allclose([there[0] / there[1], np.log(there[1])], static[middle], atol=1e-6)


def test_no_scenelet_reaches_into_the_next_persons_frames() -> None:
    starts = np.array(BARE.path_starts)
    starts[9] = True
    problem = BARE._replace(path_starts=starts)
    gains, room = gains_of(problem), room_of(problem)
    assert room[[0, 8, 9, N_FRAMES]].tolist() == [9, 1, N_FRAMES - 9, 0]
    fits = problem.lengths <= room[:-1, None]
    assert (np.isfinite(gains) == fits).all()
    assert (sequences_of(problem, gains).scenelets[:-1][~fits] == 0).all()


def test_without_a_likelihood_nothing_gains() -> None:
    gains = gains_of(BARE._replace(likelihood=0.0))
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
    gains = 5 * random_gains(BARE)
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
