"""Conversion between floor coordinates and camera-centred coordinates of a scenelet.

On the floor a scenelet has a placement (x, y, yaw), and its person a log size. Seen from the
camera, the same is (bearing, log depth, yaw, log size), called *where* for short, with

    bearing = x / y,   log depth = log y,   |d(x, y) / d(bearing, log depth)| = y^2.

Nearly all uncertainty of a position lies along the viewing ray and is relative to the distance, so
fits, steps and Gaussians have the same size near and far in these coordinates. They exist only
ahead of the camera, y > 0. They refer to the floor and do not depend on the camera's pitch or
elevation.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.jit import inlined

__all__ = ["floor_point", "log_area", "seen_point", "to_floor", "to_view"]

Array = NDArray[np.float64]


@inlined
def seen_point(x: float, y: float) -> tuple[float, float]:
    """Bearing and log depth of a point on the floor, or in camera axes, compiled.

    Parameters
    ----------
    x, y : float
        To the right and ahead, metres; y > 0.

    Returns
    -------
    bearing, log_depth : float
        Tangent, and log metres.
    """
    return x / y, math.log(y)


@inlined
def floor_point(bearing: float, log_depth: float) -> tuple[float, float]:
    """The inverse of :func:`seen_point`, compiled.

    Parameters
    ----------
    bearing, log_depth : float
        Tangent, and log metres.

    Returns
    -------
    x, y : float
        Metres.
    """
    y = math.exp(log_depth)
    return bearing * y, y


@inlined
def log_area(log_depth: float) -> float:
    """log |d(x, y) / d(bearing, log depth)|, compiled.

    Parameters
    ----------
    log_depth : float
        Log metres.

    Returns
    -------
    float
        Log square metres.
    """
    return 2.0 * log_depth


def to_view(placements: ArrayLike, sizes: ArrayLike) -> Array:
    """Convert placements and log sizes to (bearing, log depth, yaw, log size).

    Parameters
    ----------
    placements : (..., 3) float
        x, y in metres and yaw in radians; the result is NaN unless y > 0.
    sizes : (...) float
        Log sizes.

    Returns
    -------
    (..., 4) float
        Bearing (tangent), log depth (log m), yaw (radians) and log size.
    """
    placements = np.asarray(placements, float)
    where = np.empty((*placements.shape[:-1], 4))
    where[..., 0] = placements[..., 0] / placements[..., 1]
    where[..., 1] = np.log(placements[..., 1])
    where[..., 2] = placements[..., 2]
    where[..., 3] = sizes
    return where


def to_floor(where: ArrayLike) -> tuple[Array, Array]:
    """Convert (bearing, log depth, yaw, log size) to placements and log sizes.

    Parameters
    ----------
    where : (..., 4) float
        Bearing (tangent), log depth (log m), yaw (radians), log size.

    Returns
    -------
    placements : (..., 3) float
        x, y (m), yaw (rad).
    sizes : (...) float
        Log sizes.
    """
    where = np.asarray(where, float)
    placements = np.empty((*where.shape[:-1], 3))
    placements[..., 1] = y = np.exp(where[..., 1])
    placements[..., 0] = where[..., 0] * y
    placements[..., 2] = where[..., 2]
    return placements, where[..., 3].copy()
