"""Moves of what is known of camera and body, phi; of most, the scenelets go along."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.sampling.jit import compiled
from imapper_prob.sampling.looks import reprojected
from imapper_prob.sampling.scene import Scene

__all__ = ["scale_depth", "scale_focal", "walk_adapted", "walk_camera", "walk_compensated"]

Array = NDArray[np.float64]

_SCALES: Final = (0.1, 0.4, 1.2)
"""Steps in standard deviations of the prior; chosen."""
_ADAPTED: Final = (0.35, 1.0)
"""Steps in those of the posterior: about 2.4 over the root of the number of coordinates, the best
for a Gaussian of this shape (Roberts, Gelman & Gilks 1997), and a third of that for where it
bends."""
_DEPTH: Final = (0.01, 0.04)
"""Steps in log distance; chosen."""
_FOCAL: Final = (0.2, 0.8)
"""Steps in standard deviations of the log focal length in the prior; chosen."""


@compiled
def _stepped(
    scales: tuple[float, ...], factor: Array, rng: np.random.Generator, camera: Array
) -> Array:
    """A normal step of a shape, at one of several scales."""
    scale = scales[rng.integers(0, len(scales))]
    z, there = rng.standard_normal(len(camera)), camera.copy()
    for i in range(len(camera)):
        for j in range(i + 1):
            there[i] += scale * factor[i, j] * z[j]
    return there


@compiled
def walk_camera(factor: Array, rng: np.random.Generator, scene: Scene) -> tuple[Scene, float]:
    """Camera and body alone, a step of their prior's shape; symmetric.

    Parameters
    ----------
    factor : (5, 5) float
        Lower Cholesky factor of the prior's covariance.
    rng : numpy.random.Generator
    scene : Scene

    Returns
    -------
    Scene, float
    """
    camera = _stepped(_SCALES, factor, rng, scene.camera)
    return Scene(camera, scene.items, scene.placements, scene.sizes, scene.latent), 0.0


@compiled
def _compensated(heights: Array, scene: Scene, camera: Array) -> tuple[Scene, float]:
    """Another camera, through which every scenelet looks as before."""
    everything = np.ones(len(scene.items), np.bool_)
    placements, sizes, ratio = reprojected(heights, scene, scene.camera, camera, everything)
    if math.isnan(ratio):
        return scene, -math.inf
    return Scene(camera, scene.items, placements, sizes, scene.latent), ratio


@compiled
def walk_compensated(
    factor: Array, heights: Array, rng: np.random.Generator, scene: Scene
) -> tuple[Scene, float]:
    """The same step, and every scenelet stands where it looks as before.

    A camera that looks lower has everything nearer, what is far off most of all: with the camera
    alone or all depths by one factor that is never reached. Each scenelet keeps the image of its
    pelvis and the size of its person there, so the Jacobian is the product of what
    (x, y, log size) are of a look, new over old (:mod:`imapper_prob.sampling.looks`).

    Parameters
    ----------
    factor : (5, 5) float
    heights : (L,) float
        :func:`imapper_prob.sampling.looks.middle_heights`.
    rng : numpy.random.Generator
    scene : Scene

    Returns
    -------
    Scene, float
    """
    return _compensated(heights, scene, _stepped(_SCALES, factor, rng, scene.camera))


@compiled
def walk_adapted(
    shape: Array, heights: Array, rng: np.random.Generator, scene: Scene
) -> tuple[Scene, float]:
    """The same, with the shape that camera and body have in the posterior, as far as it is known.

    What the clip says of height, pitch and body is a ridge far narrower than the prior.

    Parameters
    ----------
    shape : (5, 5) float
        Lower Cholesky factor of the covariance.
    heights : (L,) float
    rng : numpy.random.Generator
    scene : Scene

    Returns
    -------
    Scene, float
    """
    return _compensated(heights, scene, _stepped(_ADAPTED, shape, rng, scene.camera))


@compiled
def scale_depth(rng: np.random.Generator, scene: Scene) -> tuple[Scene, float]:
    """Body scale, camera height and the distance of everything together.

    A larger body further away, seen from higher up, looks the same; without this move the
    largest uncertainty of the problem would be crossed in many small steps. The camera's
    elevation and (x, y) of k placements grow by e^d, so the Jacobian is e^((2 k + 1) d).

    Parameters
    ----------
    rng : numpy.random.Generator
    scene : Scene

    Returns
    -------
    Scene, float
    """
    step = _DEPTH[rng.integers(0, len(_DEPTH))] * rng.standard_normal()
    camera, placements = scene.camera.copy(), scene.placements.copy()
    camera[1] *= math.exp(step)
    camera[3] += step
    placements[:, :2] *= math.exp(step)
    changed = Scene(camera, scene.items, placements, scene.sizes, scene.latent)
    return changed, (2 * len(placements) + 1) * step


@compiled
def scale_focal(spread: float, rng: np.random.Generator, scene: Scene) -> tuple[Scene, float]:
    """Focal length and the depth of everything together.

    Seen through a longer lens and from further away things look the same but for perspective,
    which says little. Where the focal length was assumed this is most of the doubt of depth.
    The tangent of the pitch shrinks, so that the horizon stays where it was; the angle is small
    and stands for it. Depths y of k placements grow by e^d and the pitch shrinks by it, so the
    Jacobian is e^((k - 1) d).

    Parameters
    ----------
    spread : float
        Standard deviation of the log focal length in the prior.
    rng : numpy.random.Generator
    scene : Scene

    Returns
    -------
    Scene, float
    """
    step = spread * _FOCAL[rng.integers(0, len(_FOCAL))] * rng.standard_normal()
    camera, placements = scene.camera.copy(), scene.placements.copy()
    camera[0] *= math.exp(-step)
    camera[2] += step
    placements[:, 1] *= math.exp(step)
    changed = Scene(camera, scene.items, placements, scene.sizes, scene.latent)
    return changed, (len(placements) - 1) * step
