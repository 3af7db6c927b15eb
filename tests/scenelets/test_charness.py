"""Charness: high where similar motions come with the same furniture."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from imapper_prob.models.scene import SceneObject
from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.scenelets.charness import (
    KERNEL_WIDTH,
    charness,
    charness_maps,
    motion_distances,
    similarity,
)
from imapper_prob.scenelets.library import built_in_library
from tests.scenelets.motions import box, standing


def library_of(*furniture: tuple[SceneObject, ...], weights: tuple[float, ...] = ()) -> Library:
    """Scenelets of one motion, each with its own furniture."""
    weights = weights or (1.0,) * len(furniture)
    return Library(
        "small",
        tuple(
            Scenelet(f"s-{i}", "stand", standing(), objects, weight=weight)
            for i, (objects, weight) in enumerate(zip(furniture, weights, strict=True))
        ),
    )


def test_the_map_is_the_weighted_mean_of_similar_motions() -> None:
    histograms = np.zeros((3, 1, 5, 5))
    histograms[:, 0, 2, 2] = (1.0, 0.5, 0.0)
    distances = np.array([[0.0, KERNEL_WIDTH, 2 * KERNEL_WIDTH]])
    weights = np.array([1.0, 2.0, 1.0])
    kernel = np.exp([0.0, -0.5, -2.0]) * weights
    expected = kernel @ (1.0, 0.5, 0.0) / kernel.sum()
    assert charness_maps(distances, histograms, weights)[0, 0, 2, 2] == pytest.approx(expected)


def test_far_motions_do_not_divide_by_nothing() -> None:
    histograms = np.ones((2, 1, 5, 5))
    maps = charness_maps(np.array([[50.0, 51.0]]), histograms, np.ones(2))
    assert_allclose(maps, 1.0)


def test_same_motion_same_furniture_is_characteristic() -> None:
    library = library_of(*[(box("chair"),)] * 6)
    assert_allclose(charness(library, motion_distances(library)), 1.0)


def test_same_motion_any_furniture_is_not() -> None:
    places = [(box("chair", x=x, y=y),) for x in (-1.0, 0.0, 1.0) for y in (-1.0, 0.0, 1.0)]
    library = library_of(*places, (box("table"),), ())
    assert charness(library, motion_distances(library)).max() <= 0.1 + 1e-9


def test_a_scenelet_is_no_witness_of_its_own() -> None:
    library = library_of((box("chair"),), (), ())
    assert_allclose(charness(library, motion_distances(library)), [0.0, 0.5, 0.5])


def test_a_long_stay_counts_once() -> None:
    # Ten pieces of one stay on a chair, and one person who stands without any.
    objects = [(box("chair"),)] * 10 + [()] * 2
    counted = charness(library := library_of(*objects), motion_distances(library))
    once = library_of(*objects, weights=(0.1,) * 10 + (1.0,) * 2)
    assert counted[-1] == pytest.approx(10 / 11)
    assert charness(once, motion_distances(once))[-1] == pytest.approx(1 / 2)


def test_nothing_to_say_without_furniture_or_company() -> None:
    bare = library_of((), ())
    assert_allclose(charness(bare, motion_distances(bare)), 0.0)
    alone = library_of((box("chair"),))
    assert_allclose(charness(alone, motion_distances(alone)), 0.0)


def test_sitting_and_reaching_are_characteristic_and_walking_is_not() -> None:
    library = built_in_library()
    values = charness(library, motion_distances(library))
    by_action = {
        action: np.array([v for v, s in zip(values, library, strict=True) if s.action == action])
        for action in ("sit", "reach", "walk")
    }
    assert np.median(by_action["sit"]) > 0.4
    assert np.median(by_action["walk"]) < 0.1
    interesting = np.concatenate([by_action["sit"], by_action["reach"]])
    assert np.mean(interesting[:, None] > by_action["walk"]) > 0.95


def test_similarity_is_a_proposal_that_reaches_every_scenelet() -> None:
    rows = similarity(motion_distances(built_in_library()))
    assert_allclose(rows.sum(1), 1.0)
    assert_allclose(np.diag(rows), 0.0)
    off = ~np.eye(len(rows), dtype=bool)
    assert rows[off].min() >= 0.09 / len(rows)
    assert_allclose(similarity(np.zeros((1, 1))), [[1.0]])
