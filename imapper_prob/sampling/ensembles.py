"""Improve the draws of chains by ensemble MCMC (emcee) of camera, placements and path.

Successive draws of a chain have similar cameras and placements, because most of its steps change
scenelets. Here the draws of a chain with equally many scenelets become the walkers of an ensemble.
Each walker keeps its own scenelets and start frames. Camera, body and placements are a few dozen
smooth dimensions, and the latent variables of the path come in addition. A draw of the posterior
remains one (:mod:`imapper_prob.samplers.ensemble`), and becomes less correlated with the draws
before it in the chain.

Walkers move in (bearing, log depth, yaw, log size), in which the posterior is nearly Gaussian; the
density includes the Jacobian.

The ensemble has the same target with other moves and other code. If means change by more than the
Monte-Carlo error, the chains had not converged.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.kernels.cache import open_evaluator
from imapper_prob.models.kernels.incremental import NOWHERE
from imapper_prob.models.log_posterior import State
from imapper_prob.models.path_prior import CAMERA
from imapper_prob.models.problem import Problem
from imapper_prob.models.text import brief
from imapper_prob.models.view import log_area, to_floor, to_view
from imapper_prob.samplers.chains import Report, Workers, run_chains
from imapper_prob.samplers.diagnostics import ShortChainWarning, ess, mean_error, rhat
from imapper_prob.samplers.ensemble import Ensemble, can_walk, walk_ensemble
from imapper_prob.sampling.scene import arrays_of
from imapper_prob.sampling.steps import log_posteriors

__all__ = ["QUANTITIES", "EnsembleRefinement", "describe_refinement", "refine_draws"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

QUANTITIES: Final = ("log_posterior", *CAMERA, "log_depth", "log_size")
"""Compared quantities; the last two are means over the scenelets of a draw."""
_ERRORS: Final = 3.5
"""Tolerated change of a mean in standard errors; by chance, one in 250 comparisons of eight
quantities exceeds it."""


@dataclass(frozen=True)
class EnsembleRefinement:
    """The effect of the ensembles on the draws.

    Parameters
    ----------
    walkers : int
        Number of moved draws; for the others, too few draws have as many scenelets.
    steps : int
        Steps of each walker.
    acceptance : dict of str to float
        Acceptance rate by move.
    change : (8,) float
        Change of the means of ``QUANTITIES``, in standard deviations of the chains' draws.
    error : (8,) float
        Monte-Carlo standard error of ``change``, in the same unit.
    before, after : (8,) float
        Effective number of draws before and after.
    rhat : (8,) float
        R-hat of the moved draws.
    """

    walkers: int
    steps: int
    acceptance: dict[str, float]
    change: Array
    error: Array
    before: Array
    after: Array
    rhat: Array

    __repr__ = brief

    @property
    def agrees(self) -> bool:
        """Whether no mean changes by significantly more than the Monte-Carlo error."""
        return not (np.abs(self.change) > _ERRORS * self.error).any()


def refine_draws(
    problem: Problem,
    states: Sequence[State],
    values: Array,
    steps: int,
    *,
    seed: np.random.SeedSequence,
    workers: int | Workers = 1,
    scratch: Path | None = None,
    on_progress: Callable[[float], None] | None = None,
) -> tuple[tuple[State, ...], Array, EnsembleRefinement]:
    """Move the draws of chains in ensembles; each draw keeps its scenelets.

    Parameters
    ----------
    problem : Problem
    states : sequence of C N State
        Draws of C chains, chain by chain.
    values : (C, N) float
        Log-posteriors of the draws, nats.
    steps : int
        Number of steps; in each, every walker tries one move.
    seed : numpy.random.SeedSequence
    workers : int or Workers
        Number of processes.
    scratch : Path, optional
        Folder for temporary files of the processes.
    on_progress : callable, optional
        Called with the completed share of all steps.

    Returns
    -------
    states : tuple of C N State
    values : (C, N) float
    EnsembleRefinement
    """
    groups = _groups(states, values.shape)
    done = np.zeros(len(groups))
    sizes = np.array([len(group) for group in groups], float)

    def report(group: int, part: object) -> None:
        done[group] = part if isinstance(part, float) else 0.0
        if on_progress is not None:
            on_progress(float(done @ sizes / sizes.sum()))

    arrived = run_chains(
        _refine_group,
        (problem, steps),
        [tuple(states[n] for n in group) for group in groups],
        seed=seed,
        workers=workers,
        on_progress=report,
        scratch=scratch,
        restarts=1,
    )
    moved, new_values = list(states), values.ravel().copy()
    for group, ensemble in zip(groups, arrived, strict=True):
        camera, placements, sizes_of = _from_theta(ensemble.theta)
        for w, n in enumerate(group):
            path = ensemble.latent[w].reshape(problem.n_frames, 2)
            moved[n] = State(camera[w], states[n].items, placements[w], sizes_of[w], path)
            new_values[n] = ensemble.log_density[w] - log_area(ensemble.theta[w, 6::4].sum())
    new = new_values.reshape(values.shape)
    first, second = _quantities(states, values), _quantities(moved, new)
    with warnings.catch_warnings():
        # The verdict reports chains that are too short.
        warnings.simplefilter("ignore", ShortChainWarning)
        refinement = _compared(groups, arrived, first, second)
    return tuple(moved), new, refinement


def describe_refinement(refinement: EnsembleRefinement | None) -> str:
    """A sentence on whether chains and ensembles agree.

    Parameters
    ----------
    refinement : EnsembleRefinement or None

    Returns
    -------
    str
    """
    if refinement is None or not refinement.walkers:
        return "No draws walked in ensembles: too few have as many scenelets as others."
    first = f"Ensembles of emcee moved {refinement.walkers} draws by {refinement.steps} steps each"
    known = np.isfinite(refinement.error)
    if not known.any():
        return f"{first}; so few draws cannot be held against those of the chains."
    errors = np.abs(refinement.change[known]) / np.maximum(
        refinement.error[known], np.finfo(float).tiny
    )
    worst = np.flatnonzero(known)[errors.argmax()]
    said = (
        f"the mean of {QUANTITIES[worst].replace('_', ' ')} changes by "
        f"{abs(refinement.change[worst]):.2f} standard deviations, ± {refinement.error[worst]:.2f}"
    )
    if not refinement.agrees:
        return f"{first} and do not agree with the chains, which have not arrived: {said}."
    return (
        f"{first} and agree with the chains: {said}. R-hat of {len(QUANTITIES)} numbers is then "
        f"{np.nanmax(refinement.rhat):.2f} or less, with {np.nanmin(refinement.after):.0f} "
        f"effective draws or more ({np.nanmin(refinement.before):.0f} before)."
    )


# ------------------------------------------------------------------------------------------------
# Groups of walkers, and their coordinates.


def _groups(states: Sequence[State], shape: tuple[int, ...]) -> list[Ints]:
    """Indices of a chain's draws with equally many scenelets, if enough to form an ensemble."""
    together: dict[tuple[int, int], list[int]] = {}
    for n, state in enumerate(states):
        together.setdefault((n // shape[1], state.n_scenelets), []).append(n)
    groups = [np.array(group) for group in together.values()]
    return [group for group in groups if can_walk(_to_theta([states[n] for n in group]))]


def _refine_group(
    problem: tuple[Problem, int],
    states: tuple[State, ...],
    rng: np.random.Generator,
    report: Report,
) -> Ensemble:
    """One ensemble, as a task for a worker process."""
    target = _Target(problem[0], states)
    latent = np.stack([state.latent.ravel() for state in states])
    return walk_ensemble(
        target, _to_theta(states), latent, steps=problem[1], rng=rng, report=report
    )


def _to_theta(states: Sequence[State]) -> Array:
    """(W, 5 + 4 k) camera, then bearing, log depth, yaw and log size of each scenelet."""
    where = [to_view(state.placements, state.sizes).ravel() for state in states]
    return np.concatenate([np.stack([s.camera for s in states]), np.stack(where)], axis=1)


def _from_theta(theta: Array) -> tuple[Array, Array, Array]:
    """Camera (W, 5), placements (W, k, 3), sizes (W, k) of ``theta`` (W, 5 + 4 k)."""
    return theta[:, :5].copy(), *to_floor(theta[:, 5:].reshape(len(theta), -1, 4))


class _Target:
    """Log density of (theta, z); each walker has its own scenelets."""

    def __init__(self, problem: Problem, states: Sequence[State]) -> None:
        self._published = problem.paper_nats if problem.of_paper else None
        self._anywhere = arrays_of(states[0])
        self._items = np.stack([state.items for state in states])
        self._evaluator = open_evaluator(problem, max(1, self._items.shape[1]))
        self._path = (problem.n_frames, 2)

    def __call__(self, theta: Array, latent: Array, walker: Ints) -> Array:
        camera, placements, sizes = _from_theta(theta)
        # Each walker has its own camera, so no evaluation can reuse another one's values.
        values = log_posteriors(
            self._evaluator, self._published, NOWHERE, self._anywhere, camera, self._items[walker],
            np.ascontiguousarray(placements), np.ascontiguousarray(sizes),
            np.ascontiguousarray(latent).reshape(-1, *self._path), False,
        )  # fmt: skip
        density: Array = values + [log_area(depths) for depths in theta[:, 6::4].sum(1)]
        return density


# ------------------------------------------------------------------------------------------------
# Comparison of draws before and after.


def _quantities(states: Sequence[State], values: Array) -> Array:
    """(8, C, N) values of ``QUANTITIES``; means over no scenelets are 0."""
    rows = []
    for state in states:
        where = to_view(state.placements, state.sizes)
        depth, size = where[:, [1, 3]].mean(0) if len(where) else (0.0, 0.0)
        rows.append([*state.camera, depth, size])
    others = np.array(rows).T.reshape(len(QUANTITIES) - 1, *values.shape)
    return np.concatenate([values[None], others])


def _compared(
    groups: Sequence[Ints], arrived: Sequence[Ensemble], before: Array, after: Array
) -> EnsembleRefinement:
    spread = np.maximum(before.std((1, 2)), np.finfo(float).tiny)
    return EnsembleRefinement(
        walkers=sum(map(len, groups)),
        steps=min((ensemble.steps for ensemble in arrived), default=0),
        acceptance=_rates(arrived),
        change=(after - before).mean((1, 2)) / spread,
        error=np.array([float(mean_error(row)) for row in after - before]) / spread,
        before=np.array([float(ess(row)) for row in before]),
        after=np.array([float(ess(row)) for row in after]),
        rhat=np.array([float(rhat(row)) for row in after]),
    )


def _rates(arrived: Sequence[Ensemble]) -> dict[str, float]:
    """Acceptance rates, averaged over ensembles with the number of walkers as weight."""
    names = sorted({name for ensemble in arrived for name in ensemble.acceptance})
    found = {}
    for name in names:
        tried = [
            (ensemble.acceptance[name], len(ensemble.theta))
            for ensemble in arrived
            if np.isfinite(ensemble.acceptance.get(name, np.nan))
        ]
        if tried:
            rates, weights = np.transpose(tried)
            found[name] = float(np.average(rates, weights=weights))
    return found
