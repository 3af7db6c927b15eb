"""When a chain keeps what, and where it may stop.

All of it follows from the settings and the number of rounds done, so a chain that goes on from
an earlier end keeps what one run of that length would have kept.

- *Planned rounds* are those of ``steps``. The first ``burn_in`` of them are not kept, however
  long the chain becomes: temperatures stay from there on.
- *Marks* are rounds after which a draw is kept. Beyond the planned rounds they go on at the same
  distance. Whenever there are more than twice as many as planned, every second one is dropped.
- *Pieces* are the rounds between two chances to stop. A piece begins with new trackers, which
  sum in another order than old ones: a chain may end where a piece ends, and nowhere else.
- *Visits* are noted in some rounds of the burn-in (:mod:`imapper_prob.sampling.visits`). The
  reference (:mod:`imapper_prob.sampling.reference`) is learnt before the first of them, of what was
  climbed to (:mod:`imapper_prob.sampling.ascent`), and four times more, after three fourths of the
  burn-in for the last time, each time from what was noted since the time before. The rest of the
  burn-in is for the temperatures, which have to fit the last reference.
- *Blocks* are some pieces long: a fourth of what is planned after burn-in, and twice as long each
  time that there are twice as many rounds. The first one holds the burn-in as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from imapper_prob.config import SampleSettings

__all__ = [
    "Marks", "block_end", "burn_in_of", "draws_of", "end_of", "learning_of", "piece_of",
    "stopped_at", "trace_of",
]  # fmt: skip

_PIECE: Final = 200
"""Steps between two progress reports and chances of a checkpoint; a fraction of a second."""
_LEARNING: Final = 0.75
"""Part of the burn-in in which is learnt; chosen, and"""
_LEARNT_AT: Final = (8, 4, 2, 1)
"""parts of that after which the reference is learnt: each round of learning is as long as all
before together, so that the last one is half of it (Surjanovic et al. 2022)."""
_NOTED: Final = 1500
"""Rounds of each of these that are noted, about; chosen: what is noted of them takes megabytes."""
_BLOCKS: Final = 4
"""Blocks of a run of ``steps``: each a tenth or more of it, long beside the start of processes."""


@dataclass(frozen=True)
class Marks:
    """Evenly spaced rounds, of which every second one is dropped whenever there are too many.

    Parameters
    ----------
    first : int
        The first one.
    spacing : float
        Rounds from one to the next, at least 1.
    most : int
        More are not kept.
    """

    first: int
    spacing: float
    most: int

    def at(self, number: int) -> int:
        """The round of a mark, counted from 0.

        Parameters
        ----------
        number : int

        Returns
        -------
        int
            Rounds.
        """
        return round(self.first + number * self.spacing)

    def count(self, rounds: int) -> int:
        """How many there are before ``rounds``, those dropped included.

        Parameters
        ----------
        rounds : int
            Of a chain.

        Returns
        -------
        int
        """
        number = max(0, int((rounds - self.first) / self.spacing) - 1)
        while self.at(number) < rounds:
            number += 1
        return number

    def stride(self, rounds: int) -> int:
        """Of how many marks one is kept after ``rounds`` rounds.

        Parameters
        ----------
        rounds : int
            Of a chain.

        Returns
        -------
        int
        """
        stride = 1
        while -(-self.count(rounds) // stride) > self.most:
            stride *= 2
        return stride

    def kept(self, rounds: int) -> int:
        """How many are kept after ``rounds`` rounds.

        Parameters
        ----------
        rounds : int
            Of a chain.

        Returns
        -------
        int
        """
        return -(-self.count(rounds) // self.stride(rounds))

    def has(self, at: int) -> bool:
        """Whether round ``at`` is one that is kept when it comes.

        Parameters
        ----------
        at : int

        Returns
        -------
        bool
        """
        number = self.count(at)
        return self.at(number) == at and number % self.stride(at) == 0


def burn_in_of(settings: SampleSettings) -> int:
    """Rounds that are not kept.

    Parameters
    ----------
    settings : SampleSettings

    Returns
    -------
    int
        Rounds.
    """
    return int(settings.rounds * settings.burn_in)


@dataclass(frozen=True)
class Learning:
    """Rounds of the burn-in in which visits are noted, and after which is learnt from them.

    Parameters
    ----------
    ends : tuple of int
        After each of these is learnt from what was noted since the one before.
    """

    ends: tuple[int, ...]

    def has(self, rounds: int) -> bool:
        """Whether the state after so many rounds is noted."""
        if not self.ends or rounds > self.ends[-1]:
            return False
        at = next(i for i, end in enumerate(self.ends) if rounds <= end)
        length = self.ends[at] - (self.ends[at - 1] if at else 0)
        return rounds % max(1, length // _NOTED) == 0


def learning_of(settings: SampleSettings) -> Learning:
    """When a chain learns.

    Parameters
    ----------
    settings : SampleSettings

    Returns
    -------
    Learning
    """
    burn_in = burn_in_of(settings)
    if not burn_in:
        return Learning(())
    ends = {int(_LEARNING * burn_in / part) for part in _LEARNT_AT}
    return Learning((0, *sorted(ends - {0})))


def piece_of(settings: SampleSettings) -> int:
    """Rounds of a piece.

    Parameters
    ----------
    settings : SampleSettings

    Returns
    -------
    int
        Rounds.
    """
    return max(1, _PIECE // settings.swap_every)


def draws_of(settings: SampleSettings) -> Marks:
    """Rounds after which a draw is kept.

    Parameters
    ----------
    settings : SampleSettings

    Returns
    -------
    Marks
    """
    return _evenly(burn_in_of(settings), settings)


def trace_of(settings: SampleSettings) -> Marks:
    """Rounds after which the log-posterior is noted, burn-in included.

    Parameters
    ----------
    settings : SampleSettings

    Returns
    -------
    Marks
    """
    return _evenly(0, settings)


def end_of(settings: SampleSettings) -> int:
    """Rounds at which chains stop: those planned, or of ``last_step``, rounded up to a piece.

    Parameters
    ----------
    settings : SampleSettings

    Returns
    -------
    int
        Rounds.
    """
    planned = settings.rounds
    if settings.last_step == 0:
        return planned
    asked = -(-settings.last_step // settings.swap_every)
    begins = burn_in_of(settings) if asked <= planned else planned
    end = begins + _up(asked - begins, piece_of(settings))
    return min(end, planned) if asked <= planned else end


def block_end(settings: SampleSettings, rounds: int) -> int:
    """Rounds at the end of the first block that ends after ``rounds``.

    Parameters
    ----------
    settings : SampleSettings
    rounds : int
        Of a chain.

    Returns
    -------
    int
        Rounds.
    """
    planned, burn_in = settings.rounds, burn_in_of(settings)
    length = _up(-(-(planned - burn_in) // _BLOCKS), piece_of(settings))
    end = burn_in
    while end <= max(rounds, burn_in):
        if end < planned:
            end = min(end + length, planned)
            continue
        while end - burn_in >= 2 * _BLOCKS * length:
            length *= 2
        end += length
    return end


def stopped_at(settings: SampleSettings, rounds: int) -> SampleSettings:
    """The same settings for chains that stop after so many ``rounds``.

    Parameters
    ----------
    settings : SampleSettings
    rounds : int
        Of a chain.

    Returns
    -------
    SampleSettings
    """
    last_step = 0 if rounds == settings.rounds else rounds * settings.swap_every
    return replace(settings, last_step=last_step)


def _evenly(first: int, settings: SampleSettings) -> Marks:
    gaps, last = settings.draws - 1, settings.rounds - 1
    spacing = (last - first) / gaps if gaps else float(max(1, last + 1 - first))
    return Marks(first, spacing, 2 * settings.draws)


def _up(rounds: int, piece: int) -> int:
    return -(-rounds // piece) * piece
