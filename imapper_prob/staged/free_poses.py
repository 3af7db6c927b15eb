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
from imapper_prob.models.skeleton import PELV, THRX
from imapper_prob.staged.fit import Fits

__all__ = ["free_pose_cost"]

_STANDING = 0.75
"""Metres above the floor of the middle of the hips of somebody who stands, at least: .85 with the
legs straight, and bent as far as one walks with."""
_LEANING = np.radians(30.0)
"""How far from the vertical the trunk of somebody is who does not bend down."""
_TRIED = 3
"""Fits a window that are evaluated exactly; the fit's own cost ranks them well."""


def _upright(problem: Problem) -> NDArray[np.bool_]:
    """(L,) scenelets whose person stands or walks upright for most of it.

    Who kneels, squats, bends down or sits on the floor does so in a scenelet of that, whose prior
    odds it costs; a frame without any is one of somebody who does nothing of the kind.
    """
    trunk = problem.joints[:, THRX] - problem.joints[:, PELV]
    upright = trunk[:, 2] > np.cos(_LEANING) * np.linalg.norm(trunk, axis=-1)
    upright &= problem.joints[:, PELV, 2] > _STANDING
    counts = np.add.reduceat(upright, problem.joint_first[:-1])
    result: NDArray[np.bool_] = counts > problem.lengths / 2
    return result


def free_pose_cost(problem: Problem, fits: Fits) -> NDArray[np.float64]:
    """(T,) nats by which each frame's own pose explains it better than a motion nearby.

    Of the scenelets without objects in which somebody is upright the one that explains its window
    best stands for the frames nearest to the window's centre. Never negative; 0 in frames that
    none reaches.

    Raises
    ------
    InputError
        If nobody is upright in the scenelets without objects.
    """
    bare = np.flatnonzero((np.diff(problem.box_first) == 0) & _upright(problem))
    if len(bare) == 0:
        raise InputError(
            "the library has no scenelet without objects in which somebody stands or walks, to "
            "compare with"
        )
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
