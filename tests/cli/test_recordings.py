"""``record`` and ``view`` on the folder of a run."""

from __future__ import annotations

import errno
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from imapper_prob.cli import export, main
from imapper_prob.uncertainty.tree import write_tree
from tests.recording.reading import read
from tests.runs import posterior


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of which nothing but posterior.nc is left."""
    folder = tmp_path_factory.mktemp("run")
    write_tree(folder / "posterior.nc", posterior().data)
    return folder


def test_the_recording_is_made_from_posterior_nc_alone(folder: Path, tmp_path: Path) -> None:
    first, second = tmp_path / "first.rrd", tmp_path / "second.rrd"
    assert main(["record", str(folder), "-o", str(first)]) == 0
    assert main(["record", str(folder), "-o", str(second)]) == 0
    columns = read(first)
    assert columns == read(second)
    run = posterior()
    draws = columns["/world/draws/chain_1/names", "Points3D:labels"]
    assert draws[3] == [o.label for o in run.samples.objects[3]]
    (text,) = columns["/description", "TextDocument:text"][None]
    assert run.samples.verdict.text in text
    assert not (folder / "recording.rrd").exists()


def test_pictures_of_the_clip_can_be_shown(folder: Path, tmp_path: Path) -> None:
    clip, frames = posterior().clip, tmp_path / "frames"
    frames.mkdir()
    first = int(clip.frame_ids[0])
    size = (clip.camera.width, clip.camera.height)
    Image.new("RGB", size).save(frames / f"{first}.jpg")
    output = tmp_path / "run.rrd"
    assert main(["record", str(folder), "-o", str(output), "--video", str(frames)]) == 0
    assert list(read(output)["/world/camera/image/video", "EncodedImage:blob"]) == [first]


def test_a_full_disk_keeps_the_old_recording(
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    output = tmp_path / "run.rrd"
    output.write_bytes(b"old")

    def full(path: Path, content: bytes) -> None:
        with path.open("wb") as file:
            file.write(content[: len(content) // 2])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", full)
    assert main(["record", str(folder), "-o", str(output)]) == 2
    assert "run.rrd: cannot be written (No space left" in capsys.readouterr().err
    assert output.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [output]


def test_view_opens_the_recording_and_makes_it_if_need_be(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[Path] = []
    monkeypatch.setattr(export, "open_viewer", opened.append)
    assert main(["view", str(folder)]) == 0
    made = folder / "recording.rrd"
    assert opened == [made]
    assert made.is_file()
    assert main(["view", str(made)]) == 0
    assert opened == [made, made]


@pytest.fixture
def recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A recording, where there seems to be a screen."""
    monkeypatch.setattr(export.sys, "platform", "linux")
    monkeypatch.setenv("DISPLAY", ":0")
    path = tmp_path / "run.rrd"
    path.write_bytes(b"")
    return path


def test_view_starts_a_viewer_that_listens_to_this_machine_only(
    recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = recording.with_name("arguments")
    program = f"import sys; open({str(arguments)!r}, 'w').write(chr(10).join(sys.argv[1:]))"
    monkeypatch.setattr(export, "_RUN", program)
    assert main(["view", str(recording)]) == 0
    assert arguments.read_text().split("\n") == ["--bind", "127.0.0.1", str(recording)]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Linux tells who listens")
def test_the_viewer_itself_listens_to_this_machine_only(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    # Without the window, for which there is no screen here.
    more = f"sys.argv += ['--serve-grpc', '--port', '{port}']; "
    monkeypatch.setattr(export, "_RUN", export._RUN.replace("sys; ", f"sys; {more}"))
    monkeypatch.setenv("DISPLAY", ":0")
    started: list[subprocess.Popen[bytes]] = []
    start = subprocess.Popen

    def watched(*args: Any, **kwargs: Any) -> subprocess.Popen[bytes]:
        started.append(start(*args, **kwargs))
        return started[-1]

    monkeypatch.setattr(export.subprocess, "Popen", watched)
    try:
        assert main(["view", str(folder)]) == 0
        for _ in range(200):
            if found := listening(port):
                break
            time.sleep(0.1)
        assert found == {"0100007F"}
    finally:
        os.killpg(started[0].pid, signal.SIGKILL)
        started[0].wait()


def listening(port: int) -> set[str]:
    """Addresses on which somebody listens to a port, in the notation of Linux."""
    found = set()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            address, at = line.split()[1].split(":")
            if line.split()[3] == "0A" and int(at, 16) == port:
                found.add(address)
    return found


def test_a_viewer_that_finds_no_screen_is_spoken_of(
    recording: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(export, "_RUN", "import sys; sys.exit(1)")
    assert main(["view", str(recording)]) == 2
    assert "the viewer cannot show it on this screen" in capsys.readouterr().err
    for display in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(display, raising=False)
    assert main(["view", str(recording)]) == 2
    assert "no screen here" in capsys.readouterr().err


def test_what_is_not_there_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, message in (
        (["view", str(tmp_path / "no.rrd")], "no.rrd: no such recording"),
        (["view", str(tmp_path)], "posterior.nc: no such file"),
        (["record", str(tmp_path)], "posterior.nc: no such file"),
    ):
        assert main(arguments) == 2
        assert message in capsys.readouterr().err
