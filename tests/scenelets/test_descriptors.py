"""Motion descriptors: what they see, and what they must not see."""

from __future__ import annotations

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from imapper_prob.models.scene import Placement
from imapper_prob.models.skeleton import LWRI, PELV, RELB, RSHO, RWRI
from imapper_prob.scenelets.charness import (
    FROM_LINES,
    FROM_VERTICAL,
    N_FEATURES,
    N_SAMPLES,
    descriptor_distances,
    joint_line_distances,
    motion_descriptors,
)
from imapper_prob.scenelets.library import built_in_library
from tests.scenelets.motions import standing

WRIST_FROM_VERTICAL = FROM_VERTICAL.index(RWRI)
WRIST_FROM_HIPS = len(FROM_VERTICAL) + [joint for joint, _, _ in FROM_LINES].index(RWRI)
ELBOW = len(FROM_VERTICAL) + [joint for joint, _, _ in FROM_LINES].index(RELB)


def raised(height: float) -> NDArray[np.float64]:
    """Somebody whose right wrist goes from .95 m up to ``height`` while the rest keeps still."""
    joints = standing()
    joints[:, RWRI, 2] = np.linspace(0.95, height, len(joints))
    return joints


def test_there_are_fourteen_features_at_fifteen_moments() -> None:
    assert motion_descriptors([standing(), raised(1.2)]).shape == (2, 15, 14)
    assert (N_SAMPLES, N_FEATURES) == (15, 14)


def test_distances_of_a_known_pose() -> None:
    pose = standing()[0]
    shoulder = pose[RSHO].copy()
    pose[RWRI] = (0.3, 0.4, pose[PELV, 2])  # at hip height, half a metre from the pelvis
    pose[RELB] = shoulder + np.array([0.1, 0.0, 0.0])
    distances = joint_line_distances(pose)
    assert distances[WRIST_FROM_VERTICAL] == pytest.approx(0.5)
    assert distances[WRIST_FROM_HIPS] == pytest.approx(0.4)
    arm = pose[RWRI] - shoulder
    expected = np.linalg.norm(np.cross(arm, (0.1, 0, 0))) / np.linalg.norm(arm)
    assert distances[ELBOW] == pytest.approx(expected)


@given(
    index=st.integers(0, len(built_in_library()) - 1),
    x=st.floats(-9, 9),
    y=st.floats(-9, 9),
    yaw=st.floats(-3.1, 3.1),
)
def test_place_and_heading_do_not_matter(index: int, x: float, y: float, yaw: float) -> None:
    joints = built_in_library()[index].joints
    here, there = motion_descriptors([joints, Placement(x, y, yaw).apply(joints)])
    assert_allclose(here, there, atol=1e-7)


def test_speed_does_not_matter() -> None:
    slow, quick = motion_descriptors([raised(1.6), raised(1.6)[::2]])
    assert_allclose(slow, quick, atol=1e-6)


def test_moments_are_even_along_the_way_not_in_time() -> None:
    # Half of the frames at rest: even in time, half of the moments would be of rest.
    waiting = np.concatenate([np.repeat(raised(1.6)[:1], 17, axis=0), raised(1.6)])
    assert_allclose(*motion_descriptors([waiting, raised(1.6)]), atol=1e-6)


def test_somebody_who_does_not_move_is_described_all_the_same() -> None:
    (still,) = motion_descriptors([standing()])
    assert np.isfinite(still).all()
    assert_allclose(still, np.broadcast_to(still[0], still.shape), atol=1e-12)


def test_lying_is_not_standing() -> None:
    upright = standing()
    lying = upright[..., [0, 2, 1]]
    (distance,) = descriptor_distances(
        motion_descriptors([upright]), motion_descriptors([lying])
    ).ravel()
    assert distance > 0.3


def test_left_and_right_are_told_apart() -> None:
    right = raised(1.6)
    left = standing()
    left[:, LWRI, 2] = right[:, RWRI, 2]
    distances = descriptor_distances(motion_descriptors([right, left]))
    assert distances[0, 1] > 0.05


def test_distances_are_distances() -> None:
    descriptors = motion_descriptors([s.joints for s in built_in_library()[:40]])
    distances = descriptor_distances(descriptors)
    assert_allclose(distances, distances.T, atol=1e-9)
    assert_allclose(np.diag(distances), 0.0, atol=1e-12)
    around = distances[:, :, None] + distances[None]
    assert np.all(distances[:, None] <= around + 1e-9)
    assert_allclose(descriptor_distances(descriptors, descriptors), distances, atol=1e-6)


def test_a_change_of_all_features_is_its_own_distance() -> None:
    (descriptor,) = motion_descriptors([standing()])
    two = np.stack([descriptor, descriptor + 0.07])
    assert descriptor_distances(two)[0, 1] == pytest.approx(0.07)


def test_the_middle_of_a_motion_counts_most() -> None:
    (descriptor,) = motion_descriptors([standing()])
    changed = np.repeat(descriptor[None], N_SAMPLES, axis=0)
    changed[np.arange(N_SAMPLES), np.arange(N_SAMPLES)] += 0.1
    distances = descriptor_distances(changed, descriptor[None])[:, 0]
    assert distances.argmax() == N_SAMPLES // 2
    # A Gaussian of 2.33 samples on the square: three samples away exp(-.5 (3 / 2.33)^2) is left.
    assert (distances[10] / distances[7]) ** 2 == pytest.approx(np.exp(-0.5 * (3 / 2.33) ** 2))


def test_each_motion_is_described_by_itself() -> None:
    motions = [s.joints for s in built_in_library()[:30]]
    together = motion_descriptors(motions)
    for motion, descriptor in zip(motions, together, strict=True):
        assert_allclose(motion_descriptors([motion])[0], descriptor, atol=1e-9)
