"""Objects matched across draws."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from imapper_prob.samplers.diagnostics import ess
from imapper_prob.uncertainty.clusters import (
    cells_of_object,
    circular_mean_and_spread,
    object_clusters,
)
from tests.uncertainty.pieces import piece


def log_posterior(n: int, chains: int = 2) -> np.ndarray:
    return np.linspace(0, -1, n).reshape(chains, -1)


def test_a_room_known_by_hand() -> None:
    couch = [piece("couch", x, 4.0, yaw) for x, yaw in ((1.0, 0.1), (1.2, -0.1), (1.1, 0.0))]
    draws = [
        [couch[0], piece("table", 1.1, 5.0)],
        [piece("table", 1.1, 5.2), couch[1]],
        [couch[2]],
        [piece("armchair", 1.1, 4.0)],
    ]
    first, second = object_clusters(draws, log_posterior(4), radius=0.8)
    assert first.presence == 1.0
    assert dict(first.labels) == {"couch": 0.75, "armchair": 0.25}
    assert first.label == "couch"
    assert first.members.tolist() == [[0, 0], [1, 1], [2, 0], [3, 0]]
    np.testing.assert_allclose(first.mean, (1.1, 4.0))
    np.testing.assert_allclose(first.covariance, [[0.02 / 3, 0], [0, 0]], atol=1e-12)
    assert first.yaw == pytest.approx(0.0, abs=1e-12)
    assert first.typical == couch[2]
    assert second.presence == 0.5
    assert dict(second.labels) == {"table": 1.0}


def test_labels_may_be_others_than_those_of_scenelets() -> None:
    stool, chair = piece("stool", 1.0, 4.0), piece("chair", 1.1, 4.0)
    told = [[{"stool": 0.3, "chair": 0.6, "couch": 0.1}], [{"chair": 0.2, "couch": 0.8}]]
    (cluster,) = object_clusters([[stool], [chair]], log_posterior(2), radius=0.8, labels=told)
    assert list(cluster.labels.items()) == [
        ("couch", pytest.approx(0.45)), ("chair", pytest.approx(0.4)),
        ("stool", pytest.approx(0.15)),
    ]  # fmt: skip
    # No scenelet has the most probable label, so that any member may be typical.
    assert cluster.typical in (stool, chair)
    rare = [[{"stool": 0.9995, "couch": 0.0005}]] * 2
    (cluster,) = object_clusters([[stool], [chair]], log_posterior(2), radius=0.8, labels=rare)
    assert list(cluster.labels) == ["stool"]
    assert cluster.typical == stool


def test_no_draw_has_two_in_one_cluster(rng: np.random.Generator) -> None:
    draws = [
        [piece("chair", *rng.normal((x, 4), 0.15)) for x in rng.permutation([0.0, 0.7])]
        for _ in range(40)
    ]
    clusters = object_clusters(draws, log_posterior(40), radius=0.8)
    assert [c.presence for c in clusters] == [1.0, 1.0]
    for cluster in clusters:
        assert len(set(cluster.members[:, 0].tolist())) == len(cluster.members)
    assert sorted(float(c.mean[0].round()) for c in clusters) == [0.0, 1.0]


def test_members_are_each_object_once(rng: np.random.Generator) -> None:
    labels = ("chair", "stool", "table", "shelf")
    draws = [
        [piece(labels[rng.integers(4)], *rng.uniform(0, 3, 2)) for _ in range(rng.integers(5))]
        for _ in range(60)
    ]
    clusters = object_clusters(draws, log_posterior(60), radius=0.6, least=0.0)
    members = sorted(tuple(m) for c in clusters for m in c.members.tolist())
    assert members == [(n, k) for n in range(60) for k in range(len(draws[n]))]
    for cluster in clusters:
        for (n, k), position in zip(cluster.members, cluster.positions, strict=True):
            np.testing.assert_array_equal(draws[n][k].centre[:2], position)


@pytest.mark.parametrize("bearing", [0.0, 0.7, -2.0])
def test_along_the_ray_it_may_stand_twice_as_far(bearing: float) -> None:
    ray = np.array([np.sin(bearing), np.cos(bearing)])
    aside = np.array([ray[1], -ray[0]])
    for way, metres in ((ray, 1.6), (aside, 0.8)):
        for distance, clusters in ((metres - 0.01, 1), (metres + 0.01, 2)):
            place = 4 * ray + distance * way
            draws = [[piece("chair", *(4 * ray))], [piece("chair", *place)]]
            assert len(object_clusters(draws, log_posterior(2), radius=0.8)) == clusters


def test_two_in_a_row_are_two(rng: np.random.Generator) -> None:
    """Nearer to each other than the draws of one may be, but met together."""
    draws = [[piece("chair", 0, y + depth) for y in (4.0, 4.9)] for depth in rng.normal(0, 0.3, 60)]
    near, far = sorted(
        object_clusters(draws, log_posterior(60), radius=0.8), key=lambda c: c.mean[1]
    )
    assert near.presence == far.presence == 1.0
    assert far.mean[1] - near.mean[1] == pytest.approx(0.9, abs=0.1)


@pytest.mark.parametrize(("other", "metres"), [("chair", 0.8), ("stool", 0.6), ("table", 0.4)])
def test_another_label_must_stand_nearer(other: str, metres: float) -> None:
    for distance, clusters in ((metres - 0.01, 1), (metres + 0.01, 2)):
        draws = [[piece("chair", 0, 4)], [piece(other, distance, 4)]]
        found = object_clusters(draws, log_posterior(2), radius=0.8)
        assert len(found) == clusters


def test_one_object_is_one_cluster_wherever_it_was_founded(rng: np.random.Generator) -> None:
    """The two most probable draws are at the far ends of where it stands."""
    spread = [-0.45, 0.45, *np.clip(rng.normal(0, 0.2, 98), -0.5, 0.5)]
    (cluster,) = object_clusters(
        [[piece("couch", x, 4)] for x in spread], log_posterior(100), radius=0.8
    )
    assert cluster.presence == 1.0


def test_a_second_one_now_and_then_is_an_object_of_its_own(rng: np.random.Generator) -> None:
    spread = [-0.45, 0.45, *np.clip(rng.normal(0, 0.2, 98), -0.5, 0.5)]
    draws = [[piece("couch", x, 4)] for x in spread]
    draws[50].append(piece("couch", float(np.sign(-spread[50])) * 0.4, 4))
    first, second = object_clusters(draws, log_posterior(100), radius=0.8, least=0.0)
    assert (first.presence, second.presence) == (1.0, 0.01)
    assert second.members[0, 0] == 50


@pytest.mark.parametrize(("both", "presences"), [(10, [1.0, 0.1]), (20, [0.6, 0.6])])
def test_two_that_are_seldom_met_together_are_one(both: int, presences: list[float]) -> None:
    """A couch here or there in a hundred draws: of 55 each 10, or of 60 each 20, have it twice."""
    places = [(-0.3, 0.3)] * both + [(-0.3,), (0.3,)] * ((100 - both) // 2)
    draws = [[piece("couch", x, 4) for x in own] for own in places]
    found = object_clusters(draws, log_posterior(100), radius=0.8, least=0.0)
    assert [c.presence for c in found] == presences


def test_what_is_known_badly_along_the_ray_is_still_one(rng: np.random.Generator) -> None:
    """Further apart than the radius at the ends, and nowhere a gap."""
    draws = [[piece("couch", 0, y)] for y in rng.uniform(3.2, 4.8, 200)]
    (cluster,) = object_clusters(draws, log_posterior(200), radius=0.8)
    assert cluster.presence == 1.0


def test_rare_objects_are_left_out_and_an_empty_room_has_none() -> None:
    draws = [[piece("chair", 0, 4)] * (n == 7) for n in range(40)]
    assert object_clusters(draws, log_posterior(40), radius=0.8) == ()
    (rare,) = object_clusters(draws, log_posterior(40), radius=0.8, least=0.0)
    assert rare.presence == 1 / 40
    assert object_clusters([[], []], log_posterior(2), radius=0.8) == ()


def test_regions_hold_their_share_of_any_cloud(rng: np.random.Generator) -> None:
    """Two heaps: nothing normal about it, and still half is half."""
    heaps = np.where(rng.random(400) < 0.7, 0.0, 0.6)
    draws = [[piece("chair", *rng.normal((x, 4), (0.02, 0.1)))] for x in heaps]
    (cluster,) = object_clusters(draws, log_posterior(400), radius=1.2)
    for share in (0.5, 0.9):
        region = cluster.region(share)
        held = region.holds(cluster.positions).mean()
        # Exactly the share of the draws, to one draw.
        assert share <= held <= share + 1 / 400
    half, most = cluster.region(0.5), cluster.region(0.9)
    assert (half.half_axes < most.half_axes).all()


@pytest.mark.parametrize("n", [4000, pytest.param(20_000, marks=pytest.mark.slow)])
def test_regions_follow_the_covariance(rng: np.random.Generator, n: int) -> None:
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    points = np.array([1.0, 4.0]) + (rng.normal(size=(n, 2)) * (0.3, 0.05)) @ turn.T
    draws = [[piece("table", x, y)] for x, y in points]
    (cluster,) = object_clusters(draws, log_posterior(n), radius=5.0)
    region = cluster.region(0.9)
    # Chi-square with two degrees of freedom; a standard deviation is known to 1 / sqrt(2 n).
    expected = np.sqrt(4.605) * np.array([0.05, 0.3])
    np.testing.assert_allclose(region.half_axes, expected, rtol=4 * 2 / np.sqrt(2 * n))
    long_axis = region.angle + np.pi / 2
    assert abs(np.sin(long_axis - np.arctan2(0.6, 0.8))) < 0.02


def test_one_draw_alone_still_has_a_region() -> None:
    (cluster,) = object_clusters([[piece("bed", 0, 4)]] * 2, log_posterior(2), radius=0.8)
    region = cluster.region(0.5)
    assert region.holds(cluster.positions).all()
    assert (region.half_axes > 0).all()
    assert (region.half_axes < 0.01).all()


def test_directions_are_averaged_around_the_circle() -> None:
    mean, spread = circular_mean_and_spread(np.array([np.pi - 0.1, -np.pi + 0.1]))
    assert abs(np.cos(mean) + 1) < 1e-12
    assert spread == pytest.approx(np.sqrt(-2 * np.log(np.cos(0.1))))
    assert circular_mean_and_spread(np.array([0.3]))[1] == pytest.approx(0.0, abs=1e-7)
    assert circular_mean_and_spread(np.array([0.0, np.pi]))[1] > 8
    # Axes are the same after half a turn, and spread as they are.
    axis, spread = circular_mean_and_spread(np.array([0.1, np.pi - 0.1, 0.1, -0.1]), front=False)
    assert axis == pytest.approx(0.0, abs=1e-12)
    assert spread == pytest.approx(0.1, rel=0.02)


def test_the_error_of_presence_is_that_of_its_share(rng: np.random.Generator) -> None:
    there = rng.random(2000) < 0.4
    draws = [[piece("chair", 0, 4)] * bool(t) for t in there]
    (cluster,) = object_clusters(draws, log_posterior(2000, chains=4), radius=0.8)
    assert cluster.presence == there.mean()
    # Draws are independent here; the effective number of draws is itself an estimate.
    assert cluster.presence_error == pytest.approx(np.sqrt(0.24 / 2000), rel=0.15)


def test_a_presence_on_which_all_draws_agree_has_an_error(rng: np.random.Generator) -> None:
    draws = [[piece("chair", 0, 4)]] * 120
    values = rng.standard_normal((2, 60))
    (cluster,) = object_clusters(draws, values, radius=0.8)
    assert cluster.presence == 1
    assert cluster.presence_error == 1 / (float(ess(values)) + 2) > 0.001
    assert cells_of_object(cluster).there != "1.00 ± 0.00"


def test_the_cells_of_an_object_are_in_metres_and_whole_turns() -> None:
    clusters = object_clusters([[piece("chair", 0, 4)]] * 8, log_posterior(8), radius=0.8)
    cluster = replace(
        clusters[0], labels={"chair": 0.998, "stool": 0.002}, presence=0.9981,
        presence_error=0.0009, positions=np.array([[0.9, 4.0], [1.1, 4.2]]),
        yaw=math.radians(-90.2), yaw_spread=math.radians(7),
    )  # fmt: skip
    assert cells_of_object(cluster) == (
        "chair > 0.99, stool < 0.01", "0.998 ± 0.001", "1.00 ± 0.14", "4.10 ± 0.14", "270° ± 7°",
    )  # fmt: skip
    certain = replace(
        cluster, labels={"chair": 1.0}, yaw=math.radians(-0.2), yaw_spread=math.radians(200)
    )
    assert cells_of_object(certain).labels == "chair"
    assert cells_of_object(certain).facing == "any"
    assert cells_of_object(replace(cluster, yaw=math.radians(-0.2))).facing == "0° ± 7°"
