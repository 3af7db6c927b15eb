"""Left and right flipped: summed out exactly, and found where it happened."""

from __future__ import annotations

from itertools import pairwise, product

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.extra.numpy import arrays

from imapper_prob.models.kernels.detection import flip_probabilities, forward_filter
from imapper_prob.models.log_posterior import empty_state, log_posterior, side_flips
from imapper_prob.models.problem import pack_problem
from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.skeleton import MIRROR
from imapper_prob.simulate.clips import simulate_track
from tests.models import worlds

RUN = slice(6, 14)
"""Frames in which the test's detector takes left for right."""


def enumerated(
    by_frame: np.ndarray, starts: np.ndarray, weight: float, begins: float, ends: float
) -> tuple[float, np.ndarray]:
    """Log-likelihood and P(flipped), by adding up all 2^T sequences."""
    n = len(by_frame)
    start = (ends / (begins + ends), begins / (begins + ends))
    step = ((1 - begins, begins), (ends, 1 - ends))
    total, turned = 0.0, np.zeros(n)
    for states in product((0, 1), repeat=n):
        p = start[states[0]]
        for t, (a, b) in enumerate(pairwise(states), 1):
            p *= start[b] if starts[t] else step[a][b]
        p *= np.exp(weight * sum(by_frame[t, s] for t, s in enumerate(states)))
        total += p
        turned += p * np.array(states)
    return float(np.log(total)), turned / total


@settings(max_examples=30)
@given(
    starts=arrays(bool, 7),
    by_frame=arrays(float, (7, 2), elements=st.floats(-8, 8)),
    weight=st.floats(0.05, 1),
    begins=st.floats(0.001, 0.5),
    ends=st.floats(0.01, 0.5),
)
def test_the_recursion_adds_up_all_sequences(
    starts: np.ndarray, by_frame: np.ndarray, weight: float, begins: float, ends: float
) -> None:
    expected, turned = enumerated(by_frame, starts, weight, begins, ends)
    starts[0] = True
    shares, _ = forward_filter(by_frame, starts, weight, begins, ends)
    assert shares.sum() == pytest.approx(expected)
    found = flip_probabilities(by_frame, starts, weight, begins, ends)
    np.testing.assert_allclose(found, turned, atol=1e-9)


def test_nothing_seen_says_nothing() -> None:
    starts = np.arange(50) == 0
    shares, _ = forward_filter(np.zeros((50, 2)), starts, 0.1, 0.002, 0.1)
    np.testing.assert_allclose(shares, 0.0, atol=1e-12)
    found = flip_probabilities(np.zeros((50, 2)), starts, 0.1, 0.002, 0.1)
    np.testing.assert_allclose(found, 0.002 / 0.102)


def exchanged(clip: Clip) -> Clip:
    """The clip with left and right flipped in ``RUN``, by detector and lifter alike."""
    (track,) = clip.tracks
    values = [np.array(a) for a in (track.keypoints, track.confidences, track.poses)]
    for array in values:
        array[RUN] = array[RUN][:, list(MIRROR)]
    turned = Track(track.name, *values, track.interpolated)
    return Clip(clip.name, clip.camera, clip.fps, clip.frame_ids, (turned,))


def test_a_run_of_swapped_frames_is_found_and_costs_little() -> None:
    joints = worlds.walk(20)
    clip = worlds.clip_of(joints, np.random.default_rng(0))
    library = worlds.library(20, n_scenelets=1, objects=False)
    scenelet = np.concatenate([joints - joints[10, 6] * (1, 1, 0)])
    library = worlds.Library("walk", (worlds.Scenelet("walk", "walk", scenelet, ()),))
    values = {}
    for name, seen in (("right", clip), ("flipped", exchanged(clip))):
        problem = pack_problem(seen, worlds.path_of(joints), worlds.camera_prior(), library)
        state = empty_state(problem).with_item(0, 0, np.array([*joints[10, 6, :2], 0.0]))
        values[name] = log_posterior(problem, state)
        wrong = side_flips(problem, state)
        inside = np.zeros(20, bool)
        inside[RUN] = name == "flipped"
        assert wrong[inside].min(initial=1.0) > 0.7
        assert wrong[~inside].max() < 0.5
    # Begin and end of a run: log .002 and log .1 and a little.
    assert -11.0 < values["flipped"] - values["right"] < -7.0


def test_the_simulator_swaps_as_often_as_the_model_says() -> None:
    joints = np.repeat(worlds.walk(1), 6000, axis=0)
    rng = np.random.default_rng(1)
    hidden = np.zeros(joints.shape[:2], bool)
    track = simulate_track(rng, joints, hidden, camera=worlds.CAMERA, fps=10.0)
    # The ankles of the upright pose are .2 m apart; detections err by some 15 pixels.
    swapped_there = track.keypoints[:, 0, 0] < track.keypoints[:, 5, 0]
    # Where a lost joint is said to be says nothing.
    known = (track.confidences[:, [0, 5]] > 0.02).all(1)
    share = swapped_there[known].mean()
    # Runs of 1 s, one in 50 s: 2 % of frames; the share of 600 s has a standard deviation
    # of sqrt(2 * .02 * 1 s / 600 s) = .8 %, and pixel errors cross over in a per mille.
    assert 0.0 < share < 0.02 + 3 * 0.008 + 0.01
