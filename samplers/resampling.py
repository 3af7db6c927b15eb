"""Part of a state drawn anew several times at once, and one of the draws kept.

Iterated sampling importance resampling: beside what is there, n independent draws are made from a
density q that depends on nothing of what they would replace. Of all n + 1 one is chosen with
probability in proportion to pi / q. What is there counts as one more draw, with its own q; so the
target is left as it is for any q and n, and a poor q only wastes draws (Andrieu, Lee & Vihola
2018, Bernoulli 24, 842). Where pi / q is unbounded the chain may stay long: mix q with a flatter
density.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = ["Drawn", "Redraw", "choice_probabilities"]

S = TypeVar("S")


class Drawn(NamedTuple, Generic[S]):
    """Draws beside what is there.

    Parameters
    ----------
    log_present : float
        Log density of drawing what is there.
    others : sequence of (S, float)
        The states with each draw in place of it, and its log density. A draw that is nowhere in
        the space of states is left out.
    """

    log_present: float
    others: Sequence[tuple[S, float]]


class Redraw(ABC, Generic[S]):
    """A move that draws part of a state anew; it undoes itself."""

    @property
    @abstractmethod
    def name(self) -> str:
        """Unique in its mixture."""

    @property
    def reverse(self) -> str:
        """Its own name."""
        return self.name

    @abstractmethod
    def draw(self, rng: np.random.Generator, state: S, /, *, power: float) -> Drawn[S] | None:
        """Draws for a state, or None where what is there is none that would be drawn.

        ``power`` is that of the likelihood in the target, for densities that follow it. All
        densities are of the same coordinates. Whether there is a None may depend on what is there
        only in that its density is zero.
        """


def choice_probabilities(
    log_density: float, drawn: Drawn[S], log_density_fn: Callable[[S], float]
) -> tuple[NDArray[np.float64], list[float]]:
    """With what probability each is kept, what is there first; and the log target of the draws.

    Raises
    ------
    FloatingPointError
        A log density is NaN or +inf, or that of what is there is not finite.
    """
    if not math.isfinite(drawn.log_present):
        raise FloatingPointError(f"what is there has the log density {drawn.log_present}")
    values = [float(log_density_fn(state)) for state, _ in drawn.others]
    for value, (_, log_q) in zip(values, drawn.others, strict=True):
        if math.isnan(value) or value == math.inf or not math.isfinite(log_q):
            raise FloatingPointError(f"a draw has the log densities {value} and {log_q}")
    log_weights = np.array(
        [
            log_density - drawn.log_present,
            *(value - log_q for value, (_, log_q) in zip(values, drawn.others, strict=True)),
        ]
    )
    weights = np.exp(log_weights - log_weights.max())
    return weights / weights.sum(), values
