"""The costs of the paper's tracker as a network (Monszpart et al. 2019, appendix A).

    E = sum_t sum_a E_u(a, s, t) + w_pw sum_t sum_a C(a, s_0, s_1, t)

    E_u = -mean_k c_k of the skeleton, or 1 for the dummy
    C   = mean_k |u_k - u'_k|^2 / diag^2 c_k c'_k, or 1 where one of the two is the dummy

with half the diagonal of the image as unit of length and w_pw = 10^3. Misprints, mended: E_u
carries a minus and is subtracted again, which would prefer unsure skeletons; the quantifiers of
the two constraints are exchanged – each actor takes one skeleton or the dummy in every frame, each
skeleton at most one actor. Steps lead from a frame to the next, and to stay invisible costs
1 + w_pw a frame.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.skeleton import DETECTED
from imapper_prob.tracking.flow import Network

__all__ = ["PAIRWISE", "published_network", "step_cost"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

PAIRWISE: Final = 1e3
"""w_pw."""
_DUMMY: Final = 1.0
"""Cost of the dummy skeleton, and of a step from or to it."""
_LIFT: Final = 1.0
"""Added to every actor's cost in every frame, so that none is negative."""


def step_cost(one: Array, other: Array, c: Array, d: Array, *, half_diagonal: float) -> Array:
    """C of pairs of skeletons.

    Parameters
    ----------
    one, other : (P, 16, 2) float
        Pixels; any number or NaN where the confidence is 0.
    c, d : (P, 16) float
        Their confidences.
    half_diagonal : float
        Of the image, pixels.

    Returns
    -------
    (P,) float
    """
    joints = list(DETECTED)
    weight = (c * d)[:, joints]
    apart = np.where(weight[..., None] > 0, (one - other)[:, joints], 0.0) / half_diagonal
    cost: Array = (weight * (apart**2).sum(-1)).mean(1)
    return cost


def published_network(
    frames: Ints, keypoints: Array, confidences: Array, *, half_diagonal: float
) -> Network:
    """The network whose cheapest paths are the paper's actors; rows sorted by frame.

    Parameters
    ----------
    frames : (N,) int
    keypoints : (N, 16, 2) float
        Pixels; NaN where missing.
    confidences : (N, 16) float
        0 where missing.
    half_diagonal : float
        Of the image, pixels.
    """
    n, at = len(frames), frames - frames[0]
    times = int(at[-1]) + 1
    arrive, depart = np.arange(n), n + np.arange(n)
    nobody, begin = 2 * n + np.arange(times), 2 * n + times
    end = begin + 1
    low = np.searchsorted(frames, frames + 1, side="left")
    counts = np.searchsorted(frames, frames + 1, side="right") - low
    before = np.repeat(np.arange(n), counts)
    after = low[before] + np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    step = step_cost(
        keypoints[before], keypoints[after], confidences[before], confidences[after],
        half_diagonal=half_diagonal,
    )  # fmt: skip
    unsure = _LIFT - confidences[:, list(DETECTED)].mean(1)
    hidden, change = _LIFT + _DUMMY, PAIRWISE * _DUMMY
    left, came = at < times - 1, at > 0
    first, last = at == 0, at == times - 1
    edges: list[tuple[Ints, Ints, Array]] = [
        (arrive, depart, unsure),
        (depart[before], arrive[after], PAIRWISE * step),
        (depart[left], nobody[at[left] + 1], np.full(left.sum(), change + hidden)),
        (nobody[at[came] - 1], arrive[came], np.full(came.sum(), change)),
        (nobody[:-1], nobody[1:], np.full(times - 1, change + hidden)),
        (np.full(first.sum(), begin), arrive[first], np.zeros(first.sum())),
        (depart[last], np.full(last.sum(), end), np.zeros(last.sum())),
        (np.array([begin]), nobody[:1], np.array([hidden])),
        (nobody[-1:], np.array([end]), np.zeros(1)),
    ]
    tail, head, cost = (np.concatenate(part) for part in zip(*edges, strict=True))
    return Network(tail=tail, head=head, cost=cost, begin=int(begin), end=int(end), single=n)
