"""A jump between kinds of furniture.

Somebody who sits for ten seconds is covered by several scenelets that meet the same couch.
To call it a chair, all of them have to change at once: one alone would put a chair into the
couch. This move changes all scenelets that share a piece of furniture to another kind of
scenelet with a similar motion, their times and placements kept.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.posterior import State
from imapper_prob.models.problem import Problem
from imapper_prob.samplers.kernel import Proposal
from imapper_prob.sampling.moves import in_order

__all__ = ["Refurnish"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_SHARED = 1.0
"""Metres; scenelets of one kind this near to each other are taken to share their furniture."""


@dataclass(frozen=True)
class Refurnish:
    """All scenelets around one piece of furniture become another kind.

    Parameters
    ----------
    problem : Problem
    similarity : (L, L) float
        Weights of trying one scenelet for another, positive off the diagonal.
    kinds : tuple of L tuples of int
        Categories of each scenelet's objects; a scenelet without objects is left alone.
    """

    problem: Problem
    similarity: Array
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
        items = state.items.copy()
        half = self.problem.lengths // 2
        log_ratio = 0.0
        for member in group:
            old = int(items[member, 0])
            choices, weights = self._choices(old, new_kind)
            pick = int(rng.choice(len(choices), p=weights))
            new = int(choices[pick])
            items[member] = (new, items[member, 1] + half[old] - half[new])
            back, back_weights = self._choices(new, old_kind)
            log_ratio += math.log(back_weights[np.flatnonzero(back == old)[0]])
            log_ratio -= math.log(weights[pick])
        changed = replace(state, items=items)
        if not in_order(self.problem, changed) or self._group(changed, index) != group:
            return None
        return Proposal(changed, log_ratio)

    def _group(self, state: State, index: int) -> list[int]:
        """Indices of the scenelets that share furniture with one, itself among them."""
        kind = self.kinds[int(state.items[index, 0])]
        gap = np.linalg.norm(state.placements[:, :2] - state.placements[index, :2], axis=1)
        return [
            k
            for k, scenelet in enumerate(state.items[:, 0].tolist())
            if self.kinds[scenelet] == kind and gap[k] < _SHARED
        ]

    def _choices(self, scenelet: int, kind: tuple[int, ...]) -> tuple[Ints, Array]:
        """Scenelets of a kind, and the probability of each in place of ``scenelet``."""
        choices = self.members[kind]
        weights = self.similarity[scenelet, choices]
        return choices, weights / weights.sum()
