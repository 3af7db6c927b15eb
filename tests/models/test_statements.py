"""Statements: refused by name before anything is sampled, written and read back."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import imapper_prob as im
from imapper_prob.models.problem import label_kinds, labels_of
from imapper_prob.models.statement_rows import check_statements, tell
from imapper_prob.models.statements import Statement, describe, from_json, to_json
from imapper_prob.models.valid import check_problem
from imapper_prob.solver.selection import of_scenelets
from tests.models.said import ALL, LIBRARY, REGION, clip, problem


@pytest.mark.parametrize(
    ("statements", "words"),
    [
        ([im.Presence("piano")], "no 'piano'"),
        ([im.ObjectAt("couch", place=(0.0, -2.0))], "behind the camera"),
        ([im.ObjectAt("couch", box=(2000, 0, 2100, 50))], "outside the picture"),
        ([im.Seen(1, ((-50, 0, -10, 50),), ({"couch": 1.0},))], "outside the picture"),
        ([im.JointAt("PELV", 99, (0, 3, 1), 0.1)], "no frame 99"),
        ([im.Contact("couch", 3, 20)], "no frame 20"),
        ([im.DepthOf((0,), (3.0,), 0.1, person=2)], "no person 2"),
        ([im.SameObject("couch", [(1, 2), (4, 5)], people=(1, 2))], "no person 2"),
        ([im.SameObject("couch", [(1, 2), (4, 55)])], "no frame 55"),
        ([im.Behind("couch", "piano")], "no 'piano'"),
        (
            [im.Presence("chair", there=False), im.Behind("couch", "chair")],
            "contradict each other",
        ),
        (
            [im.Presence("couch", there=False), im.SameObject("couch", [(1, 2), (4, 5)])],
            "contradict each other",
        ),
        (
            [im.Measured("height", 1.5, 0.01), im.Measured("height", 1.6, 0.01)],
            "contradict each other",
        ),
        ([im.Presence("couch"), im.Presence("couch", there=False)], "contradict each other"),
        (
            [im.Presence(("couch", "chair"), there=False), im.Contact("couch", 1, 2)],
            "contradict each other",
        ),
        ([im.Room(REGION), im.ObjectAt("couch", place=(5.0, 3.0))], "contradict each other"),
        ([im.Room([(9, 1), (11, 1), (11, 3)]), im.Room(REGION)], "contradict each other"),
        ([im.Room(REGION), im.JointAt("PELV", 3, (9.0, 3.0, 0.9), 0.1)], "contradict each other"),
        (
            [im.DepthOf((3, 4), (3.0, 3.1), 0.02), im.DepthOf((4,), (6.0,), 0.02)],
            "contradict each other",
        ),
        ([im.Room([(-1, -3), (1, -3), (0, -1)])], "behind the camera"),
        ([im.Presence("couch", region=[(-1, -3), (1, -3), (0, -1)])], "behind the camera"),
        ([im.Presence("couch"), im.Presence("couch")], "is given twice"),
        ([im.Seen(1, (), (), named={"piano": 1.0})], "no 'piano'"),
    ],
)
def test_what_no_scene_can_be_is_refused(statements: list[Statement], words: str) -> None:
    with pytest.raises(im.InputError, match=words):
        check_statements(statements, clip(), labels_of(LIBRARY))


def test_a_stature_is_of_one_person() -> None:
    (track,) = clip().tracks
    two = replace(clip(), tracks=(track, replace(track, name="another")))
    said = [im.Measured("stature", 1.8, 0.02)]
    check_statements(said, clip(), labels_of(LIBRARY))
    with pytest.raises(im.InputError, match="has 2 people"):
        check_statements(said, two, labels_of(LIBRARY))


@pytest.mark.parametrize("number", [np.float32, np.float64, np.int64])
def test_numbers_may_be_those_of_numpy(number) -> None:
    said = [
        im.Measured("height", number(2), number(1)),
        im.ObjectAt("couch", place=(number(0), number(3)), place_std=number(1)),
        im.DepthOf((1,), (number(2),), number(1), scale_error=number(0)),
        im.Seen(0, ((0, 0, 1, 1),), ({"couch": number(1)},), named={"couch": number(1)}),
    ]
    assert list(from_json(to_json(said))) == said


def test_doubts_and_answers_may_be_those_of_numpy() -> None:
    said = [
        im.Presence("couch", there=np.bool_(False), doubt=np.float32(0.25)),
        im.Contact("couch", 1, 2, np.bool_(True), np.float32(0.25)),
    ]
    assert list(from_json(to_json(said))) == said


def test_frames_may_be_numbers_of_numpy() -> None:
    for integer in (np.int64, np.uint8):
        said = [
            im.JointAt("PELV", integer(3), (0, 1, 1), 0.1, person=integer(1)),
            im.Contact("couch", integer(3), integer(5)),
            im.SameObject("couch", np.array([(1, 2), (4, 5)], integer)),
            im.DepthOf(np.array([1, 2], integer), (2.0, 2.0), 0.1, person=integer(1)),
            im.Seen(integer(2), ((0, 0, 1, 1),), ({"couch": 1.0},)),
        ]
        assert list(from_json(to_json(said))) == said


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: im.Measured("weight", 70, 1), "'weight' is not measured"),
        (lambda: im.Measured("height", 1.5, 0.0), "height = 0.0 must be at least"),
        (
            lambda: im.Measured("stature", 5.0, 0.1),
            r"the measured stature = 5.0 must be in \(0.5, 2.5\)",
        ),
        (lambda: im.ObjectAt("couch"), "neither place, size nor box"),
        (lambda: im.ObjectAt("couch", place=(0.0, math.nan)), "2 finite numbers"),
        (lambda: im.ObjectAt("couch", place=((0.0, 1.0), 3.0)), "2 finite numbers"),
        (lambda: im.ObjectAt("couch", box=(5, 5, 1, 9)), "left, top, right, bottom"),
        (lambda: im.ObjectAt("couch", size=(1, -1, 1)), "must be positive"),
        (lambda: im.Presence("couch", doubt=0.0), "must be a probability"),
        (lambda: im.Presence("couch", region=[(0, 0), (1, 1)]), "three or more corners"),
        (lambda: im.Room([(0, 0), (1, 1), (1, 0), (0, 1)]), "do not cross"),
        (lambda: im.JointAt("NOSE", 0, (0, 1, 1), 0.1), "'NOSE' is no joint"),
        (lambda: im.JointAt("PELV", 0.5, (0, 1, 1), 0.1), "frame = 0.5 must be a whole number"),
        (lambda: im.Contact("couch", 1, "2"), "last = '2' must be a whole number"),
        (lambda: im.Contact("couch", True, 2), "first = True must be a whole number"),
        (lambda: im.Contact("couch", 1, 2, person=0), "person = 0 must be at least 1"),
        (lambda: im.DepthOf((1, 1), (2.0, 2.0), 0.1), "each frame once"),
        (lambda: im.DepthOf((1,), (-2.0,), 0.1), "behind the camera"),
        (lambda: im.Contact("couch", 5, 4), "frame 4 is before the first, 5"),
        (lambda: im.Seen(0, ((0, 0, 1, 1),), ()), "1 boxes in the picture, but 0 labels"),
        (
            lambda: im.Seen(0, ((0, 0, 1, 1),), ({"couch": 2},)),
            "the probability of 'couch' = 2 must be at most 1",
        ),
        (lambda: im.Seen(0, (), (), named={"couch": "a lot"}), "= 'a lot' must be a finite number"),
        (lambda: im.DepthOf((1,), (2.0,), 0.1, -0.1), "scale_error = -0.1 must be at least 0"),
        (lambda: im.Presence(()), "must be a label"),
        (lambda: im.SameObject("couch", [(1, 2)]), "two spans or more"),
        (lambda: im.SameObject("couch", [(1, 2), (4, 5)], people=[1]), "a person for each"),
        (lambda: im.SameObject("couch", [(1, 2), (5, 4)]), "frame 4 is before the first, 5"),
        (lambda: im.Behind("couch", ()), "must be a label"),
        (
            lambda: im.Measured("height", True, 0.1),
            "the measured height = True must be a finite number",
        ),
        (
            lambda: im.Measured("height", 10**400, 0.1),
            "the measured height = 1000000000.* must be a finite number",
        ),
        (lambda: im.Presence("couch", there="no"), "there of couch = 'no' must be True or False"),
        (lambda: im.Contact("couch", 1, 2, "touches"), "= 'touches' must be True or False"),
        (lambda: im.SameObject("couch", [(1, 2), (4, 5)], 1), "= 1 must be True or False"),
        (
            lambda: im.ObjectAt("couch", place=(0, 3), place_std=1e-9),
            "place_std of couch = 1e-09 must be at least 0.0001",
        ),
        (
            lambda: im.Seen(0, ((0, 0, 1, 1),), ({"couch": 0.5},), named={"couch": 0.4}),
            "a couch with probability 0.5, but all labels together name one with 0.4",
        ),
    ],
)
def test_what_is_no_statement_is_refused(make, words: str) -> None:
    with pytest.raises(im.InputError, match=words):
        make()


def test_every_statement_can_be_said() -> None:
    assert all(describe(statement) for statement in ALL)


def test_statements_are_written_and_read_back() -> None:
    assert from_json(to_json(ALL)) == ALL


def test_frames_of_the_second_person_follow_those_of_the_first() -> None:
    (track,) = clip().tracks
    two = replace(clip(), tracks=(track, replace(track, name="another")))
    said = [
        im.JointAt("PELV", 3, (0, 3, 1), 0.1, person=2),
        im.Contact("couch", 4, 9, person=2),
        im.DepthOf((5, 7), (3.0, 3.1), 0.1, person=2),
        im.SameObject("couch", [(4, 9), (1, 2)], people=[2, 1]),
    ]
    told = tell(problem(0.0), said, two, labels_of(LIBRARY))
    assert told.given_kinds[:2, 5:].tolist() == [[23, 24], [24, 30]]
    assert told.given_rows[:, 0].tolist() == [25, 27, 24, 1]
    assert told.given_rows[2:, 1].tolist() == [30, 3]


def test_a_part_of_a_library_numbers_labels_as_the_whole() -> None:
    """A run keeps only the scenelets that some draw has."""
    part, labels = of_scenelets(problem(0.0), [2, 5]), labels_of(LIBRARY)
    said = [im.Presence("chair")]
    by_part, by_whole = (tell(p, said, clip(), labels) for p in (part, problem(0.0)))
    check_problem(by_part)
    np.testing.assert_array_equal(label_kinds(by_part), label_kinds(by_whole))
    np.testing.assert_array_equal(by_part.given_labels, by_whole.given_labels)
