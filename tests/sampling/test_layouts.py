"""Merging objects met twice, and telling layouts apart."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from imapper_prob.layouts import (
    group_layouts,
    match_objects,
    merged_objects,
    placed_objects,
    same_objects,
    through_one_lens,
)
from imapper_prob.models.log_posterior import empty_state, log_posterior
from imapper_prob.models.scene import SceneObject
from tests.models import worlds
from tests.models.worlds import couch


def test_furniture_grows_with_the_person_who_uses_it() -> None:
    library = worlds.library()
    state = empty_state(worlds.problem()).with_item(1, 5, np.array([0.3, 4.3, 0.5]))
    ((_, before),) = placed_objects(state, library)
    ((_, after),) = placed_objects(
        state.with_placement(0, state.placements[0], np.log(1.25)), library
    )
    from_origin = (o.footprint - state.placements[0, :2] for o in (before, after))
    np.testing.assert_allclose(1.25 * next(from_origin), next(from_origin))
    np.testing.assert_allclose(1.25 * before.bounds[:, 2], after.bounds[:, 2])


def test_the_same_couch_met_twice_is_one_object() -> None:
    library, problem = worlds.library(), worlds.problem()
    state = empty_state(problem).with_item(0, 0, np.array([0.0, 4.0, 0.0]))
    near = state.with_item(0, 10, np.array([0.2, 4.1, 0.2]))
    turned = state.with_item(0, 10, np.array([0.2, 4.1, 1.5]))
    far = state.with_item(0, 10, np.array([2.5, 4.0, 0.0]))
    assert len(merged_objects(problem, library, near)) == 1
    assert len(merged_objects(problem, library, turned)) == 2
    assert len(merged_objects(problem, library, far)) == 2
    assert merged_objects(problem, library, empty_state(problem)) == ()


def test_of_two_that_are_one_the_more_important_one_is_reported() -> None:
    library, problem = worlds.library(), worlds.problem()
    places = np.array([0.0, 4.0, 0.0]), np.array([0.2, 4.1, 0.2])
    for first, second in (places, places[::-1]):
        state = empty_state(problem).with_item(0, 0, first).with_item(0, 10, second)
        (found,) = merged_objects(problem, library, state)
        worse = [log_posterior(problem, state.without_item(k)) for k in range(2)]
        assert abs(worse[0] - worse[1]) > 0.01
        placed = placed_objects(state, library)
        (important,) = [o for k, o in placed if k == int(np.argmin(worse))]
        np.testing.assert_array_equal(found.centre, important.centre)


def test_a_seat_half_in_another_is_the_same_whatever_it_is_called() -> None:
    """Couches of 1.6 m by .8, an object of each of two scenelets."""
    first = couch(0.0, 4.0)

    def groups(*others: SceneObject) -> list[list[int]]:
        return same_objects(list(enumerate((first, *others))), 0.6)

    assert groups(couch(0.7, 4.0, label="chair")) == [[0, 1]]
    assert groups(couch(0.9, 4.0, label="chair")) == [[0], [1]]
    assert groups(couch(0.1, 4.0, 3.0, label="stool")) == [[0, 1]]
    assert groups(couch(0.1, 4.0, 3.0)) == [[0, 1]]
    assert groups(couch(0.1, 4.0, label="table")) == [[0], [1]]
    assert groups(couch(0.7, 4.0, label="chair"), couch(1.4, 4.0, label="stool")) == [[0, 1, 2]]
    # One and the same scenelet does not speak of one thing twice.
    assert same_objects([(0, first), (0, couch(0.1, 4.0, label="chair"))], 0.6) == [[0], [1]]


def test_a_table_across_another_is_the_same() -> None:
    """Met from its short side and from its long side: tables have no front. 1.6 m by .8."""
    one = couch(0.0, 4.0, label="table")
    for x, yaw, expected in ((0.1, 3.1, [[0, 1]]), (1.0, 1.57, [[0, 1]]), (1.3, 1.57, [[0], [1]])):
        assert same_objects([(0, one), (1, couch(x, 4.0, yaw, label="table"))], 0.6) == expected
    assert same_objects([(0, one), (1, couch(0.1, 4.0, 3.1, label="shelf"))], 0.6) == [[0], [1]]


def test_matching_needs_groups_of_labels_and_nearness() -> None:
    first = [couch(0, 3), couch(2, 3, label="table")]
    assert match_objects(first, first[::-1], radius=0.5) == [1, 0]
    assert match_objects(first, [first[1], couch(0, 3, label="chair")], radius=0.5) == [1, 0]
    assert match_objects(first, [couch(0, 3), couch(2, 3)], radius=0.5) is None
    assert match_objects(first, [couch(0, 3), couch(2, 3, label="shelf")], radius=0.5) is None
    assert match_objects(first, [couch(0.6, 3), couch(2, 3, label="table")], radius=0.5) is None
    assert match_objects(first, first[:1], radius=0.5) is None
    assert match_objects([], [], radius=0.5) == []


def test_a_room_seen_through_a_longer_lens_is_the_same_room() -> None:
    """Twice as deep with twice the focal length: one layout, and two without knowing that."""
    near, far = [couch(0.5, 3.0)], [couch(0.5, 6.0)]
    first, second = through_one_lens([near, far], [0.0, float(np.log(2.0))])
    np.testing.assert_allclose(first[0].centre, near[0].centre)
    np.testing.assert_allclose(second[0].centre[:2], [0.5, far[0].centre[1] / 2])
    assert second[0].placement.yaw == far[0].placement.yaw
    assert len(group_layouts([near, far], np.zeros(2), radius=0.8).leaders) == 2
    assert len(group_layouts([first, second], np.zeros(2), radius=0.8).leaders) == 1


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_layouts_are_numbered_by_frequency_and_hold_what_matches(seed: int) -> None:
    rng = np.random.default_rng(seed)
    places = rng.uniform(-3, 3, 12)
    sets = [[couch(float(x), 4.0)] for x in places]
    found = group_layouts(sets, rng.normal(size=12), radius=0.5)
    counts = np.bincount(found.indicator)
    assert np.all(np.diff(counts) <= 0)
    for draw, layout in enumerate(found.indicator):
        leader = found.leaders[layout]
        assert abs(places[draw] - places[leader]) <= 0.5
    assert [found.indicator[leader] for leader in found.leaders] == list(range(len(counts)))
