"""Two scenes exchange what happens in a stretch of time.

What somebody does at the beginning of a clip and at its end hardly know of each other. A hot
scene has found a better seat for the one, and a cold scene for the other: exchanged as wholes
neither gets anywhere. So scenes of neighbouring temperatures exchange all scenelets of a
stretch, and the latent numbers of the path with them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.posterior import State
from imapper_prob.models.problem import Problem
from imapper_prob.sampling.looks import View, middle_heights, seen_alike

__all__ = ["TimeCrossover"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_ONE_MORE = 0.4
"""Probability that the stretch takes in one block more."""


@dataclass(frozen=True)
class TimeCrossover:
    """Exchange the scenelets of one or several blocks of time.

    A block is a run of frames that are under a scenelet in either scene, without a gap. Both
    scenes together have the same blocks afterwards, so that the way back is as likely as
    the way there. Scenelets are taken to where they look the same through the other camera
    (:mod:`~imapper_prob.sampling.looks`).
    """

    problem: Problem
    _heights: list[float] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_heights", middle_heights(self.problem).tolist())

    def __call__(
        self, rng: np.random.Generator, hot: State, cold: State
    ) -> tuple[State, State, float] | None:
        """Both scenes afterwards and the log Jacobian.

        None where both are empty, or a scenelet would have nowhere to stand.
        """
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
        warm, cool = View(hot.camera), View(cold.camera)
        to_cold = self._carried(hot, one, warm, cool)
        to_hot = self._carried(cold, other, cool, warm)
        if to_cold is None or to_hot is None:
            return None
        new_hot = _exchanged(hot, one, cold, other, begin, end, to_hot)
        new_cold = _exchanged(cold, other, hot, one, begin, end, to_cold)
        return new_hot, new_cold, to_hot[2] + to_cold[2]

    def _carried(
        self, state: State, which: Flags, own: View, others: View
    ) -> tuple[Array, Array, float] | None:
        """Where some scenelets of a state stand for another one's camera."""
        return seen_alike(
            own, others,
            self._heights, state.items[which], state.placements[which], state.sizes[which],
        )  # fmt: skip

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


def _inside(state: State, begin: int, end: int) -> Flags:
    starts = state.items[:, 1]
    inside: Flags = (starts >= begin) & (starts < end)
    return inside


def _exchanged(
    own: State,
    given: Flags,
    others: State,
    taken: Flags,
    begin: int,
    end: int,
    carried: tuple[Array, Array, float],
) -> State:
    """One scene with the other's scenelets in a stretch, where its own camera sees them."""
    placements, sizes, _ = carried
    items = np.concatenate([own.items[~given], others.items[taken]])
    order = np.argsort(items[:, 1], kind="stable")
    latent = own.latent.copy()
    latent[begin:end] = others.latent[begin:end]
    return replace(
        own,
        items=items[order],
        placements=np.concatenate([own.placements[~given], placements])[order],
        sizes=np.concatenate([own.sizes[~given], sizes])[order],
        latent=latent,
    )
