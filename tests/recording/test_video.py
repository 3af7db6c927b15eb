"""Pictures of the clip behind its detections."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from imapper_prob.models.errors import InputError
from imapper_prob.recording import video as video_module
from imapper_prob.recording.log import write_recording
from imapper_prob.recording.video import WIDTH, read_video
from tests.recording.reading import read
from tests.recording.room import make_room

CLIP, SCENES, _ = make_room(6)


def picture(shade: int, width: int = 1920, height: int = 1080) -> Image.Image:
    return Image.new("RGB", (width, height), (shade, shade, shade))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Pictures of frames 100 to 104 of 100 to 105, one of another frame, and a text."""
    folder = tmp_path / "frames"
    folder.mkdir()
    for i in [*range(100, 105), 999]:
        picture(20 * (i - 100) % 250).save(folder / f"cam2_color_{i:05d}.png")
    (folder / "notes 101.txt").write_text("nothing")
    return folder


def test_pictures_are_found_by_number_and_shrunk(folder: Path) -> None:
    video = read_video(folder, CLIP)
    assert video.frame_ids.tolist() == [100, 101, 102, 103, 104]
    assert (video.width, video.height) == (WIDTH, WIDTH * 1080 // 1920)
    for k, data in enumerate(video.pictures):
        with Image.open(io.BytesIO(data)) as image:
            assert image.format == "JPEG"
            assert image.size == (video.width, video.height)
            assert abs(int(np.asarray(image).mean()) - 20 * k) <= 2


def test_pictures_full_of_detail_are_made_coarser(
    folder: Path, monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator
) -> None:
    noise = Image.fromarray(rng.integers(0, 255, (1080, 1920, 3), dtype=np.uint8))
    for i in range(100, 105):
        noise.save(folder / f"cam2_color_{i:05d}.png", compress_level=1)
    as_it_is = sum(map(len, read_video(folder, CLIP).pictures))
    monkeypatch.setattr(video_module, "_MOST", as_it_is * 3 // 4)
    assert sum(map(len, read_video(folder, CLIP).pictures)) <= as_it_is * 3 // 4


def test_points_are_in_the_pixels_of_the_pictures(folder: Path, tmp_path: Path) -> None:
    video = read_video(folder, CLIP)
    path = tmp_path / "room.rrd"
    write_recording(path, clip=CLIP, scenes=SCENES, traces={}, description="", video=video)
    columns = read(path)
    blobs = columns["/world/camera/image/video", "EncodedImage:blob"]
    assert list(blobs) == video.frame_ids.tolist()
    assert bytes(blobs[100][0]) == video.pictures[0]
    scale = video.width / CLIP.camera.width
    resolution = columns["/world/camera/image", "Pinhole:resolution"][None][0]
    assert list(resolution) == [video.width, video.height]
    best = SCENES[0].scene
    drawn = columns["/world/camera/image/reprojection", "Points2D:positions"]
    expected = scale * best.camera.project(best.joints)
    np.testing.assert_allclose(np.array(list(drawn.values())), expected, atol=0.01)
    points = columns["/world/camera/image/detections", "Points2D:positions"][103]
    track = CLIP.tracks[0]
    seen = track.confidences[3] > 0
    np.testing.assert_allclose(points, scale * track.keypoints[3, seen], atol=0.01)
    # The miss stays in pixels of the clip.
    plain = tmp_path / "plain.rrd"
    write_recording(plain, clip=CLIP, scenes=SCENES, traces={}, description="")
    miss = ("/fit/miss/scene_1", "Scalars:scalars")
    assert columns[miss] == read(plain)[miss]


def test_what_cannot_be_shown_is_said(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        read_video(tmp_path / "nothing", CLIP)
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(InputError, match=r"no picture of a frame of clip room.* 100 to 105"):
        read_video(empty, CLIP)
    picture(0, 1080, 1080).save(folder / "cam2_color_00105.png")
    with pytest.raises(InputError, match=r"frame 105: is 1080 x 1080.*crop it"):
        read_video(folder, CLIP)
    (folder / "cam2_color_00105.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"00105\.png: is no picture"):
        read_video(folder, CLIP)


def test_a_video_file_is_read_by_number(tmp_path: Path) -> None:
    av = pytest.importorskip("av", reason="PyAV is not installed")
    path = tmp_path / "clip.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=30)
        stream.width, stream.height = 640, 360
        # The clip's frames 100 to 105, at ten a second.
        for k in range(-300, 18):
            frame = av.VideoFrame.from_image(picture(max(0, 10 * k), 640, 360))
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    video = read_video(path, CLIP)
    # Ten frames a second of thirty: every third picture.
    assert video.frame_ids.tolist() == CLIP.frame_ids.tolist()
    for k, data in enumerate(video.pictures):
        shade = np.asarray(Image.open(io.BytesIO(data))).mean()
        assert abs(shade - 30 * k) <= 5
    assert read_video(path, CLIP, rate=30.0).pictures == video.pictures
    assert len(read_video(path, CLIP, rate=31.0).pictures) < len(video.pictures)
    (tmp_path / "no.mp4").write_bytes(b"no video")
    with pytest.raises(InputError, match="is no video"):
        read_video(tmp_path / "no.mp4", CLIP)
