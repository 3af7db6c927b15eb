"""The log-posterior as chains ask for it: where they stand, and what a proposal would change."""

from __future__ import annotations

import math

from imapper_prob.models.incremental import Incremental
from imapper_prob.models.posterior import State, terms
from imapper_prob.models.problem import Problem
from imapper_prob.samplers.tempering import Parts

__all__ = ["SceneTracker", "split"]


def split(problem: Problem, state: State) -> Parts:
    """The log-posterior in what is known beforehand and what the other temperatures flatten.

    Flattening all of it would fill the hot scenes with scenelets, for prior odds of one in ten
    thousand would mean little there.
    """
    nats = terms(problem, state)
    prior = nats["camera"] + nats["layout"] + nats["placement"] + nats["path"]
    return Parts(prior, sum(nats.values()) - prior if math.isfinite(prior) else 0.0)


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
        self._last: State | None = None

    def __call__(self, state: State) -> Parts:
        """The parts of ``state``; the chain stays where it is."""
        if state is self._incremental.state:
            return Parts(*self._incremental.parts)
        self._last = state
        return Parts(*self._incremental.propose(state))

    def move(self, state: State) -> None:
        """The chain has gone to ``state``."""
        if state is self._incremental.state:
            return
        if state is not self._last:
            self._incremental.propose(state)
        self._incremental.accept()
        self._last = None
