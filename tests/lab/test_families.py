"""Families: every scenelet of the built-in library has one, and can be left out with it."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import pytest

from imapper_prob.models.errors import InputError
from imapper_prob.models.scenelet import Library
from imapper_prob.scenelets.library import built_in_library, joined
from lab.unseen.families import FAMILIES, family_of, only_family, without_family

OTHER_WAYS = {
    "legs-crossed", "leg-folded", "cross-legged", "perch", "lean-on-arm", "slouch",
    "floor-sit", "floor-lie", "squat", "kneel", "bend",
}  # fmt: skip
WITHOUT_FURNITURE = {"floor-sit", "floor-lie", "squat", "kneel", "bend", "walk"}


BEGINNINGS = {
    "legs-crossed": ("sit-crossed-",),
    "leg-folded": ("sit-on-leg-",),
    "cross-legged": ("sit-tailor-",),
    "perch": ("perch-",),
    "lean-on-arm": ("sit-leaning-",),
    "slouch": ("slouch-", "sit-back-"),
    "floor-sit": ("sit-floor-",),
    "floor-lie": ("lie-floor-",),
    "squat": ("squat-",),
    "kneel": ("kneel-",),
    "bend": ("pick-up-floor-", "put-down-floor-", "bend-over-"),
}


@pytest.mark.parametrize("family", sorted(OTHER_WAYS))
def test_a_family_is_all_whose_names_begin_so(family: str) -> None:
    library = built_in_library()
    own = [s.name for s in library if family_of(s.name) == family]
    assert own == [s.name for s in library if s.name.startswith(BEGINNINGS[family])]


def test_every_scenelet_has_a_family() -> None:
    count = Counter(family_of(s.name) for s in built_in_library())
    assert set(count) == set(FAMILIES)
    assert set(FAMILIES) >= OTHER_WAYS
    assert {"walk", "stand", "sit", "sit-down", "stand-up", "lie", "reach"} < set(FAMILIES)
    assert min(count.values()) >= 8
    # No family of another way to do things outweighs the plain one.
    assert all(count[name] < 0.1 * count["sit"] for name in OTHER_WAYS)


@pytest.mark.parametrize(
    ("name", "family"),
    [
        ("sit-on-leg-bed-004", "leg-folded"),
        ("sit-bed-004", "sit"),
        ("sit-floor-knees-up-001", "floor-sit"),
        ("perch-table-011", "perch"),
        ("pick-up-floor-000", "bend"),
        ("pick-up-table-000", "pick-up"),
        ("squat-down-007", "squat"),
        ("built-in 4/kneel-one-015", "kneel"),
        ("built-in 4, seed 1/walk-001", "walk"),
        ("office-12-kneel", None),
        ("scene04/003", None),
        ("sit", None),
    ],
)
def test_the_name_says_which(name: str, family: str | None) -> None:
    assert family_of(name) == family


@pytest.mark.parametrize("family", sorted(OTHER_WAYS))
@pytest.mark.slow
def test_a_family_can_be_left_out_or_taken_alone(family: str) -> None:
    library = built_in_library()
    own, others = only_family(library, family), without_family(library, family)
    assert len(own) + len(others) == len(library)
    assert {family_of(s.name) for s in own} == {family}
    assert family not in {family_of(s.name) for s in others}
    assert [s.name for s in others] == [s.name for s in library if s in others.scenelets]
    assert len({library.name, own.name, others.name}) == 3
    bare = {not s.objects for s in own}
    assert bare == {family in WITHOUT_FURNITURE}


def test_scenelets_of_other_libraries_are_of_no_family() -> None:
    few = Library("few", built_in_library().scenelets[-60:])
    recorded = Library("office", tuple(replace(s, name=f"take-{i}") for i, s in enumerate(few)))
    both = joined([few, recorded, Library("again", few.scenelets)])
    left = without_family(both, "kneel")
    assert sum(s.name.startswith("take-") for s in left) == len(few)
    kneeling = sum(family_of(s.name) == "kneel" for s in few)
    assert kneeling > 0
    assert len(both) - len(left) == 2 * kneeling


def test_an_unknown_family_is_named() -> None:
    for select in (only_family, without_family):
        with pytest.raises(InputError, match=r"no family 'juggle'; there are walk, "):
            select(built_in_library(), "juggle")
