"""Charness over the clip, and its maxima: when something was probably interacted with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from imapper_prob.staged.fit import Fits

__all__ = ["CharnessCurve", "MaximaSettings", "Peak", "charness_curve"]

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
class Peak:
    """A local maximum of charness, and what became of it.

    Parameters
    ----------
    window : int
    charness : float
    dropped : str
        Why it is no maximum of the clip; empty if it is one.
    """

    window: int
    charness: float
    dropped: str


@dataclass(frozen=True)
class CharnessCurve:
    """Charness by window, and the windows that stand out.

    Parameters
    ----------
    centres : (W,) int
        Middle frames of the windows.
    raw : (W,) float
        Charness of each window's best fits in [0, 1]; NaN in windows without detections.
    values : (W,) float
        The same, bridged where it is unknown, and smoothed.
    maxima : (M,) int
        Indices of windows, the most characteristic first.
    peaks : tuple of Peak
        All maxima, and the local maxima that suppression dropped, in order of time.
    """

    centres: Ints
    raw: Array
    values: Array
    maxima: Ints
    peaks: tuple[Peak, ...]

    @property
    def step(self) -> int:
        """Frames from one window to the next; 1 if there is only one."""
        return int(np.diff(self.centres[:2]).sum()) or 1


def charness_curve(
    fits: Fits,
    charness: Array,
    *,
    fps: float,
    settings: MaximaSettings | None = None,
    bare: NDArray[np.bool_] | None = None,
) -> CharnessCurve:
    """Charness of the best fits weighted by match quality, smoothed, maxima thinned out.

    Parameters
    ----------
    fits : Fits
    charness : (L,) float
        Of the library's scenelets.
    fps : float
    settings : MaximaSettings, optional
    bare : (T,) bool, optional
        Frames without a static skeleton. Windows about these are maxima, too, whatever their
        charness, where no maximum is near: the set T' of the paper. None if not given.
    """
    settings = settings or MaximaSettings()
    known: NDArray[np.bool_] = np.any(np.isfinite(fits.cost), axis=1)
    raw = np.full(len(fits.centres), np.nan)
    for w in np.flatnonzero(known):
        cost = fits.cost[w]
        weight = np.exp(-(cost - cost.min()) / settings.temperature)
        raw[w] = float(weight @ charness / weight.sum())
    bridged = np.zeros(len(raw))
    if known.any():
        # A window without detections takes the charness of those around it.
        bridged = np.interp(np.arange(len(raw)), np.flatnonzero(known), raw[known])
    values = gaussian_filter1d(bridged, settings.smoothing, mode="nearest")
    chosen: list[int] = []
    dropped: dict[int, str] = {}
    for w in np.argsort(-values, kind="stable").tolist():
        if not known[w]:
            dropped[w] = "no scenelet could be fitted"
            continue
        if values[w] < settings.minimum:
            dropped[w] = f"charness below {settings.minimum:g}"
            continue
        near = np.abs(fits.centres[w] - fits.centres[chosen]) < settings.apart * fps
        if near.any():
            stronger = fits.centres[chosen[int(near.argmax())]]
            dropped[w] = f"within {settings.apart:g} s of the maximum at frame {stronger}"
        elif len(chosen) == settings.most:
            dropped[w] = f"{settings.most} maxima are higher"
        else:
            chosen.append(w)
    if bare is not None:
        # Windows that are long enough for some scenelet, whether or not anything was detected.
        forced = bare[fits.centres] & (fits.placements[..., 1] > 0).any(1)
        for w in np.argsort(-values, kind="stable").tolist():
            near = np.abs(fits.centres[w] - fits.centres[chosen]) < settings.apart * fps
            if forced[w] and not near.any() and len(chosen) < settings.most:
                chosen.append(w)
                dropped.pop(w, None)
    peaks = tuple(
        Peak(w, float(values[w]), dropped.get(w, ""))
        for w in range(len(values))
        if w in chosen or _stands_out(values, w)
    )
    return CharnessCurve(fits.centres, raw, values, np.array(chosen, dtype=np.int64), peaks)


def _stands_out(values: Array, window: int) -> bool:
    """Whether a window is above the one before and not below the one after it."""
    before = values[window - 1] if window > 0 else -np.inf
    after = values[window + 1] if window + 1 < len(values) else -np.inf
    return bool(before < values[window] >= after)
