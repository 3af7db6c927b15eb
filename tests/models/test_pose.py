"""Facing, turning and blending of poses."""

from __future__ import annotations

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from imapper_prob.models.skeleton import (
    BONES,
    LHIP,
    LSHO,
    N_JOINTS,
    PELV,
    RHIP,
    RSHO,
    blend_poses,
    facing,
    turned,
)

poses = arrays(float, (N_JOINTS, 3), elements=st.floats(-1, 1))


def lengths(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    a, b = np.transpose(BONES)
    return np.linalg.norm(pose[a] - pose[b], axis=-1)


@given(yaw=st.floats(-3.1, 3.1), more=st.floats(-3.1, 3.1))
def test_turning_turns_the_facing(yaw: float, more: float) -> None:
    pose = np.zeros((N_JOINTS, 3))
    pose[[RHIP, RSHO], 0], pose[[LHIP, LSHO], 0] = 0.15, -0.15
    assert facing(pose) == 0
    once = turned(pose, yaw)
    assert facing(once) == pytest.approx(yaw)
    assert np.exp(1j * facing(turned(once, more))) == pytest.approx(np.exp(1j * (yaw + more)))


@given(first=poses, second=poses)
def test_a_blend_starts_and_ends_at_its_poses(
    first: NDArray[np.float64], second: NDArray[np.float64]
) -> None:
    np.testing.assert_allclose(blend_poses(first, second, 0.0), first, atol=1e-9)
    np.testing.assert_allclose(blend_poses(first, second, 1.0), second, atol=1e-9)


def test_a_blend_keeps_the_bones(rng: np.random.Generator) -> None:
    for _ in range(50):
        first = rng.normal(size=(N_JOINTS, 3))
        second = first @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
        weight = rng.random()
        blend = blend_poses(first, second, weight)
        np.testing.assert_allclose(lengths(blend), lengths(first), rtol=1e-9)
        between = (1 - weight) * first[PELV] + weight * second[PELV]
        np.testing.assert_allclose(blend[PELV], between)


def test_many_weights_at_once(rng: np.random.Generator) -> None:
    first, second = rng.normal(size=(2, N_JOINTS, 3))
    weights = np.array([0.2, 0.7])
    blends = blend_poses(first, second, weights)
    for blend, weight in zip(blends, weights, strict=True):
        np.testing.assert_array_equal(blend, blend_poses(first, second, weight))
