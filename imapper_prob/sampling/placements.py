"""Placements of one assignment by emcee ensembles, and how far they agree with the chains.

Given which scenelet starts when, camera, body scale and placements are a few dozen smooth
dimensions, with the latent numbers of the path behind them. Walkers live in (bearing, log
depth, yaw, log size), where the posterior is nearly Gaussian; the density carries the Jacobian.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imapper_prob.config import SampleSettings
from imapper_prob.models.log_posterior import State, empty_state, log_posterior_near
from imapper_prob.models.problem import Problem
from imapper_prob.models.scenelet import Library
from imapper_prob.models.text import brief
from imapper_prob.models.view import log_area, to_floor, to_view
from imapper_prob.samplers.chains import Workers
from imapper_prob.samplers.diagnostics import rhat_nested
from imapper_prob.samplers.ensemble import EnsembleSettings, run_ensembles

__all__ = [
    "Agreement",
    "PlacementDraws",
    "compare",
    "describe_agreement",
    "is_complete",
    "sample_placements",
]

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
    """Whether the ensembles walked to their end.

    Parameters
    ----------
    draws : PlacementDraws
    settings : SampleSettings

    Returns
    -------
    bool
    """
    half, thin_by = _schedule(settings)
    return int(draws.camera.shape[1]) == half // thin_by


def sample_placements(
    problem: Problem,
    state: State,
    settings: SampleSettings,
    *,
    seed: np.random.SeedSequence,
    workers: int | Workers = 1,
    scratch: Path | None = None,
) -> PlacementDraws:
    """Ensembles around ``state``, its assignment held fixed.

    Interrupted, they have fewer draws, see `is_complete`.

    Parameters
    ----------
    problem : Problem
    state : State
    settings : SampleSettings
    seed : numpy.random.SeedSequence
    workers : int or Workers
        Processes.
    scratch : Path, optional
        Folder for what processes hand one another.

    Returns
    -------
    PlacementDraws
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


# ------------------------------------------------------------------------------------------------
# Two roads to one posterior: placements by jump chains and by ensembles of walkers.
#
# The ensembles hold one assignment fixed. Draws of the chains that have the very same
# assignment come from the same distribution of placements, by other moves and other code:
# where means and spreads differ by much, one of the two has not arrived yet.

_FEWEST = 20
"""Draws below which a spread is not worth comparing: it is known to 16 % with so many."""
_APART, _FACTOR = 0.5, 1.5
"""Differences that are worth a word: of means in standard deviations, of these as a factor."""


@dataclass(frozen=True)
class Agreement:
    """How well chains and ensembles agree on the objects of one assignment.

    Parameters
    ----------
    labels : tuple of n str
        Objects of its scenelets, unmerged, in order of time.
    difference : (n, 2) float
        Mean of the ensembles minus that of the chains in x and y, over the ensembles'
        standard deviation. NaN with too few draws.
    ratio : (n, 2) float
        Standard deviation of the chains over that of the ensembles.
    draws : int
        Draws of the chains with this assignment.
    """

    labels: tuple[str, ...]
    difference: Array
    ratio: Array
    draws: int


def compare(library: Library, draws: PlacementDraws, states: Sequence[State]) -> Agreement:
    """Hold the ensembles of an assignment against the chains' draws of it.

    Parameters
    ----------
    library : Library
    draws : PlacementDraws
    states : sequence of State
        Draws of the chains.

    Returns
    -------
    Agreement
    """
    same = [s.placements for s in states if np.array_equal(s.items, draws.items)]
    # An assignment may be empty; how many draws there are is then not to be had from the size.
    shape = draws.placements.shape
    walked = draws.placements.reshape(math.prod(shape[:-2]), *shape[-2:])
    jumped = np.array(same).reshape(len(same), *shape[-2:])
    labels, difference, ratio = [], [], []
    for index, scenelet in enumerate(draws.items[:, 0].tolist()):
        for o in library[scenelet].objects:
            first, second = (_centres(o.centre, p[:, index]) for p in (walked, jumped))
            labels.append(o.label)
            if len(same) < _FEWEST:
                difference.append(np.full(2, np.nan))
                ratio.append(np.full(2, np.nan))
                continue
            difference.append((first.mean(0) - second.mean(0)) / first.std(0))
            ratio.append(second.std(0) / first.std(0))
    by_object = (len(labels), 2)
    return Agreement(
        tuple(labels), np.reshape(difference, by_object), np.reshape(ratio, by_object), len(same)
    )


def describe_agreement(agreements: Sequence[Agreement]) -> str:
    """One line for a person: whether both roads arrive at the same place.

    Parameters
    ----------
    agreements : sequence of Agreement

    Returns
    -------
    str
    """
    known = [a for a in agreements if a.labels and a.draws >= _FEWEST]
    if not known:
        return (
            "Ensembles and chains cannot be compared: no chain stays with one assignment for "
            f"{_FEWEST} draws."
        )
    apart = max(float(np.abs(a.difference).max()) for a in known)
    ratios = np.concatenate([a.ratio.ravel() for a in known])
    alike = apart <= _APART and ratios.min() >= 1 / _FACTOR and ratios.max() <= _FACTOR
    counted = " and ".join(str(a.draws) for a in known)
    return (
        f"Ensembles and chains {'agree' if alike else 'do not agree yet'} on where objects stand: "
        f"means differ by up to {apart:.1f} standard deviations, which are {ratios.min():.1f} to "
        f"{ratios.max():.1f} times as large in the chains ({counted} draws)."
    )


def _centres(local: Array, placements: Array) -> Array:
    """(n, 2) where a point of the scenelet's frame lies in the world."""
    x, y, yaw = placements[:, :3].T
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack([x + c * local[0] - s * local[1], y + s * local[0] + c * local[1]], -1)
