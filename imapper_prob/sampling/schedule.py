"""The schedule of a chain: when draws are kept, references learnt, and blocks end.

Everything follows from the settings and the number of completed rounds. So a chain that is
continued keeps the same draws as a single longer run.

- *Planned rounds* are those of ``steps``. Their first part, ``burn_in``, is not kept, however long
  the chain becomes; temperatures are fixed afterwards.
- *Scheduled* rounds are those after which a draw is kept. Beyond the planned rounds they continue
  at the same spacing. Whenever there are more than twice as many as planned, every second one is
  dropped.
- *Pieces* are the rounds between two opportunities to stop. Each piece begins with new evaluators,
  whose rounding errors differ from those of old ones, so a chain may end only where a piece ends.
- *Visits* are recorded in some rounds (:mod:`imapper_prob.sampling.visits`). The reference
  (:mod:`imapper_prob.sampling.reference`) is first learnt from walks about the results of the
  ascents (:mod:`imapper_prob.sampling.ascent`), and up to eight more times in burn-in at equal
  intervals, each time from these and the later half of the visits so far, which include a walk
  about the best scene, the last time after three fourths of the burn-in. In the rest of the burn-in
  the temperatures adapt to this reference. After burn-in a reference is learnt whenever a long
  chain has a tenth more rounds. Between two references a chain is a Markov chain whose target is
  the posterior, and such adaptation, ever more rarely, leaves means over draws consistent
  (Chimisov, Łatuszyński & Roberts 2018, arXiv:1801.09309).
- *Blocks* consist of pieces. A block is a fourth of the planned rounds after burn-in, and twice as
  long each time the number of rounds has doubled. The first one includes the burn-in.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from imapper_prob.config import SampleSettings

__all__ = [
    "block_end", "burn_in_of", "draws_of", "end_of", "learning_of", "piece_of",
    "stopped_at", "trace_of",
]  # fmt: skip

_PIECE: Final = 200
"""Steps between two opportunities for progress reports and checkpoints; a fraction of a second."""
_LEARNING: Final = 0.75
"""Share of the burn-in after which the last reference is learnt; chosen."""
_REFERENCES: Final = 8
"""Largest number of references that are learnt from visits; chosen. Scenes that one reference draws
too seldom are rare among the visits from which the next is learnt, so that several are needed."""
_SHORTEST: Final = 20
"""Least number of rounds from one reference to the next; chosen: short chains should be short."""
_GROWTH: Final = 1.1
"""Factor of the rounds from one reference after burn-in to the next; chosen."""
_LATER_FROM: Final = 5000
"""Least number of rounds of a chain before a reference after burn-in; chosen: what shorter chains
have visited since is little, and the demo has fewer effective draws if it learns from that."""
_MOST: Final = 73
"""Largest number of references after burn-in: enough for a thousand times its rounds."""
_NOTED: Final = 1000
"""Least number of rounds from one reference to the next whose states are recorded, if there are as
many, less than twice as many at most; chosen: references learnt from a fifth of these lack scenes
of large probability, and chains stay long in such scenes. Recorded states take megabytes."""
_BLOCKS: Final = 4
"""Blocks of a run of ``steps``; each is long compared with the start of processes."""


@dataclass(frozen=True)
class RoundSchedule:
    """Evenly spaced rounds; every second one is dropped whenever there are too many.

    Parameters
    ----------
    first : int
        The first round.
    spacing : float
        Rounds from one to the next, at least 1.
    most : int
        Largest number that is kept.
    """

    first: int
    spacing: float
    most: int

    def at(self, number: int) -> int:
        """A scheduled round by its number.

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
        """Number of scheduled rounds before ``rounds``, including dropped ones.

        Parameters
        ----------
        rounds : int
            Rounds of a chain.

        Returns
        -------
        int
        """
        number = max(0, int((rounds - self.first) / self.spacing) - 1)
        while self.at(number) < rounds:
            number += 1
        return number

    def stride(self, rounds: int) -> int:
        """The stride of kept ones after ``rounds`` rounds.

        Parameters
        ----------
        rounds : int
            Rounds of a chain.

        Returns
        -------
        int
        """
        stride = 1
        while -(-self.count(rounds) // stride) > self.most:
            stride *= 2
        return stride

    def kept(self, rounds: int) -> int:
        """Number of scheduled rounds kept after ``rounds`` rounds.

        Parameters
        ----------
        rounds : int
            Rounds of a chain.

        Returns
        -------
        int
        """
        return -(-self.count(rounds) // self.stride(rounds))

    def has(self, at: int) -> bool:
        """Whether a draw is kept at round ``at`` when it is reached.

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
    """Number of rounds of the burn-in.

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
    """Rounds in which visits are recorded, and after which references are learnt.

    Parameters
    ----------
    ends : tuple of int
        After each of these rounds a reference is learnt.
    last_of_burn_in : int
        The last one of the burn-in; -1 if there is none.
    """

    ends: tuple[int, ...]
    last_of_burn_in: int

    def has(self, rounds: int) -> bool:
        """Whether the state after so many rounds is recorded."""
        if not self.ends or rounds > self.ends[-1]:
            return False
        at = next(i for i, end in enumerate(self.ends) if rounds <= end)
        length = self.ends[at] - (self.ends[at - 1] if at else 0)
        return rounds % max(1, length // _NOTED) == 0


def learning_of(settings: SampleSettings) -> Learning:
    """When a chain learns references.

    Parameters
    ----------
    settings : SampleSettings

    Returns
    -------
    Learning
    """
    burn_in = burn_in_of(settings)
    if not burn_in:
        return Learning((), -1)
    last = int(_LEARNING * burn_in)
    count = max(1, min(_REFERENCES, last // _SHORTEST))
    ends, at = sorted({last * n // count for n in range(count + 1)}), burn_in
    for _ in range(_MOST):
        at = _piece_end(settings, max(round(at * _GROWTH), at + _SHORTEST))
        if at >= _LATER_FROM:
            ends.append(at)
    return Learning(tuple(ends), last)


def piece_of(settings: SampleSettings) -> int:
    """Number of rounds of a piece.

    Parameters
    ----------
    settings : SampleSettings

    Returns
    -------
    int
        Rounds.
    """
    return max(1, _PIECE // settings.swap_every)


def draws_of(settings: SampleSettings) -> RoundSchedule:
    """Rounds after which a draw is kept.

    Parameters
    ----------
    settings : SampleSettings

    Returns
    -------
    RoundSchedule
    """
    return _evenly(burn_in_of(settings), settings)


def trace_of(settings: SampleSettings) -> RoundSchedule:
    """Rounds after which the log-posterior is recorded, including burn-in.

    Parameters
    ----------
    settings : SampleSettings

    Returns
    -------
    RoundSchedule
    """
    return _evenly(0, settings)


def end_of(settings: SampleSettings) -> int:
    """Round at which chains stop: the planned one, or that of ``last_step`` rounded up to a piece.

    Parameters
    ----------
    settings : SampleSettings

    Returns
    -------
    int
        Rounds.
    """
    if settings.last_step == 0:
        return settings.rounds
    return _piece_end(settings, -(-settings.last_step // settings.swap_every))


def block_end(settings: SampleSettings, rounds: int) -> int:
    """Round at the end of the first block that ends after ``rounds``.

    Parameters
    ----------
    settings : SampleSettings
    rounds : int
        Rounds of a chain.

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
    """The settings of chains that stop after so many ``rounds``.

    Parameters
    ----------
    settings : SampleSettings
    rounds : int
        Rounds of a chain.

    Returns
    -------
    SampleSettings
    """
    last_step = 0 if rounds == settings.rounds else rounds * settings.swap_every
    return replace(settings, last_step=last_step)


def _evenly(first: int, settings: SampleSettings) -> RoundSchedule:
    gaps, last = settings.draws - 1, settings.rounds - 1
    spacing = (last - first) / gaps if gaps else float(max(1, last + 1 - first))
    return RoundSchedule(first, spacing, 2 * settings.draws)


def _piece_end(settings: SampleSettings, rounds: int) -> int:
    """The first round from ``rounds`` on at which a piece ends that does not belong to burn-in."""
    planned = settings.rounds
    begins = burn_in_of(settings) if rounds <= planned else planned
    end = begins + _up(rounds - begins, piece_of(settings))
    return min(end, planned) if rounds <= planned else end


def _up(rounds: int, piece: int) -> int:
    return -(-rounds // piece) * piece
