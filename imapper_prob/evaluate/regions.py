"""Ranks of the truth among draws, and coverage of regions.

The rank of a point is the fraction of the draws that are nearer to the mean of all than it, in
Mahalanobis distance. If probabilities are correct and draws independent, ranks are uniform for
any number of draws (conformal prediction; Vovk, Gammerman and Shafer 2005, section 2.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import binom

from imapper_prob.evaluate.claims import Claim, Draws, claimed_pairs
from imapper_prob.evaluate.truth import TruthInView
from imapper_prob.models.skeleton import PELV, SCORED

__all__ = [
    "Coverage", "at_true_size", "coverage", "distance_ranks", "draws_inside", "elliptic_rank",
    "joint_ranks", "object_ranks",
]  # fmt: skip

Array = NDArray[np.float64]
_REGIONS: Final = (0.5, 0.9)
"""Probabilities of the regions whose coverage is reported."""
_EXPECTED: Final = (0.05, 0.95)
"""Quantiles of the expected share, a range of 90 %."""
_PAIRINGS: Final = 4000
"""Combinations of draws of independent clips, for an error of .003 in the quantiles' levels."""
_PAIRING_SEED: Final = 20190708
"""Fixed, so that the same results have the same bands; any number would do."""
_FEWEST: Final = 20
"""Least number of draws of an object for which an ellipse is fitted."""
_NUGGET: Final = 1e-6
"""Square metres added to variances, one square millimetre, for draws at a single point."""


@dataclass(frozen=True)
class Coverage:
    """Observed coverage of regions of a stated probability.

    Parameters
    ----------
    region : float
        Stated probability.
    share : float
        Fraction of the truths inside the region; NaN if there are none.
    low, high : float
        Range that contains ``share`` with probability .9 if probabilities are correct; NaN if there
        are no truths.
    count : int
        Number of truths.
    """

    region: float
    share: float
    low: float
    high: float
    count: int


def elliptic_rank(draws: ArrayLike, point: ArrayLike) -> float:
    """Rank of a point among draws, by Mahalanobis distance with the covariance of all N + 1.

    The covariance includes the point. Without it the ellipse would be too small for the point: with
    100 draws in three dimensions, coverage of a region of .9 would be .03 too low.

    Parameters
    ----------
    draws : (N, d) float
    point : (d,) float

    Returns
    -------
    float
        In [0, 1].
    """
    everything = np.concatenate([np.asarray(draws, float), np.asarray(point, float)[None]])
    distances = _squared_distances(everything)
    # The middle of the point's step among N + 1.
    return float(((distances[:-1] < distances[-1]).sum() + 0.5) / len(distances))


def _squared_distances(points: Array) -> Array:
    """(N,) squared Mahalanobis distances of (N, d) points from their mean."""
    off = points - points.mean(0)
    covariance = np.cov(points.T) + _NUGGET * np.eye(off.shape[1])
    found: Array = np.einsum("ni,ij,nj->n", off, np.linalg.inv(covariance), off)
    return found


def object_ranks(claims: Sequence[Claim], truth: TruthInView) -> Array:
    """Ranks of true centres in the clusters that they are paired with.

    Parameters
    ----------
    claims : sequence of Claim
    truth : TruthInView

    Returns
    -------
    (n,) float
        Clusters more probable than one half are paired as the objects of a scene are; a true object
        without a partner has no rank.
    """
    pairs = claimed_pairs(claims, truth, fewest=_FEWEST)
    return np.array([elliptic_rank(claim.centres, pair.truth.centre) for claim, pair in pairs])


def joint_ranks(
    draws: Draws, truth: TruthInView, *, joints: Sequence[int] = SCORED, hidden: bool = False
) -> Array:
    """Ranks of joints in annotated frames, of all or only of hidden ones.

    Parameters
    ----------
    draws : Draws
    truth : TruthInView
    joints : sequence of int
    hidden : bool
        Whether only hidden joints are used.

    Returns
    -------
    (n,) float
    """
    return np.array(
        [
            elliptic_rank(draws.joints[:, t, joint], truth.joints[t, joint])
            for t, joint in _ranked(truth, joints, hidden)
        ]
    )


def draws_inside(
    draws: Draws, truth: TruthInView, *, joints: Sequence[int] = SCORED, hidden: bool = False
) -> NDArray[np.int64]:
    """How many joints regions would contain if a draw were the truth, draw by draw.

    Joints of a clip share the doubt of its size, so the share of them that a region contains varies
    far more from clip to clip than that of independent points.

    Parameters
    ----------
    draws : Draws
    truth : TruthInView
        For the choice of joints and frames.
    joints : sequence of int
    hidden : bool
        See `joint_ranks`.

    Returns
    -------
    (N, 2) int
        For regions of 50 and 90 %.
    """
    inside = np.zeros((len(draws), len(_REGIONS)), int)
    for t, joint in _ranked(truth, joints, hidden):
        distances = _squared_distances(draws.joints[:, t, joint])
        ranks = (distances.argsort().argsort() + 0.5) / len(draws)
        inside += ranks[:, None] < _REGIONS
    return inside


def at_true_size(draws: Draws, truth: TruthInView) -> Draws:
    """Draws scaled about the camera so that the mean log distance of the pelvis is the true one.

    What remains is the doubt of poses and of the path's shape, without that of the clip's size,
    which is one unknown number a clip: one camera does not measure it.

    Parameters
    ----------
    draws : Draws
    truth : TruthInView

    Returns
    -------
    Draws
        The scaled joints; pixels and objects are unchanged.
    """
    known = truth.known

    def size(joints: Array) -> Array:
        away: Array = np.log(np.linalg.norm(joints[..., known, PELV, :], axis=-1)).mean(-1)
        return away

    factor = np.exp(size(truth.joints) - size(draws.joints))
    return replace(draws, joints=draws.joints * factor[:, None, None, None])


def _ranked(truth: TruthInView, joints: Sequence[int], hidden: bool) -> list[tuple[int, int]]:
    """Frames and joints that have ranks."""
    frames = np.flatnonzero(truth.known).tolist()
    return [(t, joint) for t in frames for joint in joints if truth.hidden[t, joint] or not hidden]


def distance_ranks(draws: Draws, truth: TruthInView) -> Array:
    """Fraction of draws whose pelvis is nearer to the camera than the true one, by frame.

    Fractions are uniform if distances are calibrated. They concentrate at 1 if draws are too near,
    and at 0 if they are too far.

    Parameters
    ----------
    draws : Draws
    truth : TruthInView

    Returns
    -------
    (n,) float
    """
    known = truth.known
    drawn = np.linalg.norm(draws.joints[:, known, PELV], axis=-1)
    true = np.linalg.norm(truth.joints[known, PELV], axis=-1)
    shares: Array = (drawn < true).mean(0)
    return shares


def coverage(ranks: Sequence[Array], inside: Sequence[ArrayLike] = ()) -> tuple[Coverage, ...]:
    """Observed coverage of regions of stated probabilities.

    Parameters
    ----------
    ranks : sequence of (n,) float
        Ranks of each clip.
    inside : sequence of (N, 2) int
        Results of `draws_inside` of each clip. If empty, truths are independent and the expected
        range is that of a binomial distribution.

    Returns
    -------
    tuple of Coverage
    """
    everything = np.concatenate([np.empty(0), *ranks])
    count = len(everything)
    rng = np.random.default_rng(_PAIRING_SEED)
    sums = np.zeros((_PAIRINGS, len(_REGIONS)))
    for each in map(np.asarray, inside):
        sums += each[rng.integers(len(each), size=_PAIRINGS)]
    result = []
    for k, region in enumerate(_REGIONS):
        share = low = high = float("nan")
        if count:
            share = float((everything < region).mean())
            low, high = (
                np.quantile(sums[:, k], _EXPECTED)
                if inside
                else binom.ppf(_EXPECTED, count, region)
            ) / count
        result.append(Coverage(region, share, float(low), float(high), count))
    return tuple(result)
