"""From video to clip, with a detector that needs no weights; and once with the real one."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from imapper_prob import memory
from imapper_prob.cli import main
from imapper_prob.clips.detect import contact_sheet, detect, usual_step
from imapper_prob.clips.load import ClipOptions
from imapper_prob.clips.mediapipe import Landmarks
from imapper_prob.clips.video import open_video, upright
from imapper_prob.models.errors import InputError
from imapper_prob.models.skeleton import DETECTED, HEAD, PELV
from tests.clips.films import SIZE, dark_figure, film, write_film
from tests.conftest import ROOT


def test_every_second_frame_of_a_film(tmp_path: Path) -> None:
    path = write_film(tmp_path / "room.mp4", film())
    heard: list[float] = []
    clip = detect(path, detector=dark_figure, progress=lambda _, part: heard.append(part))
    assert (clip.camera.width, clip.camera.height) == SIZE
    assert (clip.n_frames, clip.fps) == (20, 10)
    assert (clip.camera.fx, clip.focal_known) == (320, False)
    track = clip.tracks[0]
    assert not track.has_pose[3]
    assert (track.confidences[3] == 0).all()
    # The figure is 50 pixels wide and begins at 40 + 5 t.
    assert abs(track.keypoints[10, PELV, 0] - (65 + 5 * 20)) < 6
    assert heard == sorted(heard)
    assert heard[-1] == 1


def test_start_end_and_step(tmp_path: Path) -> None:
    path = write_film(tmp_path / "room.mp4", film())
    options = ClipOptions(focal=300.0)
    clip = detect(path, options=options, detector=dark_figure, start=0.5, end=1.5, step=1)
    assert (clip.n_frames, clip.fps, clip.focal_known) == (20, 20, True)
    assert clip.frame_ids[0] == 10
    assert abs(clip.tracks[0].keypoints[0, PELV, 0] - (65 + 5 * 10)) < 6


def test_the_sheet_shows_the_frames_of_the_clip(tmp_path: Path) -> None:
    path = write_film(tmp_path / "room.mp4", film())
    clip = detect(path, detector=dark_figure)
    video = open_video(path)
    drawn = np.asarray(contact_sheet(video, clip, first=0, step=2))
    assert drawn.shape == (2 * 480, 3 * 640, 3)
    # The last of six is the last of the clip: the figure is on the right, its joints on it.
    last = drawn[480:, 1280:]
    frame = [image for _, image in video.frames(step=2)][-1]
    plain = np.asarray(Image.fromarray(frame).resize((640, 480)))
    changed = np.argwhere(np.abs(last.astype(int) - plain).max(-1) > 40)
    assert len(changed) > 500
    assert abs(changed[:, 1].mean() / 2 - clip.tracks[0].keypoints[-1, PELV, 0]) < 10


def test_a_moving_camera_is_refused(tmp_path: Path) -> None:
    path = write_film(tmp_path / "pan.mp4", film(left=lambda t: 60 + t))
    with pytest.raises(InputError, match=r"pan\.mp4: the camera moves"):
        detect(path, detector=dark_figure)


def test_an_empty_room(tmp_path: Path) -> None:
    path = write_film(tmp_path / "empty.mp4", film())
    with pytest.raises(InputError, match="nobody was found"):
        detect(path, detector=lambda frame, image: None)


def test_joints_outside_of_the_picture_are_not_seen(tmp_path: Path) -> None:
    path = write_film(tmp_path / "room.mp4", film())

    def close(frame: int, image: NDArray[np.uint8]) -> Landmarks:
        points = np.full((33, 2), 0.5)
        points[:11, 1] = -0.3  # the head is above the picture
        return Landmarks(frame, points, np.full(33, 0.99))

    track = detect(path, detector=close).tracks[0]
    assert (track.confidences[:, HEAD] == 0).all()
    assert (track.confidences[:, [j for j in DETECTED if j not in (HEAD, 7)]] > 0).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [({"step": 0}, "step 0"), ({"start": 2.0, "end": 1.0}, "after the start"),
     ({"start": np.nan}, "after the start"), ({"end": np.inf}, "after the start"),
     ({"start": 60.0}, "no frame after")],
)  # fmt: skip
def test_faulty_arguments(arguments: dict[str, float], message: str, tmp_path: Path) -> None:
    path = write_film(tmp_path / "room.mp4", film())
    with pytest.raises(InputError, match=message):
        detect(path, detector=dark_figure, **arguments)  # type: ignore[arg-type]


def test_what_is_no_video(tmp_path: Path) -> None:
    pytest.importorskip("av", reason="the extra `video` is not installed")
    path = tmp_path / "film.mp4"
    for content in (b"", b"nonsense" * 100):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"film\.mp4"):
            open_video(path)
    whole = write_film(tmp_path / "whole.mp4", film())
    path.write_bytes(whole.read_bytes()[:3000])
    with pytest.raises(InputError, match=r"film\.mp4"):
        open_video(path)


def test_a_video_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        detect(tmp_path / "film.mp4")


def test_without_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "av", None)
    path = tmp_path / "film.mp4"
    path.write_bytes(b"")
    with pytest.raises(InputError, match=r"videos need av: pip install"):
        detect(path)


def test_turned_as_the_file_says() -> None:
    image = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    assert upright(image, 0).shape == (2, 4, 3)
    turned = upright(image, -90)  # a phone held upright: its right becomes the top
    assert turned.shape == (4, 2, 3)
    np.testing.assert_array_equal(turned[0, -1], image[0, 0])
    np.testing.assert_array_equal(upright(image, 180)[-1, -1], image[0, 0])


def test_a_phone_held_upright(tmp_path: Path) -> None:
    path = write_film(tmp_path / "room.mp4", film())
    lying = next(image for _, image in open_video(path).frames())
    content = bytearray(path.read_bytes())
    # The matrix of the track's header, identity as written: a quarter turn clockwise.
    at = content.index(b"tkhd") + 44
    turn = (0, 1 << 16, 0, -(1 << 16) & 0xFFFFFFFF, 0, 0, 0, 0, 1 << 30)
    content[at : at + 36] = struct.pack(">9I", *turn)
    path.write_bytes(bytes(content))
    video = open_video(path)
    assert (video.width, video.height) == SIZE[::-1]
    image = next(image for _, image in video.frames())
    np.testing.assert_array_equal(image, np.rot90(lying, k=-1))


def test_the_focal_length_that_a_phone_writes_down(tmp_path: Path) -> None:
    metadata = {"com.apple.quicktime.camera.focal_length.35mm_equivalent": "26"}
    path = write_film(tmp_path / "room.mov", film(), metadata=metadata)
    clip = detect(path, detector=dark_figure)
    assert clip.camera.fx == pytest.approx(26 / 43.27 * 400, rel=1e-3)
    assert not clip.focal_known


@pytest.mark.parametrize(
    ("fps", "step"), [(30, 3), (29.5, 3), (25, 2), (15, 1), (10, 1), (8, 1), (60, 6)]
)
def test_about_ten_frames_a_second(fps: float, step: int) -> None:
    assert usual_step(fps) == step


@pytest.mark.slow
def test_mediapipe_on_a_real_video(tmp_path: Path) -> None:
    pytest.importorskip("mediapipe", reason="the extra `video` is not installed")
    path = ROOT.parent / "shared" / "clips" / "Subject_1_ADL_16.mp4"
    if not path.is_file():
        pytest.skip(f"no video at {path}")
    output = tmp_path / "clip.npz"
    picture = tmp_path / "frames.png"
    command = ["detect", str(path), "-o", str(output), "--end", "1"]
    assert main([*command, "--picture", str(picture)]) == 0
    with Image.open(picture) as image:
        assert image.size == (1920, 720)
    assert main(["info", str(output)]) == 0
    assert main(command) == 2  # never over an earlier clip


@pytest.mark.parametrize("command", ["run", "solve"])
def test_a_film_that_does_not_suit_is_refused_before_its_joints_are_detected(
    command: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def work(*_: object, **__: object) -> None:
        raise AssertionError("joints were detected")

    monkeypatch.setattr("imapper_prob.clips.detect._pose_landmarker", work)
    arguments = [command, str(write_film(tmp_path / "room.mp4", film())), "-o"]
    assert main([*arguments, str(tmp_path / "out"), "--fps", "1.4"]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "clip room: 1.4 frames a second; library built-in 4 needs at least 1.43" in said
    monkeypatch.setattr(memory, "MOST_FRAMES", 15)
    assert main([*arguments, str(tmp_path / "out")]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "clip room: 20 frames of 1 are too many: a run has at most 15" in said
    assert "--frames 0:14" in said
    assert not (tmp_path / "out").exists()
    with pytest.raises(AssertionError, match="joints were detected"):
        main([*arguments, str(tmp_path / "out"), "--frames", "0:14", "--debug"])
