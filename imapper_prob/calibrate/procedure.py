"""From clips with truth to constants: three steps, and again with each clip left out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from imapper_prob.calibrate.constants import (
    FROM_FITS,
    FROM_PATH,
    FROM_TRUTH,
    Estimator,
    estimate,
)
from imapper_prob.calibrate.estimators import jackknife_error
from imapper_prob.calibrate.evidence import Seen, fit_library, look, place
from imapper_prob.calibrate.kept import KEPT
from imapper_prob.models.calibrated import Constant, Number
from imapper_prob.models.scene import Clip, Truth
from imapper_prob.models.scenelet import Library

__all__ = ["calibrate", "in_use", "rounded", "without"]

_DIGITS = 3
"""Significant digits that are kept: more than four scenes can tell."""


def calibrate(scenes: Iterable[tuple[Clip, Truth]], library: Library) -> dict[str, Constant]:
    """Estimate all constants from clips whose truth is known, two at least.

    The static path and the fits behind the later constants are made once, with what all
    clips say of the earlier ones; only the estimates are repeated with a clip left out.
    """
    found: dict[str, Constant] = {}
    evidence: Sequence[Seen] = [look(clip, truth) for clip, truth in scenes]
    found |= _estimated(FROM_TRUTH, evidence)
    placed = [place(seen, library, in_use(found)) for seen in evidence]
    found |= _estimated(FROM_PATH, placed)
    fitted = [fit_library(one, library, in_use(found)) for one in placed]
    return found | _estimated(FROM_FITS, fitted)


def in_use(found: Mapping[str, Constant]) -> dict[str, Number]:
    """The values that the program uses."""
    return {name: constant.value for name, constant in found.items()}


def without(found: Mapping[str, Constant], scene: int) -> dict[str, Number]:
    """The values that the program would use if it had never seen one of the scenes."""
    return {
        name: constant.value if constant.kept else constant.folds[scene]
        for name, constant in found.items()
    }


def _estimated(estimators: Sequence[Estimator], evidence: Sequence[Seen]) -> dict[str, Constant]:
    whole = estimate(estimators, evidence)
    folds = [
        estimate(estimators, [*evidence[:k], *evidence[k + 1 :]]) for k in range(len(evidence))
    ]
    found = {}
    for e in estimators:
        own = tuple(rounded(fold[e.name]) for fold in folds)
        measured = rounded(whole[e.name])
        value, kept = KEPT.get(e.name, (measured, ""))
        error = jackknife_error([fold[e.name] for fold in folds])
        found[e.name] = Constant(
            value, e.unit, e.meaning, e.source, measured, rounded(error.tolist()), own, kept
        )
    return found


def rounded(value: Number | list[float]) -> Number:
    """Numbers as they are stored."""
    if isinstance(value, (tuple, list)):
        return tuple(float(np.format_float_positional(v, _DIGITS, fractional=False)) for v in value)
    return float(np.format_float_positional(value, _DIGITS, fractional=False))
