"""States of a scene in Eryn's form, and a proposal density of one scenelet.

Eryn's state is a set of leaves, vectors of equal length. A scenelet becomes (x, y, yaw, log size,
scenelet + u, start + v) with u and v anywhere in [0, 1): cells of volume one, so that a density
over leaves is the density over scenelets. The camera is a branch with one leaf. The latent
variables of the path are fixed at zero for both samplers: the target is the scene posterior given z
= 0.

Eryn's births from a density p and its deaths leave invariant a uniform p(k) and, given k, the
density k! p(x_1) ... p(x_k) of a *set* of leaves. The likelihood passed to Eryn is therefore pi(s)
/ (k! p(x_1) ... p(x_k) p(camera)), which makes its target pi for any p.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled
from imapper_prob.models.kernels.cache import open_evaluator
from imapper_prob.models.kernels.incremental import NOWHERE, change
from imapper_prob.models.log_posterior import State, empty_state
from imapper_prob.models.problem import Problem

__all__ = [
    "AllLeaves", "CameraDensity", "LeafDensity", "SceneLikelihood", "log_posteriors",
    "to_leaves", "to_state",
]  # fmt: skip

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

ANYWHERE = 0.05
"""Weight of the mixture component without candidates, as in the project's own births."""
OUTSIDE = -1e300
"""Log likelihood of impossible states; Eryn does not accept minus infinity."""
SPREADS = np.array([[0.003, 0.03, 0.1], [0.015, 0.06, 0.3]])
"""Spreads of a candidate in bearing, log depth and yaw, as in the project's own births."""


def to_leaves(state: State) -> Array:
    """(k, 6) leaves of a state, in the middle of their cells, yaw in [0, 2 pi)."""
    leaves = np.column_stack([state.placements, state.sizes, state.items + 0.5])
    leaves[:, 2] %= 2 * math.pi
    return leaves


def to_state(problem: Problem, leaves: Array, camera: Array) -> State:
    """The state of (k, 6) leaves in any order and a camera."""
    items = np.floor(leaves[:, -2:]).astype(np.int64)
    order = np.argsort(items[:, 1], kind="stable")
    latent = empty_state(problem).latent
    return State(camera.copy(), items[order], leaves[order, :3], leaves[order, 3], latent)


@compiled
def log_posteriors(problem: Problem, cameras: Array, leaves: Array, first: Ints) -> Array:
    """(n,) log-posterior of states whose leaves are ``leaves[first[i]:first[i + 1]]``."""
    n_frames = len(problem.lift)
    latent = np.zeros((n_frames, 2))
    result = np.empty(len(cameras))
    for i in range(len(cameras)):
        own = leaves[first[i] : first[i + 1]]
        own = own[np.argsort(own[:, -1])]
        items = np.empty((len(own), 2), dtype=np.int64)
        for k in range(len(own)):
            items[k, 0], items[k, 1] = math.floor(own[k, -2]), math.floor(own[k, -1])
        placements, sizes = np.ascontiguousarray(own[:, :3]), own[:, 3].copy()
        evaluator = open_evaluator(problem, len(own))
        prior, likelihood = change(
            evaluator, NOWHERE, cameras[i], latent, cameras[i], items, placements, sizes, latent
        )
        result[i] = prior + likelihood
    return result


@dataclass(frozen=True)
class CameraDensity:
    """The model's prior of the camera without the limits of its support."""

    mean: Array
    precision: Array

    def logpdf(self, cameras: Array) -> Array:
        """Log density of (n, C) cameras."""
        off = cameras - self.mean
        constant = np.linalg.slogdet(self.precision / (2 * math.pi))[1]
        return np.asarray(0.5 * constant - 0.5 * np.einsum("ni,ij,nj->n", off, self.precision, off))

    def rvs(self, size: int | tuple[int, ...] = 1) -> Array:
        """Draw cameras from numpy's global generator, which Eryn's moves use."""
        return np.random.multivariate_normal(  # noqa: NPY002
            self.mean, np.linalg.inv(self.precision), size=size
        )


@dataclass(frozen=True)
class LeafDensity:
    """A normalised mixture over leaves: scenelets by their gains, blurred, and a broad component.

    Parameters
    ----------
    items : (C, 2) int
        Scenelet and start of the candidates; if empty, only the broad component remains.
    centres : (C, 3) float
        Their bearing, log depth and yaw.
    weights : (C,) float
        Their probabilities.
    last_start : (L,) int
        The last frame at which each scenelet can start.
    start_mean, start_spread : (2,) float
        Bearing and log depth of the broad component.
    size_spread : float
        Standard deviation of the log size, drawn from its prior; larger people are placed further
        away.
    """

    items: Ints
    centres: Array
    weights: Array
    last_start: Ints
    start_mean: Array
    start_spread: Array
    size_spread: float

    @classmethod
    def of(cls, problem: Problem, items: Ints, placements: Array, weights: Array) -> LeafDensity:
        """Make the density around candidates' placements (C, 3) with positive weights (C,)."""
        x, y, yaw = placements.T[:3]
        return cls(
            items,
            np.stack([x / y, np.log(y), yaw], -1),
            weights / weights.sum() if len(weights) else weights,
            problem.n_frames - problem.lengths,
            problem.start_mean,
            np.sqrt(problem.start_variance),
            problem.size_spread,
        )

    def without_candidates(self) -> LeafDensity:
        """The broad component alone."""
        return replace(
            self, items=self.items[:0], centres=self.centres[:0], weights=self.weights[:0]
        )

    @property
    def anywhere(self) -> float:
        """Probability of the broad component."""
        return ANYWHERE if len(self.weights) else 1.0

    def logpdf(self, leaves: Array) -> Array:
        """Log density of (n, 6) leaves; yaw in [0, 2 pi)."""
        return _log_mixture(
            np.ascontiguousarray(leaves), self.items, self.centres, self.weights,
            self.last_start, self.start_mean, self.start_spread, self.size_spread,
            self.anywhere, SPREADS,
        )  # fmt: skip

    def rvs(self, size: int | tuple[int, ...] = 1) -> Array:
        """Draw leaves from numpy's global generator, which Eryn's moves use."""
        n = int(np.prod(size))
        scenelet = np.random.randint(len(self.last_start), size=n)  # noqa: NPY002
        start = np.floor(np.random.rand(n) * (self.last_start[scenelet] + 1))  # noqa: NPY002
        spread = np.tile([*self.start_spread, 0.0], (n, 1))
        centre = np.tile([*self.start_mean, 0.0], (n, 1))
        centre[:, 2] = 2 * math.pi * np.random.rand(n)  # noqa: NPY002
        known = np.random.rand(n) >= self.anywhere  # noqa: NPY002
        if known.any():
            which = np.random.choice(len(self.weights), known.sum(), p=self.weights)  # noqa: NPY002
            scenelet[known], start[known] = self.items[which].T
            centre[known] = self.centres[which]
            spread[known] = SPREADS[np.random.randint(len(SPREADS), size=known.sum())]  # noqa: NPY002
        ray = centre + spread * np.random.randn(n, 3)  # noqa: NPY002
        log_size = self.size_spread * np.random.randn(n)  # noqa: NPY002
        depth = np.exp(ray[:, 1] + known * log_size)
        cells = np.stack([scenelet, start], -1) + np.random.rand(n, 2)  # noqa: NPY002
        turn = ray[:, 2] % (2 * math.pi)
        leaves = np.column_stack([ray[:, 0] * depth, depth, turn, log_size, cells])
        return leaves.reshape((*np.atleast_1d(size), -1))


@compiled
def _log_normal(offset: float, spread: float) -> float:
    return -0.5 * (offset / spread) ** 2 - math.log(spread * math.sqrt(2 * math.pi))


@compiled
def _log_mixture(
    leaves: Array,
    items: Ints,
    centres: Array,
    weights: Array,
    last_start: Ints,
    start_mean: Array,
    start_spread: Array,
    size_spread: float,
    anywhere: float,
    spreads: Array,
) -> Array:
    result = np.full(len(leaves), -np.inf)
    for i in range(len(leaves)):
        x, y, yaw, size = leaves[i, 0], leaves[i, 1], leaves[i, 2], leaves[i, 3]
        scenelet, start = math.floor(leaves[i, -2]), math.floor(leaves[i, -1])
        possible = 0 <= scenelet < len(last_start) and 0 <= yaw < 2 * math.pi and y > 0
        if not possible or not 0 <= start <= last_start[scenelet]:
            continue
        bearing, log_depth = x / y, math.log(y)
        density = math.exp(
            _log_normal(bearing - start_mean[0], start_spread[0])
            + _log_normal(log_depth - start_mean[1], start_spread[1])
        ) * (anywhere / (len(last_start) * (last_start[scenelet] + 1) * 2 * math.pi))
        for c in range(len(weights)):
            if items[c, 0] != scenelet or items[c, 1] != start:
                continue
            turn = (yaw - centres[c, 2] + math.pi) % (2 * math.pi) - math.pi
            for across, along, around in spreads:
                density += (
                    (1 - anywhere)
                    * weights[c]
                    / len(spreads)
                    * math.exp(
                        _log_normal(bearing - centres[c, 0], across)
                        + _log_normal(log_depth - size - centres[c, 1], along)
                        + _log_normal(turn, around)
                    )
                )
        # |d(bearing, log depth) / d(x, y)| = 1 / y^2
        if density > 0:
            result[i] = math.log(density) - 2 * log_depth + _log_normal(size, size_spread)
    return result


class Density(Protocol):
    """A density of the leaves of one branch."""

    def logpdf(self, x: Array, /) -> Array:
        """Log density of (n, D) leaves."""


class AllLeaves:
    """The prior of all branches in one call; Eryn's own loops over the walkers.

    It is the prior of ordered leaves; Eryn's births and deaths account for their order.
    """

    key_order = None

    def __init__(self, densities: Mapping[str, Density]) -> None:
        self.densities = densities

    def logpdf(
        self, coords: Mapping[str, Array], inds: Mapping[str, NDArray[np.bool_]], **_: object
    ) -> Array:
        """(temperatures, walkers) log prior of the existing leaves."""
        total = np.zeros(next(iter(inds.values())).shape[:2])
        for name, density in self.densities.items():
            logs = np.zeros(inds[name].shape)
            logs[inds[name]] = density.logpdf(coords[name][inds[name]])
            total += logs.sum(-1)
        return total


@dataclass(frozen=True)
class SceneLikelihood:
    """The likelihood passed to Eryn: pi(s) / (k! p(x_1) ... p(x_k) p(camera))."""

    problem: Problem
    leaf: LeafDensity
    camera: CameraDensity

    def __call__(self, branches: Sequence[Array], groups: Sequence[Ints]) -> Array:
        """Log likelihood of n states, from leaves and cameras and the state index of each."""
        (leaves, cameras), (owner, number) = branches, groups
        cameras = cameras[np.argsort(number)]
        order = np.argsort(owner, kind="stable")
        leaves, owner = leaves[order], owner[order]
        count = np.bincount(owner, minlength=len(cameras))
        first = np.concatenate([[0], np.cumsum(count)])
        value = log_posteriors(self.problem, cameras, leaves, first)
        np.subtract.at(value, owner, self.leaf.logpdf(leaves))
        value -= self.camera.logpdf(cameras) + np.array([math.lgamma(k + 1) for k in count])
        return np.where(np.isfinite(value), value, OUTSIDE)
