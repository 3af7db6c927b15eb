"""The convergence verdict on a run: good, too few draws, or chains that disagree."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from imapper_prob.samplers.diagnostics import LayoutProbabilities, ess, rhat
from imapper_prob.samplers.ladder import LadderSummary, best_rungs

__all__ = ["Measures", "Verdict", "judge", "measure", "rounded_up", "worse"]

# Limits of R-hat and of effective draws by Vehtari et al. 2021 (100 for each of four chains).
_RHAT_LIMIT = 1.01
_DRAWS_GOAL = 400.0
# Layouts with a probability within these limits are undecided. Others are as good as excluded or
# certain: their error is small whatever the effective number of draws.
_UNDECIDED = (0.05, 0.95)
# The effective number of draws is itself uncertain. With this factor, four in five runs that are
# extended by the recommended number of draws reach the goal.
_MARGIN = 1.5
# Two chains disagree if each is consistent with itself (its halves share more than half of their
# mass) and both share less than half as much with each other. Chains that are merely too short are
# inconsistent with themselves as well.
_COMMON_SHARE = 0.5
# Least draws per chain for that: both halves of a chain of one draw are this draw.
_COMPARABLE = 2


class Verdict(NamedTuple):
    """The verdict on a run.

    Parameters
    ----------
    good : bool
        Whether the run can be used as it is.
    more_draws : int
        About how many more draws each chain needs; 0 if the run is good, or if chains disagree,
        where more draws may not help.
    disagreement : (int, int), optional
        Two layouts, each the most frequent one of a chain, if the two chains disagree.
    text : str
        Text for a person: whether probabilities can be used and how far they are off (the largest
        standard error of any layout), then one sentence with the reason, then numbers.
    """

    good: bool
    more_draws: int
    disagreement: tuple[int, int] | None
    text: str


class Measures(NamedTuple):
    """The convergence measures that a verdict is based on.

    Parameters
    ----------
    error : float
        Largest standard error of any layout; NaN if unknown. If all draws have one layout, that of
        the least effective number of draws that agree.
    rhat : float
        Largest R-hat of the functionals; infinite if chains are too short, or if each stays at a
        value of its own; 1 if there are no functionals.
    rhat_of : str
        Name of the functional with that R-hat.
    effective_draws : float
        Least effective number of draws, of functionals and of layouts that are neither excluded nor
        certain; infinite if there are none.
    effective_draws_of : str
        Name of the functional or layout with that number.
    effective_layouts : float
        Least effective number of draws of these layouts alone.
    comparable : bool
        Whether chains are long enough for R-hat.
    """

    error: float
    rhat: float
    rhat_of: str
    effective_draws: float
    effective_draws_of: str
    effective_layouts: float
    comparable: bool


def measure(layouts: LayoutProbabilities, functionals: Mapping[str, ArrayLike]) -> Measures:
    """Compute the convergence measures of a run.

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
        if _UNDECIDED[0] <= share <= _UNDECIDED[1]
    ]
    effective = [(_known(ess(draws), 0.0), name) for name, draws in functionals.items()]
    found = {name: float(np.asarray(rhat(draws))) for name, draws in functionals.items()}
    rhats = [(_known(value, math.inf), name) for name, value in found.items()]
    worst, worst_of = max(rhats, default=(1.0, ""))
    fewest, fewest_of = min(effective + of_layouts, default=(math.inf, ""))
    error = float(np.max(layouts.standard_error))
    if error == 0:
        error = 1 / (fewest + 2)  # of draws that agree, see `unanimous_error`
    return Measures(
        error=error,
        rhat=worst,
        rhat_of=worst_of,
        effective_draws=fewest,
        effective_draws_of=fewest_of,
        effective_layouts=min(of_layouts, default=(math.inf, ""))[0],
        comparable=not any(map(math.isnan, found.values())),
    )


def worse(one: Measures, other: Measures) -> Measures:
    """The worse of two convergence measures, one by one.

    Parameters
    ----------
    one, other : Measures

    Returns
    -------
    Measures
    """
    by_rhat = max(one, other, key=lambda found: found.rhat)
    by_draws = min(one, other, key=lambda found: found.effective_draws)
    return Measures(
        error=float(np.maximum(one.error, other.error)),
        rhat=by_rhat.rhat,
        rhat_of=by_rhat.rhat_of,
        effective_draws=by_draws.effective_draws,
        effective_draws_of=by_draws.effective_draws_of,
        effective_layouts=min(one.effective_layouts, other.effective_layouts),
        comparable=one.comparable and other.comparable,
    )


def judge(
    layouts: LayoutProbabilities,
    functionals: Mapping[str, ArrayLike],
    *,
    ladders: Sequence[LadderSummary] = (),
    before: Measures | None = None,
) -> Verdict:
    """Judge convergence by layouts and by functionals that every draw has.

    Parameters
    ----------
    layouts : LayoutProbabilities
    functionals : mapping of str to (C, N) float
        Scalar functions of each draw, such as the log posterior and the number of objects.
    ladders : sequence of LadderSummary
        Summaries of tempered chains; they add a sentence and do not change the verdict.
    before : Measures, optional
        Measures of the draws before they were moved by ensembles. Those hide the correlation of
        draws, but not the error that these share, so the worse of both counts.

    Returns
    -------
    Verdict

    Warns
    -----
    ShortChainWarning
        Chains are too short for R-hat; the verdict then asks for more draws.
    """
    found = measure(layouts, functionals)
    if before is not None:
        found = worse(found, before)
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
    # Effective draws grow in proportion to draws. If only R-hat is too large, twice as many may do.
    factor = max(2.0, _MARGIN * _DRAWS_GOAL / max(fewest, 1.0))
    more = _two_digits(layouts.n_draws * (factor - 1))
    text = f"Not converged: probabilities may be off by {off:.2f}."
    if math.isnan(off):
        text = "Not converged: there is one draw a chain, from which no error can be given."
    if worst <= _RHAT_LIMIT:
        why = f"Chains agree, but {found.effective_draws_of} changes too seldom to be known well."
    elif not found.comparable:
        why = "Chains are too short to be compared."
    else:
        why = f"Chains do not agree yet on {found.rhat_of}."
    why = f"{why} About {more} more draws a chain are needed."
    return Verdict(False, more, None, f"{text} {why} {numbers}")


def _numbers(found: Measures) -> str:
    """A sentence with both criteria, each with its limit."""
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
    """Round an error up to hundredths.

    Parameters
    ----------
    error : float

    Returns
    -------
    float
        NaN if the error is unknown.
    """
    return error if math.isnan(error) else math.ceil(100 * error) / 100


def _known(value: ArrayLike, worst: float) -> float:
    """The value, or ``worst`` if it is NaN because chains were too short."""
    number = float(np.asarray(value))
    return worst if math.isnan(number) else number


def _disagreement(layouts: LayoutProbabilities) -> tuple[int, int] | None:
    """The most frequent layouts of the two chains that disagree most; None if none disagree."""
    if layouts.n_draws < _COMPARABLE:
        return None
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
    """A sentence about swaps, with a leading blank; empty without ladders."""
    # A chain that was stopped before its temperatures were fixed has counted no swap.
    ladders = [ladder for ladder in ladders if math.isfinite(ladder.barrier)]
    rates = [rate for ladder in ladders for rate in ladder.swap_rates]
    if not rates:
        return ""
    trips = sum(ladder.round_trips for ladder in ladders)
    counted = f"{trips} round trips with swap rates from {min(rates):.2f} to {max(rates):.2f}"
    if trips >= len(ladders):
        return f" Tempering made {counted}."
    now = max(len(ladder.betas) for ladder in ladders)
    best = max(best_rungs(ladder.barrier) for ladder in ladders)
    advice = f"{best} temperatures in place of {now}" if best > now else "more rounds"
    return f" Tempering made only {counted}: try {advice}."


def _two_digits(value: float) -> int:
    """Round up to two digits, so that an estimate does not look precise."""
    magnitude = math.pow(10, max(0, math.floor(math.log10(max(value, 1.0))) - 1))
    return math.ceil(value / magnitude) * int(magnitude)
