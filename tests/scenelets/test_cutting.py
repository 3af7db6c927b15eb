"""Where long motions are cut."""

from __future__ import annotations

import hypothesis.extra.numpy as arrays_of
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from numpy.typing import NDArray

from imapper_prob.scenelets.build import cut, smooth_path, stretches

FPS = 10.0


def straight(speeds: list[float] | NDArray[np.float64]) -> NDArray[np.float64]:
    """(n + 1, 2) a way along x at speeds in metres a second, one a frame."""
    x = np.concatenate([[0.0], np.cumsum(np.asarray(speeds) / FPS)])
    return np.stack([x, np.zeros_like(x)], 1)


def way(path: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def test_a_walk_is_cut_into_metres() -> None:
    path = straight([0.8] * 100)  # 8 m
    clips = cut(path, fps=FPS)
    # A centre every 0.25 m; frames are 8 cm apart.
    assert len(clips) == 32
    inner = clips[(clips[:, 0] > 0) & (clips[:, 1] < len(path))]
    assert len(inner) > 20
    for first, end in inner:
        assert way(path[first:end]) == pytest.approx(1.0, abs=0.17)
    middles = path[(inner[:, 0] + inner[:, 1]) // 2, 0]
    np.testing.assert_allclose(np.diff(middles), 0.25, atol=0.09)


@pytest.mark.parametrize("speed", [0.5, 1.0, 1.5])
def test_the_metre_does_not_depend_on_speed(speed: float) -> None:
    path = straight([speed] * 200)
    clips = cut(path, fps=FPS)
    first, end = clips[len(clips) // 2]
    assert way(path[first:end]) == pytest.approx(1.0, abs=2 * speed / FPS)


def test_a_stay_gets_clips_at_regular_times_of_limited_length() -> None:
    path = straight([1.0] * 30 + [0.0] * 80 + [1.0] * 30)
    clips = cut(path, fps=FPS)
    inside = clips[(clips[:, 0] >= 30) & (clips[:, 1] <= 111)]
    # Eight seconds of stay, a clip a second, those near its ends reach out of it.
    assert len(inside) in (6, 7)
    np.testing.assert_array_equal(inside[:, 1] - inside[:, 0], 21)
    np.testing.assert_array_equal(np.diff(inside[:, 0]), 10)


def test_the_trembling_of_a_stay_is_no_way(rng: np.random.Generator) -> None:
    still = np.zeros((200, 2))
    trembling = rng.normal(0.0, 0.002, size=still.shape)
    assert way(trembling) > 0.6
    np.testing.assert_array_equal(cut(trembling, fps=FPS), cut(still, fps=FPS))


def test_smoothing_averages_over_way_and_leaves_large_steps() -> None:
    walk = straight([1.0] * 20)  # steps of 10 cm
    np.testing.assert_allclose(smooth_path(walk, radius=0.01, passes=10), walk, atol=1e-12)
    # Points within 1 cm of way of each other move to their mean.
    near = np.array([[0.0, 0.0], [0.008, 0.0], [1.0, 0.0]])
    once = smooth_path(near, radius=0.01, passes=1)
    np.testing.assert_allclose(once, [[0.004, 0.0], [0.004, 0.0], [1.0, 0.0]], atol=1e-12)


@given(
    steps=arrays_of.arrays(
        float, st.tuples(st.integers(1, 80), st.just(2)), elements=st.floats(-0.3, 0.3)
    )
)
def test_clips_are_in_order_within_the_motion_and_of_limited_length(
    steps: NDArray[np.float64],
) -> None:
    path = np.cumsum(steps, axis=0)
    clips = cut(path, fps=FPS)
    assert clips.shape == (len(clips), 2)
    assert len(np.unique(clips, axis=0)) == len(clips)
    if len(clips):
        lengths = clips[:, 1] - clips[:, 0]
        assert clips.min() >= 0
        assert clips.max() <= len(path)
        assert lengths.min() >= 0.6 * FPS
        assert lengths.max() <= 2.0 * FPS + 1


@given(
    steps=arrays_of.arrays(
        float, st.tuples(st.integers(1, 80), st.just(2)), elements=st.floats(-0.3, 0.3)
    ),
    yaw=st.floats(-3, 3),
)
def test_a_turned_path_is_cut_alike(steps: NDArray[np.float64], yaw: float) -> None:
    path = np.cumsum(np.round(steps, 2), axis=0)
    c, s = np.cos(yaw), np.sin(yaw)
    turned = path @ np.array([[c, s], [-s, c]]) + (3.0, -7.0)
    one, other = (cut(p, fps=FPS) for p in (path, turned))
    # Rounding may move a border by a frame, and two clips may then be one.
    assert abs(len(one) - len(other)) <= 1
    if one.shape == other.shape:
        assert np.abs(one - other).max(initial=0) <= 1


def test_long_stays_are_covered_from_end_to_end() -> None:
    clips = cut(np.zeros((301, 2)), fps=FPS)
    assert len(clips) == 30
    covered = np.zeros(301, bool)
    for first, end in clips:
        covered[first:end] = True
    assert covered.all()


@given(arrays_of.arrays(bool, st.integers(0, 40)))
def test_stretches_are_the_runs(flags: NDArray[np.bool_]) -> None:
    again = np.zeros(len(flags), bool)
    runs = stretches(flags)
    for first, end in runs:
        assert first < end
        again[first:end] = True
    np.testing.assert_array_equal(again, flags)
    assert (runs[1:, 0] > runs[:-1, 1]).all()
