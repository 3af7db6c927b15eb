"""What the lifted poses say of where somebody faces in a scenelet.

Detections alone can hardly tell somebody who sits turned half away from somebody who does not:
a scenelet that fits them may face 60 degrees off. A lifter sees that, and is as good as its
median error of 5 degrees (i3DB). The log-posterior has no such term: in covered frames it
knows of detections only. So the solver, where it ranks candidates, asks the static path.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma

from imapper_prob.models.path import StaticPath
from imapper_prob.models.pose import facing
from imapper_prob.models.posterior import State
from imapper_prob.models.problem import Problem
from imapper_prob.staged.fit import static_world

__all__ = ["Facing"]

Array = NDArray[np.float64]

_OWN: Final = (np.radians(6.3), 1.8)
_FILLED: Final = (np.radians(16.3), 3.9)
"""Scale (radians) and degrees of freedom of the Student-t errors of the static path's facing, in
frames with a pose of their own and in filled ones: fitted to 562 and 92 annotated frames of
the four public i3DB scenes."""
_CORRELATION_TIME: Final = 0.9
"""Seconds over which these errors repeat themselves: the mean of the scenes' integrated
autocorrelation, .5 to 1.2 s."""


@dataclass(frozen=True)
class Facing:
    """Where the static path has somebody face, frame by frame.

    Parameters
    ----------
    yaw : (T,) float
        In the world of the mean camera, radians.
    scale, dof : (T,) float
        Of its error.
    within : tuple of (n,) float
        By scenelet, where its person faces in its own frames, radians.
    weight : float
        One over the number of frames in a correlation time.
    """

    yaw: Array
    scale: Array
    dof: Array
    within: tuple[Array, ...]
    weight: float

    @classmethod
    def of_path(cls, problem: Problem, path: StaticPath, *, fps: float) -> Facing:
        """What a static path says."""
        scale, dof = np.where(path.posed[:, None], _OWN, _FILLED).T
        return cls(
            yaw=facing(static_world(problem, path)),
            scale=scale,
            dof=dof,
            within=tuple(np.split(facing(problem.joints), problem.joint_first[1:-1])),
            weight=min(1.0, 1.0 / (_CORRELATION_TIME * fps)),
        )

    def of_state(self, state: State) -> float:
        """Sum over a state's scenelets, nats."""
        return sum(
            self.nats(scenelet, start, yaw)
            for (scenelet, start), yaw in zip(
                state.items.tolist(), state.placements[:, 2].tolist(), strict=True
            )
        )

    def nats(self, scenelet: int, start: int, yaw: float) -> float:
        """Log-density of the path's facing if a scenelet stands so, over what is expected.

        Less its expectation, so that scenelets which face as people do are neither charged nor
        paid against frames without any.
        """
        own = self.within[scenelet]
        frames = slice(start, start + len(own))
        apart = (own + yaw - self.yaw[frames] + np.pi) % (2 * np.pi) - np.pi
        dof = self.dof[frames]
        half = (dof + 1) / 2
        loss = half * np.log1p((apart / self.scale[frames]) ** 2 / dof)
        expected = half * (digamma(half) - digamma(dof / 2))
        return float(self.weight * (expected - loss).sum())
