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
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from emcee import EnsembleSampler, State
from numpy.typing import ArrayLike, NDArray

from imapper_prob.samplers.chains import OnProgress, Report, run_chains
from imapper_prob.samplers.ensemble_moves import CrankNicolson, DifferentialEvolution, Snooker

__all__ = ["EnsembleDraws", "EnsembleSettings", "LogDensity", "run_ensembles"]

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
    workers: int = 1,
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

    Raises
    ------
    ValueError
        Starts of the wrong shape, too few walkers, walkers in a subspace, or a start
        where the density is not finite.

    Notes
    -----
    An interrupted run returns as many draws as every ensemble has. All draws are kept in
    memory, 8 E n W (D + Z) bytes, or 8 E n W D without ``keep_latent``.
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
