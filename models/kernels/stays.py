"""E_u: the cost of a stay in which nothing supports the person (docs/explanation/model.md 17a).

A *stay* is a run of frames whose fitted pose has the thighs off the vertical. Either something
supports the person, or they squat, kneel or sit on the floor; scenelets exist for all of these. The
angle of the thighs has one density for supported people and another for people on their feet. If no
scenelet of the scene has its person off their feet during a stay, the second density applies: the
cost is the log of the ratio of both, summed over the stay's frames
(:mod:`imapper_prob.solver.camera_prior`). Both are densities of the angle, and the state only
chooses between them, so the posterior stays normalised.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import inlined
from imapper_prob.models.skeleton import PELV, thigh_angle

__all__ = ["off_feet", "unsupported"]

_BESIDE: Final = 0.1
"""Metres by which the mid-hip may lie outside its support, for people who sit on an edge."""
_ABOVE: Final = (-0.15, 0.35)
"""Height in metres of the mid-hip above its support: joint centres are .09 m above a hard seat, and
furniture of recorded scenes is known only to about .1 m."""
_FLOOR: Final = 0.55
"""Height of the mid-hip in metres below which only the floor can support the person (squatting or
sitting there). Seats are higher (.40 to .48 m, plus .09)."""


def off_feet(
    joints: NDArray[np.float64], boxes: NDArray[np.float64], *, angle: float
) -> tuple[int, int]:
    """First frame of a scenelet with its person off their feet, and the frame after the last.

    The person is off their feet if the thighs are off the vertical, and a box is beneath the hips
    or the hips are lower than any seat.

    Parameters
    ----------
    joints : (n, 16, 3) float
        Local frame, metres.
    boxes : (B, 7) float
        Centre, half sizes and yaw of the scenelet's boxes.
    angle : float
        Least angle of the thighs to the vertical, radians.

    Returns
    -------
    first, end : int
        0 and 0 if there is no such frame.
    """
    pelvis = joints[:, PELV]
    carried = pelvis[:, 2] < _FLOOR
    for x, y, z, width, depth, height, yaw in boxes:
        c, s = np.cos(yaw), np.sin(yaw)
        aside, ahead = pelvis[:, 0] - x, pelvis[:, 1] - y
        over = np.abs(c * aside + s * ahead) < width + _BESIDE
        over &= np.abs(c * ahead - s * aside) < depth + _BESIDE
        above = pelvis[:, 2] - (z + height)
        carried |= over & (above > _ABOVE[0]) & (above < _ABOVE[1])
    frames = np.flatnonzero(carried & (thigh_angle(joints) > angle))
    return (int(frames[0]), int(frames[-1]) + 1) if len(frames) else (0, 0)


@inlined
def unsupported(
    stays: NDArray[np.float64], lowered: NDArray[np.int64], items: NDArray[np.int64]
) -> float:
    """Total cost in nats of the stays during which no scenelet's person is off their feet.

    Parameters
    ----------
    stays : (K, 3) float
        First frame, frame after the last, and log ratio of densities, nats.
    lowered : (L, 2) int
        First frame, and frame after the last, in which the person of each scenelet is off their
        feet, counted from its start; equal if there is none.
    items : (k, 2) int
        Scenelet and start frame.

    Returns
    -------
    float
    """
    cost = 0.0
    for k in range(len(stays)):
        held = False
        for i in range(len(items)):
            scenelet, start = items[i, 0], items[i, 1]
            first, end = lowered[scenelet, 0], lowered[scenelet, 1]
            held |= first < end and start + first < stays[k, 1] and start + end > stays[k, 0]
        if not held:
            cost += stays[k, 2]
    return cost
