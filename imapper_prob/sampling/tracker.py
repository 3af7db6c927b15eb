"""The log-posterior as chains ask for it: where they stand, and what a proposal would change."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

from imapper_prob.models.incremental import Incremental
from imapper_prob.models.posterior import State, target_of, terms
from imapper_prob.models.problem import Problem
from imapper_prob.samplers.tempering import Parts

__all__ = ["SceneTracker", "split", "tracker_of"]


def split(problem: Problem, state: State) -> Parts:
    """The log-posterior in what stays as it is and what the other temperatures flatten.

    They flatten the prior odds of scenelets, one in ten thousand, as they flatten what a
    scenelet gains by explaining the clip: otherwise the hot scenes would be empty, and what
    comes from there to the cold ones would know nothing of them. Placements, camera and path
    are left alone, lest hot scenes fill up with scenelets that stand anywhere.
    """
    nats = terms(problem, state)
    kept = nats["camera"] + nats["placement"] + nats["path"]
    return Parts(kept, sum(nats.values()) - kept if math.isfinite(kept) else 0.0)


class SceneTracker:
    """What :func:`split` says, worked out from where a chain stands.

    Values depend by some 1e-6 nats on how the chain came to where it is, because what moves by
    nanometres is not looked at again. Chains that are to be repeated exactly from the middle
    begin with a new tracker there.

    Parameters
    ----------
    problem : Problem
        Not with the published energy, which has no incremental evaluation.
    state : State
        Where the chain stands.
    """

    def __init__(self, problem: Problem, state: State) -> None:
        self._incremental = Incremental(problem, state)
        self._log_rate = problem.log_rate
        self._last: State | None = None

    def __call__(self, state: State) -> Parts:
        """The parts of ``state``; the chain stays where it is."""
        if state is self._incremental.state:
            return self._split(state, *self._incremental.parts)
        self._last = state
        return self._split(state, *self._incremental.propose(state))

    def move(self, state: State) -> None:
        """The chain has gone to ``state``."""
        if state is self._incremental.state:
            return
        if state is not self._last:
            self._incremental.propose(state)
        self._incremental.accept()
        self._last = None

    def _split(self, state: State, log_prior: float, log_likelihood: float) -> Parts:
        odds = float(self._log_rate[state.items[:, 0]].sum())
        return Parts(log_prior - odds, log_likelihood + odds)


def tracker_of(problem: Problem) -> Callable[[State], SceneTracker] | None:
    """What makes trackers of chains; None where every state is evaluated as a whole."""
    return partial(SceneTracker, problem) if target_of(problem).incremental else None
