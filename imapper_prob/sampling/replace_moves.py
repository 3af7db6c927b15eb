"""Moves that put another scenelet, or other furniture, in place of one.

Each scenelet has a local frame of its own: put where another one was it stands half a step
aside and faces elsewhere. Its fit to the same window knows where it belongs, but not what
the rest of the scene has done since to the one that is there. So the new placement is the
old one plus the difference of the two fits, as the camera sees them, in bearing, log depth,
yaw and log size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.log_posterior import State
from imapper_prob.models.view import floor_point, log_area, seen_point
from imapper_prob.samplers.reversible_jump import Proposal
from imapper_prob.sampling.camera_moves import CameraFrame
from imapper_prob.sampling.moves import flush_run, in_order
from imapper_prob.sampling.proposals import Proposals

__all__ = [
    "Refurnish",
    "Replace",
    "ReplaceAndShift",
    "choose",
    "log_choice",
    "replaced",
    "window_of",
]

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
    proposals: Proposals,
    state: State,
    index: int,
    new: int,
    *,
    later: int = 0,
    shift: int | None = None,
) -> State | None:
    """A state with the scenelet ``new`` at ``index``, some windows ``later``.

    Its middle is ``shift`` frames off that of its window, as many as before if not given. Undone by
    the same with the old scenelet, shift and window. Bearing, log depth, yaw and size change by
    constants, so that on the floor |d(x', y') / d(x, y)| = (y' / y)^2. None where one of both
    has no fit, or is no longer nearest to its window. Order in time is not looked at.
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
    view = CameraFrame(state.camera)
    fits = proposals.carried(view, window, old), proposals.carried(view, other, new)
    if fits[0] is None or fits[1] is None:
        return None
    before, after = fits[0][0], fits[1][0]
    yaws = proposals.candidates.placements[..., 2]
    apart = np.subtract(seen_point(after.x, after.y), seen_point(before.x, before.y))
    new_x, new_y = floor_point(*np.add(seen_point(x, y), apart).tolist())
    if shift is None:
        shift = proposals.middle(old, start) - int(centres[window])
    items, placements, sizes = state.items.copy(), state.placements.copy(), state.sizes.copy()
    items[index] = (new, int(centres[other]) + shift - proposals.middle(new, 0))
    placements[index] = (new_x, new_y, yaw + yaws[other, new] - yaws[window, old])
    sizes[index] += after.size - before.size
    changed = replace(state, items=items, placements=placements, sizes=sizes)
    return changed if window_of(proposals, changed, index) == other else None


@dataclass(frozen=True)
class Replace:
    """One scenelet becomes another that was fitted to the same window."""

    proposals: Proposals
    name: str = "replace"
    reverse: str = "replace"

    def propose(self, rng: np.random.Generator, state: State) -> Proposal[State] | None:
        """Replace a scenelet; impossible where there is none."""
        if state.n_scenelets == 0:
            return None
        index = int(rng.integers(state.n_scenelets))
        window = window_of(self.proposals, state, index)
        new = choose(rng, self.proposals, window)
        if new is None:
            return None
        others = np.delete(state.items, index, axis=0)
        shift = self.proposals.draw_shift(rng, window, new, others)
        changed = replaced(self.proposals, state, index, new, shift=shift)
        if changed is None or not in_order(self.proposals.problem, changed):
            return None
        if np.array_equal(changed.items, state.items):
            return None
        jacobian = 2 * math.log(changed.placements[index, 1] / state.placements[index, 1])
        forward, backward = self._log_chosen(changed, index), self._log_chosen(state, index)
        return Proposal(changed, backward - forward + jacobian)

    def explain(self, before: State, after: State) -> float:
        """Log density of proposing ``after`` from ``before``, per square metre and radian."""
        if before.n_scenelets != after.n_scenelets:
            return -math.inf
        moved = np.flatnonzero((before.items != after.items).any(axis=1))
        if len(moved) != 1:
            return -math.inf
        k, new = int(moved[0]), int(after.items[moved[0], 0])
        _, shift = _middle_of(self.proposals, after, k)
        again = replaced(self.proposals, before, k, new, shift=shift)
        same = again is not None and all(
            np.allclose(getattr(again, name), getattr(after, name), atol=1e-9)
            for name in ("items", "placements", "sizes")
        )
        if not same:
            return -math.inf
        # Given in (bearing, log depth).
        area = log_area(math.log(after.placements[k, 1]))
        return self._log_chosen(after, k) - math.log(before.n_scenelets) - area

    def _log_chosen(self, state: State, index: int) -> float:
        """Log probability of a scenelet and its start, given the window."""
        scenelet = int(state.items[index, 0])
        window, shift = _middle_of(self.proposals, state, index)
        others = np.delete(state.items, index, axis=0)
        chance = self.proposals.shift_probability(window, scenelet, shift, others)
        return log_choice(self.proposals, window, scenelet) + math.log(chance)


@dataclass(frozen=True)
class ReplaceAndShift:
    """One scenelet becomes another some windows away, and those flush with it go along.

    Where one ends as the next begins neither can change its start or length alone without a gap,
    which costs a second jump of the person. Here what comes before stays flush with the new
    start, and what follows with the new end.

    Parameters
    ----------
    proposals : Proposals
    reach : int
        Windows by which the middle may come earlier or later.
    """

    proposals: Proposals
    reach: int = 3
    name: str = "retime"
    reverse: str = "retime"

    def propose(self, rng: np.random.Generator, state: State) -> Proposal[State] | None:
        """Replace and move; impossible where there is no scenelet, or no room."""
        if state.n_scenelets == 0:
            return None
        problem, blur = self.proposals.problem, self.proposals.blur
        index = int(rng.integers(state.n_scenelets))
        old = int(state.items[index, 0])
        later = int(rng.integers(-self.reach, self.reach + 1))
        window, _ = _middle_of(self.proposals, state, index)
        if not 0 <= window + later < len(self.proposals.candidates.centres):
            return None
        new = choose(rng, self.proposals, window + later)
        if new is None:
            return None
        shift = int(rng.integers(-blur, blur + 1))
        changed = replaced(self.proposals, state, index, new, later=later, shift=shift)
        if changed is None:
            return None
        run, items = flush_run(problem, state, index), changed.items.copy()
        moved = int(items[index, 1] - state.items[index, 1])
        items[run.start : index, 1] += moved
        items[index + 1 : run.stop, 1] += moved + int(problem.lengths[new] - problem.lengths[old])
        changed = replace(changed, items=items)
        # Flush with others now, they would all go along on the way back.
        if not in_order(problem, changed) or flush_run(problem, changed, index) != run:
            return None
        if np.array_equal(items, state.items):
            return None
        forward = log_choice(self.proposals, window + later, new)
        backward = log_choice(self.proposals, window, old)
        jacobian = 2 * math.log(changed.placements[index, 1] / state.placements[index, 1])
        return Proposal(changed, backward - forward + jacobian)


def _middle_of(proposals: Proposals, state: State, index: int) -> tuple[int, int]:
    """The window that a scenelet is in, and by how many frames its middle is off the window's."""
    middle = proposals.middle(*state.items[index].tolist())
    window = proposals.nearest_window(middle)
    return window, middle - int(proposals.candidates.centres[window])


# ------------------------------------------------------------------------------------------------
# A jump between kinds of furniture.
#
# Somebody who sits for ten seconds is covered by several scenelets that meet the same couch.
# To call it a chair, all of them have to change at once: one alone would put a chair into the
# couch. This move changes all scenelets that share a piece of furniture to another kind of
# scenelet that fits their windows. The middle of each is kept; of those that follow one another
# without a gap, that of the first, and no gap is made.

_SHARED = 1.0
"""Metres; scenelets of one kind this near to each other are taken to share their furniture."""


@dataclass(frozen=True)
class Refurnish:
    """All scenelets around one piece of furniture become another kind.

    Parameters
    ----------
    proposals : Proposals
    kinds : tuple of L tuples of int
        Categories of each scenelet's objects; a scenelet without objects is left alone.
    """

    proposals: Proposals
    kinds: tuple[tuple[int, ...], ...]
    name: str = "refurnish"
    reverse: str = "refurnish"
    members: dict[tuple[int, ...], Ints] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        numbers: dict[tuple[int, ...], list[int]] = {}
        for scenelet, kind in enumerate(self.kinds):
            numbers.setdefault(kind, []).append(scenelet)
        members = {kind: np.array(own, dtype=np.int64) for kind, own in sorted(numbers.items())}
        object.__setattr__(self, "members", members)

    def propose(self, rng: np.random.Generator, state: State) -> Proposal[State] | None:
        """Change one group; impossible where there is no furniture or no other kind."""
        if state.n_scenelets == 0:
            return None
        index = int(rng.integers(state.n_scenelets))
        old_kind = self.kinds[int(state.items[index, 0])]
        others = [kind for kind in self.members if kind and kind != old_kind]
        if not old_kind or not others:
            return None
        new_kind = others[int(rng.integers(len(others)))]
        group = self._group(state, index)
        windows = [window_of(self.proposals, state, member) for member in group]
        choices = self.members[new_kind]
        chosen = [choose(rng, self.proposals, window, choices) for window in windows]
        changed = self._changed(state, group, windows, chosen)
        if changed is None or self._group(changed, index) != group:
            return None
        before, after = state.placements[group, 1], changed.placements[group, 1]
        log_ratio = 2 * float(np.log(after / before).sum())
        log_ratio += self._log_choices(changed, state, group)
        log_ratio -= self._log_choices(state, changed, group)
        return Proposal(changed, log_ratio)

    def _changed(
        self, state: State, group: list[int], windows: list[int], chosen: list[int | None]
    ) -> State | None:
        """The state with other scenelets for a group, and what was flush still flush."""
        problem, middle = self.proposals.problem, self.proposals.middle
        runs = [flush_run(problem, state, member) for member in group]
        items = state.items.copy()
        for member, new in zip(group, chosen, strict=True):
            if new is None:
                return None
            items[member] = (new, middle(*state.items[member].tolist()) - middle(new, 0))
        lengths = problem.lengths[items[:, 0]]
        for i, (first, run) in enumerate(zip(group, runs, strict=True)):
            if run in runs[:i]:
                continue
            for k in range(first, run.start, -1):
                items[k - 1, 1] = items[k, 1] - lengths[k - 1]
            for k in range(first + 1, run.stop):
                items[k, 1] = items[k - 1, 1] + lengths[k - 1]
        changed = state
        for member, window in zip(group, windows, strict=True):
            new, start = items[member].tolist()
            shift = middle(new, start) - int(self.proposals.candidates.centres[window])
            found = replaced(self.proposals, changed, member, new, shift=shift)
            if found is None:
                return None
            changed = found
        changed = replace(changed, items=items)
        # Flush with others now, they would all go along on the way back.
        alike = [flush_run(problem, changed, member) for member in group] == runs
        return changed if alike and in_order(problem, changed) else None

    def _log_choices(self, before: State, after: State, group: list[int]) -> float:
        """Log probability of choosing the scenelets of a group that ``after`` has."""
        choices = self.members[self.kinds[int(after.items[group[0], 0])]]
        return sum(
            log_choice(
                self.proposals,
                window_of(self.proposals, before, k),
                int(after.items[k, 0]),
                choices,
            )
            for k in group
        )

    def _group(self, state: State, index: int) -> list[int]:
        """Indices of the scenelets that share furniture with one, itself among them."""
        kind = self.kinds[int(state.items[index, 0])]
        gap = np.linalg.norm(state.placements[:, :2] - state.placements[index, :2], axis=1)
        return [
            k
            for k, scenelet in enumerate(state.items[:, 0].tolist())
            if self.kinds[scenelet] == kind and gap[k] < _SHARED
        ]
