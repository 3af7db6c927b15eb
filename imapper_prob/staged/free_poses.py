"""What the freedom of a frame without scenelet is worth.

The pose of a free frame comes from a lifter that has already seen the frame, so that its
small residual is no evidence against a scenelet. A free frame is therefore judged as if the
best motion without furniture (somebody walking or standing about) had to explain it: an
interaction has to beat that, not the lifter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.errors import InputError
from imapper_prob.models.posterior import empty_state, frame_log_likelihood
from imapper_prob.models.problem import Problem
from imapper_prob.staged.fit import Fits

__all__ = ["free_pose_cost"]

_TRIED = 3
"""Fits a window that are evaluated exactly; the fit's own cost ranks them well."""


def free_pose_cost(problem: Problem, fits: Fits) -> NDArray[np.float64]:
    """(T,) nats by which each frame's own pose explains it better than a motion nearby.

    Of the scenelets without objects the one that explains its window best stands for the
    frames nearest to the window's centre. Never negative; 0 in frames that none reaches.

    Raises
    ------
    InputError
        If every scenelet of the library has objects.
    """
    bare = np.flatnonzero(np.diff(problem.box_first) == 0)
    if len(bare) == 0:
        raise InputError("the library has no scenelet without objects to compare with")
    empty = empty_state(problem)
    own = frame_log_likelihood(problem, empty)
    cost = np.zeros(problem.n_frames)
    fitted = np.flatnonzero(np.isfinite(fits.cost[:, bare]).any(1))
    if len(fitted) == 0:
        return cost
    # At the ends of a clip the nearest window may be one that no scenelet fits into; a frame
    # there is as free as any other, and its judge the first or last scenelet that reaches it.
    distance = np.abs(np.arange(problem.n_frames)[:, None] - fits.centres[fitted])
    nearest = fitted[distance.argmin(1)]
    for w in fitted.tolist():
        order = bare[np.argsort(fits.cost[w, bare], kind="stable")[:_TRIED]]
        best, best_total = own, -np.inf
        for scenelet in order[np.isfinite(fits.cost[w, order])]:
            start = int(fits.centres[w] - problem.lengths[scenelet] // 2)
            state = empty.with_item(int(scenelet), start, fits.placements[w, scenelet])
            values = frame_log_likelihood(problem, state)
            total = values[start : start + problem.lengths[scenelet]].sum()
            if total > best_total:
                best, best_total = values, total
        mine = nearest == w
        cost[mine] = np.maximum(own[mine] - best[mine], 0.0)
    return cost
