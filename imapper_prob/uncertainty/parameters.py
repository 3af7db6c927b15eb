"""Camera and body parameters: prior compared with posterior."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.path_prior import CAMERA
from imapper_prob.models.text import brief

__all__ = ["CAMERA_UNITS", "Nuisance", "cells_of_parameter", "nuisances"]

Array = NDArray[np.float64]

CAMERA_UNITS: Mapping[str, str] = {
    "pitch": "rad",
    "elevation": "m",
    "log_focal_scale": "1",
    "log_body_scale": "1",
    "roll": "rad",
}
"""Unit of every parameter of the camera and the body."""
_SHOWN: Mapping[str, tuple[str, str, float]] = {
    "pitch": ("camera pitch", "°", 180 / np.pi),
    "roll": ("camera roll", "°", 180 / np.pi),
    "elevation": ("camera height", "m", 1.0),
    "log_focal_scale": ("log focal length", "%", 100.0),
    "log_body_scale": ("log stature", "%", 100.0),
}
"""Name and unit of each parameter in tables, and the factor to that unit from the model's unit."""


@dataclass(frozen=True)
class Nuisance:
    """One nuisance parameter with its prior and its posterior draws.

    Parameters
    ----------
    name : str
        See `imapper_prob.models.path_prior.CAMERA`.
    unit : str
    prior_mean, prior_standard_deviation : float
        Of the normal prior, which already includes the evidence of the feet.
    draws : (C, N) float
        Posterior draws.
    """

    name: str
    unit: str
    prior_mean: float
    prior_standard_deviation: float
    draws: Array

    __repr__ = brief

    @property
    def mean(self) -> float:
        """Posterior mean."""
        return float(self.draws.mean())

    @property
    def standard_deviation(self) -> float:
        """Posterior standard deviation."""
        return float(self.draws.std(ddof=1))

    @property
    def shift(self) -> float:
        """Shift of the mean, in prior standard deviations."""
        return (self.mean - self.prior_mean) / self.prior_standard_deviation

    @property
    def contraction(self) -> float:
        """1 - posterior variance / prior variance: by how much the variance is less.

        0 if the rest of the clip tells no more than the feet, 1 if it tells everything; negative if
        the posterior is wider than the prior.
        """
        return 1.0 - (self.standard_deviation / self.prior_standard_deviation) ** 2

    def interval(self, share: float) -> tuple[float, float]:
        """The central interval that holds a share of the draws.

        Parameters
        ----------
        share : float
            Between 0 and 1.

        Returns
        -------
        low, high : float
        """
        low, high = np.quantile(self.draws, ((1 - share) / 2, (1 + share) / 2))
        return float(low), float(high)


class ParameterCells(NamedTuple):
    """What tables say of a parameter.

    Parameters
    ----------
    name : str
    feet, everything : str
        Mean and standard deviation of prior and posterior, with their unit.
    contraction : str
        See :attr:`Nuisance.contraction`, per cent.
    """

    name: str
    feet: str
    everything: str
    contraction: str


def cells_of_parameter(one: Nuisance) -> ParameterCells:
    """Put a parameter into words for tables.

    Parameters
    ----------
    one : Nuisance

    Returns
    -------
    ParameterCells
    """
    title, unit, scale = _SHOWN[one.name]
    digits = 2 if unit == "m" else 1

    def told(mean: float, spread: float) -> str:
        return f"{scale * mean:.{digits}f} ± {scale * spread:.{digits}f} {unit}"

    return ParameterCells(
        name=title,
        feet=told(one.prior_mean, one.prior_standard_deviation),
        everything=told(one.mean, one.standard_deviation),
        contraction=f"{100 * one.contraction:.0f} %",
    )


def nuisances(draws: Array, *, mean: Array, covariance: Array) -> dict[str, Nuisance]:
    """All camera and body parameters by name.

    Parameters
    ----------
    draws : (C, N, 5) float
        In the order of `imapper_prob.models.path_prior.CAMERA`.
    mean, covariance : (5,), (5, 5) float
        Of the prior.

    Returns
    -------
    dict of str to Nuisance
    """
    spread = np.sqrt(np.diag(covariance))
    return {
        name: Nuisance(name, CAMERA_UNITS[name], float(mean[i]), float(spread[i]), draws[..., i])
        for i, name in enumerate(CAMERA)
    }
