"""Motion at other moments than those it was recorded at."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.skeleton import N_JOINTS

__all__ = ["joints_at"]

Array = NDArray[np.float64]


def joints_at(moments: ArrayLike, times: ArrayLike, joints: ArrayLike, *, bridged: float) -> Array:
    """Joints at chosen moments, on straight lines between the recorded ones.

    Each joint is interpolated by itself, so that one which a tracker lost for a moment does
    not take the rest of the body with it.

    Parameters
    ----------
    moments : (M,) float
        Seconds.
    times : (T,) float
        When ``joints`` were recorded, seconds, ascending.
    joints : (T, 16, 3) float
        Metres; NaN where a joint was not seen.
    bridged : float
        Longest time in seconds between two sightings that is bridged.

    Returns
    -------
    (M, 16, 3) float
        NaN for a whole frame before the first and after the last sighting of any joint, and
        wherever one of them was lost for longer than ``bridged``.
    """
    moments, times = np.asarray(moments, float), np.asarray(times, float)
    joints = np.asarray(joints, float)
    seen = np.isfinite(joints).all(2)
    result = np.full((len(moments), N_JOINTS, 3), np.nan)
    # Times of regular frames are sums of rounded steps: a moment may miss one by a hair.
    hair = 1e-9 * (1.0 + np.abs(times).max(initial=0.0))
    for joint in range(N_JOINTS):
        known = times[seen[:, joint]]
        if len(known) == 0:
            continue
        after = np.clip(np.searchsorted(known, moments - hair), 0, len(known) - 1)
        before = np.clip(np.searchsorted(known, moments + hair, "right") - 1, 0, len(known) - 1)
        inside = (moments >= known[0] - hair) & (moments <= known[-1] + hair)
        inside &= known[after] - known[before] <= bridged + hair
        for axis in range(3):
            values = np.interp(moments, known, joints[seen[:, joint], joint, axis])
            result[inside, joint, axis] = values[inside]
    result[~np.isfinite(result).all((1, 2))] = np.nan
    return result
