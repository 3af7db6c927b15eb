"""How unlike two skeletons are."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["distances"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_STEP: Final = 0.1
"""Share of the body's height in the image that two skeletons of one person may well differ by
from frame to frame: a step's length at ten frames a second. It is the unit of distance."""
_FARTHEST: Final = 6.0
"""Cap on the distance of a joint, in those units: one that jumps says no more than this."""
_SMALLEST: Final = 20.0
"""Pixels: least height of a body, of which only a few joints may be seen."""
_ROWS_AT_ONCE: Final = 50_000


def distances(keypoints: Array, confidences: Array, one: Ints, other: Ints) -> Array:
    """Mean normalised joint distance of pairs of skeletons.

    Parameters
    ----------
    keypoints : (N, 16, 2) float
        Pixels; NaN where missing.
    confidences : (N, 16) float
        0 where missing; unsure joints count less.
    one, other : (P,) int
        The pairs.

    Returns
    -------
    (P,) float
        In units of a step; pairs without a common joint are as far apart as can be.
    """
    there = (confidences > 0) & np.isfinite(keypoints).all(-1)
    points = np.where(there[..., None], keypoints, 0.0)
    high = np.where(there, keypoints[..., 1], -np.inf).max(1)
    low = np.where(there, keypoints[..., 1], np.inf).min(1)
    wide = np.where(there, keypoints[..., 0], -np.inf).max(1)
    narrow = np.where(there, keypoints[..., 0], np.inf).min(1)
    with np.errstate(invalid="ignore"):
        height = np.nan_to_num(np.hypot(high - low, wide - narrow), nan=0.0, posinf=0.0)
    result = np.empty(len(one))
    for start in range(0, len(one), _ROWS_AT_ONCE):
        a, b = one[start : start + _ROWS_AT_ONCE], other[start : start + _ROWS_AT_ONCE]
        weight = np.where(there[a] & there[b], np.minimum(confidences[a], confidences[b]), 0.0)
        unit = _STEP * np.maximum(np.maximum(height[a], height[b]), _SMALLEST)
        apart = np.linalg.norm(points[a] - points[b], axis=-1) / unit[:, None]
        total = weight.sum(1)
        mean = (weight * np.minimum(apart, _FARTHEST)).sum(1) / np.maximum(total, 1e-12)
        result[start : start + _ROWS_AT_ONCE] = np.where(total > 0, mean, _FARTHEST)
    return result
