"""A log-posterior with no more scenelets than are asked for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.problem import Problem

__all__ = ["of_scenelets"]

Ints = NDArray[np.int64]


def of_scenelets(problem: Problem, chosen: Sequence[int] | Ints) -> Problem:
    """The same problem with a library of exactly ``chosen``, in their order.

    A scenelet may be chosen twice. What it costs to have one is as before: the prior odds of
    the others are left out, not shared again.
    """
    chosen = np.asarray(chosen, np.int64)
    frames = _ranges(problem.joint_first, chosen)
    boxes = _ranges(problem.box_first, chosen)
    return problem._replace(
        joints=problem.joints[frames],
        joint_facing=problem.joint_facing[frames],
        joint_first=_starts(problem.lengths[chosen]),
        boxes=problem.boxes[boxes],
        box_first=_starts(np.diff(problem.box_first)[chosen]),
        box_object=problem.box_object[boxes],
        box_label=problem.box_label[boxes],
        box_yaw=problem.box_yaw[boxes],
        lowered=problem.lowered[chosen],
        log_rate=problem.log_rate[chosen],
    )


def _ranges(first: Ints, chosen: Ints) -> Ints:
    """Rows of the chosen entries of a packed array."""
    rows = [np.arange(first[i], first[i + 1]) for i in chosen]
    return np.concatenate([np.empty(0, np.int64), *rows])


def _starts(counts: Ints) -> Ints:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
