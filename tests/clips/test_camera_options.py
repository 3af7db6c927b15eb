"""Cameras that users know: files, distortion, and what is assumed otherwise."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imapper_prob.clips.load import ClipOptions, read_camera, read_whatever
from imapper_prob.clips.options import CameraFile, camera_of, undistorted
from imapper_prob.models.errors import InputError
from imapper_prob.models.skeleton import RKNE
from tests.clips.bodies import POINTS, SIZE, place, write_openpose

TOML = """
size = [1280, 720]
matrix = [[900, 0, 630], [0, 905, 365], [0, 0, 1]]
distortion = [-0.28, 0.07, 0.001, -0.0005, 0.0]
pitch_degrees = -12
height = 2.1
"""


def lens(coefficients: list[float]) -> CameraFile:
    matrix = np.array([[900.0, 0, 630], [0, 905, 365], [0, 0, 1]])
    return CameraFile(SIZE, matrix, np.array(coefficients))


def distorted(pixels: np.ndarray, file: CameraFile) -> np.ndarray:
    """The published formula, written out."""
    k1, k2, p1, p2, k3 = file.distortion
    x, y = ((pixels - file.matrix[:2, 2]) / file.matrix[[0, 1], [0, 1]]).T
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.stack([u, v], -1) * file.matrix[[0, 1], [0, 1]] + file.matrix[:2, 2]


def test_a_camera_file(tmp_path: Path) -> None:
    path = tmp_path / "camera.toml"
    path.write_text(TOML)
    file = read_camera(path)
    camera, known = camera_of("film", ClipOptions(camera=file), size=SIZE)
    assert known
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (900, 905, 630, 365)
    assert camera.pitch == pytest.approx(np.deg2rad(-12))
    assert camera.elevation == 2.1
    said = ClipOptions(camera=file, pitch=-5.0, height=1.0)
    camera, _ = camera_of("film", said, size=SIZE)
    assert (camera.pitch, camera.elevation) == (pytest.approx(np.deg2rad(-5)), 1.0)


@given(
    st.floats(-0.3, 0.1), st.floats(0, 0.1), st.floats(-0.002, 0.002), st.floats(200, 1080),
    st.floats(100, 620),
)  # fmt: skip
def test_distortion_is_undone(k1: float, k2: float, p1: float, u: float, v: float) -> None:
    file = lens([k1, k2, p1, -p1, 0.0])
    straight = undistorted(np.array([[u, v]]), file)
    np.testing.assert_allclose(distorted(straight, file), [[u, v]], atol=0.01)


def test_outside_of_what_the_lens_can_see() -> None:
    file = lens([-0.5, 0.0, 0.0, 0.0, 0.0])
    assert np.isnan(undistorted(np.array([[20_000.0, 300.0]]), file)).all()


def test_keypoints_are_undistorted_at_the_door(tmp_path: Path) -> None:
    folder = write_openpose(tmp_path / "film", "body_25")
    file = lens([-0.28, 0.07, 0.001, -0.0005, 0.0])
    clip = read_whatever(folder, ClipOptions(camera=file, fps=25))
    there = clip.tracks[0].keypoints[0, RKNE]
    expected = np.add(POINTS["right_knee"], place(0))
    assert np.linalg.norm(there - expected) > 1
    np.testing.assert_allclose(distorted(there[None], file)[0], expected, atol=0.01)


def test_an_assumed_focal_length_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = write_openpose(tmp_path / "film", "body_25")
    with caplog.at_level(logging.WARNING):
        clip = read_whatever(folder, ClipOptions(size=SIZE))
    assert not clip.focal_known
    assert clip.camera.fx == 1280
    assert clip.focal_spread == 0.2
    assert "focal length assumed to be 1280 pixels, give or take 20 %" in caplog.text
    assert "frame rate assumed" in caplog.text
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        assert read_whatever(folder, ClipOptions(size=SIZE, focal=1000, fps=25)).focal_known
    assert not caplog.text
    told = ClipOptions(size=SIZE, focal=1000, focal_spread=0.08, fps=25)
    assert read_whatever(folder, told).focal_spread == 0.08


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("size = [1280, 720]", "no entry 'matrix'"),
        (TOML + "zoom = 2\n", "unknown entry 'zoom'"),
        (TOML.replace("900", "nan"), "not finite"),
        (TOML.replace("900", "-900"), "matrix must be"),
        (TOML.replace("[900, 0,", "[900, 450,"), "matrix must be"),
        (TOML.replace("1280", "1280.5"), "whole numbers"),
        (TOML.replace("-0.28, 0.07,", ""), "distortion has 4, 5 or 8"),
        (TOML + "rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n", "go together"),
        (TOML + "rotation = [[2, 0, 0], [0, 1, 0], [0, 0, 1]]\n", "no rotation matrix"),
        (TOML.replace("height = 2.1", "height = 0"), "height must be positive"),
        ("= = =", "not a TOML file"),
    ],
)
def test_faulty_camera_files(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "camera.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_camera(path)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"focal": -1.0}, "focal"),
        ({"fps": float("nan")}, "fps"),
        ({"pitch": 91.0}, "pitch"),
        ({"size": (0, 4)}, "size"),
        ({"people": 0}, "people"),
        ({"camera": lens([]), "focal": 3.0}, "not both"),
    ],
)
def test_faulty_options(options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        ClipOptions(**options)  # type: ignore[arg-type]


def test_sizes_that_contradict_each_other(tmp_path: Path) -> None:
    folder = write_openpose(tmp_path / "film", "body_25")
    options = ClipOptions(camera=lens([]), size=(640, 480))
    with pytest.raises(InputError, match="contradict"):
        read_whatever(folder, options)
