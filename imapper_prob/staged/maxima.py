"""Charness over the clip, and its maxima: when something was probably interacted with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from imapper_prob.staged.fit import Fits

__all__ = ["CharnessCurve", "MaximaSettings", "charness_curve"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class MaximaSettings:
    """Parameters
    ----------
    temperature : float
        Nats per joint; a fit worse than the window's best by this has 1/e of its say.
    smoothing : float
        Standard deviation in windows (2.5 in the paper).
    minimum : float
        Smallest charness of a maximum: between the medians of walking windows (.09) and of
        reaching ones (.29) on i3DB. (.3 in the authors' code, with categories of their own.)
    apart : float
        Seconds between maxima, about the length of a scenelet.
    most : int
        How many maxima to keep (1 to 5 in the paper).
    """

    temperature: float = 0.1
    smoothing: float = 2.5
    minimum: float = 0.2
    apart: float = 1.6
    most: int = 12


@dataclass(frozen=True)
class CharnessCurve:
    """Charness by window, and the windows that stand out.

    Parameters
    ----------
    centres : (W,) int
        Middle frames of the windows.
    values : (W,) float
        Smoothed charness in [0, 1].
    maxima : (M,) int
        Indices of windows, the most characteristic first.
    """

    centres: Ints
    values: Array
    maxima: Ints


def charness_curve(
    fits: Fits, charness: Array, *, fps: float, settings: MaximaSettings | None = None
) -> CharnessCurve:
    """Charness of the best fits weighted by match quality, smoothed, maxima thinned out."""
    settings = settings or MaximaSettings()
    known = np.isfinite(fits.cost).any(1)
    raw = np.zeros(len(fits.centres))
    for w in np.flatnonzero(known):
        cost = fits.cost[w]
        weight = np.exp(-(cost - cost.min()) / settings.temperature)
        raw[w] = float(weight @ charness / weight.sum())
    if known.any():
        # A window without detections takes the charness of those around it.
        raw = np.interp(np.arange(len(raw)), np.flatnonzero(known), raw[known])
    values = gaussian_filter1d(raw, settings.smoothing, mode="nearest")
    chosen: list[int] = []
    for w in np.argsort(-values, kind="stable"):
        if values[w] < settings.minimum or len(chosen) == settings.most:
            break
        gaps = np.abs(fits.centres[w] - fits.centres[chosen])
        if np.all(gaps >= settings.apart * fps):
            chosen.append(int(w))
    return CharnessCurve(fits.centres, values, np.array(chosen, dtype=np.int64))
