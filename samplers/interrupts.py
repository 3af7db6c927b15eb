"""Ctrl-C and SIGTERM, also while compiled code runs.

Python handles a signal between two instructions of its own, wherever it is. Code compiled by numba
calls a few functions written in Python while it converts arguments and results, and does not check
whether they return: an exception raised there ends the process by a segmentation fault, or is lost.
A handler of this module sends the signal again a moment later if it finds itself in such a
function.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from types import FrameType
from typing import Any, Final

__all__ = ["first_interrupt_sets", "interruptible", "raising", "send_again"]

_AGAIN: Final = 0.05
"""Seconds until a signal that could not be handled is sent again; shorter than people notice."""
_UNCHECKED: Final = ("numba.core.serialize", "numba.experimental.structref", "ctypes")
"""Modules whose functions compiled code calls without checking for exceptions."""
_TUPLES: Final = "namedtuple_"
"""What names of modules of named tuples begin with; compiled code calls their constructors."""


def send_again(number: int) -> None:
    """Send a signal to this process again, a moment later.

    Parameters
    ----------
    number : int
        Of the signal.
    """
    again = threading.Timer(_AGAIN, os.kill, (os.getpid(), number))
    again.daemon = True
    again.start()


def _in_call_from_compiled_code(frame: FrameType | None) -> bool:
    while frame is not None:
        module = str(frame.f_globals.get("__name__", ""))
        if module in _UNCHECKED or module.startswith(_TUPLES):
            return True
        frame = frame.f_back
    return False


def _raise(error: type[BaseException], number: int, frame: FrameType | None) -> None:
    if _in_call_from_compiled_code(frame):
        send_again(number)
    else:
        raise error


@contextmanager
def _handled(
    numbers: Iterable[int], handle: Callable[[int, FrameType | None], None]
) -> Iterator[None]:
    """Handle signals; outside the main thread, where Python does not permit it, do nothing."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    previous = {number: signal.signal(number, handle) for number in numbers}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


@contextmanager
def raising(errors: Mapping[int, type[BaseException]]) -> Iterator[None]:
    """Let signals raise exceptions, as soon as compiled code permits.

    Does nothing outside the main thread, because Python permits handlers only there.

    Parameters
    ----------
    errors : mapping of int to exception class
        By number of the signal.

    Yields
    ------
    None
    """

    def handle(number: int, frame: FrameType | None) -> None:
        _raise(errors[number], number, frame)

    with _handled(errors, handle):
        yield


@contextmanager
def interruptible() -> Iterator[None]:
    """Let Ctrl-C raise `KeyboardInterrupt` as soon as compiled code permits.

    Programs that handle or ignore Ctrl-C continue to do so; shells let programs in the background
    ignore it.

    Yields
    ------
    None
    """
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    with raising({signal.SIGINT: KeyboardInterrupt}):
        yield


@contextmanager
def first_interrupt_sets(stop: Any) -> Iterator[None]:
    """Make the first Ctrl-C set ``stop``; a further one raises `KeyboardInterrupt`.

    Parameters
    ----------
    stop : object
        Its attribute ``value`` is set to True.

    Yields
    ------
    None
    """

    def handle(number: int, frame: FrameType | None) -> None:
        if stop.value:
            _raise(KeyboardInterrupt, number, frame)
        stop.value = True

    with _handled([signal.SIGINT], handle):
        yield
