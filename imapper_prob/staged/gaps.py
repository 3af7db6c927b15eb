"""Where a person was who is not detected for a while: they went on as people do.

Steps of a person are no coin tosses: who walks goes on walking for about a second. Bearing and log
depth have a velocity that is an Ornstein-Uhlenbeck process, and the path through a gap is what
that process expects, given the fitted path at both ends (a Kalman filter and the smoother of Rauch,
Tung and Striebel 1965). Its variance says how far off that may be: over two seconds it grows to
metres where steps that forget each other would leave it at a few decimetres.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.settings import StaticPathSettings
from imapper_prob.staged.path_fit import REFERENCE_RATE

__all__ = ["through_gaps"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_MEASURED_OVER = 0.2
"""Seconds over which the calibrated steps were measured, as if their halves were independent."""

_ANYWHERE = 2.0
"""Standard deviation of bearing and log depth of somebody nobody has seen yet."""


def through_gaps(
    place: Array, seen: Flags, *, settings: StaticPathSettings, fps: float
) -> tuple[Array, Array]:
    """The path through frames in which nobody is detected.

    Parameters
    ----------
    place : (T, 3) float
        Bearing, lift and log depth of the fitted path.
    seen : (T,) bool
        Frames with a detection; the others are filled in.
    settings : StaticPathSettings
    fps : float
        Frames a second.

    Returns
    -------
    place : (T, 3) float
        Height above the optical axis, lift times depth, goes on evenly.
    deviation : (T, 2) float
        Of bearing and log depth; 0 where somebody is detected.
    """
    filled, deviation = np.array(place), np.zeros((len(place), 2))
    if seen.all() or not seen.any():
        return filled, deviation
    steps = (settings.walk_bearing, settings.walk_log_depth)
    for k, (column, step) in enumerate(zip((0, 2), steps, strict=True)):
        mean, spread = _smoothed(
            place[:, column], seen, speed=_speed(step, settings.walk_time),
            time=settings.walk_time, noise=step, fps=fps,
        )  # fmt: skip
        filled[~seen, column] = mean[~seen]
        deviation[~seen, k] = spread[~seen]
    t = np.arange(len(place))
    height = place[:, 1] * np.exp(place[:, 2])
    height = np.interp(t, t[seen], height[seen])
    filled[~seen, 1] = height[~seen] / np.exp(filled[~seen, 2])
    return filled, deviation


def _speed(step: float, time: float) -> float:
    """Standard deviation of the velocity, units a second, of which a step was measured.

    ``step`` is that of 1 / 10 s if steps forgot each other.
    """
    moved = step**2 * _MEASURED_OVER * REFERENCE_RATE
    return math.sqrt(moved / _displacement(_MEASURED_OVER, time))


def _displacement(seconds: float, time: float) -> float:
    """Variance of the displacement of an Ornstein-Uhlenbeck velocity of unit variance."""
    return 2 * time * (seconds - time * -math.expm1(-seconds / time))


def _smoothed(
    values: Array, seen: Flags, *, speed: float, time: float, noise: float, fps: float
) -> tuple[Array, Array]:
    """(T,) mean and standard deviation of the position, given ``values`` where seen."""
    h, kept = 1.0 / fps, math.exp(-1.0 / (fps * time))
    onward = np.array([[1.0, time * (1.0 - kept)], [0.0, kept]])
    cross = speed**2 * time * (1.0 - kept) ** 2
    fresh = np.array(
        [
            [speed**2 * time * (2 * h - time * (3 - 4 * kept + kept**2)), cross],
            [cross, speed**2 * (1 - kept**2)],
        ]
    )
    n = len(values)
    first = values[seen.argmax()]
    mean, covariance = np.array([first, 0.0]), np.diag([_ANYWHERE**2, speed**2])
    means, covariances = np.zeros((n, 2)), np.zeros((n, 2, 2))
    expected, doubted = np.zeros((n, 2)), np.zeros((n, 2, 2))
    for t in range(n):
        if t:
            mean, covariance = onward @ mean, onward @ covariance @ onward.T + fresh
        expected[t], doubted[t] = mean, covariance
        if seen[t]:
            gain = covariance[:, 0] / (covariance[0, 0] + noise**2)
            mean = mean + gain * (values[t] - mean[0])
            covariance = covariance - np.outer(gain, covariance[0])
        means[t], covariances[t] = mean, covariance
    for t in range(n - 2, -1, -1):
        back = covariances[t] @ onward.T @ np.linalg.inv(doubted[t + 1])
        means[t] += back @ (means[t + 1] - expected[t + 1])
        covariances[t] += back @ (covariances[t + 1] - doubted[t + 1]) @ back.T
    return means[:, 0], np.sqrt(covariances[:, 0, 0])
