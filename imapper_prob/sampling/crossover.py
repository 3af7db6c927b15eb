"""A crossover move: two scenes of a tempered chain exchange a stretch of time.

The beginning and the end of a clip are nearly independent. If the hot scene has a better seat in
one and the cold scene in the other, a swap of whole scenes rarely succeeds. So scenes of
neighbouring temperatures exchange all scenelets of a stretch, and the latent variables of the path
in it.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.log_posterior import State
from imapper_prob.models.problem import Problem
from imapper_prob.sampling.image_pelvis import middle_heights, reproject_placements
from imapper_prob.sampling.jit import compiled, inner
from imapper_prob.sampling.scene import StateArrays, arrays_of, state_of

__all__ = ["TimeCrossover"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]

_ONE_MORE: Final = 0.4
"""Probability of extending the stretch by one more block; chosen."""


class TimeCrossover:
    """Exchanges the scenelets of one or several blocks of time.

    A block is a run of frames without a gap that are inside a scenelet of either scene. Both scenes
    together have the same blocks after the exchange, so forward and reverse proposals are equally
    probable. Scenelets are moved so that their pelvis has the same image in the other camera
    (:mod:`imapper_prob.sampling.image_pelvis`).

    Parameters
    ----------
    problem : Problem
    """

    def __init__(self, problem: Problem) -> None:
        self._lengths, self._heights = np.array(problem.lengths), middle_heights(problem).copy()

    def __call__(
        self, rng: np.random.Generator, hot: State, cold: State
    ) -> tuple[State, State, float] | None:
        """Propose both scenes after the exchange, and the log Jacobian.

        None if both stretches are empty, or if a scenelet has no valid placement.
        """
        warm, cool, ratio = _exchange(
            self._lengths, self._heights, rng, arrays_of(hot), arrays_of(cold)
        )
        return None if math.isnan(ratio) else (state_of(warm), state_of(cool), float(ratio))


@compiled
def _exchange(
    lengths: Ints, heights: Array, rng: np.random.Generator, hot: StateArrays, cold: StateArrays
) -> tuple[StateArrays, StateArrays, float]:
    """Both scenes after the exchange and the log Jacobian, NaN if it is impossible."""
    cuts = _cuts(lengths, hot.items, cold.items, len(hot.latent))
    n_blocks = len(cuts) - 1
    if n_blocks < 1:
        return hot, cold, math.nan
    first = int(rng.integers(0, n_blocks))
    last = min(n_blocks, first + int(rng.geometric(1.0 - _ONE_MORE)))
    begin, end = cuts[first], cuts[last]
    of_hot, of_cold = _inside(hot, begin, end), _inside(cold, begin, end)
    if not of_hot.any() and not of_cold.any():
        return hot, cold, math.nan
    to_cold, sizes_cold, ratio_cold = reproject_placements(
        heights, hot, hot.camera, cold.camera, of_hot
    )
    to_hot, sizes_hot, ratio_hot = reproject_placements(
        heights, cold, cold.camera, hot.camera, of_cold
    )
    new_hot = _merged(hot, ~of_hot, cold, of_cold, to_hot, sizes_hot, begin, end)
    new_cold = _merged(cold, ~of_cold, hot, of_hot, to_cold, sizes_cold, begin, end)
    return new_hot, new_cold, ratio_hot + ratio_cold


@inner
def _cuts(lengths: Ints, one: Ints, other: Ints, n_frames: int) -> Ints:
    """Boundaries of blocks: the middles of gaps, and both ends of the clip."""
    items = np.concatenate((one, other))
    if len(items) == 0:
        return np.zeros(0, np.int64)
    items = items[np.argsort(items[:, 1], kind="mergesort")]
    cuts, n = np.zeros(len(items) + 1, np.int64), 1
    end = items[0, 1] + lengths[items[0, 0]]
    for i in range(1, len(items)):
        if end <= items[i, 1]:
            cuts[n] = (end + items[i, 1]) // 2
            n += 1
        end = max(end, items[i, 1] + lengths[items[i, 0]])
    cuts[n] = n_frames
    return cuts[: n + 1].copy()


@inner
def _inside(scene: StateArrays, begin: int, end: int) -> Flags:
    starts = scene.items[:, 1]
    return (starts >= begin) & (starts < end)


@inner
def _merged(
    own: StateArrays,
    kept: Flags,
    others: StateArrays,
    taken: Flags,
    placements: Array,
    sizes: Array,
    begin: int,
    end: int,
) -> StateArrays:
    """A scene with the other's scenelets in a stretch, placed for its own camera."""
    items = np.concatenate((own.items[kept], others.items[taken]))
    order = np.argsort(items[:, 1], kind="mergesort")
    latent = own.latent.copy()
    latent[begin:end] = others.latent[begin:end]
    return StateArrays(
        own.camera,
        items[order],
        np.concatenate((own.placements[kept], placements[taken]))[order],
        np.concatenate((own.sizes[kept], sizes[taken]))[order],
        latent,
    )
