"""The log-posterior along a chain: each proposal costs what it changes.

A walk of one scenelet among five moves the frames it covers, the path up to its neighbours,
and its boxes in the view of the rest. :class:`Incremental` remembers what everything else
came to. Its value is that of :func:`imapper_prob.models.posterior.log_posterior`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

from imapper_prob.models.kernels.change import change, settle
from imapper_prob.models.kernels.session import Session, open_session
from imapper_prob.models.posterior import State, log_posterior, target_of
from imapper_prob.models.problem import Problem

__all__ = ["Incremental", "log_posterior_near"]

_CAPACITY = 8
"""Scenelets there is room for at first; it is doubled when it runs out."""


class Incremental:
    """Evaluates proposals from a current state, and moves on when told so.

    Parameters
    ----------
    problem : Problem
    state : State
        Where to start.

    Raises
    ------
    ValueError
        ``state`` is outside the support.
    """

    def __init__(self, problem: Problem, state: State) -> None:
        self._problem = problem
        self._state, self._parts = state, (-math.inf, 0.0)
        self._proposal: tuple[State, tuple[float, float]] | None = None
        self._start(_CAPACITY)

    @property
    def state(self) -> State:
        """The current state."""
        return self._state

    @property
    def session(self) -> Session:
        """What compiled code is handed to evaluate proposals by itself."""
        return self._session

    @property
    def parts(self) -> tuple[float, float]:
        """What :meth:`propose` said of the current state."""
        return self._parts

    def propose(self, state: State) -> tuple[float, float]:
        """Log prior and log likelihood of ``state``, nats; the current state stays.

        The prior is -inf outside the support. Their sum is log pi; the likelihood includes
        the costs of free poses, jumps, collisions, motion and ground.
        """
        if state.n_scenelets > self._capacity:
            self._start(2 * state.n_scenelets)
        now = self._state
        parts: tuple[float, float] = change(
            self._session, now.n_scenelets, now.camera, now.latent,
            state.camera, state.items, state.placements, state.sizes, state.latent,
        )  # fmt: skip
        self._proposal = state, parts
        return parts

    def accept(self) -> None:
        """Make the state last proposed the current one.

        Raises
        ------
        ValueError
            Nothing was proposed since the last time, or it is outside the support.
        """
        if self._proposal is None or self._proposal[1][0] == -math.inf:
            raise ValueError("there is no proposal inside the support to accept")
        self._state, self._parts = self._proposal
        self._proposal = None
        settle(self._session)

    def _start(self, room: int) -> None:
        """Remember nothing but the current state, with room for so many scenelets."""
        if not target_of(self._problem).incremental:
            raise ValueError("the published energy has no incremental evaluation")
        state = self._state
        self._capacity = max(room, state.n_scenelets)
        self._session: Session = open_session(self._problem, self._capacity)
        parts: tuple[float, float] = change(
            self._session, -1, state.camera, state.latent,
            state.camera, state.items, state.placements, state.sizes, state.latent,
        )  # fmt: skip
        if parts[0] == -math.inf:
            raise ValueError("an evaluation cannot start from a state outside the support")
        self._proposal = state, parts
        self.accept()


def log_posterior_near(problem: Problem, state: State) -> Callable[[State], float]:
    """The log-posterior for states that have most in common with one.

    What :func:`~imapper_prob.models.posterior.log_posterior` says, to some 1e-6 nats, and
    sooner; exactly what it says where nothing is incremental: with the published energy, and
    about states outside the support.
    """
    whole = partial(log_posterior, problem)
    if not target_of(problem).incremental or whole(state) == -math.inf:
        return whole
    incremental = Incremental(problem, state)
    return lambda other: sum(incremental.propose(other))
