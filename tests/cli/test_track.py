"""``track`` and ``info`` on keypoints of several people."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from PIL import Image

from imapper_prob.cli import main
from imapper_prob.clips.load import read_clip
from tests.clips.bodies import write_openpose
from tests.clips.test_marks import marks

CAMERA = ["--size", "1280x720", "--focal", "1000", "--fps", "10"]


def test_two_people_become_two_tracks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_openpose(tmp_path / "film", "body_25", people=2)
    (tmp_path / "marks.json").write_text(json.dumps(marks()))
    output, picture = tmp_path / "clip.npz", tmp_path / "tracks.png"
    command = ["track", str(folder), "-o", str(output), *CAMERA]
    more = ["--marks", str(tmp_path / "marks.json"), "--picture", str(picture)]
    assert main([*command, *more]) == 0
    assert "anna" in capsys.readouterr().out
    clip = read_clip(output)
    assert [track.name for track in clip.tracks] == ["anna", "ben"]
    assert all(track.has_pose.all() for track in clip.tracks)
    assert clip.focal_known
    with Image.open(picture) as image:
        assert image.width > 500
    assert main(command) == 2
    assert "clip.npz exists" in capsys.readouterr().err
    other = ["track", str(folder), "-o", str(tmp_path / "other.npz"), *CAMERA]
    assert main([*other, "--picture", str(picture)]) == 2
    assert "tracks.png exists" in capsys.readouterr().err
    assert not (tmp_path / "other.npz").exists()
    assert main([*command, "--overwrite", "--people", "1"]) == 0
    assert len(read_clip(output).tracks) == 1


def test_info_on_keypoints(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_openpose(tmp_path / "film", "body_25")
    assert main(["info", str(folder), "--size", "1280x720"]) == 0
    text = capsys.readouterr().out
    assert "assumed" in text
    assert "film" in text


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["track", "nowhere", "-o", "clip.npz"], "no such file"),
        (["track", "nowhere", "-o", "clip.json"], "must end in .npz"),
        (["track", "nowhere", "-o", "no/folder/clip.npz"], "there is no folder"),
        (["track", "no", "-o", "a.npz", "--picture", "a.foo"], "a.foo: a picture's name ends in"),
        (["detect", "no.mp4", "-o", "a.npz", "--picture", "b/a.png"], "there is no folder b"),
        (["detect", "nowhere.mp4", "-o", "clip.npz"], "no such file"),
        (["info", "nowhere.mp4"], "nowhere.mp4"),
    ],
)
def test_faulty_arguments(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    assert message in capsys.readouterr().err


def test_a_size_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(SystemExit):
        main(["info", str(tmp_path), "--size", "large"])
