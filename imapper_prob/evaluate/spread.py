"""Do stated uncertainties hold? Ranks of the truth among the draws.

The rank of a point is the share of the draws that lie in a smaller ellipse than it does, around
the mean of all of them. Where probabilities are right and draws independent, ranks are uniform:
half of them are below .5, however few the draws are (conformal prediction; Vovk, Gammerman and
Shafer 2005, section 2.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import beta

from imapper_prob.evaluate.claims import Claim
from imapper_prob.evaluate.draws import Draws
from imapper_prob.evaluate.objects import pair_up
from imapper_prob.evaluate.truth import TruthInView
from imapper_prob.models.skeleton import PELV, SCORED

__all__ = [
    "REGIONS", "Coverage", "coverage", "distance_ranks", "elliptic_rank", "joint_ranks",
    "object_ranks",
]  # fmt: skip

Array = NDArray[np.float64]

REGIONS: Final = (0.5, 0.9)
"""Probabilities of the regions that are checked."""
_FEWEST: Final = 20
"""Draws that an object must have, below which an ellipse says nothing."""
_NUGGET: Final = 1e-6
"""Square metres added to variances: a millimetre, so that draws on one spot have an ellipse."""


@dataclass(frozen=True)
class Coverage:
    """How often regions of a stated probability hold the truth.

    Parameters
    ----------
    region : float
        Stated probability.
    share : float
        Of the truths that lie in it; NaN for none.
    low, high : float
        Binomial interval of 90 % around ``share`` (Clopper and Pearson), as if the truths were
        independent; joints of neighbouring frames are not.
    count : int
        Truths.
    """

    region: float
    share: float
    low: float
    high: float
    count: int


def elliptic_rank(draws: ArrayLike, point: ArrayLike) -> float:
    """Rank of ``point`` (d,) among ``draws`` (N, d) by distance in the covariance of all N + 1.

    The point is one of those that the ellipse is drawn around: an ellipse around the others
    would be too small for it, with 100 draws in three dimensions by .03 of a region of .9.
    """
    everything = np.concatenate([np.asarray(draws, float), np.asarray(point, float)[None]])
    off = everything - everything.mean(0)
    covariance = np.cov(everything.T) + _NUGGET * np.eye(off.shape[1])
    distances = np.einsum("ni,ij,nj->n", off, np.linalg.inv(covariance), off)
    # The middle of the step that the point has among N + 1.
    return float(((distances[:-1] < distances[-1]).sum() + 0.5) / len(distances))


def object_ranks(claims: Sequence[Claim], truth: TruthInView) -> Array:
    """(n,) ranks of true centres in the claims that are taken for them.

    Claims are made without the truth. Those of more than even odds are paired as a scene is;
    a true object that finds no partner has no rank, and is not counted as covered or missed.
    """
    likely = [c for c in claims if c.probability > 0.5 and len(c.members) >= _FEWEST]
    claim_of = {id(c.representative): c for c in likely}
    pairs = pair_up(truth.used_objects, [c.representative for c in likely])
    return np.array([elliptic_rank(claim_of[id(p.found)].centres, p.truth.centre) for p in pairs])


def joint_ranks(
    draws: Draws, truth: TruthInView, *, joints: Sequence[int] = SCORED, hidden: bool = False
) -> Array:
    """Ranks of some joints in annotated frames, or of those of them that are hidden."""
    return np.array(
        [
            elliptic_rank(draws.joints[:, t, joint], truth.joints[t, joint])
            for t in np.flatnonzero(truth.known)
            for joint in joints
            if truth.hidden[t, joint] or not hidden
        ]
    )


def distance_ranks(draws: Draws, truth: TruthInView) -> Array:
    """Shares of the draws whose pelvis is nearer to the camera than the true one, by frame.

    Uniform where distances are right; heaped at 1 where draws are too near, and at 0 where
    they are too far.
    """
    known = truth.known
    drawn = np.linalg.norm(draws.joints[:, known, PELV], axis=-1)
    true = np.linalg.norm(truth.joints[known, PELV], axis=-1)
    shares: Array = (drawn < true).mean(0)
    return shares


def coverage(ranks: Array) -> tuple[Coverage, ...]:
    """By :data:`REGIONS`."""
    count = len(ranks)
    result = []
    for region in REGIONS:
        inside = int((ranks < region).sum())
        low = beta.ppf(0.05, inside, count - inside + 1) if inside else 0.0
        high = beta.ppf(0.95, inside + 1, count - inside) if inside < count else 1.0
        share = inside / count if count else float("nan")
        result.append(Coverage(region, share, float(low), float(high), count))
    return tuple(result)
