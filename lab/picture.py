"""How does a recording look? A PNG of it, rendered by the viewer without a screen.

    python -m lab.picture RECORDING PNG [--frame N] [--width 1600] [--height 1000]

makes the pictures of recordings in ``docs/``, in some seconds each. Errors and warnings of the
viewer are printed, and the exit code is then 1; it is 2 if the viewer cannot render.
"""

from __future__ import annotations

import argparse
import io
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING

from imapper_prob.files import written_whole
from imapper_prob.models.errors import InputError

if TYPE_CHECKING:
    from rerun.experimental import ViewerClient

__all__ = ["PictureUnavailable", "main", "render_recording"]

_START_SECONDS = 60.0
"""Seconds to wait for a viewer that starts or loads, on a busy machine without a graphics card."""
_ANSWER_SECONDS = 5.0
_POLL_SECONDS = 0.2
_STILL = 2
"""Equal screenshots in a row after which the view counts as settled."""
_RUN = "import sys; from rerun_cli.__main__ import main; sys.exit(main())"
"""Command of the viewer; ``python -m rerun_cli`` would lose its exit code."""
_NO_GRAPHICS = "Failed to get render context"
"""Error message of the viewer without a graphics driver."""


class PictureUnavailable(RuntimeError):
    """The viewer cannot render here, for instance without a Vulkan driver."""


class ViewerCrash(RuntimeError):
    """The viewer can render here but crashed on this recording."""


def render_recording(
    recording_path: str | os.PathLike[str],
    png_path: str | os.PathLike[str],
    *,
    width: int = 1600,
    height: int = 1000,
    frame: int | None = None,
) -> list[str]:
    """Open a recording in a viewer without a window and write a screenshot.

    Parameters
    ----------
    recording_path : path
        An ``.rrd`` file with its blueprint inside.
    png_path : path
        Written atomically; at most 500 kB.
    width, height : int
        Size in pixels.
    frame : int, optional
        Frame to show on the timeline `frame`; by default that at three quarters of it, when the
        person has reached the furniture.

    Returns
    -------
    list of str
        Errors and warnings that the viewer reported; empty if there are none.

    Raises
    ------
    InputError
        There is no such recording.
    PictureUnavailable
        The viewer does not start or does not load the recording.
    ViewerCrash
        The viewer crashes on the recording.
    """
    recording_path, png_path = Path(recording_path).resolve(), Path(png_path)
    if not recording_path.is_file():
        raise InputError(f"{recording_path}: no such recording")
    with _viewer(width, height) as client:
        client.open(str(recording_path))
        _go_to(client, frame)
        picture = _settled_screenshot(client)
        reports = [
            f"{view.name}: {report.severity}: {report.summary}"
            for view in client.get_state().views
            for report in view.reports
        ]
    with written_whole(png_path) as beside:
        beside.write_bytes(_compressed(picture))
    return reports


@contextmanager
def _viewer(width: int, height: int) -> Iterator[ViewerClient]:
    """Start a viewer of a given size, which rerun's own ``spawn`` cannot do."""
    from rerun.experimental import ViewerClient

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-c", _RUN, "--headless", "--bind", "127.0.0.1"]
    command += ["--port", str(port), "--window-size", f"{width}x{height}", "--hide-welcome-screen"]
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(
            command,
            stdout=subprocess.DEVNULL,
            stderr=said,
            # As in rerun's own spawn: no questions about analytics.
            env={**os.environ, "RERUN_APP_ONLY": "true"},
            # The command wraps the viewer; a process group of their own ends both.
            start_new_session=True,
        )
        try:
            yield _connected(ViewerClient, process, port, said)
        except ConnectionError as error:
            # The port opens before the graphics start, so a viewer may crash after its first
            # answer.
            raise _ended(process, said) from error
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGTERM)
            process.wait()


def main(arguments: Sequence[str] | None = None) -> None:
    """Command line: ``RECORDING PNG [--frame N] [--width W] [--height H]``."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("recording", type=Path)
    parser.add_argument("png", type=Path)
    parser.add_argument("--frame", type=int)
    parser.add_argument("--width", type=int, default=1600)
    parser.add_argument("--height", type=int, default=1000)
    chosen = parser.parse_args(arguments)
    try:
        reports = render_recording(
            chosen.recording,
            chosen.png,
            width=chosen.width,
            height=chosen.height,
            frame=chosen.frame,
        )
    except (InputError, PictureUnavailable, ViewerCrash) as error:
        parser.exit(2, f"error: {error}\n")
    if reports:
        parser.exit(1, "\n".join(reports) + "\n")


def _connected(
    kind: type[ViewerClient], process: subprocess.Popen[bytes], port: int, said: IO[bytes]
) -> ViewerClient:
    deadline = time.monotonic() + _START_SECONDS
    while True:
        if process.poll() is not None:
            raise _ended(process, said)
        try:
            with socket.create_connection(("127.0.0.1", port), timeout=1):
                pass
            client = kind.connect(f"rerun+http://127.0.0.1:{port}/proxy")
            client.get_state()
            return client
        except (OSError, RuntimeError, ValueError) as error:
            if time.monotonic() > deadline:
                raise PictureUnavailable("the viewer started but does not answer") from error
            time.sleep(_POLL_SECONDS)


def _ended(process: subprocess.Popen[bytes], said: IO[bytes]) -> RuntimeError:
    """The reason why the viewer ended, from its standard error ``said``."""
    try:
        code = process.wait(_ANSWER_SECONDS)
    except subprocess.TimeoutExpired:
        return PictureUnavailable("the viewer runs but has stopped answering")
    said.seek(0)
    panic = re.search(r"panicked at '(.*)'", said.read().decode(errors="replace"))
    if panic is not None and panic[1] != _NO_GRAPHICS:
        return ViewerCrash(f"the viewer crashed: {panic[1]}")
    if panic is not None:
        return PictureUnavailable(
            "the viewer found no graphics driver; on Debian, install mesa-vulkan-drivers"
        )
    return PictureUnavailable(f"the viewer ended with exit code {code}")


def _go_to(client: ViewerClient, frame: int | None) -> None:
    """Wait until the recording is loaded, then go to a frame and pause."""
    deadline = time.monotonic() + _START_SECONDS
    while time.monotonic() < deadline:
        state = client.get_state()
        timelines = {t.name: t for r in state.recordings for t in r.timelines}
        if not state.loading and "frame" in timelines:
            start, end = timelines["frame"].start or 0, timelines["frame"].end or 0
            chosen = frame if frame is not None else start + 3 * (end - start) // 4
            client.set_time("frame", sequence=chosen, play_state="paused")
            return
        time.sleep(_POLL_SECONDS)
    raise PictureUnavailable("the viewer did not load the recording")


def _settled_screenshot(client: ViewerClient) -> bytes:
    """Screenshot after layout, textures and notifications have settled."""
    deadline = time.monotonic() + _START_SECONDS
    same, last = 0, b""
    while same < _STILL and time.monotonic() < deadline:
        time.sleep(_POLL_SECONDS)
        picture = client.take_screenshot()
        same = same + 1 if picture == last else 0
        last = picture
    return last


def _compressed(png: bytes) -> bytes:
    """The image recompressed without loss and without transparency."""
    from PIL import Image

    out = io.BytesIO()
    Image.open(io.BytesIO(png)).convert("RGB").save(out, "PNG", optimize=True)
    return out.getvalue()


if __name__ == "__main__":
    main()
