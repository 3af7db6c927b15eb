"""A rung's chain of any kernel, such as a step of reversible jumps."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

import numpy as np

from imapper_prob.samplers.reversible_jump import ChainState, StepInfo
from imapper_prob.samplers.tempering import PRIOR, LogDensityParts, Rung, TemperedDensity

S = TypeVar("S")


class Kernel(Protocol[S]):
    """A transition kernel at one temperature.

    For example ``functools.partial(imapper_prob.samplers.reversible_jump.step, mixture=mixture)``.
    """

    def __call__(
        self,
        rng: np.random.Generator,
        chain_state: ChainState[S],
        /,
        *,
        log_density_fn: Callable[[S], float],
    ) -> tuple[ChainState[S], StepInfo]:
        """Make one step that leaves the density invariant."""


class KernelChain(Generic[S]):
    """A chain made of a kernel and a target, without a cache.

    Reference kernels are tempered with it; the program's chains are compiled.

    Parameters
    ----------
    target : callable
        ``target(state) -> LogDensityParts``.
    kernel : Kernel
    state : S
        State of the chain.
    """

    def __init__(self, target: Callable[[S], LogDensityParts], kernel: Kernel[S], state: S) -> None:
        self._target, self._kernel, self._state = target, kernel, state

    def __call__(self, state: S, rung: Rung = PRIOR, least: float = -math.inf) -> LogDensityParts:
        """Evaluate the log density of ``state``, whatever is needed."""
        return self._target(state)

    def move(self, state: S) -> None:
        """Set the state of the chain."""
        self._state = state

    def advance(
        self, rng: np.random.Generator, rung: Rung, steps: int
    ) -> tuple[ChainState[S], tuple[StepInfo, ...]]:
        """Make steps with the kernel; the chain afterwards, and a record of each step."""
        density, infos = TemperedDensity(self._target, rung), []
        at = ChainState(self._state, density(self._state))
        for _ in range(steps):
            at, info = self._kernel(rng, at, log_density_fn=density)
            infos.append(info)
        self._state = at.state
        return at, tuple(infos)
