"""A recording in a file, whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from imapper_prob.files import written_whole

__all__ = ["saved"]


@contextmanager
def saved(recording: rr.RecordingStream, path: Path, blueprint: rrb.Blueprint) -> Iterator[None]:
    """What is logged meanwhile is the file's content.

    It is gathered in memory: the thread of the library that writes to files waits for ever where
    the disk is full from the beginning.
    """
    memory = recording.memory_recording()
    with recording:
        recording.send_blueprint(blueprint, make_active=False, make_default=True)
        yield
    content = memory.drain_as_bytes()
    with written_whole(path) as beside:
        beside.write_bytes(content)
