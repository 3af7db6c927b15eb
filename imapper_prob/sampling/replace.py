"""Another scenelet where one is, displaced from its fit as the old one was from its own.

Each scenelet has a local frame of its own: put where another one was it stands half a step
aside and faces elsewhere. Its fit to the same window knows where it belongs, but not what
the rest of the scene has done since to the one that is there. So the new placement is the
old one plus the difference of the two fits, as the camera sees them, in bearing, log depth,
yaw and log size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.posterior import State
from imapper_prob.samplers.kernel import Proposal
from imapper_prob.sampling.looks import View
from imapper_prob.sampling.moves import in_order
from imapper_prob.sampling.proposals import Proposals

__all__ = ["Replace", "choose", "log_choice", "replaced", "window_of"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


def choose(
    rng: np.random.Generator, proposals: Proposals, window: int, choices: Ints | None = None
) -> int | None:
    """A scenelet to try in a window, of ``choices`` or of all; None where none was fitted."""
    weights = proposals.candidates.weights[window]
    own = weights if choices is None else weights[choices]
    cumulative = own.cumsum()
    if cumulative[-1] <= 0:
        return None
    pick = int(np.searchsorted(cumulative, rng.random() * cumulative[-1], side="right"))
    return pick if choices is None else int(choices[pick])


def log_choice(
    proposals: Proposals, window: int, scenelet: int, choices: Ints | None = None
) -> float:
    """Log probability with which :func:`choose` finds a scenelet."""
    weights = proposals.candidates.weights[window]
    total = (weights if choices is None else weights[choices]).sum()
    return math.log(weights[scenelet] / total) if weights[scenelet] > 0 else -math.inf


def window_of(proposals: Proposals, state: State, index: int) -> int:
    """The window that a scenelet of a state is in."""
    return proposals.nearest_window(proposals.middle(*state.items[index].tolist()))


def replaced(
    proposals: Proposals, state: State, index: int, new: int, *, later: int = 0
) -> State | None:
    """A state with the scenelet ``new`` at ``index``, some windows ``later``.

    How far its middle is from that of its window stays. Undone by the same with the old scenelet
    and as many windows earlier. Bearing, log depth, yaw and size change by constants, so that on
    the floor |d(x', y') / d(x, y)| = (y' / y)^2. None where one of both has no fit, or is no
    longer nearest to its window. Order in time is not looked at.
    """
    old, start = state.items[index].tolist()
    centres = proposals.candidates.centres
    window = window_of(proposals, state, index)
    other = window + later
    x, y, yaw = state.placements[index]
    if not 0 <= other < len(centres) or y <= 0:
        return None
    weights = proposals.candidates.weights
    if not weights[window, old] > 0 or not weights[other, new] > 0:
        return None
    view = View(state.camera)
    fits = proposals.carried(view, window, old), proposals.carried(view, other, new)
    if fits[0] is None or fits[1] is None:
        return None
    before, after = fits[0][0], fits[1][0]
    yaws = proposals.candidates.placements[..., 2]
    depth = y * after.y / before.y
    bearing = x / y + after.x / after.y - before.x / before.y
    by = int(centres[other] - centres[window])
    items, placements, sizes = state.items.copy(), state.placements.copy(), state.sizes.copy()
    items[index] = (new, start + by + proposals.middle(old, 0) - proposals.middle(new, 0))
    placements[index] = (bearing * depth, depth, yaw + yaws[other, new] - yaws[window, old])
    sizes[index] += after.size - before.size
    changed = replace(state, items=items, placements=placements, sizes=sizes)
    return changed if window_of(proposals, changed, index) == other else None


@dataclass(frozen=True)
class Replace:
    """One scenelet becomes another that was fitted to the same window or one nearby.

    Parameters
    ----------
    proposals : Proposals
    reach : int
        Windows by which it may come earlier or later.
    """

    proposals: Proposals
    reach: int = 0
    name: str = "replace"
    reverse: str = "replace"

    def propose(self, rng: np.random.Generator, state: State) -> Proposal[State] | None:
        """Replace a scenelet; impossible where there is none."""
        if state.n_scenelets == 0:
            return None
        index = int(rng.integers(state.n_scenelets))
        old, window = int(state.items[index, 0]), window_of(self.proposals, state, index)
        later = int(rng.integers(-self.reach, self.reach + 1))
        other = window + later
        if not 0 <= other < len(self.proposals.candidates.centres):
            return None
        new = choose(rng, self.proposals, other)
        if new is None or (new == old and later == 0):
            return None
        changed = replaced(self.proposals, state, index, new, later=later)
        if changed is None or not in_order(self.proposals.problem, changed):
            return None
        backward = log_choice(self.proposals, window, old)
        forward = log_choice(self.proposals, other, new)
        jacobian = 2 * math.log(changed.placements[index, 1] / state.placements[index, 1])
        return Proposal(changed, backward - forward + jacobian)

    def explain(self, before: State, after: State) -> float:
        """Log density of proposing ``after`` from ``before``, per square metre and radian."""
        if before.n_scenelets != after.n_scenelets:
            return -math.inf
        moved = np.flatnonzero((before.items != after.items).any(axis=1))
        if len(moved) != 1:
            return -math.inf
        k = int(moved[0])
        window = window_of(self.proposals, before, k)
        later = window_of(self.proposals, after, k) - window
        new = int(after.items[k, 0])
        again = replaced(self.proposals, before, k, new, later=later)
        same = again is not None and all(
            np.allclose(getattr(again, name), getattr(after, name), atol=1e-9)
            for name in ("items", "placements", "sizes")
        )
        if not same or abs(later) > self.reach:
            return -math.inf
        chosen = log_choice(self.proposals, window + later, new)
        # Given in (bearing, log depth): on the floor that is 1 / y'^2.
        ways = before.n_scenelets * (2 * self.reach + 1)
        return chosen - math.log(ways) - 2 * math.log(after.placements[k, 1])
