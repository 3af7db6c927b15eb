"""The arrays of a state for compiled moves, and conversion from and to a state.

A move takes the arrays of a scene and a generator, and returns those of another scene and the log
ratio of reverse to forward proposal density, including Jacobians (Green 1995); -inf if it is
impossible. Arrays are never modified: a move copies those that it changes and shares the others.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.log_posterior import State
from imapper_prob.sampling.jit import compiled

__all__ = ["StateArrays", "arrays_of", "flush_run", "state_of"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


class StateArrays(NamedTuple):
    """The arrays of a :class:`imapper_prob.models.log_posterior.State`.

    Parameters
    ----------
    camera : (5,) float
    items : (k, 2) int
    placements : (k, 3) float
    sizes : (k,) float
    latent : (T, 2) float
    """

    camera: Array
    items: Ints
    placements: Array
    sizes: Array
    latent: Array


def arrays_of(state: State) -> StateArrays:
    """Writable copies of the arrays of a state.

    Parameters
    ----------
    state : State

    Returns
    -------
    StateArrays
    """
    return StateArrays(*state.copies())


def state_of(arrays: StateArrays) -> State:
    """Convert arrays to a state, which shares them but cannot write them.

    Parameters
    ----------
    arrays : StateArrays

    Returns
    -------
    State
    """
    return State(
        arrays.camera.view(),
        arrays.items.view(),
        arrays.placements.view(),
        arrays.sizes.view(),
        arrays.latent.view(),
    )


@compiled
def flush_run(lengths: Ints, items: Ints, index: int) -> tuple[int, int]:
    """Range of the scenelets around one that are flush with each other.

    Parameters
    ----------
    lengths : (L,) int
        Frames of each scenelet.
    items : (k, 2) int
        Scenelet and start frame.
    index : int
        Row of ``items``.

    Returns
    -------
    first : int
    last : int
        The one after the last.
    """
    first = index
    while first > 0 and items[first - 1, 1] + lengths[items[first - 1, 0]] == items[first, 1]:
        first -= 1
    last = index + 1
    while last < len(items) and items[last - 1, 1] + lengths[items[last - 1, 0]] == items[last, 1]:
        last += 1
    return first, last
