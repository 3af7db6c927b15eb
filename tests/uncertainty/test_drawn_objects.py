"""Furniture as it may stand about the person."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from imapper_prob.models.settings import ModelSettings
from imapper_prob.uncertainty.clusters import object_clusters
from imapper_prob.uncertainty.estimate import drawn_objects
from tests.uncertainty.rooms import couch_and_table

SETTINGS = ModelSettings(furniture_aside=0.2, furniture_ahead=0.1)


def test_pieces_move_along_their_own_axes_by_the_stated_deviations(
    rng: np.random.Generator,
) -> None:
    couch = couch_and_table().objects[0]
    moved = [drawn_objects(rng, [couch], SETTINGS)[0] for _ in range(2000)]
    offsets = np.array([o.centre - couch.centre for o in moved])
    along = offsets[:, :2] @ couch.placement.rotation
    # 4 standard errors of a standard deviation from 2,000 draws are 6 %; the couch is 2 m wide.
    np.testing.assert_allclose(along.std(0), (0.4, 0.1), rtol=0.065)
    np.testing.assert_allclose(along.mean(0), 0.0, atol=4 * 0.4 / np.sqrt(2000))
    np.testing.assert_array_equal(offsets[:, 2], 0.0)
    assert {o.placement.yaw for o in moved} == {couch.placement.yaw}
    assert all(o.cuboids == couch.cuboids and o.label == "couch" for o in moved)


def test_the_same_generator_draws_the_same() -> None:
    objects = couch_and_table().objects
    one, other = (drawn_objects(np.random.default_rng(3), objects, SETTINGS) for _ in range(2))
    assert one == other


def test_regions_are_of_where_it_may_stand_and_identity_of_what_scenelets_say(
    rng: np.random.Generator,
) -> None:
    """Chairs half a metre apart stay two, however far each may be from where it is said to be."""
    couch = couch_and_table().objects[0]
    beside = replace(couch, placement=replace(couch.placement, x=couch.placement.x + 0.9))
    draws = [(couch, beside)] * 40
    standing = [drawn_objects(rng, d, SETTINGS) for d in draws]
    clusters = object_clusters(draws, np.zeros((2, 20)), radius=0.5, standing=standing)
    assert [c.presence for c in clusters] == [1.0, 1.0]
    assert [c.typical for c in clusters] in ([couch, beside], [beside, couch])
    for cluster in clusters:
        assert 0.25 < np.sqrt(np.linalg.eigvalsh(cluster.covariance)[1]) < 0.6
