"""The one door: by content, and what is too little to say anything."""

from __future__ import annotations

import errno
import json
import os
import re
from pathlib import Path

import pytest

from imapper_prob.cli import main
from imapper_prob.clips.load import ClipOptions, load_clip, read_camera, write_clip
from imapper_prob.clips.parsing import load_archive
from imapper_prob.models.errors import InputError
from tests.clips.i3db_folder import FRAMES, I3dbFolder


def test_folder_and_file_give_the_same_clip(tmp_path: Path) -> None:
    clip = load_clip(I3dbFolder().write(tmp_path / "Hall"))
    write_clip(tmp_path / "hall.npz", clip)
    again = load_clip(str(tmp_path / "hall.npz"))
    assert again.name == clip.name == "Hall"
    assert (again.tracks[0].keypoints == clip.tracks[0].keypoints).all()


def test_nothing_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"absent: no such file or folder"):
        load_clip(tmp_path / "absent")


def test_empty_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a folder without files; expected an i3DB scene"):
        load_clip(tmp_path)


@pytest.mark.parametrize(
    ("name", "content", "seen"),
    [
        ("notes.txt", b"years of work", "a text file; expected JSON"),
        ("photo.jpg", b"\xff\xd8\xff\xe0\x00\x10", "a binary file"),
        ("other.json", b'{"a": 1}', "JSON of another kind; expected results of MMPose"),
        ("posterior.nc", b"\x89HDF", "the draws of a run; give the clip"),
        ("folder/1.txt", b"", "a folder with 1 .txt files; expected"),
        ("run/posterior.nc", b"", "the folder of a run; give the clip"),
    ],
)
def test_what_is_no_clip_is_named(tmp_path: Path, name: str, content: bytes, seen: str) -> None:
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content)
    with pytest.raises(InputError, match=f"not a known clip, but {re.escape(seen)}"):
        load_clip(path.parent if "/" in name else path)


def test_unknown_file(tmp_path: Path) -> None:
    path = tmp_path / "clip.mp4"
    path.write_bytes(b"")
    with pytest.raises(InputError, match=r"clip\.mp4: not a known clip"):
        load_clip(path)


def test_three_frames_are_too_few(tmp_path: Path) -> None:
    files = I3dbFolder()
    for frame in FRAMES[3:]:
        files.drop_detection(frame)
    with pytest.raises(InputError, match=r"Hall: a clip of 3 frames; at least 8 are needed"):
        load_clip(files.write(tmp_path / "Hall"))


@pytest.mark.parametrize("name", [b"Sc\xe8ne", b"Sc\x1b[31m\xff\nne"])
def test_a_folder_whose_name_is_no_text_is_read_and_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: bytes
) -> None:
    folder = I3dbFolder().write(tmp_path / os.fsdecode(name))
    clip = load_clip(folder)
    assert clip.name.isprintable()
    write_clip(tmp_path / "clip.npz", clip)
    assert load_clip(tmp_path / "clip.npz").name == clip.name
    assert main(["info", str(folder)]) == 0
    # The folder that a run would be written to may be called so, too.
    assert main(["run", str(folder), "-o", str(folder / "out"), "--seed", "-1"]) == 2
    said = capsys.readouterr()
    assert "\x1b" not in said.out + said.err


def test_joints_at_one_pixel_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one = [{"x": 0.5, "y": 0.5, "visibility": 0.9}] * 33
    (tmp_path / "clip.json").write_text(
        json.dumps([{"frame": t, "landmarks": one} for t in range(20)])
    )
    arguments = ["run", str(tmp_path / "clip.json"), "--size", "1920x1080", "--fps", "10"]
    assert main([*arguments, "--focal", "1000", "-o", str(tmp_path / "out")]) == 2
    assert "track clip is 0.0 pixels high and wide" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_no_frame_with_both_joint_and_pose(tmp_path: Path) -> None:
    files = I3dbFolder()
    files.drop_detection(5)
    files.lifted["3d"] = {"00005": files.lifted["3d"]["00005"]}
    with pytest.raises(InputError, match=r"Hall: track hall has no frame with both"):
        load_clip(files.write(tmp_path / "Hall"))


def test_options_of_a_clip_file_belong_to_the_command_that_made_it(tmp_path: Path) -> None:
    folder = I3dbFolder().write(tmp_path / "Hall")
    write_clip(tmp_path / "hall.npz", load_clip(folder))
    with pytest.raises(InputError, match="has its own focal; give the option to the command that"):
        load_clip(tmp_path / "hall.npz", options=ClipOptions(focal=900.0))
    with pytest.raises(InputError, match="has its own focal; leave the option out"):
        load_clip(folder, options=ClipOptions(focal=900.0))


def test_what_cannot_be_opened_is_said_to_be_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match=r"nothere: no such file; name the file of a camera"):
        read_camera(tmp_path / "nothere")
    path = tmp_path / "library.npz"
    path.touch()

    def locked(*_: object) -> None:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(Path, "open", locked)
    with pytest.raises(InputError, match=r"library.npz: cannot be read \(Permission denied\)"):
        load_archive(path, what="library")
