"""Another scenelet where one is, displaced from its fit as the old one was from its own.

Each scenelet has a local frame of its own: put where another one was it stands half a step
aside and faces elsewhere. Its fit to the same window knows where it belongs, but not what
the rest of the scene and the camera have done since to the one that is there. So the new
placement is the old one plus the difference of the two fits, in bearing, log depth and yaw.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.posterior import State
from imapper_prob.samplers.kernel import Proposal
from imapper_prob.sampling.moves import in_order
from imapper_prob.sampling.proposals import Proposals

__all__ = ["Replace", "choose", "log_choice", "replaced"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


def choose(
    rng: np.random.Generator,
    proposals: Proposals,
    state: State,
    index: int,
    choices: Ints | None = None,
) -> int | None:
    """A scenelet to try at ``index``, of ``choices`` or of all; None where none was fitted."""
    weights = _weights(proposals, state, index)
    own = weights if choices is None else weights[choices]
    cumulative = own.cumsum()
    if cumulative[-1] <= 0:
        return None
    pick = int(np.searchsorted(cumulative, rng.random() * cumulative[-1], side="right"))
    return pick if choices is None else int(choices[pick])


def log_choice(
    proposals: Proposals, state: State, index: int, new: int, choices: Ints | None = None
) -> float:
    """Log probability with which :func:`choose` finds a scenelet."""
    weights = _weights(proposals, state, index)
    total = (weights if choices is None else weights[choices]).sum()
    return math.log(weights[new] / total) if weights[new] > 0 else -math.inf


def replaced(proposals: Proposals, state: State, index: int, new: int) -> State | None:
    """A state with the scenelet ``new`` at ``index``, its middle frame kept.

    Undone by the same with the old scenelet. Bearing, log depth and yaw change by constants, so
    that on the floor |d(x', y') / d(x, y)| = (y' / y)^2. None where one of both has no fit.
    Order in time is not looked at.
    """
    old, start = state.items[index].tolist()
    weights = _weights(proposals, state, index)
    x, y, yaw = state.placements[index]
    if not weights[old] > 0 or not weights[new] > 0 or y <= 0:
        return None
    window = proposals.nearest_window(proposals.middle(old, start))
    before, after = proposals.candidates.placements[window, (old, new)]
    depth = y * after[1] / before[1]
    bearing = x / y + after[0] / after[1] - before[0] / before[1]
    items, placements = state.items.copy(), state.placements.copy()
    items[index] = (new, start + proposals.middle(old, 0) - proposals.middle(new, 0))
    placements[index] = (bearing * depth, depth, yaw + after[2] - before[2])
    return replace(state, items=items, placements=placements)


def _weights(proposals: Proposals, state: State, index: int) -> Array:
    """(L,) of the window that a scenelet is in."""
    scenelet, start = state.items[index].tolist()
    window = proposals.nearest_window(proposals.middle(scenelet, start))
    weights: Array = proposals.candidates.weights[window]
    return weights


@dataclass(frozen=True)
class Replace:
    """One scenelet becomes another that was fitted to the same window, its middle kept."""

    proposals: Proposals
    name: str = "replace"
    reverse: str = "replace"

    def propose(self, rng: np.random.Generator, state: State) -> Proposal[State] | None:
        """Replace a scenelet; impossible where there is none."""
        if state.n_scenelets == 0:
            return None
        index = int(rng.integers(state.n_scenelets))
        old = int(state.items[index, 0])
        new = choose(rng, self.proposals, state, index)
        if new is None or new == old:
            return None
        changed = replaced(self.proposals, state, index, new)
        if changed is None or not in_order(self.proposals.problem, changed):
            return None
        backward = log_choice(self.proposals, changed, index, old)
        forward = log_choice(self.proposals, state, index, new)
        jacobian = 2 * math.log(changed.placements[index, 1] / state.placements[index, 1])
        return Proposal(changed, backward - forward + jacobian)

    def explain(self, before: State, after: State) -> float:
        """Log density of proposing ``after`` from ``before``, per square metre and radian."""
        index = _changed(before, after)
        if len(index) != 1:
            return -math.inf
        k, new = index[0], int(after.items[index[0], 0])
        again = replaced(self.proposals, before, k, new)
        same = again is not None and all(
            np.allclose(getattr(again, name), getattr(after, name), atol=1e-9)
            for name in ("placements", "sizes")
        )
        if not same:
            return -math.inf
        chosen = log_choice(self.proposals, before, k, new) - math.log(before.n_scenelets)
        # Given in (bearing, log depth): on the floor that is 1 / y'^2.
        return chosen - 2 * math.log(after.placements[k, 1])


def _changed(before: State, after: State) -> list[int]:
    """Indices of the scenelets that are others in ``after``."""
    if before.n_scenelets != after.n_scenelets:
        return []
    return [int(k) for k in np.flatnonzero(before.items[:, 0] != after.items[:, 0])]
