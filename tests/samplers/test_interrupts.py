"""Signals raise exceptions, but never where compiled code would not survive them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path
from types import SimpleNamespace

import pytest

from imapper_prob.samplers.interrupts import first_interrupt_sets, interruptible, raising

ROOT = Path(__file__).parents[2]


class Told(Exception):
    """Raised by a signal."""


def test_signals_raise_and_are_forgotten() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(Told), raising({signal.SIGTERM: Told}):
        os.kill(os.getpid(), signal.SIGTERM)
    assert signal.getsignal(signal.SIGTERM) is before


def test_ctrl_c_of_programs_that_handle_it_is_left_alone() -> None:
    heard = []
    previous = signal.signal(signal.SIGINT, lambda *_: heard.append(True))
    try:
        with interruptible():
            os.kill(os.getpid(), signal.SIGINT)
        assert heard == [True]
        # A shell lets programs in the background ignore it.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        with pytest.raises(KeyboardInterrupt), interruptible():
            os.kill(os.getpid(), signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, previous)


def test_the_first_sets_and_the_second_raises() -> None:
    stop = SimpleNamespace(value=False)
    with first_interrupt_sets(stop):
        os.kill(os.getpid(), signal.SIGINT)
        assert stop.value
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)


def test_compiled_code_survives_signals() -> None:
    """Most of these signals arrive while arguments and results are converted.

    One that is lost lets the program run until the time is up.
    """
    program = textwrap.dedent(
        """
        import signal
        from typing import NamedTuple

        import numba
        import numpy as np
        from numba.experimental import structref

        from imapper_prob.samplers import interrupts

        interrupts._AGAIN = 0.001

        class Pair(NamedTuple):
            one: float
            other: float

        @structref.register
        class BoxType(numba.types.StructRef):
            pass

        class Box(structref.StructRefProxy):
            pass

        structref.define_proxy(Box, BoxType, ["number"])

        @numba.njit
        def draw(rng, box):
            return Pair(rng.random(), box.number), Pair(2.0, 3.0)

        rng, box, raised = np.random.default_rng(0), Box(1.0), 0
        draw(rng, box)
        with interrupts.raising({signal.SIGALRM: KeyboardInterrupt}):
            while raised < 300:
                try:
                    signal.setitimer(signal.ITIMER_REAL, 0.0001 + 0.0005 * np.random.random())
                    while True:
                        draw(rng, box)
                except KeyboardInterrupt:
                    raised += 1
        print(raised)
        """
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert (done.returncode, done.stdout) == (0, "300\n"), done.stderr
