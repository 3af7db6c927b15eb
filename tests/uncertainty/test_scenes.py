"""Distances between scenes, what they are grouped by, and what is said of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imapper_prob.layouts import Layouts, object_distance, pair_objects
from imapper_prob.models.scene import Cuboid, Placement, SceneObject
from imapper_prob.samplers.diagnostics import ess, layout_probabilities
from imapper_prob.uncertainty.scenes import (
    Representative,
    covariances_about,
    describe_difference,
    group_scenes,
)
from tests.runs import posterior


def item(label: str, x: float = 0.0, y: float = 4.0, yaw: float = 0.0) -> SceneObject:
    box = Cuboid("body", np.array([0.0, 0.0, 0.4]), np.array([0.6, 0.6, 0.8]))
    return SceneObject(label, Placement(x, y, yaw), (box,))


SETS = st.lists(
    st.builds(
        item,
        st.sampled_from(["chair", "couch", "stool", "table", "shelf"]),
        st.floats(-2, 2),
        st.floats(2, 6),
        st.floats(-4, 4),
    ),
    max_size=4,
)


def distance(first: list[SceneObject], second: list[SceneObject]) -> float:
    return pair_objects(first, second).distance


@given(SETS, SETS, SETS)
@settings(max_examples=200)
def test_the_distance_is_a_metric(
    a: list[SceneObject], b: list[SceneObject], c: list[SceneObject]
) -> None:
    assert distance(a, a) == pytest.approx(0, abs=1e-6)
    assert distance(a, b) == pytest.approx(distance(b, a))
    assert distance(a, c) <= distance(a, b) + distance(b, c) + 1e-9


@given(SETS, SETS)
@settings(max_examples=60)
def test_every_object_is_paired_or_left_over_once(
    a: list[SceneObject], b: list[SceneObject]
) -> None:
    found = pair_objects(a, b)
    assert sorted([i for i, _ in found.pairs] + list(found.only_first)) == list(range(len(a)))
    assert sorted([j for _, j in found.pairs] + list(found.only_second)) == list(range(len(b)))


def test_distances_by_hand() -> None:
    assert distance([item("chair")], []) == pytest.approx(1)
    assert distance([item("chair")], [item("chair", 0.3, 4.4)]) == pytest.approx(0.5)
    # The kind of a seat is no part of a scene.
    assert distance([item("chair")], [item("stool", 0.3, 4.4)]) == pytest.approx(0.5)
    assert distance([item("chair")], [item("chair", yaw=1.0)]) == pytest.approx(0.3)
    # Another kind of thing, or too far away: both are left over.
    assert distance([item("chair")], [item("table")]) == pytest.approx(np.sqrt(2))
    assert distance([item("chair")], [item("chair", 3.0)]) == pytest.approx(np.sqrt(2))
    two = [item("chair"), item("shelf", 2.0)]
    assert distance(two, [item("shelf", 2.0, 4.6)]) == pytest.approx(np.hypot(1, 0.6))


def test_orientations_that_look_alike_are_one() -> None:
    assert object_distance(item("table"), item("table", yaw=np.pi)) == pytest.approx(0, abs=1e-6)
    assert object_distance(item("stool"), item("stool", yaw=-1.0)) == pytest.approx(0.3)
    assert object_distance(item("chair"), item("chair", yaw=np.pi)) == pytest.approx(0.3 * np.pi)
    assert object_distance(item("chair", yaw=3.1), item("chair", yaw=-3.1)) < 0.03


def test_the_cheapest_pairing_is_found_not_the_nearest_first() -> None:
    first = [item("chair", 0.0), item("chair", 1.0)]
    second = [item("chair", 0.9), item("chair", -0.8)]
    assert pair_objects(first, second).pairs == ((0, 1), (1, 0))


def test_layouts_that_are_near_make_one_scene() -> None:
    layouts = [
        [item("couch"), item("table", 1.0)],
        [item("chair", 0.2), item("table", 1.0)],
        [item("couch")],
        [item("couch", 0.1)],
        [item("couch", 0.3), item("table", 1.2)],
        [],
    ]
    assert group_scenes(layouts).tolist() == [0, 0, 1, 1, 0, 2]
    assert group_scenes([]).tolist() == []


def layout_of(
    members: list[int], *, turned_round: bool, objects: list[SceneObject]
) -> Representative:
    """A layout of draws of two objects, whose first draw is shown."""
    partners = np.tile([1, 0] if turned_round else [0, 1], (len(members), 1))
    shown = tuple(objects[k] for k in partners[0].tolist())
    return Representative(members[0], shown, np.array(members), partners)


def test_ninety_percent_of_the_furniture_of_a_scene_is_in_its_region(
    rng: np.random.Generator,
) -> None:
    """Layouts differ in the order of their objects, and furniture stands beside its scenelet."""
    count = 2000
    seen, standing = [], []
    for n in range(count):
        places = np.array([[0.0, 4.0], [1.5, 4.0]]) + rng.normal(0, 0.1, (2, 2)) + 0.3 * (n % 2)
        beside = places + rng.normal(0, (0.2, 0.4), (2, 2))
        order = [0, 1] if n % 2 else [1, 0]
        names = ("couch", "table")
        seen.append([item(names[k], *places[k]) for k in order])
        standing.append([item(names[k], *beside[k]) for k in order])
    first = layout_of(list(range(0, count, 2)), turned_round=True, objects=seen[0])
    second = layout_of(list(range(1, count, 2)), turned_round=False, objects=seen[1])
    covariances = covariances_about(first, [first, second], seen=seen, standing=standing)
    for k, (o, covariance) in enumerate(zip(first.objects, covariances, strict=True)):
        stand = [standing[n][k if n % 2 else 1 - k].centre[:2] for n in range(count)]
        offset = np.array(stand) - o.centre[:2]
        distance = np.einsum("ni,ij,nj->n", offset, np.linalg.inv(covariance), offset)
        assert np.mean(distance < 4.605) == pytest.approx(0.9, abs=0.03)


def test_of_one_draw_the_spread_is_unknown() -> None:
    seen = [[item("couch"), item("table", 1.5)], [item("couch", 0.1), item("table", 1.6)]]
    first, second = (layout_of([n], turned_round=False, objects=seen[n]) for n in range(2))
    alone = covariances_about(first, [first], seen=seen, standing=seen)
    assert alone.shape == (2, 2, 2)
    assert np.isnan(alone).all()
    both = covariances_about(first, [first, second], seen=seen, standing=seen)
    np.testing.assert_allclose(both, [[[0.005, 0.0], [0.0, 0.0]]] * 2, atol=1e-12)


@pytest.mark.parametrize(
    ("other", "words"),
    [
        ([item("couch")], "no table"),
        ([item("couch"), item("table", 1.0), item("shelf", -1.2, 5.0)],
         "also a shelf 1.2 m to the left and 5.0 m away"),
        ([item("couch", 0.0, 4.6), item("table", 1.0)], "the seat 0.6 m further away"),
        ([item("couch", -0.5, 3.5), item("table", 1.0)],
         "the seat 0.5 m to the left, 0.5 m nearer"),
        ([item("stool"), item("table", 1.0)], "the same furniture, nearly as it stands"),
        ([item("couch", yaw=np.pi / 2), item("table", 1.0)], "the seat turned by 90°"),
        ([item("couch", 0.25, 4.25), item("table", 1.0)], "the seat 0.4 m off"),
        ([item("couch", 0.1), item("table", 1.0)], "the same furniture, nearly as it stands"),
        ([item("chair", 0.6), item("shelf", 1.0)],
         "the seat 0.6 m to the right; no table; "
         "also a shelf 1.0 m to the right and 4.0 m away"),
    ],
)  # fmt: skip
def test_differences_in_words(other: list[SceneObject], words: str) -> None:
    assert describe_difference([item("couch"), item("table", 1.0)], other) == words


def test_of_two_chairs_the_distance_says_which() -> None:
    two = [item("chair", y=3.0), item("chair", y=5.0)]
    assert describe_difference(two, [item("chair", y=3.0), item("stool", y=5.4)]) == (
        "the seat (at 5.0 m) 0.4 m further away"
    )
    assert describe_difference(two, two[:1]) == "no seat (at 5.0 m)"


def test_scenes_are_layouts_put_together() -> None:
    run = posterior()
    found, samples = run.scene_probabilities, run.samples
    scenes = run.scenes(len(found.layouts))
    numbers = sorted(n for s in scenes for n in s.layouts)
    assert numbers == list(range(1, len(samples.layouts.leaders) + 1))
    assert sum(s.probability for s in scenes) == pytest.approx(1)
    shares = samples.probabilities.probability
    place = {int(n): i for i, n in enumerate(samples.probabilities.layouts)}
    for s in scenes:
        assert s.probability == pytest.approx(sum(shares[place[n]] for n in s.layouts))
        assert samples.layouts.indicator[s.draw] + 1 == s.layouts[0]
        assert s.scene.log_posterior == samples.log_posterior.flat[s.draw]
    assert scenes[0].difference == ""
    assert all(s.difference for s in scenes[1:])
    assert (np.diff([s.probability for s in scenes]) <= 1e-12).all()
    first = run.layouts(3)[0]
    assert first.layouts == (1,)
    assert first.probability == samples.probabilities.probability[0]


def test_scenes_are_apart() -> None:
    founders = [s.scene.objects for s in posterior().scenes(20)]
    apart = [pair_objects(a, b).distance for i, a in enumerate(founders) for b in founders[:i]]
    # They are sorted as one lens sees them all, which moves pieces by some per cent.
    assert not apart or min(apart) >= 0.8


def test_the_error_of_a_scene_is_that_of_its_indicator() -> None:
    run = posterior()
    best = run.scenes(1)[0]
    inside = np.isin(run.samples.layouts.indicator + 1, best.layouts).reshape(run.samples.shape)
    alone = layout_probabilities(inside.astype(int), rng=np.random.default_rng(0))
    # Of a run of a few dozen draws, from transitions of two states or of several.
    assert 0.5 < best.error / alone.standard_error[0] < 2.0
    assert run.scenes(1)[0] is best  # a call costs nothing the second time


def test_what_a_scene_explains_is_counted_from_its_draw() -> None:
    run = posterior()
    best = run.scenes(1)[0]
    told = best.explains
    assert told is not None
    lengths = {s.name: s.n_frames for s in run.solution.library}
    assert told.covered == sum(lengths[name] for name, _ in best.scene.assignment)
    assert [first for first, _ in told.frames] == [
        int(run.clip.frame_ids[start]) for _, start in best.scene.assignment
    ]
    assert told.n_frames == run.clip.n_frames
    # The table of the demo hides the feet of whoever sits there, and the detector loses them.
    assert 0 < told.unsure_behind <= told.unsure
    share = told.sure_behind / (14 * told.n_frames - told.unsure)
    assert told.unsure_behind / told.unsure > 2 * share
    assert f"{told.covered} of {told.n_frames} frames" in told.text


def test_a_scene_that_all_draws_have_has_an_error() -> None:
    run = posterior()
    samples, draws = run.samples, run.samples.log_posterior.size
    one = Layouts(np.zeros(draws, np.int64), samples.layouts.leaders[:1])
    agreed = replace(run, samples=replace(samples, layouts=one))
    (error,) = agreed.scene_probabilities.standard_error
    assert error == 1 / (float(ess(samples.log_posterior)) + 2)
