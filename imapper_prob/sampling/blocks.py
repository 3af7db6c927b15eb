"""Sampling in blocks, until the verdict is good or the time is up.

In a block every chain continues from its checkpoint to the same round. The settings alone determine
where blocks end (:mod:`imapper_prob.sampling.schedule`); the clock determines only their number.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

from imapper_prob.models.errors import InputError
from imapper_prob.samplers.verdict import Measures, Verdict

__all__ = ["LONGEST", "Block", "Clock", "Limits", "OnBlock"]

LONGEST: Final = 60.0
"""Default limit in minutes of sampling until the verdict is good."""


@dataclass(frozen=True)
class Limits:
    """When sampling stops.

    Parameters
    ----------
    minutes : float, optional
        Time limit of sampling. No block starts that would end later, except the first.
    until : "good", optional
        Stop as soon as the verdict is good.

    Raises
    ------
    InputError
        A limit is invalid.
    """

    minutes: float | None = None
    until: Literal["good"] | None = None

    def __post_init__(self) -> None:
        if self.minutes is not None and not 0 < self.minutes < math.inf:
            raise InputError(f"minutes = {self.minutes:g} must be a positive number")
        if self.until not in (None, "good"):
            raise InputError(f"until = {self.until!r} must be 'good'")

    @property
    def any(self) -> bool:
        """Whether sampling is done in blocks."""
        return self.minutes is not None or self.until is not None

    @property
    def seconds(self) -> float:
        """Time limit of sampling, seconds."""
        return 60 * (LONGEST if self.minutes is None else self.minutes)


@dataclass(frozen=True)
class Block:
    """The state of a run after a block.

    Parameters
    ----------
    steps, draws : int
        Of each chain so far.
    finished : bool
        Whether no chain was interrupted.
    measures : Measures
    verdict : Verdict
    seconds : float
        Time of sampling in this call, seconds.
    seconds_to_good : float
        Estimated further time until the verdict is good; 0 if it is good, NaN if unknown.
    seconds_left : float
        Estimated time until sampling stops: the rest of the time limit, or less if the verdict will
        be good earlier. 0 after the last block.
    """

    steps: int
    draws: int
    finished: bool
    measures: Measures
    verdict: Verdict
    seconds: float
    seconds_to_good: float
    seconds_left: float


OnBlock = Callable[[Block], None]


class Clock:
    """Measures the time of sampling and decides about the next block.

    Parameters
    ----------
    limits : Limits
    """

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._begun = time.monotonic()
        self._block_begun = self._begun
        self._pace = math.nan

    @property
    def seconds(self) -> float:
        """Seconds since the clock was made."""
        return time.monotonic() - self._begun

    def begin(self) -> None:
        """Mark the start of a block."""
        self._block_begun = time.monotonic()

    def end(self, rounds: float) -> None:
        """Mark the end of a block, and update the pace.

        Parameters
        ----------
        rounds : float
            Mean number of rounds per chain in the block.
        """
        if rounds > 0:
            self._pace = (time.monotonic() - self._block_begun) / rounds

    def part(self, of_block: float) -> float:
        """Estimate the share of all sampling that is done.

        Parameters
        ----------
        of_block : float
            Share of the current block that is done, 0 to 1.

        Returns
        -------
        float
            0 to 1.
        """
        in_block = time.monotonic() - self._block_begun
        ends = self.seconds - in_block + in_block / max(of_block, 1e-3)
        return min(1.0, self.seconds / max(self._limits.seconds, ends))

    def takes(self, rounds: float) -> float:
        """Time in seconds for a number of rounds at the pace of the last block; NaN if unknown.

        Parameters
        ----------
        rounds : float

        Returns
        -------
        float
            Seconds.
        """
        return rounds * self._pace

    def allows(self, rounds: float, verdict: Verdict) -> bool:
        """Whether another block of so many rounds is to follow.

        Parameters
        ----------
        rounds : float
            Rounds of the block.
        verdict : Verdict
            Verdict so far.

        Returns
        -------
        bool
        """
        if not self._limits.any or (self._limits.until == "good" and verdict.good):
            return False
        takes = self.takes(rounds)
        return self.seconds + (0.0 if math.isnan(takes) else takes) < self._limits.seconds

    def left(self, to_good: float) -> float:
        """Estimate the seconds until sampling stops.

        Parameters
        ----------
        to_good : float
            Seconds of sampling until the verdict is good; NaN if unknown.

        Returns
        -------
        float
            Seconds.
        """
        left = max(0.0, self._limits.seconds - self.seconds)
        good_first = self._limits.until == "good" and to_good < left
        return to_good if good_first else left
