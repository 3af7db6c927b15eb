"""The verdict on a run: good, in need of more draws, or of chains that disagree."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from imapper_prob.samplers.diagnostics import LayoutProbabilities, ess, rhat
from imapper_prob.samplers.tempering import LadderSummary

__all__ = ["Measures", "Verdict", "judge", "measure", "rounded_up"]

# Vehtari et al. 2021 recommend both numbers, the second as 100 for each of four chains.
_RHAT_LIMIT = 1.01
_DRAWS_GOAL = 400.0
# Layouts with a share outside are as good as excluded or certain: their error is small
# whatever the number of effective draws.
_OPEN = (0.05, 0.95)
# The number of effective draws is itself uncertain, before as after: with this factor four
# in five of those who run as many more as it says do not fall short again.
_MARGIN = 1.5
# Two chains disagree when each agrees with itself, its halves having more than half of their
# mass in common, and they have less than half as much with each other. Chains that are merely
# short differ from themselves as well.
_COMMON_SHARE = 0.5


class Verdict(NamedTuple):
    """What to think of a run.

    Parameters
    ----------
    good : bool
        The run can be used as it is.
    more_draws : int
        About how many more draws each chain needs; 0 where it is good, or where chains
        disagree and more of the same may not help.
    disagreement : (int, int), optional
        Two layouts, each the favourite of a chain that hardly knows the other's.
    text : str
        For a person: first whether probabilities can be used and how far they are off, one
        standard error of the layout that is known worst, then one sentence why, then numbers.
    """

    good: bool
    more_draws: int
    disagreement: tuple[int, int] | None
    text: str


class Measures(NamedTuple):
    """What a verdict goes by.

    Parameters
    ----------
    error : float
        Standard error of the layout that is known worst; NaN where it is not known.
    rhat : float
        The largest R-hat of what all draws have; infinite where chains are too short, 1 where
        there is nothing to look at.
    rhat_of : str
        What has it.
    effective_draws : float
        The fewest of what all draws have and of the layouts that are neither excluded nor
        certain; infinite where there is nothing to look at.
    effective_draws_of : str
        What has them.
    effective_layouts : float
        The fewest of these layouts alone.
    """

    error: float
    rhat: float
    rhat_of: str
    effective_draws: float
    effective_draws_of: str
    effective_layouts: float


def measure(layouts: LayoutProbabilities, functionals: Mapping[str, ArrayLike]) -> Measures:
    """How far chains agree and how much they know.

    Parameters
    ----------
    layouts, functionals
        See `judge`.

    Returns
    -------
    Measures

    Warns
    -----
    ShortChainWarning
        Chains are too short for R-hat.
    """
    of_layouts = [
        (_known(draws, 0.0), f"layout {layout}")
        for layout, share, draws in zip(
            layouts.layouts, layouts.probability, layouts.effective_draws, strict=True
        )
        if _OPEN[0] <= share <= _OPEN[1]
    ]
    effective = [(_known(ess(draws), 0.0), name) for name, draws in functionals.items()]
    rhats = [(_known(rhat(draws), math.inf), name) for name, draws in functionals.items()]
    worst, worst_of = max(rhats, default=(1.0, ""))
    fewest, fewest_of = min(effective + of_layouts, default=(math.inf, ""))
    return Measures(
        error=float(np.max(layouts.standard_error)),
        rhat=worst,
        rhat_of=worst_of,
        effective_draws=fewest,
        effective_draws_of=fewest_of,
        effective_layouts=min(of_layouts, default=(math.inf, ""))[0],
    )


def judge(
    layouts: LayoutProbabilities,
    functionals: Mapping[str, ArrayLike],
    *,
    ladders: Sequence[LadderSummary] = (),
) -> Verdict:
    """Judge chains by their layouts and by what all draws have.

    Parameters
    ----------
    layouts : LayoutProbabilities
    functionals : mapping of str to (C, N) float
        Such as the log posterior and the number of objects.
    ladders : sequence of LadderSummary
        Of chains that were tempered; they add a sentence and change no verdict.

    Returns
    -------
    Verdict

    Warns
    -----
    ShortChainWarning
        Chains are too short for R-hat; the verdict then asks for more.
    """
    found = measure(layouts, functionals)
    numbers = f"{_numbers(found)}{_tempering(ladders)}"
    disagreement = _disagreement(layouts)
    if disagreement is not None:
        first, second = disagreement
        text = (
            "Not converged: probabilities cannot be trusted, nor can their order. Chains disagree "
            f"on layouts {first} and {second}: each stays with its own."
        )
        return Verdict(False, 0, disagreement, f"{text} {numbers}")
    off = rounded_up(found.error)
    fewest, worst = found.effective_draws, found.rhat
    if fewest >= _DRAWS_GOAL and worst <= _RHAT_LIMIT:
        text = (
            f"Converged: probabilities are good to ± {off:.2f}. Chains agree, and each has seen "
            "enough."
        )
        return Verdict(True, 0, None, f"{text} {numbers}")
    # Effective draws grow with the draws; where R-hat alone is too large, twice as many may do.
    factor = max(2.0, _MARGIN * _DRAWS_GOAL / max(fewest, 1.0))
    more = _two_digits(layouts.n_draws * (factor - 1))
    text = f"Not converged: probabilities may be off by {off:.2f}."
    if math.isnan(off):
        text = "Not converged: too few draws to say how far probabilities are off."
    if worst <= _RHAT_LIMIT:
        why = f"Chains agree, but {found.effective_draws_of} changes too seldom to be known well."
    elif math.isinf(worst):
        why = "Chains are too short to be compared."
    else:
        why = f"Chains do not agree yet on {found.rhat_of}."
    why = f"{why} About {more} more draws a chain are needed."
    return Verdict(False, more, None, f"{text} {why} {numbers}")


def _numbers(found: Measures) -> str:
    """Both criteria, each beside its limit; a sentence."""
    parts = []
    if found.effective_draws_of:
        parts.append(
            f"{found.effective_draws:.0f} effective draws of {found.effective_draws_of} "
            f"({_DRAWS_GOAL:.0f} wanted)"
        )
    if found.rhat_of:
        parts.append(f"R-hat {found.rhat:.3f} of {found.rhat_of} ({_RHAT_LIMIT} wanted)")
    return f"At worst: {', '.join(parts)}." if parts else "There is one certain layout."


def rounded_up(error: float) -> float:
    """An error rounded up to hundredths.

    Parameters
    ----------
    error : float

    Returns
    -------
    float
        NaN where it is not known.
    """
    return error if math.isnan(error) else math.ceil(100 * error) / 100


def _known(value: ArrayLike, worst: float) -> float:
    """The value, or the worst one where chains were too short to tell."""
    number = float(np.asarray(value))
    return worst if math.isnan(number) else number


def _disagreement(layouts: LayoutProbabilities) -> tuple[int, int] | None:
    """The favourites of the two chains with the least in common, where that is too little."""
    shares = layouts.by_chain
    favourites = shares.argmax(1)
    common = np.minimum(shares[:, None], shares[None, :]).sum(-1)
    own = layouts.by_half.min(1).sum(-1)
    known = np.minimum(own[:, None], own[None, :])
    apart = (common < _COMMON_SHARE * known) & (known > _COMMON_SHARE)
    apart &= favourites[:, None] != favourites[None, :]
    if not apart.any():
        return None
    first, second = np.unravel_index(np.where(apart, common, np.inf).argmin(), common.shape)
    pair = sorted((int(favourites[first]), int(favourites[second])))
    return int(layouts.layouts[pair[0]]), int(layouts.layouts[pair[1]])


def _tempering(ladders: Sequence[LadderSummary]) -> str:
    """A sentence on what tempering did, with a blank before it; none without ladders."""
    # A chain that was stopped before its temperatures stayed has counted no swap.
    ladders = [ladder for ladder in ladders if math.isfinite(ladder.barrier)]
    rates = [rate for ladder in ladders for rate in ladder.swap_rates]
    if not rates:
        return ""
    trips = sum(ladder.round_trips for ladder in ladders)
    counted = f"{trips} round trips with swap rates from {min(rates):.2f} to {max(rates):.2f}"
    if trips >= len(ladders):
        return f" Tempering made {counted}."
    now = max(len(ladder.betas) for ladder in ladders)
    best = max(math.ceil(2 * ladder.barrier) + 1 for ladder in ladders)
    advice = f"{best} temperatures in place of {now}" if best > now else "more rounds"
    return f" Tempering made only {counted}: try {advice}."


def _two_digits(value: float) -> int:
    """Rounded up: a guess should not look like a measurement."""
    magnitude = math.pow(10, max(0, math.floor(math.log10(max(value, 1.0))) - 1))
    return math.ceil(value / magnitude) * int(magnitude)
