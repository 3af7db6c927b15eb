"""Ensemble MCMC over a few parameters and many latent standard normal variables.

The target of walker w is ``p_w(theta, z) = pi_w(theta, z) N(z; 0, I)``; ``theta`` has up to about
twenty dimensions and ``z`` many hundreds. Proposals for ``theta`` use the positions of other
walkers (differential evolution and snooker moves, which need more walkers than dimensions).
Proposals for ``z`` are preconditioned Crank-Nicolson steps, whose acceptance does not fall with the
dimension. Neither kind evaluates N(z): the first leaves ``z`` unchanged and the second is
reversible with respect to N(z). So only ``pi_w`` is evaluated.

A move of one walker is reversible with respect to its own target, whatever the positions of the
others. So walkers may have different targets: draws of a posterior over several models can move
together, each within its own model, and remain draws of that posterior. The more alike the models
are, the higher the acceptance.

References
----------
Foreman-Mackey, Hogg, Lang & Goodman 2013, PASP 125, 306 (emcee).
ter Braak 2006, Stat. Comput. 16, 239 (differential evolution).
ter Braak & Vrugt 2008, Stat. Comput. 18, 435 (snooker).
Cotter, Roberts, Stuart & White 2013, Stat. Sci. 28, 424 (preconditioned Crank-Nicolson).
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar, Final, NamedTuple

import numpy as np
from emcee import EnsembleSampler, State
from emcee.moves import MHMove, RedBlueMove
from emcee.moves.move import Move
from numpy.typing import ArrayLike, NDArray

from imapper_prob.samplers.chains import Report

__all__ = [
    "CrankNicolson",
    "DifferentialEvolution",
    "Ensemble",
    "Snooker",
    "can_walk",
    "walk_ensemble",
]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
LogDensity = Callable[[Array, Array, Ints], Array]


class Ensemble(NamedTuple):
    """State of an ensemble of W walkers.

    Parameters
    ----------
    theta : (W, D) float
    latent : (W, Z) float
    log_density : (W,) float
        ``log pi``, without N(z).
    steps : int
        Number of steps made.
    acceptance : dict of str to float
        Acceptance rate by move; NaN for a move that was never tried.
    """

    theta: Array
    latent: Array
    log_density: Array
    steps: int
    acceptance: dict[str, float]


def _fewest_walkers(n_theta: int) -> int:
    """Least number of walkers: half of them must span the space, and snooker uses three."""
    return max(2 * n_theta, 8)


def can_walk(theta: Array) -> bool:
    """Whether there are enough walkers, and they span the parameter space.

    Parameters
    ----------
    theta : (W, D) float

    Returns
    -------
    bool
    """
    n_walkers, n_theta = theta.shape
    if n_walkers < _fewest_walkers(n_theta):
        return False
    spread = theta.std(0)
    if not (spread > 0).all():
        return False
    return bool(np.linalg.matrix_rank((theta - theta[0]) / spread) == n_theta)


def walk_ensemble(
    log_density_fn: LogDensity,
    theta: ArrayLike,
    latent: ArrayLike,
    *,
    steps: int,
    rng: np.random.Generator,
    report: Report | None = None,
) -> Ensemble:
    """Move walkers so that each one's target distribution is preserved.

    Parameters
    ----------
    log_density_fn : callable
        ``(theta (w, D), z (w, Z), walker (w,)) -> log pi (w,)`` for some of the walkers, given by
        index; -inf outside the support.
    theta : (W, D) float
        Starting positions; W is at least 8 and at least 2 D, better more.
    latent : (W, Z) float
        Starting values of ``z``; Z may be 0.
    steps : int
        Number of steps; in each, every walker tries one move.
    rng : numpy.random.Generator
    report : callable, optional
        Called with the completed share, 0 to 1; returns whether to continue.

    Returns
    -------
    Ensemble

    Raises
    ------
    ValueError
        Starts have the wrong shape, are too few, lie in a subspace, or have a density that is not
        finite.
    """
    theta, latent = np.asarray(theta, float), np.asarray(latent, float)
    if theta.ndim != 2 or latent.ndim != 2 or len(theta) != len(latent):
        raise ValueError(f"starts must be (W, D) and (W, Z), not {theta.shape} and {latent.shape}")
    n_walkers, n_theta = theta.shape
    if not can_walk(theta):
        raise ValueError(
            f"{n_theta} parameters need at least {_fewest_walkers(n_theta)} walkers that are not "
            f"all in a subspace, which they could not leave; there are {n_walkers}"
        )
    # emcee does not pass a walker's index, so the index is a coordinate that no move changes.
    numbers = np.arange(n_walkers, dtype=float)[:, None]
    coordinates = np.concatenate([theta, latent, numbers], axis=1)
    chosen = _moves(n_theta, latent.shape[1])

    def density(x: Array) -> Array:
        return log_density_fn(x[:, :n_theta], x[:, n_theta:-1], x[:, -1].astype(np.int64))

    sampler = EnsembleSampler(*coordinates.shape, density, moves=chosen, vectorize=True)
    # Without the wrapper of emcee, which prints a traceback on any exception, an interrupt as well.
    sampler.log_prob_fn = density
    # emcee seeds itself from numpy's global state unless told otherwise.
    sampler.random_state = np.random.MT19937(int(rng.integers(2**63))).state
    log_density, _ = sampler.compute_log_prob(coordinates)
    if not np.isfinite(log_density).all():
        bad = int(np.count_nonzero(~np.isfinite(log_density)))
        raise ValueError(f"{bad} walkers start where the log density is not finite")
    state, done = State(coordinates, log_prob=log_density), 0
    # `can_walk` has checked that theta spans its space; the check of emcee would include z.
    for done, at in enumerate(
        sampler.sample(state, iterations=steps, store=False, skip_initial_state_check=True), 1
    ):
        state = at
        if report is not None and not report(done / steps):
            break
    return Ensemble(
        theta=state.coords[:, :n_theta].copy(),
        latent=state.coords[:, n_theta:-1].copy(),
        log_density=np.array(state.log_prob),
        steps=done,
        acceptance={move.name: move.rate for move, _ in chosen},
    )


def _moves(n_theta: int, n_latent: int) -> list[tuple[Any, float]]:
    """Moves and the probability of trying each."""
    moves: list[tuple[Any, float]] = [
        (DifferentialEvolution(n_theta, jump_between_modes=_JUMPS), 0.6),
        (Snooker(n_theta), 0.15),
    ]
    if n_latent:
        moves.append((CrankNicolson(n_theta), 0.25))
    return moves


# ------------------------------------------------------------------------------------------------
# Moves in emcee's protocol. The coordinates are `theta`, then `z`, then the walker's index.

_FACTOR_SPREAD: Final = 0.01
"""Relative standard deviation of the differential-evolution factor (Nelson, Ford & Payne 2013, ApJS
210, 11); with a constant factor walkers would stay on a lattice."""
_JUMPS: Final = 0.1
"""Share of differential-evolution proposals with factor 1, as in ter Braak 2006."""
_SNOOKER_FACTOR: Final = 1.7
"""Scale of the snooker step, as recommended by ter Braak & Vrugt."""
_LEAST_LATENT_STEP: Final = 0.02
"""The step of the latent variables is drawn between this and 1, uniformly in the logarithm. A
chosen value: the best step depends on how well the path is known, so it is not tuned."""


class _Counted(Move):  # type: ignore[misc]
    """A move that counts its proposals and acceptances."""

    name: ClassVar[str]
    proposed = 0
    accepted = 0

    def propose(self, model: Any, state: Any) -> tuple[Any, NDArray[np.bool_]]:
        state, accepted = super().propose(model, state)
        self.proposed += accepted.size
        self.accepted += int(accepted.sum())
        return state, accepted

    @property
    def rate(self) -> float:
        """Acceptance rate; NaN before the first proposal."""
        return self.accepted / self.proposed if self.proposed else float("nan")


class _ThetaMove(_Counted, RedBlueMove):  # type: ignore[misc]
    """A move that proposes `theta` of half the walkers from the other half; `z` is unchanged.

    emcee asks for twice as many walkers as coordinates, because such moves never leave the subspace
    that the walkers span. Here only the space of `theta` counts, whatever the number of latent
    variables; hence ``live_dangerously``.
    """

    def __init__(self, n_theta: int) -> None:
        super().__init__(live_dangerously=True)
        self.n_theta = n_theta

    def get_proposal(self, s: Array, c: list[Array], random: Any) -> tuple[Array, Array]:
        """Proposed coordinates of walkers ``s`` and log proposal ratios, given walkers ``c``."""
        theta, others = s[:, : self.n_theta], np.concatenate(c)[:, : self.n_theta]
        moved, log_ratio = self.move(theta, others, random)
        return np.concatenate([moved, s[:, self.n_theta :]], axis=1), log_ratio

    @abstractmethod
    def move(self, theta: Array, others: Array, random: Any) -> tuple[Array, Array]:
        """Proposed `theta` (w, D) and log proposal ratios (w,), given other walkers (v, D)."""


class DifferentialEvolution(_ThetaMove):
    """Adds a multiple of the difference of two other walkers.

    Parameters
    ----------
    n_theta : int
        D, the number of leading coordinates.
    jump_between_modes : float
        Share of proposals with factor 1, which can jump from one mode to another.
    """

    name = "differential evolution"

    def __init__(self, n_theta: int, *, jump_between_modes: float) -> None:
        super().__init__(n_theta)
        self.jump_between_modes = jump_between_modes

    def move(self, theta: Array, others: Array, random: Any) -> tuple[Array, Array]:
        """Propose new positions; the proposal is symmetric.

        Parameters
        ----------
        theta : (w, D) float
            Walkers to move.
        others : (v, D) float
            Walkers that are used for the proposal.
        random : numpy.random.RandomState
            The generator of emcee.

        Returns
        -------
        theta : (w, D) float
        log_ratio : (w,) float
            Zeros.
        """
        first, second = _distinct(len(others), len(theta), 2, random)
        factor = 2.38 / np.sqrt(2 * self.n_theta) * np.ones(len(theta))
        factor[random.rand(len(theta)) < self.jump_between_modes] = 1
        factor *= 1 + _FACTOR_SPREAD * random.randn(len(theta))
        return theta + factor[:, None] * (others[first] - others[second]), np.zeros(len(theta))


class Snooker(_ThetaMove):
    """Moves along the line to another walker, by the projected difference of two others.

    This class replaces the move of emcee 3.1, which does not leave the target invariant: emcee
    divides by the root of the distance instead of the distance, and its Jacobian is too small (in
    five dimensions it gives a standard normal target a variance of 0.69).

    Parameters
    ----------
    n_theta : int
        D, the number of leading coordinates.
    """

    name = "snooker"

    def move(self, theta: Array, others: Array, random: Any) -> tuple[Array, Array]:
        """Propose new positions; the ratio is the Jacobian (r'/r)^(D-1) of polar coordinates.

        Parameters
        ----------
        theta, others, random
            See :meth:`DifferentialEvolution.move`.

        Returns
        -------
        theta : (w, D) float
        log_ratio : (w,) float
        """
        anchor, first, second = others[_distinct(len(others), len(theta), 3, random)]
        distance = np.linalg.norm(theta - anchor, axis=1)
        # Two walkers at the same position define no line; such a proposal is rejected.
        apart = distance > 0
        distance[~apart] = 1.0
        direction = (theta - anchor) / distance[:, None]
        shift = _SNOOKER_FACTOR * np.sum((first - second) * direction, axis=1)
        far = np.abs(distance + shift)
        ratio = np.log(far, out=np.full(len(far), -np.inf), where=apart & (far > 0))
        ratio -= np.log(distance)
        return theta + shift[:, None] * direction, (self.n_theta - 1) * ratio


class CrankNicolson(_Counted, MHMove):  # type: ignore[misc]
    """Proposes ``z' = sqrt(1 - b^2) z + b N(0, I)``, reversible with respect to N(0, I).

    Each walker draws its own step b between 0.02 and 1.

    Parameters
    ----------
    n_theta : int
        D, the number of leading coordinates, which stay the same.
    """

    name = "latent"

    def __init__(self, n_theta: int) -> None:
        super().__init__(self.move)
        self.n_theta = n_theta

    def move(self, coordinates: Array, random: Any) -> tuple[Array, Array]:
        """Propose new ``z``; log ratios are 0, because the target is a density relative to N(z).

        Parameters
        ----------
        coordinates : (w, D + Z + 1) float
        random : numpy.random.RandomState
            The generator of emcee.

        Returns
        -------
        coordinates : (w, D + Z + 1) float
        log_ratio : (w,) float
            Zeros.
        """
        moved = coordinates.copy()
        latent = moved[:, self.n_theta : -1]
        step = _LEAST_LATENT_STEP ** random.rand(len(moved), 1)
        latent *= np.sqrt(1 - step**2)
        latent += step * random.standard_normal(latent.shape)
        return moved, np.zeros(len(moved))


def _distinct(n: int, size: int, count: int, random: Any) -> NDArray[np.intp]:
    """(count, size) indices below n; the ``count`` indices of each walker differ."""
    return np.argsort(random.rand(size, n), axis=1)[:, :count].T
