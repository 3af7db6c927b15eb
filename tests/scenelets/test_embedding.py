"""The plane of motions: near what is alike, whatever the order."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.distance import cdist

from imapper_prob.scenelets.charness import motion_distances
from imapper_prob.scenelets.figures import embed
from imapper_prob.scenelets.library import built_in_library

WORDS = ("sit", "stand", "walk", "reach")
"""What the paper's figure tells apart."""


def test_points_of_a_plane_are_found_again(rng: np.random.Generator) -> None:
    # Close enough to each other that all are neighbours: then chains are straight.
    points = rng.normal(size=(12, 2)) * (2.0, 1.0)
    found = embed(cdist(points, points))
    assert_allclose(cdist(found, found), cdist(points, points), atol=1e-8)
    assert_allclose(found.mean(0), 0.0, atol=1e-8)
    assert found[:, 0].var() >= found[:, 1].var()


def test_a_spiral_is_unrolled() -> None:
    turn = np.linspace(0.5, 2.0, 400)
    along = 2 * np.pi * turn
    spiral = turn[:, None] * np.column_stack([np.cos(along), np.sin(along)])
    found = embed(cdist(spiral, spiral))
    length = np.cumsum(np.linalg.norm(np.diff(spiral, axis=0, prepend=spiral[:1]), axis=1))
    assert abs(np.corrcoef(found[:, 0], length)[0, 1]) > 0.999


def test_far_groups_stay_apart_and_finite(rng: np.random.Generator) -> None:
    points = np.concatenate([rng.normal(size=(40, 3)), rng.normal(size=(40, 3)) + 100.0])
    found = embed(cdist(points, points))
    assert np.isfinite(found).all()
    assert abs(found[:40, 0].mean() - found[40:, 0].mean()) > 100.0


def test_equal_motions_share_a_point(rng: np.random.Generator) -> None:
    points = np.repeat(rng.normal(size=(30, 3)), 2, axis=0)
    found = embed(cdist(points, points))
    assert_allclose(found[::2], found[1::2], atol=1e-6)
    twins = np.array([[0.0], [0.0], [5.0], [5.0]])
    found = embed(cdist(twins, twins))
    assert_allclose(cdist(found, found), cdist(twins, twins), atol=1e-6)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_few_motions(n: int) -> None:
    points = np.arange(n, dtype=float)[:, None]
    found = embed(cdist(points, points))
    assert found.shape == (n, 2)
    assert_allclose(cdist(found, found), cdist(points, points), atol=1e-7)


def test_order_does_not_matter(rng: np.random.Generator) -> None:
    distances = cdist(points := rng.normal(size=(60, 5)), points)
    shuffled = rng.permutation(60)
    assert_allclose(
        embed(distances[np.ix_(shuffled, shuffled)]), embed(distances)[shuffled], atol=1e-8
    )


@pytest.mark.slow
def test_what_people_do_is_told_apart() -> None:
    library = built_in_library()
    points = embed(motion_distances(library))
    actions = np.array([s.action for s in library])
    chosen = np.isin(actions, WORDS)
    points, actions = points[chosen], actions[chosen]
    apart = cdist(points, points)
    np.fill_diagonal(apart, np.inf)
    nearest = np.argsort(apart, axis=1)[:, :10]
    same = (actions[nearest] == actions[:, None]).mean(1)
    purity = {word: same[actions == word].mean() for word in WORDS}
    assert np.mean(list(purity.values())) > 0.75
    assert purity["sit"] > 0.95
    assert purity["walk"] > 0.75
