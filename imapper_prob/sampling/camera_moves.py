"""Moves of the camera and body parameters phi; most of them also move the scenelets."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.sampling.image_pelvis import reproject_placements
from imapper_prob.sampling.jit import inner
from imapper_prob.sampling.scene import StateArrays

__all__ = ["scale_depth", "scale_focal", "walk_adapted", "walk_camera", "walk_compensated"]

Array = NDArray[np.float64]

_SCALES: Final = (0.1, 0.4, 1.2)
"""Step sizes in standard deviations of the prior; chosen."""
_ADAPTED: Final = (0.35, 1.0)
"""Step sizes in standard deviations of the posterior: about 2.4 over the root of the dimension,
which is optimal for a Gaussian (Roberts, Gelman & Gilks 1997), and a third of that, for where the
posterior is curved."""
_DEPTH: Final = (0.01, 0.04)
"""Step sizes in log distance; chosen."""
_FOCAL: Final = (0.2, 0.8)
"""Step sizes in prior standard deviations of the log focal length; chosen."""


@inner
def _stepped(
    scales: tuple[float, ...], factor: Array, rng: np.random.Generator, camera: Array
) -> Array:
    """Add a normal step with a given Cholesky factor, at one of several scales."""
    scale = scales[rng.integers(0, len(scales))]
    z, there = rng.standard_normal(len(camera)), camera.copy()
    for i in range(len(camera)):
        for j in range(i + 1):
            there[i] += scale * factor[i, j] * z[j]
    return there


@inner
def walk_camera(
    factor: Array, rng: np.random.Generator, scene: StateArrays
) -> tuple[StateArrays, float]:
    """Move camera and body alone, by a step with the prior's covariance; symmetric.

    Parameters
    ----------
    factor : (5, 5) float
        Lower Cholesky factor of the prior's covariance.
    rng : numpy.random.Generator
    scene : StateArrays

    Returns
    -------
    StateArrays, float
    """
    camera = _stepped(_SCALES, factor, rng, scene.camera)
    return StateArrays(camera, scene.items, scene.placements, scene.sizes, scene.latent), 0.0


@inner
def _compensated(heights: Array, scene: StateArrays, camera: Array) -> tuple[StateArrays, float]:
    """Change the camera, and move every scenelet so that its pelvis has the same image."""
    everything = np.ones(len(scene.items), np.bool_)
    placements, sizes, ratio = reproject_placements(
        heights, scene, scene.camera, camera, everything
    )
    if math.isnan(ratio):
        return scene, -math.inf
    return StateArrays(camera, scene.items, placements, sizes, scene.latent), ratio


@inner
def walk_compensated(
    factor: Array, heights: Array, rng: np.random.Generator, scene: StateArrays
) -> tuple[StateArrays, float]:
    """Move the camera by such a step, and every scenelet so that its pelvis has the same image.

    If the camera is tilted down, everything comes nearer, distant things most of all; moves of the
    camera alone or of all depths by one factor cannot do this. Each scenelet keeps the image of its
    pelvis and the apparent size of its person. So the Jacobian is the product, over scenelets, of
    that of (x, y, log size) with respect to the image pelvis, new over old
    (:mod:`imapper_prob.sampling.image_pelvis`).

    Parameters
    ----------
    factor : (5, 5) float
    heights : (L,) float
        :func:`imapper_prob.sampling.image_pelvis.middle_heights`.
    rng : numpy.random.Generator
    scene : StateArrays

    Returns
    -------
    StateArrays, float
    """
    return _compensated(heights, scene, _stepped(_SCALES, factor, rng, scene.camera))


@inner
def walk_adapted(
    shape: Array, heights: Array, rng: np.random.Generator, scene: StateArrays
) -> tuple[StateArrays, float]:
    """Like :func:`walk_compensated`, with the estimated posterior covariance of camera and body.

    In the posterior, elevation, pitch and body scale lie on a ridge much narrower than the prior.

    Parameters
    ----------
    shape : (5, 5) float
        Lower Cholesky factor of the covariance.
    heights : (L,) float
    rng : numpy.random.Generator
    scene : StateArrays

    Returns
    -------
    StateArrays, float
    """
    return _compensated(heights, scene, _stepped(_ADAPTED, shape, rng, scene.camera))


@inner
def scale_depth(rng: np.random.Generator, scene: StateArrays) -> tuple[StateArrays, float]:
    """Scale the body, the camera's elevation and all distances by one factor.

    A larger body farther away, seen from higher up, looks the same. Without this move the direction
    of largest uncertainty would be crossed in many small steps. The camera's elevation and (x, y)
    of k placements grow by e^d, so the Jacobian is e^((2 k + 1) d).

    Parameters
    ----------
    rng : numpy.random.Generator
    scene : StateArrays

    Returns
    -------
    StateArrays, float
    """
    step = _DEPTH[rng.integers(0, len(_DEPTH))] * rng.standard_normal()
    camera, placements = scene.camera.copy(), scene.placements.copy()
    camera[1] *= math.exp(step)
    camera[3] += step
    placements[:, :2] *= math.exp(step)
    changed = StateArrays(camera, scene.items, placements, scene.sizes, scene.latent)
    return changed, (2 * len(placements) + 1) * step


@inner
def scale_focal(
    spread: float, rng: np.random.Generator, scene: StateArrays
) -> tuple[StateArrays, float]:
    """Change the focal length and all depths together.

    Through a longer lens and from farther away things look the same except for perspective, which
    the detections hardly determine. If the focal length is not calibrated, it is the main
    uncertainty of depth. The pitch (a small angle, in place of its tangent) shrinks, so that the
    horizon stays where it is. Depths y of k placements grow by e^d and the pitch shrinks by it, so
    the Jacobian is e^((k - 1) d).

    Parameters
    ----------
    spread : float
        Prior standard deviation of the log focal length.
    rng : numpy.random.Generator
    scene : StateArrays

    Returns
    -------
    StateArrays, float
    """
    step = spread * _FOCAL[rng.integers(0, len(_FOCAL))] * rng.standard_normal()
    camera, placements = scene.camera.copy(), scene.placements.copy()
    camera[0] *= math.exp(-step)
    camera[2] += step
    placements[:, 1] *= math.exp(step)
    changed = StateArrays(camera, scene.items, placements, scene.sizes, scene.latent)
    return changed, (len(placements) - 1) * step
