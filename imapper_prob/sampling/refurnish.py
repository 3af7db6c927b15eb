"""A jump between kinds of furniture.

Somebody who sits for ten seconds is covered by several scenelets that meet the same couch.
To call it a chair, all of them have to change at once: one alone would put a chair into the
couch. This move changes all scenelets that share a piece of furniture to another kind of
scenelet that fits their windows. The middle of each is kept; of those that follow one another
without a gap, that of the first, and no gap is made.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.posterior import State
from imapper_prob.samplers.kernel import Proposal
from imapper_prob.sampling.moves import flush_run, in_order
from imapper_prob.sampling.proposals import Proposals
from imapper_prob.sampling.replace import choose, log_choice, replaced, window_of

__all__ = ["Refurnish"]

Ints = NDArray[np.int64]

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
