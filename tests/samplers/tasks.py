"""Chains for other processes: they must be importable by name."""

from __future__ import annotations

import os
import signal
import time

import numpy as np


def walk(problem, start, rng, report) -> np.ndarray:
    """A random walk of ``problem`` steps, or fewer if asked to stop."""
    steps = []
    for i in range(problem):
        steps.append(rng.standard_normal())
        if not report(i):
            break
    return start + np.cumsum(steps)


def slow_walk(problem, start, rng, report) -> int:
    """Counts steps of 10 ms, ``problem`` of them at most."""
    for i in range(problem):
        time.sleep(0.01)
        if not report(i):
            return i + 1
    return problem


def threads(problem, start, rng, report) -> dict[str, str | None]:
    return {name: os.environ.get(name) for name in problem}


def process(problem, start, rng, report) -> int:
    """Which process this is, after ``problem`` seconds."""
    time.sleep(problem)
    return os.getpid()


def fail(problem, start, rng, report) -> None:
    raise FloatingPointError("a bad density")


def fail_or_wait(problem, start, rng, report) -> None:
    """The chain that starts at ``problem`` fails, others wait as many seconds as they start at."""
    if start == problem:
        raise FloatingPointError("a bad density")
    time.sleep(start)


def fail_one(problem, start, rng, report) -> None:
    """The chain that starts at ``problem`` fails, the others wait to be stopped."""
    if start == problem:
        raise FloatingPointError("a bad density")
    while report():
        time.sleep(0.01)


def kill_one(problem, start, rng, report) -> None:
    """The process of the chain that starts at ``problem`` is killed."""
    if start == problem:
        time.sleep(0.2)
        os.kill(os.getpid(), signal.SIGKILL)
    while report():
        time.sleep(0.01)


def unloadable() -> None:
    raise ImportError("not in this process")


class Unloadable:
    """Can be sent, but not received."""

    def __reduce__(self):
        return unloadable, ()


def leave_pid(problem, start, rng, report) -> None:
    """Writes its process to the folder ``problem`` and stays for a minute."""
    (problem / f"{start}.pid").write_text(str(os.getpid()))
    time.sleep(60)
