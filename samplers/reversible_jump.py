"""A reversible-jump chain as a generator, so that stopping and thinning are the caller's."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from imapper_prob.samplers.kernel import ChainState, Mixture, StepInfo, init, step

__all__ = ["AcceptanceTable", "sample"]

S = TypeVar("S")


def sample(
    rng: np.random.Generator,
    state: S,
    *,
    log_density_fn: Callable[[S], float],
    mixture: Mixture[S],
    check: bool = False,
) -> Iterator[tuple[ChainState[S], StepInfo]]:
    """An endless chain from ``state``, one item a proposal.

    Parameters
    ----------
    rng : numpy.random.Generator
    state : S
        Start; it is not yielded itself.
    log_density_fn : callable
        Log density of the target up to a constant; -inf outside its support.
    mixture : Mixture
    check : bool
        Check every proposal's ratio, see `imapper_prob.samplers.kernel.step`.

    Returns
    -------
    iterator of (ChainState, StepInfo)

    Raises
    ------
    FloatingPointError
        At once where the log density of the start is not finite; later where a proposal
        has a log density or ratio that is NaN or +inf.

    Examples
    --------
    >>> chain = sample(rng, start, log_density_fn=target, mixture=mixture)  # doctest: +SKIP
    >>> draws = [at.state for at, info in islice(chain, 0, 10_000, 10)]  # doctest: +SKIP
    """
    return _steps(rng, init(log_density_fn, state), log_density_fn, mixture, check)


def _steps(
    rng: np.random.Generator,
    chain_state: ChainState[S],
    log_density_fn: Callable[[S], float],
    mixture: Mixture[S],
    check: bool,
) -> Iterator[tuple[ChainState[S], StepInfo]]:
    while True:
        chain_state, info = step(
            rng, chain_state, log_density_fn=log_density_fn, mixture=mixture, check=check
        )
        yield chain_state, info


@dataclass
class AcceptanceTable:
    """How often each move was proposed and accepted.

    Impossible moves count as proposed. Tables of several chains add up.
    """

    proposed: Counter[str] = field(default_factory=Counter)
    accepted: Counter[str] = field(default_factory=Counter)

    def record(self, info: StepInfo) -> None:
        """Count one step."""
        self.proposed[info.move] += 1
        self.accepted[info.move] += info.accepted

    def rates(self) -> dict[str, float]:
        """Accepted over proposed, by move in alphabetical order."""
        return {name: self.accepted[name] / n for name, n in sorted(self.proposed.items())}

    def __add__(self, other: AcceptanceTable) -> AcceptanceTable:
        return AcceptanceTable(self.proposed + other.proposed, self.accepted + other.accepted)
