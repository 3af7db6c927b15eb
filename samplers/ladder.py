"""Ladders of inverse temperatures: their spacing, their number, and how well states travel.

References
----------
Xie, Lewis, Fan, Kuo & Chen 2011, Syst. Biol. 60, 150 (powers of the likelihood).
Vousden, Farr & Mandel 2016, MNRAS 455, 1919 (equal swap rates by stochastic approximation).
Syed, Bouchard-Côté, Deligiannidis & Doucet 2022, JRSS B 84, 321 (barrier, round trips).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

__all__ = [
    "LadderSummary", "SwapTable", "best_rungs", "power_ladder", "resized_betas", "respaced",
    "tilted",
]  # fmt: skip


# The tempered distributions change fastest near the prior. On the scale beta^0.3, on which Xie et
# al. recommend even steps, they change about evenly.
_SCALE = 0.3


def power_ladder(n_rungs: int) -> tuple[float, ...]:
    """Initial inverse temperatures, evenly spaced on the scale beta^0.3.

    Parameters
    ----------
    n_rungs : int
        Number of rungs, at least 2.

    Returns
    -------
    tuple of float
        Ascending from 0 (the prior) to 1 (the posterior).
    """
    if n_rungs < 2:
        raise ValueError(f"a ladder of {n_rungs} rungs cannot go from 0 to 1")
    betas = np.linspace(0, 1, n_rungs) ** (1 / _SCALE)
    return (0.0, *betas[1:-1].tolist(), 1.0)


def respaced(
    betas: Sequence[float], acceptance: Sequence[float], *, gain: float
) -> tuple[float, ...]:
    """Widen gaps whose swap rate is above the mean, and narrow the others.

    Gaps are measured on the scale beta^0.3 and multiplied by exp(gain (rate - mean rate)); both
    ends stay fixed. With decreasing gains this is a stochastic approximation whose only fixed point
    has equal rates.

    Parameters
    ----------
    betas : sequence of K float
        Ascending.
    acceptance : sequence of K - 1 float
        Probability of a swap across each gap.
    gain : float
        Step size of the adaptation, positive.

    Returns
    -------
    tuple of K float
    """
    if len(betas) <= 2:
        return tuple(betas)
    places = np.asarray(betas) ** _SCALE
    rates = np.asarray(acceptance)
    gaps = np.diff(places) * np.exp(gain * (rates - rates.mean()))
    gaps *= (places[-1] - places[0]) / gaps.sum()
    inner = (places[0] + np.cumsum(gaps[:-1])) ** (1 / _SCALE)
    return (betas[0], *inner.tolist(), betas[-1])


def tilted(
    betas: Sequence[float],
    tilts: Sequence[Sequence[float]],
    counts: Sequence[Sequence[float]],
    mean_counts: tuple[Sequence[float], Sequence[float]],
    *,
    gain: float,
) -> tuple[tuple[tuple[float, ...], ...], tuple[tuple[float, ...], tuple[float, ...]]]:
    """Raise the tilts of kinds that a rung has too few of, and lower the others.

    The aim of each rung is the mean of the mean counts at both ends, weighted by the inverse
    temperature. With decreasing gains this is a stochastic approximation. The ends have no tilts.

    Parameters
    ----------
    betas : sequence of K float
        Ascending.
    tilts : sequence of K sequences of M float
        Factor of each kind's count in the log density of each rung.
    counts : sequence of K sequences of M float
        Number of parts of each kind of the states on the rungs.
    mean_counts : tuple of 2 sequences of M float
        Running means of the counts at both ends.
    gain : float
        Step size of the adaptation, positive.

    Returns
    -------
    tilts : tuple of K tuples of M float
    mean_counts : tuple of 2 tuples of M float
    """
    now, ends = np.asarray(counts, float), np.array(mean_counts, float)
    ends += gain * (now[[0, -1]] - ends)
    share = np.asarray(betas)[1:-1, None]
    new = np.array(tilts, float)
    new[1:-1] += gain * (ends[0] + share * (ends[1] - ends[0]) - now[1:-1])
    first, last = ends.tolist()
    return tuple(map(tuple, new.tolist())), (tuple(first), tuple(last))


def resized_betas(betas: Sequence[float], rungs: int) -> tuple[tuple[int, ...], tuple[float, ...]]:
    """Fewer or more inverse temperatures between the same ends.

    Between the new rungs are equal numbers of old gaps, in fractions, so that equal swap rates
    remain about equal. In the first gap rates change in proportion to the inverse temperature.

    Parameters
    ----------
    betas : sequence of K float
        Ascending, at least two.
    rungs : int
        At least 2.

    Returns
    -------
    nearest : tuple of int
        For each new rung the nearest old one.
    betas : tuple of float

    Raises
    ------
    ValueError
        The number of rungs, old or new, is less than 2.
    """
    old = len(betas)
    if min(old, rungs) < 2:
        raise ValueError(f"a ladder of {old} rungs cannot have {rungs}")
    places = np.linspace(0, old - 1, rungs)
    inner = np.interp(places, np.arange(old), np.asarray(betas) ** _SCALE) ** (1 / _SCALE)
    inner = np.where(places < 1, places * betas[1], inner)
    nearest = tuple(round(place) for place in places.tolist())
    return nearest, (betas[0], *inner[1:-1].tolist(), betas[-1])


class LadderSummary(NamedTuple):
    """How well replicas travelled between the prior and the posterior.

    Parameters
    ----------
    betas : tuple of K float
        Inverse temperatures, ascending.
    swap_rates : tuple of K - 1 float
        Mean probability of a swap across each gap.
    round_trips : int
        Number of journeys of replicas from one end to the other and back.
    rounds : int
        Number of rounds counted.
    """

    betas: tuple[float, ...]
    swap_rates: tuple[float, ...]
    round_trips: int
    rounds: int

    @property
    def barrier(self) -> float:
        """Sum of the rejection rates (Syed)."""
        return float(sum(1 - rate for rate in self.swap_rates))


def best_rungs(barrier: float) -> int:
    """Number of rungs with the most round trips for the same work, about 2 barrier + 1 (Syed).

    Parameters
    ----------
    barrier : float
        Finite.

    Returns
    -------
    int
        At least 2.

    Examples
    --------
    >>> best_rungs(1.9)
    5
    """
    return max(2, round(2 * barrier) + 1)


@dataclass(frozen=True)
class SwapTable:
    """Counts of swaps and journeys at fixed inverse temperatures.

    All fields are plain numbers, so ``dataclasses.asdict`` of a table can be stored in a
    checkpoint, and ``SwapTable(**values)`` restores it.

    Parameters
    ----------
    betas : sequence of K float
    rounds : int
        Number of rounds so far.
    swaps : sequence of K - 1 float
        Sum of swap probabilities for each gap.
    last_end : sequence of K int
        End that each replica visited last: -1 the hottest, 1 the coldest, 0 none yet.
    crossings : sequence of K int
        How often each replica went from one end to the other.
    """

    betas: Sequence[float]
    rounds: int
    swaps: Sequence[float]
    last_end: Sequence[int]
    crossings: Sequence[int]

    @classmethod
    def empty(cls, betas: Sequence[float]) -> SwapTable:
        """A table with all counts zero.

        Parameters
        ----------
        betas : sequence of K float

        Returns
        -------
        SwapTable
        """
        n = len(betas)
        return cls(tuple(betas), 0, (0.0,) * (n - 1), (0,) * n, (0,) * n)

    def recorded(self, acceptance: Sequence[float], replicas: Sequence[int]) -> SwapTable:
        """The table after one more round.

        Parameters
        ----------
        acceptance : sequence of K - 1 float
            Probability of a swap across each gap.
        replicas : sequence of K int
            The replica on each rung after the round.

        Returns
        -------
        SwapTable
        """
        last_end, crossings = list(self.last_end), list(self.crossings)
        if len(replicas) > 1:
            for replica, end in ((replicas[0], -1), (replicas[-1], 1)):
                crossings[replica] += last_end[replica] == -end
                last_end[replica] = end
        return SwapTable(
            betas=self.betas,
            rounds=self.rounds + 1,
            swaps=tuple(a + b for a, b in zip(self.swaps, acceptance, strict=True)),
            last_end=tuple(last_end),
            crossings=tuple(crossings),
        )

    def summary(self) -> LadderSummary:
        """Summarise the counts; rates are NaN before the first round.

        Returns
        -------
        LadderSummary
        """
        return LadderSummary(
            betas=tuple(self.betas),
            swap_rates=tuple(s / self.rounds if self.rounds else float("nan") for s in self.swaps),
            round_trips=sum(count // 2 for count in self.crossings),
            rounds=self.rounds,
        )
