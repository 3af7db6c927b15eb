"""Inverse temperatures from the prior to the posterior: where they stand, and who climbs them.

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

__all__ = ["LadderSummary", "SwapTable", "power_ladder", "respaced"]

# The distributions change fastest near the prior. On the scale beta^0.3, on which Xie et al.
# recommend even steps, they change about evenly.
_SCALE = 0.3


def power_ladder(n_rungs: int, *, hottest: float = 0.0) -> tuple[float, ...]:
    """Inverse temperatures to start from, even on the scale beta^0.3.

    Parameters
    ----------
    n_rungs : int
        At least 2.
    hottest : float
        The first one, in [0, 1); 0 is the prior itself.

    Returns
    -------
    tuple of float
        Ascending from ``hottest`` to 1.
    """
    if n_rungs < 2 or not 0 <= hottest < 1:
        raise ValueError(f"a ladder of {n_rungs} rungs cannot go from {hottest} to 1")
    betas = np.linspace(hottest**_SCALE, 1, n_rungs) ** (1 / _SCALE)
    return (hottest, *betas[1:-1].tolist(), 1.0)


def respaced(
    betas: Sequence[float], acceptance: Sequence[float], *, gain: float
) -> tuple[float, ...]:
    """Widen the gaps across which swaps succeed more often than on average, narrow the others.

    Gaps are taken on the scale beta^0.3 and multiplied by exp(gain (rate - mean rate)); both
    ends stay. Repeated with falling gains this is a stochastic approximation whose only
    fixed point has equal rates.

    Parameters
    ----------
    betas : sequence of K float
        Ascending.
    acceptance : sequence of K - 1 float
        Probability of a swap across each gap.
    gain : float
        Positive.
    """
    if len(betas) <= 2:
        return tuple(betas)
    places = np.asarray(betas) ** _SCALE
    rates = np.asarray(acceptance)
    gaps = np.diff(places) * np.exp(gain * (rates - rates.mean()))
    gaps *= (places[-1] - places[0]) / gaps.sum()
    inner = (places[0] + np.cumsum(gaps[:-1])) ** (1 / _SCALE)
    return (betas[0], *inner.tolist(), betas[-1])


class LadderSummary(NamedTuple):
    """How well replicas travelled between the prior's end and the posterior's.

    Parameters
    ----------
    betas : tuple of K float
        Inverse temperatures, ascending.
    swap_rates : tuple of K - 1 float
        Mean probability of a swap across each gap.
    round_trips : int
        Journeys of replicas from one end to the other and back.
    rounds : int
        Rounds of swaps that were counted.
    """

    betas: tuple[float, ...]
    swap_rates: tuple[float, ...]
    round_trips: int
    rounds: int

    @property
    def barrier(self) -> float:
        """Sum of the rejection rates; 2 barrier + 1 rungs are about the best number (Syed)."""
        return float(sum(1 - rate for rate in self.swap_rates))


@dataclass(frozen=True)
class SwapTable:
    """Counts swaps and journeys while the inverse temperatures of a ladder stay.

    All fields are plain numbers, so that ``dataclasses.asdict`` can go into a checkpoint and
    ``SwapTable(**values)`` comes back.

    Parameters
    ----------
    betas : sequence of K float
    rounds : int
        Rounds so far.
    swaps : sequence of K - 1 float
        Sums of swap probabilities, by gap.
    last_end : sequence of K int
        By replica, the end where it was last: -1 the hottest, 1 the coldest, 0 none yet.
    crossings : sequence of K int
        By replica, how often it went from one end to the other.
    """

    betas: Sequence[float]
    rounds: int
    swaps: Sequence[float]
    last_end: Sequence[int]
    crossings: Sequence[int]

    @classmethod
    def empty(cls, betas: Sequence[float]) -> SwapTable:
        """Nothing counted yet."""
        n = len(betas)
        return cls(tuple(betas), 0, (0.0,) * (n - 1), (0,) * n, (0,) * n)

    def recorded(self, acceptance: Sequence[float], replicas: Sequence[int]) -> SwapTable:
        """The table with one round more.

        Parameters
        ----------
        acceptance : sequence of K - 1 float
            Probability of a swap across each gap.
        replicas : sequence of K int
            The replica on each rung afterwards.
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
        """What to tell a person; rates are NaN before the first round."""
        return LadderSummary(
            betas=tuple(self.betas),
            swap_rates=tuple(s / self.rounds if self.rounds else float("nan") for s in self.swaps),
            round_trips=sum(count // 2 for count in self.crossings),
            rounds=self.rounds,
        )
