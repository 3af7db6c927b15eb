"""Ranks of the truth: uniform where uncertainties are right, and not where they are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest

from imapper_prob.evaluate.claims import Claim, Draws
from imapper_prob.evaluate.regions import (
    at_true_size,
    coverage,
    distance_ranks,
    draws_inside,
    elliptic_rank,
    joint_ranks,
    object_ranks,
)
from imapper_prob.models.skeleton import PELV, SCORED
from tests.evaluate.scenes import CAMERA, piece, truth, walk


def test_ranks_of_what_is_drawn_alike_are_uniform(rng: np.random.Generator) -> None:
    shape = np.array([[2.0, 0.0, 0.0], [1.5, 0.3, 0.0], [0.0, 0.4, 1.0]])
    clouds = rng.standard_normal((400, 201, 3)) @ shape
    ranks = [elliptic_rank(cloud[1:], cloud[0]) for cloud in clouds]
    assert kstest(ranks, "uniform").pvalue > 0.01


@pytest.mark.parametrize(("count", "dimensions"), [(19, 2), (99, 3)])
def test_regions_of_few_draws_hold_as_much_as_of_many(
    rng: np.random.Generator, count: int, dimensions: int
) -> None:
    clouds = rng.standard_normal((6000, count + 1, dimensions))
    ranks = np.array([elliptic_rank(cloud[1:], cloud[0]) for cloud in clouds])
    for region in (0.5, 0.9):
        error = np.sqrt(region * (1 - region) / 6000)
        assert np.mean(ranks < region) == pytest.approx(region, abs=4 * error)


def test_ranks_tell_too_sure_and_too_unsure(rng: np.random.Generator) -> None:
    clouds = rng.standard_normal((200, 200, 2))
    sure = [elliptic_rank(0.3 * cloud, rng.standard_normal(2)) for cloud in clouds]
    unsure = [elliptic_rank(3.0 * cloud, rng.standard_normal(2)) for cloud in clouds]
    assert np.mean(np.array(sure) < 0.9) < 0.3
    assert np.mean(np.array(unsure) < 0.5) > 0.9


def test_ranks_go_by_the_shape_of_the_cloud(rng: np.random.Generator) -> None:
    along = rng.standard_normal((500, 2)) * (0.1, 1.0)
    # Three standard deviations off across, a third of one along.
    assert elliptic_rank(along, (0.3, 0.0)) > 0.95
    assert elliptic_rank(along, (0.0, 0.3)) < 0.15


def test_draws_on_one_spot_have_a_rank() -> None:
    assert elliptic_rank(np.ones((30, 2)), (1.0, 1.0)) < 0.02
    assert elliptic_rank(np.ones((30, 2)), (1.1, 1.0)) > 0.98


def test_coverage_of_independent_truths_has_a_binomial_range() -> None:
    half, most = coverage([np.array([0.1, 0.4]), np.array([0.6, 0.95])])
    assert (half.share, most.share) == (0.5, 0.75)
    # P(X <= 1 | 4, .5) = 5 / 16 and P(X = 0) = 1 / 16; P(X <= 2 | 4, .9) = .0523.
    assert (half.low, half.high) == (0.0, 1.0)
    assert (most.low, most.high) == (0.5, 1.0)
    assert np.isnan(coverage([np.empty(0)])[0].share)


def test_the_range_of_dependent_truths_is_that_of_draws(rng: np.random.Generator) -> None:
    known = truth()
    shared, alone = draws(rng, 0.3, 200), draws(rng, 0.0, 200)
    alone = replace(alone, joints=alone.joints + 0.3 * rng.standard_normal(alone.joints.shape))
    for cloud, low, high in ((shared, 0.0, 1.0), (alone, 0.35, 0.65)):
        inside = draws_inside(cloud, known)
        # Each joint's ranks are uniform over the draws.
        np.testing.assert_allclose(inside.mean(0) / (11 * len(SCORED)), (0.5, 0.9), atol=0.01)
        half, _ = coverage([joint_ranks(cloud, known)], [inside])
        assert (half.low <= low) == (cloud is shared)
        assert (half.high >= high) == (cloud is shared)
    assert draws_inside(shared, known, hidden=True).max() <= known.hidden.sum()


def test_two_clips_of_one_doubt_each_expect_less_scatter(rng: np.random.Generator) -> None:
    known = truth()
    cloud = draws(rng, 0.3, 200)
    ranks, inside = joint_ranks(cloud, known), draws_inside(cloud, known)
    one, four = coverage([ranks], [inside])[0], coverage([ranks] * 4, [inside] * 4)[0]
    assert (one.low, one.high) == (0.0, 1.0)
    # Two of four, one of four with probability 5 / 16: the quantiles of a binomial of four.
    assert (four.low, four.high) == (0.0, 1.0)
    nine = coverage([ranks] * 9, [inside] * 9)[0]
    assert (nine.low, nine.high) == (2 / 9, 7 / 9)


def test_size_is_removed_and_nothing_else(rng: np.random.Generator) -> None:
    known = truth()
    sizes = np.exp(0.1 * rng.standard_normal(60))
    joints = walk() * sizes[:, None, None, None]
    cloud = at_true_size(Draws(joints, CAMERA.project_camera(joints), ((),) * 60), known)
    np.testing.assert_allclose(cloud.joints, np.broadcast_to(walk(), joints.shape), rtol=1e-12)


def claim(label: str, centres: np.ndarray, probability: float) -> Claim:
    return Claim(probability, {label: 1.0}, tuple(piece(label, x, y) for x, y in centres))


def test_objects_are_ranked_in_their_own_claims(rng: np.random.Generator) -> None:
    known = truth()
    chair = np.array([0.2, 4.0])
    near = claim("stool", chair + 0.2 * rng.standard_normal((100, 2)), 0.8)
    # Nearer, but with less than even odds: not what a user is told.
    unlikely = claim("chair", chair + 0.01 * rng.standard_normal((30, 2)), 0.3)
    far = claim("shelf", np.array([1.0, 6.5]) + 0.1 * rng.standard_normal((100, 2)), 0.9)
    ranks = object_ranks((far, near, unlikely), known)
    assert len(ranks) == 2
    assert ranks[0] < 0.9
    assert ranks[1] > 0.99
    assert len(object_ranks((), known)) == 0


def test_a_claim_stands_at_its_mean_on_the_ray() -> None:
    shown = claim("chair", np.array([[0.0, 2.0], [0.0, 8.0], [0.0, 4.0]]), 0.6).representative
    np.testing.assert_allclose(shown.centre, (0.0, 4.0), atol=1e-12)
    np.testing.assert_allclose(shown.hull.centroid.coords[0], (0.0, 4.0), atol=1e-12)


def draws(rng: np.random.Generator, spread: float, count: int = 60) -> Draws:
    joints = walk() + spread * rng.standard_normal((count, 1, 1, 3))
    return Draws(joints, CAMERA.project_camera(joints), ((),) * count)


def test_joints_are_ranked_where_they_are_known(rng: np.random.Generator) -> None:
    known = truth()
    ranks = joint_ranks(draws(rng, 0.3), known)
    assert ranks.shape == (11 * len(SCORED),)
    assert len(joint_ranks(draws(rng, 0.3), known, hidden=True)) == known.hidden.sum()


def test_one_joint_and_its_distance(rng: np.random.Generator) -> None:
    known = truth()
    assert joint_ranks(draws(rng, 0.3), known, joints=(PELV,)).shape == (11,)
    away = walk() * np.linspace(0.9, 1.1, 60)[:, None, None, None]
    shifted = Draws(away, CAMERA.project_camera(away), ((),) * 60)
    np.testing.assert_allclose(distance_ranks(shifted, known), 0.5, atol=0.02)
    assert (distance_ranks(draws_at(0.8), known) == 1).all()
    assert (distance_ranks(draws_at(1.2), known) == 0).all()


def draws_at(scale: float) -> Draws:
    joints = scale * walk()[None]
    return Draws(joints, CAMERA.project_camera(joints), ((),))
