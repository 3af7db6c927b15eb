"""Placements of one assignment by ensembles of walkers: a second road to the same posterior.

Given which scenelet starts when, camera, body scale and placements are a few dozen smooth
dimensions, with the latent numbers of the path behind them. Walkers live in (bearing, log
depth, yaw, log size), where the posterior is nearly Gaussian; the density carries the Jacobian.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imapper_prob.config import SampleSettings
from imapper_prob.models.brief import brief
from imapper_prob.models.incremental import log_posterior_near
from imapper_prob.models.posterior import State, empty_state
from imapper_prob.models.problem import Problem
from imapper_prob.models.view import log_area, to_floor, to_view
from imapper_prob.samplers.diagnostics import rhat_nested
from imapper_prob.samplers.ensemble import EnsembleSettings, run_ensembles

__all__ = ["PlacementDraws", "from_theta", "is_complete", "sample_placements", "to_theta"]

Array = NDArray[np.float64]

_SPREAD = np.array([0.004, 0.02, 0.05])
"""Spread of the walkers' starts in bearing, log metres and radians."""
_CAMERA_SPREAD = _SIZE_SPREAD = 0.2
"""The same for the nuisance parameters, in standard deviations of their prior."""

_KEPT = 20
"""Draws kept of each walker: neighbouring ones say the same."""


@dataclass(frozen=True)
class PlacementDraws:
    """What the ensembles of one assignment visited.

    Parameters
    ----------
    items : (k, 2) int
        Scenelet and start frame.
    camera : (E, n, W, 5) float
        Pitch, elevation, log focal scale, log body scale, roll.
    placements : (E, n, W, k, 3) float
        x, y in metres, yaw in radians.
    sizes : (E, n, W, k) float
        Log size of the person in each scenelet.
    rhat : (5 + 4 k,) float
        Nested R-hat of camera, then bearing, log depth, yaw and log size of each scenelet.
    acceptance : dict of str to float
        Accepted share by move.
    """

    items: NDArray[np.int64]
    camera: Array
    placements: Array
    sizes: Array
    rhat: Array
    acceptance: dict[str, float]

    __repr__ = brief


def to_theta(state: State) -> Array:
    """(5 + 4 k,) camera, then bearing, log depth, yaw and log size of each scenelet."""
    return np.concatenate([state.camera, to_view(state.placements, state.sizes).ravel()])


def from_theta(theta: Array) -> tuple[Array, Array, Array]:
    """Camera (..., 5), placements (..., k, 3), sizes (..., k) of ``theta`` (..., 5 + 4 k)."""
    return theta[..., :5], *to_floor(theta[..., 5:].reshape(*theta.shape[:-1], -1, 4))


@dataclass(frozen=True)
class _Target:
    """Log density of (theta, z) for one assignment, many walkers at a time."""

    problem: Problem
    items: NDArray[np.int64]

    def __call__(self, theta: Array, latent: Array) -> Array:
        camera, placements, sizes = from_theta(theta)
        shape = (len(theta), self.problem.n_frames, 2)
        path = latent.reshape(shape)
        # Each walker has a camera of its own, so that nothing is left of the scene gone on from.
        value = log_posterior_near(self.problem, empty_state(self.problem))
        values = [
            value(State(camera[w], self.items, placements[w], sizes[w], path[w]))
            for w in range(len(theta))
        ]
        density: Array = np.array(values) + log_area(theta[:, 6::4].sum(1))
        return density


def _schedule(settings: SampleSettings) -> tuple[int, int]:
    """Steps that are thrown away, as many of which draws are kept, and steps between draws."""
    half = settings.ensemble_steps // 2
    return half, max(1, half // _KEPT)


def is_complete(draws: PlacementDraws, settings: SampleSettings) -> bool:
    """Whether the ensembles walked to their end."""
    half, thin_by = _schedule(settings)
    return int(draws.camera.shape[1]) == half // thin_by


def sample_placements(
    problem: Problem,
    state: State,
    settings: SampleSettings,
    *,
    seed: np.random.SeedSequence,
    workers: int = 1,
    scratch: Path | None = None,
) -> PlacementDraws:
    """Ensembles around ``state``, its assignment held fixed.

    Interrupted, they have fewer draws, see `is_complete`.
    """
    start_seed, run_seed = seed.spawn(2)
    rng = np.random.default_rng(start_seed)
    centre = to_theta(state)
    camera_spread = _CAMERA_SPREAD / np.sqrt(np.diag(problem.camera_precision))
    placed_spread = np.append(_SPREAD, _SIZE_SPREAD * problem.size_spread)
    spread = np.concatenate([camera_spread, np.tile(placed_spread, state.n_scenelets)])
    walkers = 2 * len(centre) + 2
    shape = (settings.ensembles, walkers)
    theta = centre + spread * rng.standard_normal((*shape, len(centre)))
    latent = rng.standard_normal((*shape, 2 * problem.n_frames))
    half, thin_by = _schedule(settings)
    draws = run_ensembles(
        _Target(problem, state.items),
        theta,
        latent,
        seed=run_seed,
        settings=EnsembleSettings(
            burn_in=half, n_draws=half // thin_by, thin_by=thin_by, keep_latent=False
        ),
        workers=workers,
        scratch=scratch,
    )
    camera, placements, sizes = from_theta(draws.theta)
    return PlacementDraws(
        items=state.items,
        camera=camera,
        placements=placements,
        sizes=sizes,
        rhat=rhat_nested(draws.theta),
        acceptance={name: float(rates.mean()) for name, rates in draws.acceptance.items()},
    )
