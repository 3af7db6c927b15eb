"""Moves of an ensemble of walkers whose leading coordinates are `theta`, the others `z`.

They follow emcee's protocol for moves; how to mix them is the matter of
`imapper_prob.samplers.ensemble`.

References
----------
ter Braak 2006, Stat. Comput. 16, 239 (differential evolution). ter Braak & Vrugt 2008,
Stat. Comput. 18, 435 (snooker). Cotter, Roberts, Stuart & White 2013, Stat. Sci. 28, 424
(preconditioned Crank-Nicolson).
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np
from emcee.moves import MHMove, RedBlueMove
from emcee.moves.move import Move
from numpy.typing import NDArray

__all__ = ["CrankNicolson", "DifferentialEvolution", "Snooker"]

Array = NDArray[np.float64]

# Relative spread of the differential-evolution factor (Nelson, Ford & Payne 2013, ApJS
# 210, 11): without it walkers would stay on a lattice.
_FACTOR_SPREAD = 0.01
# Snooker factor recommended by ter Braak & Vrugt.
_SNOOKER_FACTOR = 1.7
# Best acceptance of a random walk in many dimensions (Roberts, Gelman & Gilks 1997).
_ACCEPTANCE_GOAL = 0.234
# Robbins-Monro: steps of n^-0.6 sum to infinity and their squares do not.
_ADAPTATION_DECAY = 0.6


class _Counted(Move):  # type: ignore[misc]
    """A move that counts what it proposed and what was accepted."""

    name: ClassVar[str]
    proposed = 0
    accepted = 0

    def propose(self, model: Any, state: Any) -> tuple[Any, NDArray[np.bool_]]:
        state, accepted = super().propose(model, state)
        self.proposed += accepted.size
        self.accepted += int(accepted.sum())
        return state, accepted

    def reset(self) -> None:
        """Forget the counts."""
        self.proposed = self.accepted = 0

    @property
    def rate(self) -> float:
        """Accepted over proposed; NaN before the first proposal."""
        return self.accepted / self.proposed if self.proposed else float("nan")


class _ThetaMove(_Counted, RedBlueMove):  # type: ignore[misc]
    """Moves `theta` of half the walkers by looking at the other half; `z` stays.

    emcee asks for twice as many walkers as coordinates, for such moves never leave the
    subspace that the walkers span. Here that is the space of `theta` alone, whatever the
    number of coordinates behind it: hence ``live_dangerously``.
    """

    def __init__(self, n_theta: int) -> None:
        super().__init__(live_dangerously=True)
        self.n_theta = n_theta

    def get_proposal(self, s: Array, c: list[Array], random: Any) -> tuple[Array, Array]:
        """New coordinates of walkers ``s`` and log ratios, given the walkers in ``c``."""
        theta, others = s[:, : self.n_theta], np.concatenate(c)[:, : self.n_theta]
        moved, log_ratio = self.move(theta, others, random)
        return np.concatenate([moved, s[:, self.n_theta :]], axis=1), log_ratio

    @abstractmethod
    def move(self, theta: Array, others: Array, random: Any) -> tuple[Array, Array]:
        """New `theta` (w, D) and log proposal ratios (w,), given the others (v, D)."""


class DifferentialEvolution(_ThetaMove):
    """Adds the difference of two other walkers.

    Parameters
    ----------
    n_theta : int
        D, the number of leading coordinates.
    jump_between_modes : float
        Share of proposals with factor 1, which lead from one mode to another.
    """

    name = "differential evolution"

    def __init__(self, n_theta: int, *, jump_between_modes: float) -> None:
        super().__init__(n_theta)
        self.jump_between_modes = jump_between_modes

    def move(self, theta: Array, others: Array, random: Any) -> tuple[Array, Array]:
        """See the base class; the proposal is symmetric."""
        first, second = _distinct(len(others), len(theta), 2, random)
        factor = 2.38 / np.sqrt(2 * self.n_theta) * np.ones(len(theta))
        factor[random.rand(len(theta)) < self.jump_between_modes] = 1
        factor *= 1 + _FACTOR_SPREAD * random.randn(len(theta))
        return theta + factor[:, None] * (others[first] - others[second]), np.zeros(len(theta))


class Snooker(_ThetaMove):
    """Moves along the line to another walker, by the projected difference of two more.

    Written here because the one of emcee 3.1 does not leave the target invariant: it
    divides by the root of the distance instead of the distance, and its Jacobian is too
    small (in five dimensions the variance of a normal target comes out at 0.69).
    """

    name = "snooker"

    def move(self, theta: Array, others: Array, random: Any) -> tuple[Array, Array]:
        """See the base class; the ratio is the Jacobian (r'/r)^(D-1) of polar coordinates."""
        anchor, first, second = others[_distinct(len(others), len(theta), 3, random)]
        distance = np.linalg.norm(theta - anchor, axis=1)
        direction = (theta - anchor) / distance[:, None]
        shift = _SNOOKER_FACTOR * np.sum((first - second) * direction, axis=1)
        ratio = np.log(np.abs(distance + shift) / distance)
        return theta + shift[:, None] * direction, (self.n_theta - 1) * ratio


class CrankNicolson(_Counted, MHMove):  # type: ignore[misc]
    """``z' = sqrt(1 - b^2) z + b N(0, I)``, reversible with respect to N(0, I).

    Parameters
    ----------
    n_theta : int
        How many leading coordinates stay.
    step : float
        b, in (0, 1]; emcee's ``tune`` adapts it.
    """

    name = "latent"

    def __init__(self, n_theta: int, *, step: float) -> None:
        super().__init__(self.move)
        self.n_theta = n_theta
        self.step = step
        self.tunings = 0

    def move(self, coordinates: Array, random: Any) -> tuple[Array, Array]:
        """New coordinates and log ratios 0: the target is a density relative to N(z)."""
        moved = coordinates.copy()
        latent = moved[:, self.n_theta :]
        latent *= np.sqrt(1 - self.step**2)
        latent += self.step * random.standard_normal(latent.shape)
        return moved, np.zeros(len(moved))

    def tune(self, state: Any, accepted: NDArray[np.bool_]) -> None:
        """Lengthen the step where too much is accepted, and shorten it where too little."""
        self.tunings += 1
        change = (accepted.mean() - _ACCEPTANCE_GOAL) / self.tunings**_ADAPTATION_DECAY
        self.step = min(1.0, self.step * float(np.exp(change)))


def _distinct(n: int, size: int, count: int, random: Any) -> NDArray[np.intp]:
    """(count, size): for each walker ``count`` different indices below n."""
    return np.argsort(random.rand(size, n), axis=1)[:, :count].T
