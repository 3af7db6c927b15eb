"""Capture files: what comes back, other skeletons and axes, and what bad ones are told."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import hypothesis.extra.numpy as arrays_of
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from imapper_prob.clips.furniture import category
from imapper_prob.clips.keypoints import joints_by_name
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Cuboid, Placement, SceneObject
from imapper_prob.models.skeleton import (
    HEAD,
    JOINTS,
    LANK,
    LHIP,
    LSHO,
    N_JOINTS,
    NECK,
    PELV,
    RHIP,
    RSHO,
    RWRI,
    THRX,
)
from imapper_prob.scenelets.build import captures_from
from imapper_prob.scenelets.captures import FORMAT, Capture, joints_at, read_capture, write_capture

N_FRAMES = 12


def capture(**changes: Any) -> Capture:
    joints = np.random.default_rng(1).normal(size=(N_FRAMES, N_JOINTS, 3))
    joints[4] = np.nan
    box = Cuboid("seat", np.array([0.0, 0.1, 0.2]), np.array([0.5, 0.5, 0.4]))
    leg = Cuboid("leg", np.array([0.1, 0.1, 0.1]), np.array([0.1, 0.1, 0.2]))
    given = {
        "name": "tuesday",
        "scene": "office",
        "joints": joints,
        "objects": (
            SceneObject("chair", Placement(1.0, 2.0, 0.3), (box, leg)),
            SceneObject("table", Placement(-1.0, 0.0, -2.0), (box,)),
        ),
        "fps": 30.0,
        "actions": ("walk",) * 6 + ("sit",) * 6,
    }
    return Capture(**(given | changes))


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    path = tmp_path / "some.npz"
    write_capture(path, capture())
    return path


def altered(path: Path, **changes: Any) -> Path:
    with np.load(path, allow_pickle=False) as archive:
        arrays = {key: archive[key] for key in archive.files}
    arrays |= changes
    np.savez(path, **{k: v for k, v in arrays.items() if v is not None})
    return path


def test_a_capture_survives_its_file(saved: Path) -> None:
    one, other = capture(), read_capture(saved)
    np.testing.assert_array_equal(one.joints, other.joints)
    assert (one.name, one.scene, one.fps, one.actions) == (
        other.name, other.scene, other.fps, other.actions
    )  # fmt: skip
    assert [o.label for o in other.objects] == ["chair", "table"]
    for a, b in zip(one.objects, other.objects, strict=True):
        assert a.placement == b.placement
        assert [c.part for c in a.cuboids] == [c.part for c in b.cuboids]
        np.testing.assert_array_equal(a.bounds, b.bounds)
    assert [p.name for p in saved.parent.iterdir()] == [saved.name]


def test_the_least_that_a_file_needs(tmp_path: Path) -> None:
    path = tmp_path / "least.npz"
    np.savez(path, format=FORMAT, fps=25, joints=np.zeros((3, 16, 3)))
    least = read_capture(path)
    assert (least.name, least.scene, least.objects, least.actions) == ("least", "least", (), ())


def test_a_frame_with_a_joint_missing_is_one_without_anybody(saved: Path) -> None:
    joints = np.zeros((N_FRAMES, N_JOINTS, 3))
    joints[2, 5, 1] = np.nan
    there = np.isfinite(read_capture(altered(saved, joints=joints)).joints).all((1, 2))
    assert list(np.flatnonzero(~there)) == [2]


def test_y_up_is_turned(saved: Path) -> None:
    joints = np.zeros((N_FRAMES, N_JOINTS, 3)) + np.array([1.0, 1.7, 3.0])
    turned = read_capture(altered(saved, joints=joints, up=np.array("y"))).joints
    np.testing.assert_allclose(turned[0, 0], (1.0, -3.0, 1.7))


KINECT = [
    "SpineBase", "SpineMid", "Neck", "Head", "ShoulderLeft", "ElbowLeft", "WristLeft", "HandLeft",
    "ShoulderRight", "ElbowRight", "WristRight", "HandRight", "HipLeft", "KneeLeft", "AnkleLeft",
    "FootLeft", "HipRight", "KneeRight", "AnkleRight", "FootRight", "SpineShoulder",
    "HandTipLeft", "ThumbLeft", "HandTipRight", "ThumbRight",
]  # fmt: skip
LIMBS = ["Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot"]
MIXAMO = [
    f"mixamorig:{name}"
    for name in (
        *("Hips", "Spine", "Spine1", "Spine2", "Neck", "Head"),
        *(side + limb for side in ("Left", "Right") for limb in LIMBS),
    )
]


def test_names_of_a_kinect() -> None:
    positions = np.arange(25.0)[None, :, None] + np.zeros((2, 25, 3))
    expected = (18, 17, 16, 12, 13, 14, 0, 20, 2, 3, 10, 9, 8, 4, 5, 6)
    np.testing.assert_array_equal(joints_by_name(positions, KINECT)[0, :, 0], expected)


def test_names_of_bones_stand_for_the_joints_they_begin_at() -> None:
    positions = np.arange(len(MIXAMO))[None, :, None] + np.zeros((1, len(MIXAMO), 3))
    joints = joints_by_name(positions, MIXAMO)[0, :, 0]
    chosen = {j: MIXAMO[int(joints[i])].removeprefix("mixamorig:") for i, j in enumerate(JOINTS)}
    assert chosen["RHIP"] == "RightUpLeg"
    assert chosen["RKNE"] == "RightLeg"
    assert chosen["LANK"] == "LeftFoot"
    assert chosen["LELB"] == "LeftForeArm"
    assert chosen["RWRI"] == "RightHand"
    assert chosen["PELV"] == "Hips"


@given(arrays_of.arrays(float, (2, N_JOINTS, 3), elements=st.floats(-3, 3)), st.randoms())
def test_names_may_come_in_any_order(positions: Any, random: Any) -> None:
    order = list(range(N_JOINTS))
    random.shuffle(order)
    names = [JOINTS[i] for i in order]
    np.testing.assert_array_equal(joints_by_name(positions[:, order], names), positions)


@given(arrays_of.arrays(float, (2, N_JOINTS, 3), elements=st.floats(-3, 3)))
def test_joints_of_the_middle_are_made_where_they_are_missing(positions: Any) -> None:
    kept = [i for i in range(N_JOINTS) if i not in (PELV, THRX, NECK)]
    joints = joints_by_name(positions[:, kept], [JOINTS[i].lower() for i in kept])
    np.testing.assert_array_equal(joints[:, kept], positions[:, kept])
    np.testing.assert_allclose(joints[:, PELV], positions[:, [RHIP, LHIP]].mean(1))
    np.testing.assert_allclose(joints[:, THRX], positions[:, [RSHO, LSHO]].mean(1))
    np.testing.assert_allclose(joints[:, NECK], (joints[:, THRX] + positions[:, HEAD]) / 2)


def test_an_ankle_is_preferred_to_a_foot() -> None:
    names = [*JOINTS, "left_foot", "hand.R"]
    joints = joints_by_name(np.arange(18.0)[None, :, None] + np.zeros((1, 18, 3)), names)
    assert joints[0, LANK, 0] == LANK
    assert joints[0, RWRI, 0] == RWRI


def test_joint_names_with_one_missing_are_told(saved: Path) -> None:
    names = np.array([n if n != "LELB" else "tail" for n in JOINTS])
    with pytest.raises(InputError, match=r"some\.npz: no joint called LELB or the like among"):
        read_capture(altered(saved, joint_names=names))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": np.array("imapper-prob clip 1")}, "format 'imapper-prob clip 1'"),
        ({"format": None}, "entry format is missing"),
        ({"fps": None}, "entry fps is missing"),
        ({"fps": np.array(-1.0)}, "frame rate -1.0"),
        ({"joints": np.zeros((N_FRAMES, 25, 3))}, "25 joints without joint_names"),
        ({"joints": np.zeros((N_FRAMES, 16, 2))}, r"joints has shape \(12, 16, 2\)"),
        ({"joints": np.full((N_FRAMES, 16, 3), np.nan)}, "no frame with a person"),
        ({"joints": np.full((N_FRAMES, 16, 3), "a")}, "expected number"),
        ({"joint_names": np.array(["a"] * 3)}, "3 joint_names for 16 joints"),
        ({"joint_names": np.array(["LANK"] * 16)}, "'LANK' occurs twice"),
        ({"up": np.array("x")}, "up is 'x'"),
        ({"actions": np.array(["walk"])}, r"actions has shape \(1,\), expected \(12,\)"),
        ({"cuboid_size": np.zeros((3, 3))}, "size positive"),
        ({"cuboid_size": None}, "entry cuboid_size is missing"),
        ({"cuboid_object": np.array([0, 0, 7])}, "cuboid_object names one that does not exist"),
        ({"cuboid_object": np.array([0, 1, 0])}, "must be in ascending order"),
        ({"cuboid_object": np.array([0, 1, 0], np.uint64)}, "must be in ascending order"),
        ({"cuboid_object": np.array([0, 0, 0])}, "'table' has no cuboids"),
        ({"cuboid_object": np.array([0.0, 0.0, 1.0])}, "expected index"),
        ({"object_placement": np.full((2, 3), np.nan)}, "must be finite"),
    ],
)
def test_a_fault_is_named(saved: Path, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read_capture(altered(saved, **changes))
    assert "some.npz" in str(caught.value)


def test_a_file_cut_in_half_is_named(saved: Path) -> None:
    saved.write_bytes(saved.read_bytes()[: saved.stat().st_size // 2])
    with pytest.raises(InputError, match=r"some\.npz: damaged"):
        captures_from("npz", saved)


def test_a_pickle_is_not_opened(tmp_path: Path) -> None:
    path = tmp_path / "pickled.npz"
    np.savez(path, format=np.array([{"a": 1}], dtype=object))
    with pytest.raises(InputError, match=r"pickled\.npz"):
        read_capture(path)


def test_a_capture_goes_to_an_npz_only(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"ends in \.npz"):
        write_capture(tmp_path / "some.csv", capture())


def test_other_peoples_labels_become_ours(saved: Path, caplog: pytest.LogCaptureFixture) -> None:
    altered(saved, object_label=np.array(["Sofa", "wall"]))
    with caplog.at_level(logging.WARNING):
        assert [o.label for o in read_capture(saved).objects] == ["couch"]
    assert "capture tuesday: left out what is no furniture (1 wall)" in caplog.text


@pytest.mark.parametrize(
    ("label", "expected"),
    [("Office_Chair", "chair"), ("Armchair", "couch"), ("book-case", "book case"),
     ("Bookcase", "shelf"), ("piano", "piano"), ("Ceiling", None), ("", None)],
)  # fmt: skip
def test_labels(label: str, expected: str | None) -> None:
    assert category(label) == expected


def test_a_folder_of_captures_and_one_left_out(tmp_path: Path) -> None:
    for name, scene in (("a", "office"), ("b", "office"), ("c", "hall")):
        write_capture(tmp_path / f"{name}.npz", capture(name=name, scene=scene))
    assert [c.name for c in captures_from("npz", tmp_path)] == ["a", "b", "c"]
    assert [c.name for c in captures_from("npz", tmp_path, leave_out="office")] == ["c"]
    with pytest.raises(InputError, match="no scene 'attic' to leave out; there are hall, office"):
        captures_from("npz", tmp_path, leave_out="attic")
    with pytest.raises(InputError, match="nothing is left without hall"):
        captures_from("npz", tmp_path / "c.npz", leave_out="hall")


def test_sources_and_places_that_are_not_there_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no capture file \(\.npz\) there"):
        captures_from("npz", tmp_path)
    with pytest.raises(InputError, match="no i3DB scene there"):
        captures_from("i3db", tmp_path)
    with pytest.raises(InputError, match="no such file or folder"):
        captures_from("npz", tmp_path / "nowhere")
    with pytest.raises(InputError, match="unknown format of captures 'bvh'"):
        captures_from("bvh", tmp_path)


def test_a_folder_of_bad_captures_is_no_empty_list(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / f"{name}.npz").write_text("no archive")
    with pytest.raises(InputError, match=r"none of 2 files is a usable .* the first: .*a\.npz"):
        captures_from("npz", tmp_path)


def test_few_bad_captures_are_named_and_many_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    write_capture(tmp_path / "good.npz", capture(name="good"))
    for k in range(8):
        (tmp_path / f"bad-{k}.npz").write_text("no archive")
    with caplog.at_level(logging.WARNING):
        assert [c.name for c in captures_from("npz", tmp_path)] == ["good"]
    told = [r.getMessage() for r in caplog.records if "left out" in r.getMessage()]
    assert len(told) == 6
    assert "bad-4.npz" in told[4]
    assert told[5] == "left out: 3 more"


@given(
    times=st.lists(st.floats(0.02, 0.2), min_size=2, max_size=20),
    velocity=arrays_of.arrays(float, (N_JOINTS, 3), elements=st.floats(-2, 2)),
)
def test_even_motion_is_the_same_at_any_moments(times: list[float], velocity: Any) -> None:
    recorded = np.cumsum([0.0, *times])
    moments = np.linspace(0.0, recorded[-1], 7)
    joints = joints_at(moments, recorded, recorded[:, None, None] * velocity, bridged=0.2)
    np.testing.assert_allclose(joints, moments[:, None, None] * velocity, atol=1e-9)


def test_long_gaps_and_the_ends_are_not_bridged() -> None:
    recorded = np.array([0.0, 0.1, 0.2, 0.6, 0.7])
    moments = np.array([-0.1, 0.0, 0.15, 0.2, 0.4, 0.6, 0.7, 0.8])
    joints = joints_at(moments, recorded, np.zeros((5, N_JOINTS, 3)), bridged=0.3)
    there = np.isfinite(joints).all((1, 2))
    np.testing.assert_array_equal(there, [False, True, True, True, False, True, True, False])
