"""Moves of one or a few scenelets, and of the latent path."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.view import floor_point, log_area, seen_point
from imapper_prob.sampling.jit import inner
from imapper_prob.sampling.reference import Reference, draw_summed
from imapper_prob.sampling.scene import StateArrays, flush_run

__all__ = ["refresh_path", "replace_similar", "shift", "walk_placement"]

Ints = NDArray[np.int64]

_REACH: Final = 4
"""Largest shift of a scenelet, frames; chosen."""
_SCALES: Final = (0.2, 1.0, 4.0)
"""Factors on the unit steps below; chosen: small steps near a narrow mode, large ones out of it."""
_BEARING, _LOG_DEPTH, _YAW = 0.006, 0.03, 0.08
"""Unit steps of a placement in bearing (tangent), log depth and yaw (radians), which are multiplied
by one of the scales; about the standard deviations of placements in chains of a simulated clip."""
_TURNED: Final = 0.05
"""Probability of an additional half turn; chosen."""
_STRETCH: Final = 60
"""Frames of the path that are refreshed together; chosen."""
_STRENGTHS: Final = (0.2, 1.0)
"""Step sizes of Crank-Nicolson proposals; 1 is independent of the old values. Chosen."""


@inner
def replace_similar(
    reference: Reference, rng: np.random.Generator, scene: StateArrays
) -> tuple[StateArrays, float]:
    """Replace a scenelet by one of similar motion, at the same placement and centre frame.

    Parameters
    ----------
    reference : Reference
        It has the weights of other scenelets.
    rng : numpy.random.Generator
    scene : StateArrays

    Returns
    -------
    StateArrays, float
    """
    if len(scene.items) == 0:
        return scene, -math.inf
    index = rng.integers(0, len(scene.items))
    old, lengths = scene.items[index, 0], reference.lengths
    similar_to, sums = reference.similar_to, reference.similar_sums
    others = sums[old, -1] - similar_to[old, old]
    if others <= 0.0:
        return scene, -math.inf
    new = old
    while new == old:
        new = reference.by_length[draw_summed(sums, old, len(lengths), rng)]
    items = scene.items.copy()
    items[index, 0] = new
    items[index, 1] += lengths[old] // 2 - lengths[new] // 2
    ratio = math.log(similar_to[old, new] / (sums[new, -1] - similar_to[new, new]))
    ratio -= math.log(similar_to[new, old] / others)
    return StateArrays(scene.camera, items, scene.placements, scene.sizes, scene.latent), ratio


@inner
def shift(lengths: Ints, rng: np.random.Generator, scene: StateArrays) -> tuple[StateArrays, float]:
    """Shift a scenelet by a few frames, alone or with those it is flush with.

    Where one scenelet ends as the next begins, the pose jumps only once, so separating them is
    costly. Symmetric.

    Parameters
    ----------
    lengths : (L,) int
    rng : numpy.random.Generator
    scene : StateArrays

    Returns
    -------
    StateArrays, float
    """
    if len(scene.items) == 0:
        return scene, -math.inf
    index = int(rng.integers(0, len(scene.items)))
    step = rng.integers(1, _REACH + 1) * (1 if rng.random() < 0.5 else -1)
    together = rng.random() < 0.5
    first, last = flush_run(lengths, scene.items, index)
    items = scene.items.copy()
    for k in range(first if together else index, last if together else index + 1):
        items[k, 1] += step
    # If the shifted run is flush with others, the reverse move would shift those too: impossible.
    if together and flush_run(lengths, items, index) != (first, last):
        return scene, -math.inf
    return StateArrays(scene.camera, items, scene.placements, scene.sizes, scene.latent), 0.0


@inner
def walk_placement(rng: np.random.Generator, scene: StateArrays) -> tuple[StateArrays, float]:
    """Move one scenelet along and across the viewing ray, and turn it.

    Steps are normal in (bearing, log depth, yaw), at one of several scales, sometimes with half a
    turn. The Jacobian of (x, y) is (y' / y)^2. Half of the steps also scale the person with the
    depth, so that the apparent size stays the same.

    Parameters
    ----------
    rng : numpy.random.Generator
    scene : StateArrays

    Returns
    -------
    StateArrays, float
    """
    if len(scene.items) == 0:
        return scene, -math.inf
    index = rng.integers(0, len(scene.items))
    x, y, yaw = scene.placements[index]
    if y <= 0.0:
        return scene, -math.inf
    scale = _SCALES[rng.integers(0, len(_SCALES))]
    bearing, log_depth = seen_point(x, y)
    further = scale * _LOG_DEPTH * rng.standard_normal()
    bearing += scale * _BEARING * rng.standard_normal()
    yaw += scale * _YAW * rng.standard_normal()
    if rng.random() < _TURNED:
        yaw += math.pi
    placements, sizes = scene.placements.copy(), scene.sizes.copy()
    x, y = floor_point(bearing, log_depth + further)
    placements[index, 0], placements[index, 1], placements[index, 2] = x, y, yaw
    if rng.random() < 0.5:
        sizes[index] += further
    return StateArrays(scene.camera, scene.items, placements, sizes, scene.latent), log_area(
        further
    )


@inner
def refresh_path(rng: np.random.Generator, scene: StateArrays) -> tuple[StateArrays, float]:
    """Refresh the latent variables of a stretch of the path by preconditioned Crank-Nicolson.

    The proposal is reversible with respect to the normal distribution of these variables, which is
    the reference measure of the log-posterior, so the ratio is one (Cotter et al. 2013).

    Parameters
    ----------
    rng : numpy.random.Generator
    scene : StateArrays

    Returns
    -------
    StateArrays, float
    """
    first = int(rng.integers(1 - _STRETCH, len(scene.latent)))
    strength = _STRENGTHS[rng.integers(0, len(_STRENGTHS))]
    kept = math.sqrt(1.0 - strength**2)
    latent = scene.latent.copy()
    for t in range(max(first, 0), min(first + _STRETCH, len(latent))):
        for i in range(2):
            latent[t, i] = kept * latent[t, i] + strength * rng.standard_normal()
    return StateArrays(scene.camera, scene.items, scene.placements, scene.sizes, latent), 0.0
