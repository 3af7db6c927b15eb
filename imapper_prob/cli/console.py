"""What the command line prints, how it shows progress, and what an interruption does."""

from __future__ import annotations

import argparse
import logging
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, Final

from imapper_prob import progress
from imapper_prob.models.text import readable
from imapper_prob.progress import Bars

__all__ = [
    "Stopped",
    "Terminated",
    "console",
    "last_words",
    "printable",
    "progress_bars",
    "stoppable",
    "told",
]


def printable(text: str) -> str:
    """Text line by line without anything that a terminal takes for an order.

    Parameters
    ----------
    text : str

    Returns
    -------
    str
    """
    return "\n".join(map(readable, text.split("\n")))


def console(*, stderr: bool = False) -> Any:
    """A `rich.console.Console` that takes no word of a text for markup, emoji or an order.

    Parameters
    ----------
    stderr : bool
        Whether it writes to standard error instead of standard output.

    Returns
    -------
    rich.console.Console
    """
    from rich.console import Console

    class Plain(Console):
        def render_str(self, text: str, **options: Any) -> Any:
            options.update(markup=False, emoji=False)
            return super().render_str(printable(text), **options)

    return Plain(stderr=stderr, markup=False, emoji=False, highlight=False)


@contextmanager
def told() -> Iterator[None]:
    """Warnings of the program as lines on standard error, and no character that stops a line.

    Yields
    ------
    None
    """
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    handler = logging.StreamHandler()
    handler.setFormatter(_Plain())
    handler.setLevel(logging.WARNING)
    program = logging.getLogger("imapper_prob")
    program.addHandler(handler)
    try:
        yield
    finally:
        program.removeHandler(handler)


class _Plain(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        return printable(super().format(record))


# ------------------------------------------------------------------------------------------------
# How far a run is.


def progress_bars() -> AbstractContextManager[Bars]:
    """Bars on standard error: one line a stage, what, how much of it and how long.

    Returns
    -------
    context manager
        Of Bars.
    """
    return progress.progress_bars(console(stderr=True))


# ------------------------------------------------------------------------------------------------
# What becomes of a command that somebody stops, from its first stage to its last byte.
#
# Chains and ensembles hear of the first Ctrl-C and return what they have, see
# :mod:`imapper_prob.samplers.chains`; what follows is written and the command ends as interrupted.
# At any other time Ctrl-C, and SIGTERM at all times, end the command where it is: files that are
# not complete are removed, those that a run goes on from stay.

_AGAIN: Final = 0.05
"""Seconds until an interruption is sent again that a finaliser swallowed; it is over by then."""
_INTERRUPTED: Final = 128 + signal.SIGINT
_TERMINATED: Final = 128 + signal.SIGTERM
"""Exit codes, as shells have them."""


class Stopped(KeyboardInterrupt):
    """Somebody asked to stop; what there is was written, and the message says what that is."""


class Terminated(KeyboardInterrupt):
    """Somebody sent SIGTERM."""


@contextmanager
def stoppable() -> Iterator[None]:
    """Let SIGTERM end a command as Ctrl-C does, so that it leaves nothing behind.

    An interruption that Python throws into a finaliser is lost there: it is sent again.

    Yields
    ------
    None
    """
    if threading.current_thread() is not threading.main_thread():
        # Python hands signals to the main thread alone.
        yield
        return

    def handle(number: int, frame: object) -> None:
        raise Terminated

    def hear(lost: sys.UnraisableHookArgs) -> None:
        if not isinstance(lost.exc_value, KeyboardInterrupt):
            unraisable(lost)
            return
        number = signal.SIGTERM if isinstance(lost.exc_value, Terminated) else signal.SIGINT
        again = threading.Timer(_AGAIN, os.kill, (os.getpid(), number))
        again.daemon = True
        again.start()

    previous, unraisable = signal.signal(signal.SIGTERM, handle), sys.unraisablehook
    sys.unraisablehook = hear
    try:
        yield
    finally:
        sys.unraisablehook = unraisable
        signal.signal(signal.SIGTERM, previous)


def last_words(error: KeyboardInterrupt, options: argparse.Namespace) -> tuple[str, int]:
    """What is said of it, and the exit code.

    Parameters
    ----------
    error : KeyboardInterrupt
    options : argparse.Namespace
        Of the command that was stopped.

    Returns
    -------
    tuple of str and int
    """
    from imapper_prob.results.folders import CHECKPOINTS

    code = _TERMINATED if isinstance(error, Terminated) else _INTERRUPTED
    if isinstance(error, Stopped):
        held = f"{error}; " if error.args else ""
        return f"interrupted; {held}the same command goes on", code
    output = getattr(options, "output", None)
    kept = isinstance(output, Path) and (output / CHECKPOINTS).is_dir()
    if kept or getattr(options, "suite", None) is not None:
        return "interrupted; what there is was kept, the same command goes on", code
    return "interrupted; nothing was written", code
