"""What one scenelet gains alone in the scene, and where it gains most.

A fit to detections knows nothing of what its furniture hides, nor of path and floor. Moved to
where the whole log-posterior is highest it is a better place to be born at.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.incremental import log_posterior_near
from imapper_prob.models.posterior import empty_state
from imapper_prob.models.problem import Problem
from imapper_prob.models.view import to_floor

__all__ = ["Alone"]

Array = NDArray[np.float64]

_STEPS = np.array(
    [[0.004, 0.0, 0.0, 0.0], [0.0, 0.03, 0.0, 0.0], [0.0, 0.0, 0.08, 0.0], [0.0, 0.025, 0.0, 0.025]]
)
"""(4, 4) from point to point of a parabola, in bearing, log depth, yaw, and in log size with the
depth along: about the standard deviations of placements in chains of one simulated clip."""
_ROUNDS = 2
"""Times that each direction is taken, chosen."""
_FURTHEST = 2.0
"""Steps at once, chosen: beyond, a parabola is not trusted."""


class Alone:
    """Scenes of one scenelet.

    Where it stands is (4,): bearing (tangent), log depth (log m), yaw (radians) and log size.
    """

    def __init__(self, problem: Problem) -> None:
        self._scene = empty_state(problem)
        # One scenelet alone is quickly judged where nothing else changes.
        self._judge = log_posterior_near(problem, self._scene)
        self._nothing = self._judge(self._scene)

    def gain(self, scenelet: int, start: int, where: Array) -> float:
        """Nats over the scene without it."""
        placement, size = to_floor(where)
        there = self._scene.with_item(scenelet, start, placement, float(size))
        return self._judge(there) - self._nothing

    def mended(self, scenelet: int, start: int, where: Array, gain: float) -> tuple[Array, float]:
        """A better place nearby and its gain, by parabolas along one direction after the other."""
        for step in [*_STEPS] * _ROUNDS:
            less, more = (self.gain(scenelet, start, where + sign * step) for sign in (-1, 1))
            bend = 2 * gain - less - more
            if not np.isfinite(bend):
                continue
            by = 0.5 * (more - less) / bend if bend > 0 else np.sign(more - less)
            there = where + float(np.clip(by, -_FURTHEST, _FURTHEST)) * step
            found = self.gain(scenelet, start, there)
            if found > gain:
                where, gain = there, found
        return where, gain
