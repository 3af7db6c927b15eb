"""How well the library knows what is seen: of every frame the best fit of any scenelet.

What a fit costs (:mod:`imapper_prob.staged.fit`) depends on how large a pixel is and on which
joints a detector is sure of. Less what the right motion would cost on average with the same joints
at the same distance it is a pure number: about 0 where some scenelet is right.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.limits import NEAREST
from imapper_prob.models.problem import Problem
from imapper_prob.staged.fit import Fits

__all__ = ["best_fits"]

Array = NDArray[np.float64]


def best_fits(problem: Problem, fits: Fits) -> Array:
    """(T,) by how much the best scenelet over a frame fits worse than the right one would.

    Nats per confident joint, on average over the scenelet's frames. NaN in frames without a
    detection, where no scenelet was fitted, and with the published energy.

    Parameters
    ----------
    problem : Problem
        Of one actor.
    fits : Fits
        Of the same.
    """
    if problem.of_paper:  # whose squared residuals say nothing of what the right motion costs
        return np.full(problem.n_frames, np.nan)
    expected, joints = _right_costs(problem)
    best = np.full(problem.n_frames, np.inf)
    lengths = np.unique(problem.lengths)
    own = [problem.lengths == length for length in lengths]
    for centre, cost in zip(fits.centres.tolist(), fits.cost, strict=True):
        for length, these in zip(lengths.tolist(), own, strict=True):
            start = centre - length // 2
            least = cost[these].min()
            if not np.isfinite(least):
                continue
            frames = slice(start, start + length)
            excess = least - expected[frames].sum() / max(joints[frames].sum(), 1.0)
            best[frames] = np.minimum(best[frames], excess)
    judged = problem.used.any(1) & np.isfinite(best)
    return np.where(judged, best, np.nan)


def _right_costs(problem: Problem) -> tuple[Array, Array]:
    """(T,) what the right motion costs in a frame, summed over joints, and how many these are.

    Of a bivariate Student-t error of scale s and nu degrees of freedom, (nu / 2 + 1) log(1 + r^2 /
    (nu s^2)) is 1 + 2 / nu on average.
    """
    weight = problem.used * problem.confidence_density.argmax(-1)
    focal = problem.fx * np.exp(problem.camera_mean[2])
    depth = np.exp(problem.path_centre[:, 1] + problem.camera_mean[2] + problem.camera_mean[3])
    loose = focal * problem.pose_tolerance / np.maximum(depth, NEAREST)
    variance = problem.error_scale[..., 1] ** 2 + loose[:, None] ** 2
    cost = np.log(variance) + 1.0 + 2.0 / problem.error_dof[..., 1]
    return (weight * cost).sum(1), weight.sum(1).astype(np.float64)
