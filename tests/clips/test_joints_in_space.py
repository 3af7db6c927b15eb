"""3D joints with a camera: TRC and .npz."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imapper_prob.clips.load import ClipOptions, format_of, read_whatever
from imapper_prob.clips.options import CameraFile
from imapper_prob.models.errors import InputError
from imapper_prob.models.skeleton import HEAD, JOINTS, LWRI, N_JOINTS, PELV
from tests.clips.bodies import write_trc

CAMERA = CameraFile(
    size=(640, 480),
    matrix=np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]),
    distortion=np.zeros(0),
)


def joints(rng: np.random.Generator, n_frames: int = 10) -> np.ndarray[Any, Any]:
    """(T, 16, 3) about 4 m in front of a camera: x right, y down, z forward."""
    return rng.normal(size=(n_frames, N_JOINTS, 3)) * 0.4 + (0.2, 0.1, 4)


def test_npz_is_projected(tmp_path: Path, rng: np.random.Generator) -> None:
    points = joints(rng)
    points[3, LWRI] = 0
    path = tmp_path / "walk.npz"
    np.savez(path, joints=points, fps=30.0, matrix=CAMERA.matrix, size=[640, 480])
    assert format_of(path) == "joints"
    clip = read_whatever(path, ClipOptions())
    track = clip.tracks[0]
    x, y, z = points[5, HEAD]
    np.testing.assert_allclose(track.keypoints[5, HEAD], (320 + 500 * x / z, 240 + 500 * y / z))
    relative = points[5, HEAD] - points[5, PELV]
    np.testing.assert_allclose(track.poses[5, HEAD], relative[[0, 2, 1]] * (1, 1, -1))
    assert track.confidences[3, LWRI] == 0
    assert not track.has_pose[3]
    assert clip.focal_known


@pytest.mark.parametrize("form", ["npz", "trc"])
def test_joints_in_space_have_no_distortion(
    form: str, tmp_path: Path, rng: np.random.Generator
) -> None:
    """They are projected without that of the lens, so none is removed."""
    points = joints(rng)
    path = tmp_path / f"walk.{form}"
    if form == "trc":
        write_trc(path, points, JOINTS)
    else:
        np.savez(path, joints=points, fps=25.0)
    lens = replace(CAMERA, distortion=np.array([-0.3, 0.1, 0.0, 0.0, 0.0]))
    one, other = (
        read_whatever(path, ClipOptions(camera=camera)).tracks[0].keypoints
        for camera in (CAMERA, lens)
    )
    np.testing.assert_array_equal(one, other)


def test_npz_of_two_people_and_of_other_names(tmp_path: Path, rng: np.random.Generator) -> None:
    points = np.stack([joints(rng), np.add(joints(rng), (1, 0, 0))])
    order = rng.permutation(N_JOINTS)
    path = tmp_path / "two.npz"
    np.savez(
        path,
        joints=points[:, :, order],
        joint_names=[JOINTS[i] for i in order],
        confidences=np.full((2, 10, N_JOINTS), 0.4),
        fps=30.0,
        matrix=CAMERA.matrix,
        size=[640, 480],
    )
    clip = read_whatever(path, ClipOptions())
    assert [track.name for track in clip.tracks] == ["person-0", "person-1"]
    relative = points[1, 2, HEAD] - points[1, 2, PELV]
    np.testing.assert_allclose(clip.tracks[1].poses[2, HEAD], relative[[0, 2, 1]] * (1, 1, -1))
    assert clip.tracks[0].confidences.max() == 0.4


def test_trc_in_a_world_of_its_own(tmp_path: Path, rng: np.random.Generator) -> None:
    points = joints(rng)
    rotation = np.array([[0, -1.0, 0], [0, 0, -1], [1, 0, 0]])
    translation = np.array([0.1, 1.2, 0.3])
    world = (points - translation) @ rotation
    names = (*(j for j in JOINTS), "Extra")
    extra = np.full((len(world), 1, 3), np.nan)
    millimetres = np.concatenate([world, extra], 1) * 1000
    path = write_trc(tmp_path / "walk.trc", millimetres, names, unit="mm")
    assert format_of(path) == "trc"
    camera = replace(CAMERA, rotation=rotation, translation=translation)
    clip = read_whatever(path, ClipOptions(camera=camera))
    x, y, z = points[5, HEAD]
    np.testing.assert_allclose(
        clip.tracks[0].keypoints[5, HEAD], (320 + 500 * x / z, 240 + 500 * y / z)
    )
    assert (clip.fps, int(clip.frame_ids[0])) == (25, 1)


def test_trc_needs_a_camera(tmp_path: Path, rng: np.random.Generator) -> None:
    path = write_trc(tmp_path / "walk.trc", joints(rng), JOINTS)
    with pytest.raises(InputError, match="without a camera"):
        read_whatever(path, ClipOptions())


def test_joints_behind_the_camera(tmp_path: Path, rng: np.random.Generator) -> None:
    path = write_trc(tmp_path / "walk.trc", -joints(rng), JOINTS)
    with pytest.raises(InputError, match="behind the camera"):
        read_whatever(path, ClipOptions(camera=CAMERA))


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda lines: lines[:3], "cut off"),
        (lambda lines: [*lines[:7], lines[8], lines[7], *lines[9:]], "does not follow"),
        (lambda lines: [*lines[:6], lines[6].replace("\t", "\tx"), *lines[7:]], "not a number"),
        (lambda lines: [*lines[:2], lines[2].replace("25\t", "0\t", 1), *lines[3:]], "data rate"),
        (lambda lines: [*lines[:2], lines[2].replace("\tm\t", "\tft\t"), *lines[3:]], "unit"),
        (lambda lines: lines[:5], "cut off"),
        (lambda lines: lines[:-1], "9 frames, the header says 10"),
    ],
)
def test_faulty_trc(spoil: Any, message: str, tmp_path: Path, rng: np.random.Generator) -> None:
    path = write_trc(tmp_path / "walk.trc", joints(rng), JOINTS)
    path.write_text("\n".join(spoil(path.read_text().splitlines())))
    with pytest.raises(InputError, match=message):
        read_whatever(path, ClipOptions(camera=CAMERA))


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"fps": -1.0}, "frame rate"),
        ({"joints": np.zeros((5, 16))}, "expected"),
        ({"joints": np.zeros((5, 15, 3))}, "16 joint names for 15"),
        ({"size": np.array([640.0, 480.0])}, "size holds"),
        ({"matrix": np.zeros((3, 3))}, "matrix"),
        ({"confidences": np.full((10, 16), 2.0)}, "in \\[0, 1\\]"),
        ({"confidences": np.ones(4)}, "one a joint"),
        ({"confidences": np.ones((16, 10))}, r"one a joint, \(10, 16\)"),
        ({"translation": np.ones(3)}, "one of 'rotation' and 'translation'"),
        ({"rotation": np.eye(3)}, "one of 'rotation' and 'translation'"),
    ],
)
def test_faulty_npz(
    entries: dict[str, Any], message: str, tmp_path: Path, rng: np.random.Generator
) -> None:
    content = {"joints": joints(rng), "fps": 30.0, "matrix": CAMERA.matrix, "size": [640, 480]}
    np.savez(tmp_path / "walk.npz", **{**content, **entries})
    with pytest.raises(InputError, match=message):
        read_whatever(tmp_path / "walk.npz", ClipOptions())


def test_a_joint_too_far_away_is_named(tmp_path: Path, rng: np.random.Generator) -> None:
    points = joints(rng)
    points[3, LWRI] = 1e8
    write_trc(tmp_path / "walk.trc", points, JOINTS)
    with pytest.raises(InputError, match="line 9, frame 4, marker LWRI: a coordinate is infinite"):
        read_whatever(tmp_path / "walk.trc", ClipOptions(camera=CAMERA))
    camera = {"fps": 30.0, "matrix": CAMERA.matrix, "size": [640, 480]}
    np.savez(tmp_path / "walk.npz", joints=points, **camera)
    with pytest.raises(InputError, match=r"walk.npz: person 0, frame 3, joint LWRI: a coordinate"):
        read_whatever(tmp_path / "walk.npz", ClipOptions())
    sure = np.full((10, N_JOINTS), 0.5)
    sure[2, HEAD] = 1.5
    np.savez(tmp_path / "sure.npz", joints=joints(rng), confidences=sure, **camera)
    with pytest.raises(InputError, match="person 0, frame 2, joint HEAD: confidence"):
        read_whatever(tmp_path / "sure.npz", ClipOptions())
