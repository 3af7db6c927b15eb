"""Who was kept at each maximum of charness, and what spoke against everybody else.

The paper takes 200 fits a maximum, drops those that walk through furniture, then those whose
furniture hides the wrong joints, and keeps three (Monszpart et al. 2019, section 5). Here one
log-posterior judges all of it at once; this table takes its verdicts apart in that order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from imapper_prob.models.posterior import empty_state, log_posterior, terms
from imapper_prob.models.problem import Problem
from imapper_prob.staged.candidates import Candidate, assigned
from imapper_prob.staged.fit import Fits
from imapper_prob.staged.maxima import CharnessCurve

__all__ = ["Fate", "MaximumTable", "Shortlisted", "shortlist"]

_SOLID = ("motion", "collision", "ground")
"""Terms that say who stands in what."""


class Fate(StrEnum):
    """What became of a candidate: kept, or what it would have needed to be."""

    FIT = "fit"
    MOTION = "motion"
    OCCLUSION = "occlusion"
    KIND = "same furniture"
    KEPT = "kept"


@dataclass(frozen=True)
class Shortlisted:
    """A candidate at a maximum, its gain over no scenelet in three parts, all in nats.

    Parameters
    ----------
    candidate : Candidate
    fit : float
        All but the other two: detections if nothing hid anything, facing, path, prior.
    motion : float
        For people and furniture that stand in each other, at most 0.
    occlusion : float
        For what the furniture hides.
    fate : Fate
        ``KIND``: another of the same furniture is better. ``MOTION`` and ``OCCLUSION``: would
        have been kept if it were not for that part. ``FIT``: neither would have helped.
    """

    candidate: Candidate
    fit: float
    motion: float
    occlusion: float
    fate: Fate


@dataclass(frozen=True)
class MaximumTable:
    """One maximum of charness.

    Parameters
    ----------
    window : int
    fitted : int
        Scenelets fitted there and in the windows beside it.
    rows : tuple of Shortlisted
        Those with furniture that were judged, the best first.
    """

    window: int
    fitted: int
    rows: tuple[Shortlisted, ...]

    def counts(self) -> dict[str, int]:
        """How many are left after each step, from all that were fitted to those kept."""
        left = {"fitted": self.fitted, "judged": len(self.rows)}
        remaining = len(self.rows)
        for fate in (Fate.FIT, Fate.MOTION, Fate.OCCLUSION, Fate.KIND):
            remaining -= sum(row.fate is fate for row in self.rows)
            left[f"after {fate}"] = remaining
        return left


def shortlist(
    problem: Problem,
    fits: Fits,
    candidates: Sequence[Candidate],
    curve: CharnessCurve,
    kept: Sequence[Candidate],
) -> tuple[MaximumTable, ...]:
    """The table of every maximum, in order of time.

    Parameters
    ----------
    problem, fits, candidates, curve
        As of the stages before.
    kept : sequence of Candidate
        Those that went on to be combined.
    """
    empty = empty_state(problem)
    bare = _without_furniture(problem)
    nothing = log_posterior(problem, empty)
    chosen = {(c.window, c.scenelet) for c in kept}
    tables = []
    for window in sorted(curve.maxima.tolist()):
        near = slice(max(0, window - 1), window + 2)
        here = [c for c in candidates if abs(c.window - window) <= 1 and c.kind]
        here.sort(key=lambda c: -c.gain)
        own = [c for c in here if (c.window, c.scenelet) in chosen]
        rows = []
        for c in here:
            state = assigned(empty, [c])
            fit = log_posterior(bare, state) - nothing
            values = terms(problem, state)
            motion = sum(values.get(name, 0.0) for name in _SOLID)
            occlusion = c.gain - fit - motion
            fate = Fate.KEPT if any(c is k for k in own) else _fate(c, own, motion, occlusion)
            rows.append(Shortlisted(c, fit, motion, occlusion, fate))
        fitted = int(np.isfinite(fits.cost[near]).sum())
        tables.append(MaximumTable(window, fitted, tuple(rows)))
    return tuple(tables)


def _fate(candidate: Candidate, kept: Sequence[Candidate], motion: float, occlusion: float) -> Fate:
    """What spoke against a candidate that was not kept."""
    if any(candidate.kind == k.kind for k in kept):
        return Fate.KIND
    missing = min(k.gain for k in kept) - candidate.gain
    if -motion >= missing:
        return Fate.MOTION
    return Fate.OCCLUSION if -occlusion >= missing else Fate.FIT


def _without_furniture(problem: Problem) -> Problem:
    """The same scenelets with nothing around them."""
    return problem._replace(
        boxes=problem.boxes[:0],
        box_first=np.zeros_like(problem.box_first),
        box_object=problem.box_object[:0],
        box_label=problem.box_label[:0],
        box_yaw=problem.box_yaw[:0],
    )
