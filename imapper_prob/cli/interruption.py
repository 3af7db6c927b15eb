"""What becomes of a command that somebody stops, from its first stage to its last byte.

Chains and ensembles hear of the first Ctrl-C and return what they have, see
:mod:`imapper_prob.samplers.chains`; what follows is written and the command ends as interrupted.
At any other time Ctrl-C, and SIGTERM at all times, end the command where it is: files that are
not complete are removed, those that a run goes on from stay.
"""

from __future__ import annotations

import argparse
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

__all__ = ["Stopped", "Terminated", "last_words", "stoppable"]

_INTERRUPTED: Final = 128 + signal.SIGINT
_TERMINATED: Final = 128 + signal.SIGTERM
"""Exit codes, as shells have them."""


class Stopped(KeyboardInterrupt):
    """Somebody asked to stop; what there is was written, and the message says what that is."""


class Terminated(KeyboardInterrupt):
    """Somebody sent SIGTERM."""


@contextmanager
def stoppable() -> Iterator[None]:
    """Let SIGTERM end a command as Ctrl-C does, so that it leaves nothing behind."""
    if threading.current_thread() is not threading.main_thread():
        # Python hands signals to the main thread alone.
        yield
        return

    def handle(number: int, frame: object) -> None:
        raise Terminated

    previous = signal.signal(signal.SIGTERM, handle)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous)


def last_words(error: KeyboardInterrupt, options: argparse.Namespace) -> tuple[str, int]:
    """What is said of it, and the exit code."""
    from imapper_prob.output import CHECKPOINTS

    code = _TERMINATED if isinstance(error, Terminated) else _INTERRUPTED
    if isinstance(error, Stopped):
        held = f"{error}; " if error.args else ""
        return f"interrupted; {held}the same command goes on", code
    output = getattr(options, "output", None)
    kept = isinstance(output, Path) and (output / CHECKPOINTS).is_dir()
    if kept or getattr(options, "suite", None) is not None:
        return "interrupted; what there is was kept, the same command goes on", code
    return "interrupted; nothing was written", code
