"""What detections say of a person's own limbs, against persons whose limbs are known."""

from __future__ import annotations

import numpy as np
import pytest

from imapper_prob.models.log_posterior import State, empty_state, motion
from imapper_prob.models.problem import Problem
from imapper_prob.models.skeleton import DETECTED, HEAD, MIRROR, NECK, PELV, THRX
from imapper_prob.solver.limbs import limbs_of
from tests.models import worlds

SEEN = list(DETECTED)


def scene(problem: Problem) -> State:
    """One scenelet in the middle of the walk."""
    return empty_state(problem).with_item(0, 7, np.array([0.0, 4.0, 0.3]))


def seen_as(
    problem: Problem, keypoints: np.ndarray, *, noise: float = 6.0, dof: float = 1e6
) -> Problem:
    """Other detections, all of them surely of joints that are seen."""
    return problem._replace(
        keypoints=keypoints,
        used=np.isin(np.arange(16), SEEN) & np.ones(problem.used.shape, bool),
        confidence_density=np.tile([1e-9, 1.0], (*problem.used.shape, 1)),
        error_scale=np.full(problem.error_scale.shape, noise),
        error_dof=np.full(problem.error_dof.shape, dof),
    )


def test_a_joint_seen_where_it_is_expected_stays_there() -> None:
    base = worlds.problem()
    joints = motion(base, scene(base))
    problem = seen_as(base, worlds.CAMERA.project(joints), dof=3.0)
    found = limbs_of(problem, scene(base), worlds.CAMERA)
    np.testing.assert_allclose(found.joints, joints, atol=1e-9)
    depth = worlds.CAMERA.to_camera(joints)[:, SEEN, 1]
    tolerance = (worlds.CAMERA.fx * base.pose_tolerance[SEEN] / depth) ** 2
    np.testing.assert_allclose(found.known[:, SEEN], tolerance / (tolerance + 36.0), rtol=1e-6)
    assert not found.known[:, [PELV, NECK]].any()
    np.testing.assert_allclose(np.linalg.norm(found.rays, axis=-1), 1.0)


def test_errors_of_known_persons_are_as_large_as_said() -> None:
    base, rng = worlds.problem(), np.random.default_rng(4)
    state = scene(base)
    joints = motion(base, state)
    squares = []
    for _ in range(40):
        own = joints + base.pose_tolerance[:, None] * rng.standard_normal(joints.shape)
        pixels = worlds.CAMERA.project(own) + 6.0 * rng.standard_normal((*joints.shape[:2], 2))
        found = limbs_of(seen_as(base, pixels), state, worlds.CAMERA)
        off = (own - found.joints)[:, SEEN]
        precision = np.linalg.inv(found.covariance()[:, SEEN])
        squares.append(np.einsum("tji,tjik,tjk->tj", off, precision, off))
    # 11,200 of three degrees of freedom: the mean has a deviation of .023.
    assert np.mean(squares) == pytest.approx(3.0, abs=4 * 0.023)


def test_a_detection_far_off_says_little() -> None:
    base = worlds.problem()
    state, joints = scene(base), motion(base, scene(base))
    shifts = []
    for pixels in (20.0, 2000.0):
        aside = worlds.CAMERA.project(joints) + np.array([pixels, 0.0])
        problem = seen_as(base, aside, dof=3.0)
        shifts.append(np.abs(limbs_of(problem, state, worlds.CAMERA).joints - joints)[:, SEEN])
    near, far = shifts
    assert near[..., 0].min() > 0.01
    assert far.max() < near[..., 0].min()


def test_what_is_not_detected_is_as_it_was_posed() -> None:
    base = worlds.problem()
    state = scene(base)
    problem = seen_as(base, base.keypoints)._replace(used=np.zeros(base.used.shape, bool))
    found = limbs_of(problem, state, worlds.CAMERA)
    np.testing.assert_allclose(found.joints, motion(base, state), atol=1e-12)
    found_ones = np.delete(found.covariance(), PELV, axis=1)
    expected = np.delete(base.pose_tolerance, PELV)[:, None, None] ** 2 * np.eye(3)
    np.testing.assert_allclose(found_ones, np.broadcast_to(expected, found_ones.shape), atol=1e-12)
    assert not found.covariance()[:, PELV].any()


def test_the_neck_goes_with_shoulders_and_head() -> None:
    base = worlds.problem()
    state, joints = scene(base), motion(base, scene(base))
    pixels = worlds.CAMERA.project(joints)
    pixels[:, [THRX, HEAD]] += 15.0
    shift = limbs_of(seen_as(base, pixels), state, worlds.CAMERA).joints - joints
    np.testing.assert_allclose(shift[:, NECK], shift[:, [THRX, HEAD]].mean(1), atol=1e-12)
    assert np.linalg.norm(shift[:, NECK], axis=-1).min() > 0.01
    np.testing.assert_allclose(shift[:, PELV], 0.0, atol=1e-12)


def test_sides_taken_for_each_other_are_put_right() -> None:
    base = worlds.problem(60, scenelets=worlds.library(40))
    state = scene(base)
    right = seen_as(base, worlds.CAMERA.project(motion(base, state)))
    # In the order in memory that kernels are compiled for.
    mirrored = np.ascontiguousarray(right.keypoints[:, list(MIRROR)])
    wrong = right._replace(keypoints=mirrored)
    one, other = (limbs_of(p, state, worlds.CAMERA).joints for p in (right, wrong))
    np.testing.assert_allclose(one[15:40], other[15:40], atol=1e-9)
