"""Moves that draw a scene anew from the reference, or a part of it.

What is drawn does not depend on what it replaces. At an inverse temperature beta the acceptance
probability is the ratio of the weights (posterior / reference)^beta: hot chains change with nearly
every draw, and even at the posterior some draws are good enough.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from imapper_prob.models.log_posterior import State
from imapper_prob.samplers.reversible_jump import Proposal
from imapper_prob.sampling.reference import (
    Reference,
    draw_scene,
    draw_stretch,
    log_reference,
    log_stretch,
)

__all__ = ["SceneRedraw", "StretchRedraw"]

_INSERTED = 0.1
"""How often a place between scenelets is chosen, over a run of them; chosen: mostly nothing is put
there."""


@dataclass(frozen=True)
class SceneRedraw:
    """Everything anew: camera, scenelets and latent numbers."""

    reference: Reference
    name: str = "scene-redraw"
    reverse: str = "scene-redraw"

    def propose(self, rng: np.random.Generator, state: State) -> Proposal[State]:
        """A scene of the reference."""
        new = draw_scene(self.reference, rng)
        return Proposal(new, self._log_density(state) - self._log_density(new))

    def explain(self, before: State, after: State) -> float:
        """Log density of proposing ``after``, whatever was ``before``."""
        return self._log_density(after)

    def _log_density(self, state: State) -> float:
        return log_reference(
            self.reference, state.camera, state.items, state.placements, state.sizes
        )  # fmt: skip


@dataclass(frozen=True)
class StretchRedraw:
    """Some scenelets in a row anew, none to all of them, and their number with them.

    All runs of one or more are as likely; a place where nothing is taken away is chosen less often,
    for nothing is put there most of the time.
    """

    reference: Reference
    name: str = "redraw"
    reverse: str = "redraw"

    def propose(self, rng: np.random.Generator, state: State) -> Proposal[State] | None:
        """What the reference puts between the others; impossible where that overlaps."""
        k = state.n_scenelets
        runs, places = k * (k + 1) / 2, _INSERTED * (k + 1)
        if rng.random() * (runs + places) < places:
            first = last = int(rng.integers(k + 1))
        else:
            # Two different ones of the k + 1 places before, between and after the scenelets.
            first, last = sorted(rng.choice(k + 1, 2, replace=False).tolist())
        items, placements, sizes = draw_stretch(self.reference, rng, state, first, last)
        if first == last and len(items) == 0:
            return None
        new = replace(
            state,
            items=np.concatenate([state.items[:first], items, state.items[last:]]),
            placements=np.concatenate(
                [state.placements[:first], placements, state.placements[last:]]
            ),
            sizes=np.concatenate([state.sizes[:first], sizes, state.sizes[last:]]),
        )
        end = first + len(items)
        forward = _log_choice(k, last - first) + self._log_density(new, first, end)
        if forward == -math.inf:
            return None
        backward = _log_choice(new.n_scenelets, len(items)) + self._log_density(state, first, last)
        return Proposal(new, backward - forward)

    def _log_density(self, state: State, first: int, last: int) -> float:
        """Of drawing what a state has there."""
        return log_stretch(
            self.reference, state.camera, state.items, state.placements, state.sizes, first, last
        )  # fmt: skip


def _log_choice(k: int, n: int) -> float:
    """Log probability of choosing one run of n among k scenelets."""
    weight = 1.0 if n > 0 else _INSERTED
    return math.log(weight / (k * (k + 1) / 2 + _INSERTED * (k + 1)))
