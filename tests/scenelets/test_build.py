"""Scenelets from recordings: what they hold, how much they count, what is left out."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import hypothesis.extra.numpy as arrays_of
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from numpy.typing import NDArray

from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Placement
from imapper_prob.models.skeleton import BONE_LENGTHS, PELV, facing, turned
from imapper_prob.scenelets.build import (
    UNKNOWN_ACTION,
    body_scale,
    build_library_from,
    captures_from,
    weights_by_density,
)
from imapper_prob.scenelets.captures import Capture
from imapper_prob.scenelets.frames import REACH
from imapper_prob.scenelets.library import load_library, save_library
from tests.conftest import CORPUS
from tests.machine import timed
from tests.scenelets.motions import box, standing

Array = NDArray[np.float64]


def walking(
    n_frames: int = 60, *, speed: float = 1.0, fps: float = 10.0, yaw: float = 0.0
) -> Array:
    """(n, 16, 3) an upright body gliding from the origin to where it faces."""
    joints = turned(standing(n_frames), np.full(n_frames, yaw))
    ahead = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
    return joints + (np.arange(n_frames) / fps * speed)[:, None, None] * ahead


def capture(joints: Array, *objects: Any, **changes: Any) -> Capture:
    given = {"name": "hall", "scene": "hall", "fps": 10.0, "actions": ()}
    return Capture(joints=joints, objects=objects, **(given | changes))


def build(*captures: Capture) -> Any:
    return build_library_from(captures, name="some")


def test_scenelets_are_in_their_local_frame() -> None:
    library, report = build(capture(walking(yaw=2.0)))
    assert sum(report.n_scenelets.values()) == len(library) > 10
    for scenelet in library:
        middle = scenelet.joints[scenelet.n_frames // 2]
        np.testing.assert_allclose(middle[PELV, :2], 0.0, atol=1e-9)
        assert facing(middle) == pytest.approx(0.0, abs=1e-9)
        # Walking straight ahead stays on the y axis.
        np.testing.assert_allclose(scenelet.joints[:, PELV, 0], 0.0, atol=1e-9)


@given(x=st.floats(-9, 9), y=st.floats(-9, 9), yaw=st.floats(-3.1, 3.1))
def test_it_does_not_matter_where_the_room_is(x: float, y: float, yaw: float) -> None:
    world = Placement(x, y, yaw)
    joints, chair = walking(30), box("chair", x=0.3, y=2.0)
    here, _ = build(capture(joints, chair))
    there, _ = build(capture(world.apply(joints), chair.moved(world)))
    assert [s.labels for s in here] == [s.labels for s in there]
    for one, other in zip(here, there, strict=True):
        np.testing.assert_allclose(one.joints, other.joints, atol=1e-9)
        # Scenelets are counted by cells of a centimetre.
        assert one.weight == pytest.approx(other.weight, rel=0.03)
        for a, b in zip(one.objects, other.objects, strict=True):
            np.testing.assert_allclose(a.footprint, b.footprint, atol=1e-9)


def test_furniture_within_reach_belongs_to_a_scenelet() -> None:
    # The chair begins 0.25 m aside and 4 m ahead; elbows and wrists reach 0.16 m towards it.
    chair = box("chair", x=0.5, y=4.25)
    library, report = build(capture(walking(100), chair))
    assert report.n_bare == sum(not s.objects for s in library) > 0
    near = [s for s in library if s.objects]
    gaps = [np.abs(s.objects[0].centre[1] - s.joints[:, PELV, 1]).min() - 0.25 for s in near]
    assert max(gaps) == pytest.approx(np.sqrt(REACH**2 - 0.09**2), abs=0.11)
    assert max(gaps) <= REACH


@pytest.mark.parametrize("scale", [0.85, 1.0, 1.15])
def test_bodies_become_the_reference_body_and_furniture_follows(scale: float) -> None:
    chair = box("chair", x=0.6, y=1.5, side=0.45)
    tall = walking(30) * (scale, scale, scale)
    library, report = build(capture(tall, chair))
    assert report.scales["hall"] == pytest.approx(scale)
    for scenelet in library:
        for (a, b), length in BONE_LENGTHS.items():
            bones = np.linalg.norm(scenelet.joints[:, a] - scenelet.joints[:, b], axis=1)
            np.testing.assert_allclose(bones, length, atol=0.02)
        for piece in scenelet.objects:
            np.testing.assert_allclose(piece.cuboids[0].size, 0.45 / scale)
    # In the scale of the body, the chair is as far from the pelvis as it was in the room.
    distances = [np.hypot(*s.objects[0].centre[:2]) for s in library if s.objects]
    assert min(distances) == pytest.approx(0.6 / scale, abs=0.02 / scale)


def test_wrong_wrists_and_ankles_do_not_change_the_scale(rng: np.random.Generator) -> None:
    joints = walking(30)
    joints[:, [0, 5, 10, 15]] += rng.normal(0.0, 0.2, size=(30, 4, 3))
    assert body_scale(joints) == pytest.approx(1.0, abs=0.02)


def test_actions_are_the_usual_word() -> None:
    words = ("walk",) * 30 + ("",) * 5 + ("sit",) * 25
    joints = np.concatenate([walking(30), np.repeat(walking(30)[-1:], 30, axis=0)])
    library, _ = build(capture(joints, actions=words))
    actions = [s.action for s in library]
    assert actions == sorted(actions, reverse=True)  # first walk, then sit
    assert set(actions) == {"walk", "sit"}
    assert {s.action for s in build(capture(joints))[0]} == {UNKNOWN_ACTION}
    # Frames without a word do not outvote one that has a word.
    mostly = ("", "", "", "", "reach") * 12
    assert {s.action for s in build(capture(joints, actions=mostly))[0]} == {"reach"}


def test_actions_keep_their_times_at_other_frame_rates() -> None:
    words = ("walk",) * 90 + ("sit",) * 90
    library, _ = build(capture(walking(180, fps=30.0), fps=30.0, actions=words))
    reference, _ = build(capture(walking(60), actions=words[::3]))
    assert [s.action for s in library][:-1] == [s.action for s in reference][: len(library) - 1]


def test_a_stay_gives_scenelets_of_itself_alone() -> None:
    stay = np.repeat(walking(40)[-1:], 50, axis=0)
    joints = np.concatenate([walking(40), stay])
    library, _ = build(capture(joints, actions=("walk",) * 40 + ("sit",) * 50))
    alone = [s for s in library if np.ptp(s.joints[:, PELV, :2], axis=0).max() < 1e-9]
    assert len(alone) >= 3
    assert {s.action for s in alone} == {"sit"}
    # Together they count about as much as one place does, not as much as they are.
    assert sum(s.weight for s in alone) < 1.1


@pytest.mark.parametrize("fps", [5.0, 10.0, 24.0, 25.0, 30.0, 120.0])
def test_all_frame_rates_become_one(fps: float) -> None:
    library, _ = build(capture(walking(int(6 * fps), fps=fps), fps=fps))
    reference, _ = build(capture(walking(60)))
    assert {s.fps for s in library} == {10.0}
    assert len(library) == pytest.approx(len(reference), abs=1)
    np.testing.assert_allclose(library[9].joints, reference[9].joints, atol=1e-9)


def test_short_gaps_are_bridged_and_long_ones_part() -> None:
    joints = walking(60)
    short, long = joints.copy(), joints.copy()
    short[30:33] = np.nan
    long[30:34] = np.nan
    whole, _ = build(capture(joints))
    bridged, report = build(capture(short))
    np.testing.assert_allclose(
        [s.joints.sum() for s in whole], [s.joints.sum() for s in bridged], atol=1e-6
    )
    assert report.lost == {"hall": 0.0}
    parted, report = build(capture(long))
    assert report.lost["hall"] == pytest.approx(0.4)
    assert len(parted) < len(whole)
    # No clip reaches over the gap: before it the walk has 2.9 m, after it 2.5 m.
    assert max(np.ptp(s.joints[:, PELV, 1]) for s in parted) <= 1.0 + 1e-9


@given(
    arrays_of.arrays(float, st.tuples(st.integers(1, 30), st.just(2)), elements=st.floats(-5, 5))
)
def test_weights_are_one_over_a_number(origins: Array) -> None:
    weights = weights_by_density(origins, 0.2)
    assert (weights <= 1.0 + 1e-12).all()
    assert (weights >= 1.0 / len(origins) - 1e-12).all()
    order = np.random.default_rng(0).permutation(len(origins))
    np.testing.assert_allclose(weights_by_density(origins[order], 0.2), weights[order])


def test_weights_of_known_places() -> None:
    lone, three = [[10.0, 0.0]], [[0.0, 0.0]] * 3
    np.testing.assert_allclose(weights_by_density([*lone, *three], 0.2), [1, 1 / 3, 1 / 3, 1 / 3])
    # Two that are one bandwidth apart.
    expected = 1 / (1 + np.exp(-0.5))
    np.testing.assert_allclose(weights_by_density([[0.0, 0.0], [0.2, 0.0]], 0.2), expected)


def test_density_counts_all_of_a_room_and_nothing_of_another() -> None:
    one = capture(walking(30), name="monday")
    again = capture(walking(30), name="tuesday")
    elsewhere = capture(walking(30), name="wednesday", scene="attic")
    alone = np.array([s.weight for s in build(one)[0]])
    twice = np.array([s.weight for s in build(one, again)[0]])
    apart = np.array([s.weight for s in build(one, elsewhere)[0]])
    np.testing.assert_allclose(twice, np.tile(alone, 2) / 2)
    np.testing.assert_allclose(apart, np.tile(alone, 2))


def test_a_capture_without_furniture_gives_bare_scenelets() -> None:
    library, report = build(capture(walking()))
    assert report.n_bare == len(library)
    assert "without furniture" in str(report)


def test_captures_that_cannot_be_used_are_named_and_counted() -> None:
    lost = walking(40)
    lost[5::6] = lost[4::6][: len(lost[5::6])]
    gone = np.full_like(lost, np.nan)
    gone[3:6], gone[20:23] = lost[3:6], lost[20:23]
    library, report = build(
        capture(walking(), name="good"),
        capture(gone, name="torn"),
        capture(walking() * 1000.0, name="millimetres"),
        capture(walking() * (1.0, 1.0, -1.0), name="upside-down"),
    )
    assert {s.name.rpartition("-")[0] for s in library} == {"good"}
    assert list(report.n_scenelets) == ["good"]
    assert re.search("tracked for 0.6 s", report.skipped["torn"])
    assert re.search("metres", report.skipped["millimetres"])
    assert re.search("which axis is up", report.skipped["upside-down"])
    assert "torn: left out: nobody was tracked" in str(report)


def test_no_library_is_ever_empty() -> None:
    with pytest.raises(InputError, match="no captures were given"):
        build()
    with pytest.raises(InputError, match=r"would be empty; hall: nobody was tracked for 0\.6 s"):
        build(capture(walking(3)))
    with pytest.raises(InputError, match="two captures are called 'hall'"):
        build(capture(walking()), capture(walking()))


def test_a_built_library_survives_its_file(tmp_path: Path) -> None:
    library, _ = build(capture(walking(), box("chair", x=0.5, y=2.0)))
    save_library(library, tmp_path / "some.npz")
    assert load_library(tmp_path / "some.npz").digest == library.digest


@pytest.mark.slow
def test_ten_minutes_take_seconds() -> None:
    minutes, rate = 10, 10
    angle = np.arange(minutes * 60 * rate) / rate / 3.0  # 1 m/s on a circle of 3 m
    centre = np.stack([3 * np.cos(angle), 3 * np.sin(angle), 0 * angle], 1)
    joints = turned(standing(len(angle)), angle) + centre[:, None]
    furniture = [box("chair", x=3.5 * np.cos(a), y=3.5 * np.sin(a)) for a in range(12)]
    (library, _), units = timed(lambda: build(capture(joints, *furniture)))
    assert len(library) == pytest.approx(2400, rel=0.01)
    assert units < 600  # 18 s on a common machine, which takes 3 s


@pytest.mark.corpus
def test_the_benchmark_gives_seated_scenelets_with_seats() -> None:
    if not CORPUS.is_dir():
        pytest.skip(f"the i3DB scenes are not at {CORPUS}")
    captures = captures_from("i3db", CORPUS)
    library, report = build_library_from(captures, name="i3db")
    assert report.skipped == {}
    # The actors are adults, and skeletons differ in where hips and shoulders are.
    assert all(0.9 < scale < 1.1 for scale in report.scales.values())
    for scene in report.n_scenelets:
        seated = [s for s in library if s.action == "sit" and s.name.startswith(scene)]
        assert len(seated) >= 4
        assert all({"couch", "chair", "stool"} & set(s.labels) for s in seated)
    # As the paper's clips: a metre of way takes 14 to 20 frames; here some walk faster.
    walks = [s.n_frames for s in library if s.action == "walk"]
    assert 10 <= np.median(walks) <= 20
