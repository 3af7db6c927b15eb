"""The built-in library: human bodies, on the floor, beside furniture and not in it."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from numpy.typing import NDArray

from imapper_prob.models.geometry import pack_boxes, sight_clearance
from imapper_prob.models.pose import facing
from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.models.skeleton import (
    BONE_LENGTHS,
    BONES,
    LANK,
    LELB,
    LHIP,
    LKNE,
    LSHO,
    LWRI,
    PELV,
    RANK,
    RELB,
    RHIP,
    RKNE,
    RSHO,
    RWRI,
)
from imapper_prob.scenelets.library import built_in_library
from imapper_prob.scenelets.procedural.catalogue import CATALOGUE, build_library

HINGES = ((RHIP, RKNE, RANK), (LHIP, LKNE, LANK), (RSHO, RELB, RWRI), (LSHO, LELB, LWRI))
ARMS = {RELB, LELB, RWRI, LWRI}


@pytest.fixture(scope="module")
def library() -> Library:
    return built_in_library()


def every_joint(library: Library) -> NDArray[np.float64]:
    return np.concatenate([s.joints for s in library])


def deepest(scenelet: Scenelet, bone: tuple[int, int], *, label: str | None = None) -> float:
    """How deep a bone goes into furniture in every other frame, metres."""
    boxes = pack_boxes(o for o in scenelet.objects if label in (None, o.label))
    starts, ends = (scenelet.joints[::2, j] for j in bone)
    return -min(
        float(sight_clearance(start, end, boxes)) for start, end in zip(starts, ends, strict=True)
    )


def test_there_are_enough_of_every_kind(library: Library) -> None:
    assert len(library) == sum(entry.count for entry in CATALOGUE) >= 150
    count = Counter(s.name.rsplit("-", 1)[0] for s in library)
    assert count == {entry.name: entry.count for entry in CATALOGUE}
    assert {s.action for s in library} == {"walk", "stand", "sit", "sit-down", "stand-up", "reach"}
    labels = Counter(label for s in library for label in s.labels)
    assert set(labels) == {"chair", "stool", "couch", "table", "shelf"}
    assert min(labels.values()) >= 12


def test_the_same_library_comes_out_twice(library: Library) -> None:
    assert build_library(0).digest == library.digest
    assert build_library(1).digest != library.digest


def test_clips_last_a_second_or_two(library: Library) -> None:
    assert {s.fps for s in library} == {10.0}
    assert all(15 <= s.n_frames <= 20 for s in library)


@pytest.mark.parametrize("bone", BONE_LENGTHS)
def test_bones_keep_their_length(library: Library, bone: tuple[int, int]) -> None:
    joints = every_joint(library)
    length = np.linalg.norm(joints[:, bone[0]] - joints[:, bone[1]], axis=-1)
    np.testing.assert_allclose(length, BONE_LENGTHS[bone], atol=1e-3)


@pytest.mark.parametrize("hinge", HINGES)
def test_knees_and_elbows_bend_as_far_as_they_can(
    library: Library, hinge: tuple[int, int, int]
) -> None:
    joints = every_joint(library)
    root, middle, end = (joints[:, j] for j in hinge)
    upper, lower = middle - root, end - middle
    cosine = (upper * lower).sum(-1)
    cosine /= np.linalg.norm(upper, axis=-1) * np.linalg.norm(lower, axis=-1)
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() <= 150.001


def test_knees_bend_forward(library: Library) -> None:
    joints = every_joint(library)
    yaw = facing(joints)
    forward = np.stack([-np.sin(yaw), np.cos(yaw)], -1)
    for hip, knee, ankle in HINGES[:2]:
        # The hip-ankle line passes behind the knee.
        along = joints[:, ankle] - joints[:, hip]
        part = ((joints[:, knee] - joints[:, hip]) * along).sum(-1) / (along**2).sum(-1)
        bulge = joints[:, knee] - joints[:, hip] - part[:, None] * along
        assert (bulge[:, :2] * forward).sum(-1).min() > 0


def test_feet_are_on_the_floor(library: Library) -> None:
    ankles = every_joint(library)[:, [RANK, LANK], 2]
    assert ankles.min() >= 0.08
    # One foot carries at any time.
    assert ankles.min(1).max() <= 0.10


def test_standing_feet_do_not_slide(library: Library) -> None:
    for scenelet in library:
        ankles = scenelet.joints[:, [RANK, LANK]]
        stands = ankles[..., 2] < 0.095
        slide = np.linalg.norm(np.diff(ankles[..., :2], axis=0), axis=-1)
        slide = slide[stands[1:] & stands[:-1]]
        assert slide.max(initial=0.0) < 0.03, scenelet.name


def test_nobody_moves_faster_than_people_do(library: Library) -> None:
    for scenelet in library:
        step = np.linalg.norm(np.diff(scenelet.joints, axis=0), axis=-1) * scenelet.fps
        assert step[:, PELV].max() < 2.0, scenelet.name
        assert step.max() < 5.0, scenelet.name


def test_nobody_is_in_the_furniture(library: Library) -> None:
    # Every second scenelet is the mirror image of the one before.
    for scenelet in (s for s in library.scenelets[::2] if s.objects):
        for bone in BONES:
            # Boards are thin: legs and trunk must not pass through any.
            allowed = 0.05 if ARMS.intersection(bone) else 0.01
            assert deepest(scenelet, bone) < allowed, (scenelet.name, bone)
        if "table" in scenelet.labels:
            for bone in ((RWRI, RELB), (LWRI, LELB)):
                assert deepest(scenelet, bone, label="table") < 0.005, (scenelet.name, bone)


def test_seated_people_sit_on_their_seats(library: Library) -> None:
    ahead = []
    for scenelet in (s for s in library if s.action == "sit"):
        middle = scenelet.joints[scenelet.n_frames // 2]
        piece = scenelet.objects[0]
        seat = next(c for c in piece.cuboids if c.part == "seat")
        offset = middle[PELV, :2] - (piece.placement.x, piece.placement.y)
        across, forward = offset @ piece.placement.rotation
        low, high = (seat.centre + sign * seat.size / 2 for sign in (-1, 1))
        assert low[0] < across < high[0]
        assert low[1] < forward < high[1]
        assert 0.05 < middle[PELV, 2] - high[2] < 0.12
        ahead.append(forward)
    # Measured on i3DB: 9 cm before the centre, standard deviation 15 cm.
    assert abs(np.mean(ahead) - 0.09) < 0.04


def test_hands_reach_the_shelf(library: Library) -> None:
    for scenelet in (s for s in library if s.action == "reach"):
        wrists = scenelet.joints[:, [RWRI, LWRI]].reshape(-1, 3)
        (piece,) = scenelet.objects
        local = (wrists[:, :2] - (piece.placement.x, piece.placement.y)) @ piece.placement.rotation
        assert (piece.bounds[1, 1] - local[:, 1]).min() < 0.12, scenelet.name


def test_furniture_is_as_large_as_people_have_it(library: Library) -> None:
    for scenelet in library:
        for piece in scenelet.objects:
            low, high = piece.bounds
            assert low[2] == pytest.approx(0.0, abs=1e-9)
            np.testing.assert_allclose((low + high)[:2], 0.0, atol=1e-9)
            if piece.label == "shelf":
                assert 1.40 <= high[2] <= 2.25
            if piece.label == "table":
                assert 0.40 <= high[2] <= 0.45 or 0.72 <= high[2] <= 0.75
            if piece.label == "couch":
                assert high[0] - low[0] <= 2.6


def test_seats_face_where_people_on_them_do(library: Library) -> None:
    for scenelet in (s for s in library if s.action == "sit"):
        assert abs(scenelet.objects[0].placement.yaw) < np.deg2rad(15), scenelet.name
