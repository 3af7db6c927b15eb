"""Two scenes exchange what happens in a stretch of time.

What somebody does at the beginning of a clip and at its end hardly know of each other. A hot
scene has found a better seat for the one, and a cold scene for the other: exchanged as wholes
neither gets anywhere. So scenes of neighbouring temperatures exchange all scenelets of a
stretch, and the latent numbers of the path with them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.posterior import State
from imapper_prob.models.problem import Problem

__all__ = ["TimeCrossover"]

_ONE_MORE = 0.4
"""Probability that the stretch takes in one block more."""


@dataclass(frozen=True)
class TimeCrossover:
    """Exchange the scenelets of one or several blocks of time.

    A block is a run of frames that are under a scenelet in either scene, without a gap. Both
    scenes together have the same blocks afterwards, so that the way back is as likely as
    the way there. Scenelets are taken to where the other camera and body see the same.
    """

    problem: Problem

    def __call__(
        self, rng: np.random.Generator, hot: State, cold: State
    ) -> tuple[State, State, float] | None:
        """Both scenes afterwards and the log Jacobian; None where both are empty."""
        cuts = self._cuts(hot, cold)
        n_blocks = len(cuts) - 1
        if n_blocks < 1:
            return None
        first = int(rng.integers(n_blocks))
        last = min(n_blocks, first + int(rng.geometric(1 - _ONE_MORE)))
        begin, end = int(cuts[first]), int(cuts[last])
        one, other = _inside(hot, begin, end), _inside(cold, begin, end)
        if not one.any() and not other.any():
            return None
        # From the hot scene's camera and body to the cold one's.
        change = cold.camera - hot.camera
        new_hot = _exchanged(hot, one, cold, other, begin, end, -change)
        new_cold = _exchanged(cold, other, hot, one, begin, end, change)
        # x' = x e^body, y' = y e^(focal + body), for each scenelet that goes that way.
        log_jacobian = float((one.sum() - other.sum()) * (change[2] + 2 * change[3]))
        return new_hot, new_cold, log_jacobian

    def _cuts(self, hot: State, cold: State) -> NDArray[np.int64]:
        """Frames between blocks, in the middle of their gaps, and both ends of the clip."""
        items = np.concatenate([hot.items, cold.items])
        items = items[np.argsort(items[:, 1], kind="stable")]
        ends = np.maximum.accumulate(items[:, 1] + self.problem.lengths[items[:, 0]])
        gaps = [
            (int(end) + int(start)) // 2
            for end, start in zip(ends[:-1], items[1:, 1], strict=True)
            if end <= start
        ]
        if len(items) == 0:
            return np.zeros(0, np.int64)
        return np.array([0, *gaps, self.problem.n_frames], dtype=np.int64)


def _inside(state: State, begin: int, end: int) -> NDArray[np.bool_]:
    starts = state.items[:, 1]
    inside: NDArray[np.bool_] = (starts >= begin) & (starts < end)
    return inside


def _exchanged(
    own: State,
    given: NDArray[np.bool_],
    others: State,
    taken: NDArray[np.bool_],
    begin: int,
    end: int,
    change: NDArray[np.float64],
) -> State:
    """One scene with the other's scenelets in a stretch, seen with its own camera."""
    placements = others.placements[taken].copy()
    placements[:, 0] *= math.exp(change[3])
    placements[:, 1] *= math.exp(change[2] + change[3])
    items = np.concatenate([own.items[~given], others.items[taken]])
    order = np.argsort(items[:, 1], kind="stable")
    latent = own.latent.copy()
    latent[begin:end] = others.latent[begin:end]
    return replace(
        own,
        items=items[order],
        placements=np.concatenate([own.placements[~given], placements])[order],
        sizes=np.concatenate([own.sizes[~given], others.sizes[taken]])[order],
        latent=latent,
    )
