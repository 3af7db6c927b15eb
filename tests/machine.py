"""How fast this machine is now, for limits of time that hold on slow and busy machines."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

_Result = TypeVar("_Result")
_ADDITIONS = 1_000_000


def unit() -> float:
    """Seconds in which this machine makes a million additions in Python, .03 on a common one."""
    start = time.perf_counter()
    total = 0
    for number in range(_ADDITIONS):
        total += number
    return time.perf_counter() - start


def timed(work: Callable[[], _Result]) -> tuple[_Result, float]:
    """What some work gives, and its time in units.

    The unit is timed before and after the work, because the speed of a shared machine changes
    within seconds.
    """
    before = unit()
    start = time.perf_counter()
    result = work()
    seconds = time.perf_counter() - start
    return result, 2.0 * seconds / (before + unit())
