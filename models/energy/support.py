"""A body holds itself up by its feet, or something carries it.

Furniture that nobody sees is told by who sits on it, before the motion says on what. In a *stay*,
a run of frames whose fitted pose has the thighs off the vertical, somebody is carried (or squats,
kneels or sits on the floor: then a scenelet of that explains it). The angle has one density in
people who are carried and another in people on their feet, and a stay during which the scene has
nobody off their feet takes the second: it costs the log of their ratio, summed over the stay's
frames, as far as legs are seen and as often as frames say something new
(:mod:`imapper_prob.staged.stays`). Normalised: both are densities of the angle, and the
state only chooses between them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import inlined

__all__ = ["unsupported"]


@inlined
def unsupported(
    stays: NDArray[np.float64], lowered: NDArray[np.int64], items: NDArray[np.int64]
) -> float:
    """Nats that the stays cost during which no scenelet's person is off their feet.

    Parameters
    ----------
    stays : (K, 3) float
        First frame, frame after the last, and log ratio of densities, nats.
    lowered : (L, 2) int
        Of each scenelet the first frame and the one after the last in which its person is off
        their feet, counted from its start; twice the same if there is none.
    items : (k, 2) int
        Scenelet and start frame.
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
