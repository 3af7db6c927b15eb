"""Sampling in blocks, until probabilities are good or the time is up.

A block is: every chain goes on from its checkpoint to the same round. Where blocks end follows
from the settings alone (:mod:`imapper_prob.sampling.schedule`); the clock decides only how many
there are.
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
"""Minutes that sampling until good may take where nothing else is said."""


@dataclass(frozen=True)
class Limits:
    """When to stop.

    Parameters
    ----------
    minutes : float, optional
        Of sampling; no block is begun that would not end in time, but for the first.
    until : "good", optional
        Stop as soon as the verdict is good.

    Raises
    ------
    InputError
        If they are not such.
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
        """Whether there are blocks at all."""
        return self.minutes is not None or self.until is not None

    @property
    def seconds(self) -> float:
        """Of sampling, at most."""
        return 60 * (LONGEST if self.minutes is None else self.minutes)


@dataclass(frozen=True)
class Block:
    """What is known after a block.

    Parameters
    ----------
    steps, draws : int
        Of each chain so far.
    finished : bool
        Whether no chain was interrupted.
    measures : Measures
    verdict : Verdict
    seconds : float
        Of sampling in this call.
    seconds_to_good : float
        More of them, as far as can be told; 0 for a good verdict, NaN where nobody can tell.
    seconds_left : float
        Until sampling stops: what is left of the time, or less where it will be good before.
        0 after the last block.
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
    """How long sampling takes, and what that means for the next block.

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
        """Since the beginning."""
        return time.monotonic() - self._begun

    def begin(self) -> None:
        """A block begins."""
        self._block_begun = time.monotonic()

    def end(self, rounds: float) -> None:
        """The block ends, in which chains made so many ``rounds`` each in the mean.

        Parameters
        ----------
        rounds : float
            That chains made in the block, each in the mean.
        """
        if rounds > 0:
            self._pace = (time.monotonic() - self._block_begun) / rounds

    def part(self, of_block: float) -> float:
        """Part of all the sampling that is done, with a part of the block.

        Parameters
        ----------
        of_block : float
            Part of the block that is done, 0 to 1.

        Returns
        -------
        float
            0 to 1.
        """
        in_block = time.monotonic() - self._block_begun
        ends = self.seconds - in_block + in_block / max(of_block, 1e-3)
        return min(1.0, self.seconds / max(self._limits.seconds, ends))

    def takes(self, rounds: float) -> float:
        """Seconds for so many rounds, at the pace of the last block; NaN where that is unknown.

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
        """Whether a block of so many rounds is to follow.

        Parameters
        ----------
        rounds : float
            Of the block.
        verdict : Verdict
            So far.

        Returns
        -------
        bool
        """
        if not self._limits.any or (self._limits.until == "good" and verdict.good):
            return False
        takes = self.takes(rounds)
        return self.seconds + (0.0 if math.isnan(takes) else takes) < self._limits.seconds

    def left(self, to_good: float) -> float:
        """Seconds until sampling stops, where it is good after ``to_good``, perhaps NaN.

        Parameters
        ----------
        to_good : float
            Seconds of sampling until it is good; NaN where nobody can tell.

        Returns
        -------
        float
            Seconds.
        """
        left = max(0.0, self._limits.seconds - self.seconds)
        good_first = self._limits.until == "good" and to_good < left
        return to_good if good_first else left
