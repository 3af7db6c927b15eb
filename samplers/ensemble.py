"""Ensembles of walkers over a few parameters, with many latent normal numbers behind them.

The target is ``p(theta, z) = pi(theta, z) N(z; 0, I)`` with ``theta`` of perhaps twenty
dimensions and ``z`` of many hundreds. Walkers learn the shape of ``theta`` from each other
(differential evolution and snooker moves, which need more walkers than dimensions);
``z`` moves by the preconditioned Crank-Nicolson proposal, whose acceptance does not
deteriorate with dimension. Neither kind needs N(z): the first leaves ``z`` alone and the
second is reversible with respect to it, so that only ``pi`` is ever evaluated.

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
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from emcee import EnsembleSampler, State
from emcee.moves import MHMove, RedBlueMove
from emcee.moves.move import Move
from numpy.typing import ArrayLike, NDArray

from imapper_prob.samplers.chains import OnProgress, Report, Workers, run_chains

__all__ = [
    "CrankNicolson",
    "DifferentialEvolution",
    "EnsembleSettings",
    "Snooker",
    "run_ensembles",
]

Array = NDArray[np.float64]
LogDensity = Callable[[Array, Array], Array]


@dataclass(frozen=True)
class EnsembleSettings:
    """How the moves are mixed and how long they run.

    Parameters
    ----------
    burn_in, n_draws, thin_by : int
        Steps that are thrown away while the step of ``z`` adapts; draws that are kept; steps
        between them.
    differential_evolution, snooker, latent : float
        Weights of the moves; without latent coordinates the last does not count.
    jump_between_modes : float
        Share of differential-evolution steps with factor 1, which lead from one mode to
        another (ter Braak 2006 takes every tenth).
    latent_step : float
        First step of the Crank-Nicolson move, in (0, 1].
    keep_latent : bool
        Whether draws of ``z`` are wanted; they are nearly all of the memory.
    """

    burn_in: int = 1000
    n_draws: int = 1000
    thin_by: int = 1
    differential_evolution: float = 0.6
    snooker: float = 0.15
    latent: float = 0.25
    jump_between_modes: float = 0.1
    latent_step: float = 0.2
    keep_latent: bool = True


class EnsembleDraws(NamedTuple):
    """What the ensembles visited.

    Parameters
    ----------
    theta : (E, n, W, D) float
    latent : (E, n, W, Z) float
        Of no coordinates where they were not wanted.
    log_density : (E, n, W) float
        ``log pi``, N(z) not included.
    acceptance : dict of str to (E,) float
        Accepted share by move, after burn-in.
    """

    theta: Array
    latent: Array
    log_density: Array
    acceptance: dict[str, Array]


def run_ensembles(
    log_density_fn: LogDensity,
    theta: ArrayLike,
    latent: ArrayLike,
    *,
    seed: int | np.random.SeedSequence,
    settings: EnsembleSettings | None = None,
    workers: int | Workers = 1,
    on_progress: OnProgress | None = None,
    scratch: Path | None = None,
) -> EnsembleDraws:
    """Run independent ensembles; at least four let nested R-hat judge them.

    Parameters
    ----------
    log_density_fn : callable
        ``(theta (w, D), z (w, Z)) -> log pi (w,)``; -inf outside the support.
    theta : (E, W, D) float
        Starts: E ensembles of W walkers, W at least 8 and 2 D, better more.
    latent : (E, W, Z) float
        Starts of ``z``; Z may be 0.
    seed : int or numpy.random.SeedSequence
    settings : EnsembleSettings, optional
    workers, on_progress, scratch
        See `imapper_prob.samplers.chains.run_chains`; progress is (steps done, steps).

    Returns
    -------
    EnsembleDraws
        Of an interrupted run as many draws as every ensemble has.

    Raises
    ------
    ValueError
        Starts of the wrong shape, too few walkers, walkers in a subspace, or a start
        where the density is not finite.

    Notes
    -----
    All draws are kept in memory, 8 E n W (D + Z) bytes, or 8 E n W D without ``keep_latent``.
    """
    theta, latent = np.asarray(theta, float), np.asarray(latent, float)
    if theta.ndim != 3 or latent.ndim != 3 or theta.shape[:2] != latent.shape[:2]:
        raise ValueError(
            f"starts must be (E, W, D) and (E, W, Z), not {theta.shape} and {latent.shape}"
        )
    for index, walkers in enumerate(theta):
        _check_walkers(walkers, index)
    runs = run_chains(
        _run_one,
        (log_density_fn, settings or EnsembleSettings()),
        list(zip(theta, latent, strict=True)),
        seed=seed,
        workers=workers,
        on_progress=on_progress,
        scratch=scratch,
    )
    n = min(len(run.log_density) for run in runs)
    return EnsembleDraws(
        theta=np.stack([run.theta[:n] for run in runs]),
        latent=np.stack([run.latent[:n] for run in runs]),
        log_density=np.stack([run.log_density[:n] for run in runs]),
        acceptance={
            name: np.array([run.acceptance[name] for run in runs]) for name in runs[0].acceptance
        },
    )


def _check_walkers(walkers: Array, index: int) -> None:
    n_walkers, n_theta = walkers.shape
    if n_walkers < max(2 * n_theta, 8):
        # The half that is looked at must span the space, and snooker looks at three of it.
        raise ValueError(
            f"ensemble {index}: {n_theta} parameters need at least {max(2 * n_theta, 8)} "
            f"walkers, not {n_walkers}"
        )
    if len(np.unique(walkers, axis=0)) < n_walkers:
        raise ValueError(f"ensemble {index}: two walkers start at the same place")
    spread = walkers.std(0)
    if not np.all(spread > 0) or np.linalg.matrix_rank((walkers - walkers[0]) / spread) < n_theta:
        raise ValueError(f"ensemble {index}: the walkers start in a subspace and cannot leave it")


def _run_one(
    problem: tuple[LogDensity, EnsembleSettings],
    start: tuple[Array, Array],
    rng: np.random.Generator,
    report: Report,
) -> EnsembleDraws:
    log_density_fn, settings = problem
    n_theta = start[0].shape[1]
    coordinates = np.concatenate(start, axis=1)
    moves = _moves(settings, n_theta, coordinates.shape[1] - n_theta)
    sampler = EnsembleSampler(
        *coordinates.shape,
        lambda x: log_density_fn(x[:, :n_theta], x[:, n_theta:]),
        moves=moves,
        vectorize=True,
    )
    # emcee seeds itself from numpy's global state unless told otherwise.
    sampler.random_state = np.random.MT19937(int(rng.integers(2**63))).state
    log_density, _ = sampler.compute_log_prob(coordinates)
    if not np.isfinite(log_density).all():
        bad = int(np.count_nonzero(~np.isfinite(log_density)))
        raise ValueError(f"{bad} walkers start where the log density is not finite")

    state = State(coordinates, log_prob=log_density)
    total = settings.burn_in + settings.n_draws * settings.thin_by
    # `_check_walkers` has seen to theta; the check of emcee would look at z as well.
    options = {"store": False, "skip_initial_state_check": True}
    burn_in = sampler.sample(state, iterations=settings.burn_in, tune=True, **options)
    for done, at in enumerate(burn_in, 1):
        state = at
        if not report((done, total)):
            break
    for move, _ in moves:
        move.reset()
    n_kept = coordinates.shape[1] if settings.keep_latent else n_theta
    draws = np.zeros((settings.n_draws, len(coordinates), n_kept))
    log_densities = np.zeros((settings.n_draws, len(coordinates)))
    n = 0
    kept = sampler.sample(state, iterations=settings.n_draws, thin_by=settings.thin_by, **options)
    for n, at in enumerate(kept, 1):
        # emcee changes its state in place: what is kept must be a copy.
        draws[n - 1], log_densities[n - 1] = at.coords[:, :n_kept], at.log_prob
        if not report((settings.burn_in + n * settings.thin_by, total)):
            break
    return EnsembleDraws(
        theta=draws[:n, :, :n_theta],
        latent=draws[:n, :, n_theta:],
        log_density=log_densities[:n],
        acceptance={move.name: np.asarray(move.rate) for move, _ in moves},
    )


def _moves(settings: EnsembleSettings, n_theta: int, n_latent: int) -> list[tuple[Any, float]]:
    moves: list[tuple[Any, float]] = [
        (
            DifferentialEvolution(n_theta, jump_between_modes=settings.jump_between_modes),
            settings.differential_evolution,
        ),
        (Snooker(n_theta), settings.snooker),
    ]
    if n_latent:
        moves.append((CrankNicolson(n_theta, step=settings.latent_step), settings.latent))
    return moves


# ------------------------------------------------------------------------------------------------
# Moves, by emcee's protocol. The leading coordinates are `theta`, the others `z`.


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
        """Propose new places; the proposal is symmetric.

        Parameters
        ----------
        theta : (w, D) float
            Walkers that move.
        others : (v, D) float
            Walkers that are looked at.
        random : numpy.random.RandomState
            Of emcee.

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
    """Moves along the line to another walker, by the projected difference of two more.

    The move of emcee 3.1 does not leave the target invariant: it divides by the root of the
    distance instead of the distance, and its Jacobian is too small (in five dimensions the variance
    of a normal target comes out at 0.69).

    Parameters
    ----------
    n_theta : int
        D, the number of leading coordinates.
    """

    name = "snooker"

    def move(self, theta: Array, others: Array, random: Any) -> tuple[Array, Array]:
        """Propose new places; the ratio is the Jacobian (r'/r)^(D-1) of polar coordinates.

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
        """New coordinates and log ratios 0: the target is a density relative to N(z).

        Parameters
        ----------
        coordinates : (w, D + Z) float
        random : numpy.random.RandomState
            Of emcee.

        Returns
        -------
        coordinates : (w, D + Z) float
        log_ratio : (w,) float
            Zeros.
        """
        moved = coordinates.copy()
        latent = moved[:, self.n_theta :]
        latent *= np.sqrt(1 - self.step**2)
        latent += self.step * random.standard_normal(latent.shape)
        return moved, np.zeros(len(moved))

    def tune(self, state: Any, accepted: NDArray[np.bool_]) -> None:
        """Lengthen the step where too much is accepted, and shorten it where too little.

        Parameters
        ----------
        state : emcee.State
            Not looked at.
        accepted : (w,) bool
        """
        self.tunings += 1
        change = (accepted.mean() - _ACCEPTANCE_GOAL) / self.tunings**_ADAPTATION_DECAY
        self.step = min(1.0, self.step * float(np.exp(change)))


def _distinct(n: int, size: int, count: int, random: Any) -> NDArray[np.intp]:
    """(count, size): for each walker ``count`` different indices below n."""
    return np.argsort(random.rand(size, n), axis=1)[:, :count].T
