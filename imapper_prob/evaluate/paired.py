"""Is one method better than another? Differences object by object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.evaluate.score import Score

__all__ = ["Difference", "paired_difference"]

Array = NDArray[np.float64]

_RESAMPLES: Final = 4000
_INTERVAL: Final = (0.05, 0.95)
"""Quantiles of the bootstrap that bound the interval of 90 %."""


@dataclass(frozen=True)
class Difference:
    """One method less another, over the same true objects.

    Parameters
    ----------
    name, other : str
        Of the methods.
    mean : float
        Of the differences of losses, cm; negative where the first is nearer.
    low, high : float
        Bootstrap interval of 90 % over objects.
    objects : int
        True objects.
    """

    name: str
    other: str
    mean: float
    low: float
    high: float
    objects: int


def paired_difference(
    ours: Sequence[Score], theirs: Sequence[Score], rng: np.random.Generator
) -> Difference:
    """The mean difference of losses between two methods on the same clips.

    Losses are those of :attr:`imapper_prob.evaluate.objects.ObjectScore.losses`.

    Whole objects are drawn with replacement, as many as there are; that two objects of one
    clip share its camera is left out, so intervals are rather too short.
    """
    both = {s.clip: s for s in theirs}
    pairs = [(s, both[s.clip]) for s in ours if s.clip in both]
    gaps = [a.objects.losses - b.objects.losses for a, b in pairs]
    gap = 100 * np.concatenate([np.empty(0), *gaps])
    if not len(gap):
        nothing = float("nan")
        return Difference(ours[0].name, theirs[0].name, nothing, nothing, nothing, 0)
    means = rng.choice(gap, (_RESAMPLES, len(gap))).mean(1)
    low, high = np.quantile(means, _INTERVAL)
    return Difference(
        ours[0].name, theirs[0].name, float(gap.mean()), float(low), float(high), len(gap)
    )
