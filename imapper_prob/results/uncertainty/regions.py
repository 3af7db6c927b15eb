"""The smallest ellipse of a given shape on the floor that holds a share of the draws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Region", "region_of"]

Array = NDArray[np.float64]

_FINEST = 0.001
"""Metres; no position is known better, and draws that all agree still have a region."""


@dataclass(frozen=True)
class Region:
    """An ellipse on the floor.

    Parameters
    ----------
    centre : (2,) float
        Metres.
    half_axes : (2,) float
        Metres, the shorter first.
    angle : float
        Direction of the first half axis, radians from x towards y.
    """

    centre: Array
    half_axes: Array
    angle: float

    def holds(self, points: ArrayLike) -> NDArray[np.bool_]:
        """(n,) bool, which of some points (n, 2) lie in it, its edge included."""
        c, s = np.cos(self.angle), np.sin(self.angle)
        local = (np.asarray(points, float) - self.centre) @ np.array([[c, -s], [s, c]])
        inside: NDArray[np.bool_] = ((local / self.half_axes) ** 2).sum(-1) <= 1 + 1e-9
        return inside


def region_of(points: ArrayLike, share: float) -> Region:
    """The ellipse about the mean, shaped as the covariance, that holds a share of the points.

    Its size is a quantile of the points themselves. The usual chi-square quantile would hold
    that share of a normal distribution only, and where furniture stands is seldom normal.

    Parameters
    ----------
    points : (n, 2) float
        Metres; at least one.
    share : float
        Between 0 and 1.
    """
    points = np.asarray(points, float)
    centre = points.mean(0)
    offset = points - centre
    covariance = offset.T @ offset / len(points) + _FINEST**2 * np.eye(2)
    variances, axes = np.linalg.eigh(covariance)
    distance = (((offset @ axes) ** 2) / variances).sum(1)
    reach = max(float(np.quantile(distance, share, method="higher")), 1.0e-6)
    half_axes = np.maximum(np.sqrt(reach * variances), _FINEST)
    return Region(centre, half_axes, float(np.arctan2(axes[1, 0], axes[0, 0])))
