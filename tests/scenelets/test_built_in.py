"""The built-in library: human bodies, on the floor, beside furniture and not in it."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from numpy.typing import NDArray

from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.models.settings import SIDE_SPREAD
from imapper_prob.models.skeleton import (
    BONE_LENGTHS,
    HEAD,
    LANK,
    LWRI,
    PELV,
    RANK,
    REFERENCE_STATURE,
    RWRI,
    THRX,
    facing,
)
from imapper_prob.scenelets.library import built_in_library
from imapper_prob.scenelets.plausibility import faults
from imapper_prob.scenelets.procedural import catalogue
from imapper_prob.scenelets.procedural.body import (
    ANKLE_HEIGHT,
    STATURE_RANGE,
    TRACKER_ERROR,
    Drawn,
    Person,
)
from imapper_prob.scenelets.procedural.catalogue import CATALOGUE, Entry, build_library
from imapper_prob.scenelets.procedural.on_foot import idle
from lab.scenelets import seat_top
from lab.unseen.families import family_of
from tests.machine import timed

SEATS = ("chair", "couch", "stool", "bench", "bed")
LOW_DOWN = ("floor-sit", "floor-lie", "squat", "kneel", "bend")
Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def library() -> Library:
    return built_in_library()


def every_joint(library: Library) -> Array:
    return np.concatenate([s.joints for s in library])


def doing(library: Library, *actions: str) -> list[Scenelet]:
    return [s for s in library if s.action in actions]


def wrists_seen_from(scenelet: Scenelet, piece: int) -> Array:
    """(n, 2, 3) wrists in the frame of a piece of furniture, metres."""
    at = scenelet.objects[piece].placement
    wrists = scenelet.joints[:, [RWRI, LWRI]] - (at.x, at.y, 0.0)
    return np.concatenate([wrists[..., :2] @ at.rotation, wrists[..., 2:]], -1)


def test_there_are_enough_of_every_kind(library: Library) -> None:
    assert 2000 <= len(library) <= 2300
    count = Counter(s.name.rsplit("-", 1)[0] for s in library)
    assert count == {entry.name: entry.count for entry in CATALOGUE}
    assert set(Counter(s.action for s in library)) == {
        "walk", "stand", "sit", "sit-down", "stand-up", "lie", "reach", "pick-up", "put-down",
        "squat", "kneel", "bend",
    }  # fmt: skip
    labels = Counter(label for s in library for label in set(s.labels))
    assert set(labels) == {*SEATS, "table", "counter", "shelf"}
    assert min(labels.values()) >= 24


def test_kinds_are_in_proportion(library: Library) -> None:
    n = len(library)
    free = sum(not s.objects for s in library)
    assert free / n == pytest.approx(0.24, abs=0.01)
    low = [s for s in library if family_of(s.name) in LOW_DOWN]
    assert len(low) / n == pytest.approx(0.06, abs=0.005)
    assert not any(s.objects for s in low)
    sitting = doing(library, "sit", "sit-down", "stand-up")
    seated = [s.objects[0].label for s in sitting if s.objects]
    assert len(seated) / n == pytest.approx(0.52, abs=0.01)
    taken = Counter(seated)
    assert taken["chair"] / taken["couch"] == pytest.approx(1.0, abs=0.1)
    assert taken["stool"] / taken["couch"] == pytest.approx(1.5 / 4, abs=0.02)
    assert taken["bench"] / taken["couch"] == pytest.approx(0.7 / 4, abs=0.02)
    assert len(doing(library, "reach")) / n == pytest.approx(0.115, abs=0.01)
    assert len(doing(library, "lie")) / n == pytest.approx(0.02, abs=0.005)


@pytest.mark.slow
def test_the_same_library_comes_out_twice_and_soon(library: Library) -> None:
    again, units = timed(lambda: build_library(0))
    # 9 s on a common machine, which takes 2 s; a forgotten loop takes longer.
    assert units < 300
    assert again.digest == library.digest
    assert again.name == library.name == f"built-in {catalogue.VERSION}"


def test_another_seed_gives_another_library(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(catalogue, "CATALOGUE", CATALOGUE[:1])
    one, other = build_library(0), build_library(1)
    assert one.digest != other.digest
    assert one.name != other.name


def test_a_line_does_not_depend_on_the_others(
    library: Library, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(catalogue, "CATALOGUE", CATALOGUE[5:4:-1])
    for scenelet in build_library(0):
        (same,) = (s for s in library if s.name == scenelet.name)
        np.testing.assert_array_equal(same.joints, scenelet.joints)


def test_what_nobody_can_do_is_drawn_again(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[int] = []

    def clumsy(rng: np.random.Generator, person: Person) -> Drawn:
        tried.append(1)
        drawn = idle(rng, person)
        lifted = len(tried) % 3 > 0
        return drawn._replace(joints=np.add(drawn.joints, (0.0, 0.0, 0.2 * lifted)))

    monkeypatch.setattr(catalogue, "CATALOGUE", (Entry("hover", "stand", 4, clumsy),))
    assert len(build_library()) == 4
    assert len(tried) == 6


def test_a_recipe_that_never_works_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def flying(rng: np.random.Generator, person: Person) -> Drawn:
        drawn = idle(rng, person)
        return drawn._replace(joints=np.add(drawn.joints, (0.0, 0.0, 1.0)))

    monkeypatch.setattr(catalogue, "CATALOGUE", (Entry("fly", "stand", 2, flying),))
    with pytest.raises(RuntimeError, match=r"line fly, scenelet 0: 50 .* stands on nothing"):
        build_library()


def test_clips_last_a_second_or_two(library: Library) -> None:
    assert {s.fps for s in library} == {10.0}
    assert all(15 <= s.n_frames <= 20 for s in library)


def test_a_person_could_have_done_it_all(library: Library) -> None:
    found = [(s.name, fault) for s in library for fault in faults(s.joints, s.objects, fps=s.fps)]
    assert found == []


def test_bones_keep_their_length(library: Library) -> None:
    joints = every_joint(library)
    for (a, b), expected in BONE_LENGTHS.items():
        length = np.linalg.norm(joints[:, a] - joints[:, b], axis=-1)
        # Two joints, each with an error along the bone.
        assert length.std() == pytest.approx(TRACKER_ERROR * np.sqrt(2 / 3), rel=0.1), (a, b)
        assert length.mean() == pytest.approx(expected, abs=0.001), (a, b)
        assert np.abs(length - expected).max() < 0.035, (a, b)


def test_feet_are_on_the_floor(library: Library) -> None:
    legs_up = {"lie", "cross-legged", *LOW_DOWN}
    upright = [s for s in library if family_of(s.name) not in legs_up]
    ankles = np.concatenate([s.joints[:, [RANK, LANK], 2] for s in upright])
    assert ankles.min() >= ANKLE_HEIGHT - 0.03
    # One foot carries at any time.
    assert ankles.min(1).max() <= ANKLE_HEIGHT + 0.03


def test_walks_are_as_fast_as_people_indoors(library: Library) -> None:
    steady = [s for s in library if s.name.rsplit("-", 1)[0] == "walk"]
    speed = [
        np.linalg.norm(np.diff(s.joints[:, PELV], axis=0), axis=-1).mean() * 10 for s in steady
    ]
    assert 0.35 < min(speed) < 0.65
    assert 1.2 < max(speed) < 1.5
    assert np.mean(speed) == pytest.approx(0.97, abs=0.08)
    turns = [facing(s.joints[-1]) - facing(s.joints[0]) for s in steady]
    assert np.mean(np.abs(turns) < 0.25) > 0.3
    assert np.mean(np.abs(turns) > 0.5) > 0.25


def test_nothing_is_left_handed(library: Library) -> None:
    for wrists in ("reach", "pick-up", "stand"):
        height = np.concatenate([s.joints[:, [RWRI, LWRI], 2] for s in doing(library, wrists)])
        assert height[:, 0].mean() == pytest.approx(height[:, 1].mean(), abs=1e-9)


def test_seated_people_sit_on_their_seats(library: Library) -> None:
    for scenelet in (s for s in doing(library, "sit") if s.objects):
        middle = scenelet.joints[scenelet.n_frames // 2]
        piece = scenelet.objects[0]
        assert piece.label in SEATS
        seat = next(c for c in piece.cuboids if c.part == "seat")
        offset = middle[PELV, :2] - (piece.placement.x, piece.placement.y)
        across, forward = offset @ piece.placement.rotation
        low, high = (seat.centre + sign * seat.size / 2 for sign in (-1, 1))
        assert low[0] < across < high[0], scenelet.name
        assert low[1] < forward < high[1], scenelet.name
        assert 0.02 < middle[PELV, 2] - high[2] < 0.2, scenelet.name


def test_who_sits_down_or_stands_up_does(library: Library) -> None:
    for scenelet in doing(library, "sit-down", "stand-up"):
        height = scenelet.joints[:, PELV, 2]
        first, last = (height[0], height[-1]) if scenelet.action == "sit-down" else height[[-1, 0]]
        assert first > 0.78, scenelet.name
        assert last < 0.72, scenelet.name


def test_hands_reach_the_shelf_at_every_height(library: Library) -> None:
    heights = []
    for scenelet in doing(library, "reach"):
        (shelf,) = scenelet.objects
        wrists = wrists_seen_from(scenelet, 0).reshape(-1, 3)
        low, high = shelf.bounds
        beside = np.maximum(np.maximum(low - wrists, wrists - high), 0.0)
        nearest = np.linalg.norm(beside, axis=-1)
        assert nearest.min() < 0.10, scenelet.name
        heights.append(wrists[nearest.argmin(), 2])
    share, _ = np.histogram(heights, [0.25, 0.6, 0.95, 1.3, 1.65, 2.0])
    assert share.sum() == len(heights)
    assert share.min() > 0.05 * len(heights)


def test_hands_come_to_what_is_picked_up(library: Library) -> None:
    for scenelet in (s for s in doing(library, "pick-up", "put-down") if s.objects):
        wrists = wrists_seen_from(scenelet, 0)
        low, high = scenelet.objects[0].bounds
        over = ((wrists[..., :2] > low[:2]) & (wrists[..., :2] < high[:2])).all(-1)
        above = wrists[..., 2] - high[2]
        assert (over & (above > -0.02) & (above < 0.25)).any(), scenelet.name
        # The hands end or begin before the chest, with what was taken.
        ended = -1 if scenelet.action == "pick-up" else 0
        assert scenelet.joints[ended, [RWRI, LWRI], 2].max() > 0.85, scenelet.name


def test_who_leans_on_something_touches_it(library: Library) -> None:
    for scenelet in (s for s in library if s.name.startswith("lean-")):
        (piece,) = scenelet.objects
        middle = scenelet.joints[scenelet.n_frames // 2]
        at = piece.placement
        edge = piece.bounds[1, 1] - ((middle[PELV, :2] - (at.x, at.y)) @ at.rotation)[1]
        if scenelet.name.startswith("lean-on-"):
            wrists = wrists_seen_from(scenelet, 0)
            assert (wrists[..., 1] < piece.bounds[1, 1] + 0.03).all(), scenelet.name
            assert np.abs(wrists[..., 2] - piece.bounds[1, 2] - 0.05).max() < 0.08, scenelet.name
            assert (middle[THRX] - middle[PELV])[1] > 0.10, scenelet.name
        else:
            assert -0.25 < edge < -0.05, scenelet.name
            assert abs(at.yaw) < 0.3, scenelet.name


def test_heads_are_up_unless_people_lie_or_bend(library: Library) -> None:
    for scenelet in doing(library, "walk", "sit"):
        assert (scenelet.joints[:, HEAD, 2] > scenelet.joints[:, THRX, 2] + 0.1).all()


def test_furniture_stands_on_the_floor_at_its_middle(library: Library) -> None:
    for scenelet in library:
        for piece in scenelet.objects:
            low, high = piece.bounds
            assert low[2] == pytest.approx(0.0, abs=1e-9)
            np.testing.assert_allclose((low + high)[:2], 0.0, atol=1e-9)


def test_furniture_has_its_real_size_in_the_scale_of_its_performer(library: Library) -> None:
    largest = REFERENCE_STATURE / STATURE_RANGE[0]
    tallest = {label: 0.0 for label in ("table", "counter", "shelf")}
    for scenelet in library:
        for piece in scenelet.objects:
            if piece.label in tallest:
                tallest[piece.label] = max(tallest[piece.label], piece.bounds[1, 2])
    assert 0.76 < tallest["table"] <= 0.76 * largest
    assert 0.95 < tallest["counter"] <= 0.95 * largest
    assert 2.25 < tallest["shelf"] <= 2.25 * largest


def test_all_hips_are_as_high_above_a_seat(library: Library) -> None:
    """Furniture in the scale of another body than the motion's would vary this by 2 cm."""
    above = []
    for scenelet in library:
        if scenelet.name.startswith("sit-chair"):
            pelvis = float(np.median(scenelet.joints[:, PELV, 2]))
            chairs = [o for o in scenelet.objects if o.label == "chair"]
            above.append(pelvis - seat_top(chairs[0]))
    assert len(above) > 20
    assert np.std(above) < 0.008


def test_sides_of_a_label_differ_as_the_model_says(library: Library) -> None:
    """The log ratio of the sides of two pieces has twice the variance of the log of one."""
    sides: dict[str, set[tuple[float, ...]]] = {}
    for piece in (o for scenelet in library for o in scenelet.objects):
        size = np.diff(piece.bounds, axis=0)[0].round(4)
        sides.setdefault(piece.label, set()).add(tuple(size.tolist()))
    variances = [np.log(sorted(sizes)).var(0, ddof=1) for sizes in sides.values()]
    assert round(float(np.sqrt(2 * np.mean(variances))), 2) == SIDE_SPREAD
