"""Console output, progress bars, and handling of interruptions."""

from __future__ import annotations

import argparse
import logging
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
from imapper_prob.samplers.interrupts import interruptible, raising, send_again

__all__ = [
    "Stopped",
    "Terminated",
    "console",
    "interrupt_message",
    "print_lines",
    "printable",
    "progress_bars",
    "stoppable",
    "told",
]


def printable(text: str) -> str:
    """The text, line by line, without characters that a terminal interprets as commands.

    Parameters
    ----------
    text : str

    Returns
    -------
    str
    """
    return "\n".join(map(readable, text.split("\n")))


def console(*, stderr: bool = False) -> Any:
    """A `rich.console.Console` that interprets no markup, emoji or terminal command in texts.

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


def print_lines(text: str) -> None:
    """Print lines on standard output as they are, so that the commands in them can be copied.

    Parameters
    ----------
    text : str
    """
    console().print(text, soft_wrap=True)


@contextmanager
def told() -> Iterator[None]:
    """Print the program's warnings on standard error, and replace characters it cannot encode.

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
# Progress.


def progress_bars() -> AbstractContextManager[Bars]:
    """Progress bars on standard error: a line for each stage with its progress and duration.

    Returns
    -------
    context manager
        Of Bars.
    """
    return progress.progress_bars(console(stderr=True))


# ------------------------------------------------------------------------------------------------
# Interruptions of a command.
#
# Chains and ensembles handle the first Ctrl-C and return what they have, see
# :mod:`imapper_prob.samplers.chains`; the results are written and the command ends as interrupted.
# At any other time Ctrl-C ends the command at once, and SIGTERM does so at any time: incomplete
# files are removed, and the files from which a run can continue are kept.

_INTERRUPTED: Final = 128 + signal.SIGINT
_TERMINATED: Final = 128 + signal.SIGTERM
"""Exit codes, by the convention of shells."""


class Stopped(KeyboardInterrupt):
    """The user interrupted; results so far are written.

    Parameters
    ----------
    held : str
        What they are.
    goes_on : bool
        Whether the same command continues from them.
    """

    def __init__(self, held: str, *, goes_on: bool = True) -> None:
        super().__init__(held)
        self.goes_on = goes_on


class Terminated(KeyboardInterrupt):
    """SIGTERM was received."""


@contextmanager
def stoppable() -> Iterator[None]:
    """Let SIGTERM end a command as Ctrl-C does, with the same cleanup.

    An interruption that Python raises in a finaliser is lost there, so it is sent again.

    Yields
    ------
    None
    """
    if threading.current_thread() is not threading.main_thread():
        # Python delivers signals to the main thread only.
        yield
        return

    def hear(lost: sys.UnraisableHookArgs) -> None:
        if isinstance(lost.exc_value, KeyboardInterrupt):
            terminated = isinstance(lost.exc_value, Terminated)
            send_again(signal.SIGTERM if terminated else signal.SIGINT)
        else:
            unraisable(lost)

    unraisable = sys.unraisablehook
    sys.unraisablehook = hear
    try:
        with raising({signal.SIGTERM: Terminated}), interruptible():
            yield
    finally:
        sys.unraisablehook = unraisable


def interrupt_message(error: KeyboardInterrupt, options: argparse.Namespace) -> tuple[str, int]:
    """Final message and exit code of an interrupted command.

    Parameters
    ----------
    error : KeyboardInterrupt
    options : argparse.Namespace
        Options of the command that was interrupted.

    Returns
    -------
    tuple of str and int
    """
    from imapper_prob.results.folders import CHECKPOINTS

    code = _TERMINATED if isinstance(error, Terminated) else _INTERRUPTED
    if isinstance(error, Stopped):
        onward = "; the same command goes on" if error.goes_on else ""
        return f"interrupted; {error}{onward}", code
    output = getattr(options, "output", None)
    kept = isinstance(output, Path) and (output / CHECKPOINTS).is_dir()
    if kept or getattr(options, "suite", None) is not None:
        return "interrupted; what there is was kept, the same command goes on", code
    return "interrupted; nothing was written", code
