"""Where to try a new scenelet: a normalised mixture with full support.

The solver's fits are the components: a candidate names a scenelet, a start frame and a
placement, and is blurred around it along the viewing ray, across it and in yaw. A small
share of the mass goes to every scenelet at every start frame anywhere, so that no part of
the support is out of reach and the density of any scenelet can be stated exactly. The size
of its person comes from the prior, and a larger one is tried further away.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.kernels.support import log_size_density
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import read_only

__all__ = ["Candidates", "Proposals", "log_wrapped_normal"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_ANYWHERE = 0.05
"""Share of the mixture that knows nothing; small, for it is nearly always refused."""
_SPREADS = ((0.003, 0.03, 0.1), (0.015, 0.06, 0.3))
"""Blurs of a candidate in bearing (tangent), log depth and yaw (radians), tried equally often:
the width of a placement's posterior, and one that reaches placements other objects displace."""


@dataclass(frozen=True)
class Candidates:
    """Scenelets fitted to windows.

    Parameters
    ----------
    items : (C, 2) int
        Scenelet and start frame.
    placements : (C, 3) float
        x, y in metres (y > 0), yaw in radians.
    weights : (C,) float
        Positive; how often to try each.
    """

    items: Ints
    placements: Array
    weights: Array

    def __post_init__(self) -> None:
        items = np.array(self.items, dtype=np.int64).reshape(-1, 2)
        items.setflags(write=False)
        n = len(items)
        object.__setattr__(self, "items", items)
        for name, shape in (("placements", (n, 3)), ("weights", (n,))):
            object.__setattr__(
                self, name, read_only(getattr(self, name), shape=shape, name=f"candidate {name}")
            )


def log_wrapped_normal(angle: Array, spread: float) -> Array:
    """Log density on the circle of a normal of standard deviation ``spread``, wrapped."""
    turns = np.asarray(angle)[..., None] + 2 * math.pi * np.arange(-2, 3)
    turns = turns - 2 * math.pi * np.round(np.asarray(angle) / (2 * math.pi))[..., None]
    terms = -0.5 * (turns / spread) ** 2
    top = terms.max(-1)
    result: Array = top + np.log(np.exp(terms - top[..., None]).sum(-1))
    return result - math.log(spread * math.sqrt(2 * math.pi))


@dataclass(frozen=True)
class Proposals:
    """The mixture over (scenelet, start frame, placement, size), to draw from and to evaluate.

    Candidates were fitted at the mean of the camera prior. Under another focal length or
    body size the same pixels lie on another bearing and depth, and so do the proposals:
    they depend on ``camera`` (5,), which the moves that use them leave alone.
    """

    problem: Problem
    candidates: Candidates

    def _seen_from(self, camera: Array, size: float) -> tuple[float, float]:
        """By how much bearing shrinks and log depth grows from the mean camera to this one."""
        change = camera - self.problem.camera_mean
        return math.exp(-change[2]), float(change[2] + change[3] + size)

    def _near(self, start: int | None, window: int) -> Array:
        """Weights of the candidates whose start lies within ``window`` frames of ``start``."""
        if start is None:
            return self.candidates.weights
        return self.candidates.weights * (abs(self.candidates.items[:, 1] - start) <= window)

    def _starts(self, scenelet: int, start: int | None, window: int) -> tuple[int, int]:
        """First and last start frame that the clip and the window leave to a scenelet."""
        last = self.problem.n_frames - int(self.problem.lengths[scenelet])
        if start is None:
            return 0, last
        return max(0, start - window), min(last, start + window)

    def draw(
        self,
        rng: np.random.Generator,
        camera: Array,
        *,
        around: int | None = None,
        window: int = 0,
    ) -> tuple[int, int, Array, float] | None:
        """A scenelet, its start frame, placement (3,) and log size; None where none fits.

        With ``around`` only starts within ``window`` frames of it.
        """
        weights = self._near(around, window)
        total = weights.sum()
        size = self.problem.size_spread * float(rng.standard_normal())
        if total > 0 and rng.random() > _ANYWHERE:
            which = int(rng.choice(len(weights), p=weights / total))
            scenelet, start = (int(v) for v in self.candidates.items[which])
            x, y, yaw = self.candidates.placements[which]
            shrunk, further = self._seen_from(camera, size)
            spread = np.array(_SPREADS[int(rng.integers(len(_SPREADS)))])
            across, along, around_z = spread * rng.standard_normal(3)
            bearing = shrunk * x / y + across
            depth = y * math.exp(further + along)
            turn = yaw + around_z
            return scenelet, start, np.array([bearing * depth, depth, turn]), size
        scenelet = int(rng.integers(len(self.problem.lengths)))
        first, last = self._starts(scenelet, around, window)
        if last < first:
            return None
        start = int(rng.integers(first, last + 1))
        mean, spread = self.problem.start_mean, np.sqrt(self.problem.start_variance)
        bearing, log_depth = mean + spread * rng.standard_normal(2)
        depth = math.exp(log_depth)
        turn = rng.uniform(-math.pi, math.pi)
        return scenelet, start, np.array([bearing * depth, depth, turn]), size

    def log_density(
        self,
        scenelet: int,
        start: int,
        placement: Array,
        size: float,
        camera: Array,
        *,
        around: int | None = None,
        window: int = 0,
    ) -> float:
        """Log density of :meth:`draw`, per square metre, radian and unit of log size."""
        x, y, yaw = placement
        if y <= 0:
            return -math.inf
        bearing, log_depth = x / y, math.log(y)
        to_floor = -2 * log_depth  # |d(bearing, log depth) / d(x, y)| = 1 / y^2
        weights = self._near(around, window)
        total = weights.sum()
        first, last = self._starts(scenelet, around, window)
        parts = []
        if first <= start <= last:
            mean, variance = self.problem.start_mean, self.problem.start_variance
            offset = np.array([bearing, log_depth]) - mean
            parts.append(
                math.log(_ANYWHERE if total > 0 else 1.0)
                - math.log(len(self.problem.lengths) * (last - first + 1))
                - 0.5 * float((offset**2 / variance + np.log(2 * math.pi * variance)).sum())
                - math.log(2 * math.pi)
            )
        same = np.flatnonzero(
            (self.candidates.items[:, 0] == scenelet)
            & (self.candidates.items[:, 1] == start)
            & (weights > 0)
        )
        if len(same):
            cx, cy, turn = self.candidates.placements[same].T
            shrunk, further = self._seen_from(camera, size)
            shares = np.log(weights[same] / total * (1 - _ANYWHERE) / len(_SPREADS))
            for across, along, around_z in _SPREADS:
                logs = (
                    shares
                    - 0.5 * ((bearing - shrunk * cx / cy) / across) ** 2
                    - 0.5 * ((log_depth - further - np.log(cy)) / along) ** 2
                    - math.log(2 * math.pi * across * along)
                    + log_wrapped_normal(yaw - turn, around_z)
                )
                parts.extend(logs.tolist())
        if not parts:
            return -math.inf
        of_size = log_size_density(size, self.problem.size_spread)
        return to_floor + of_size + float(np.logaddexp.reduce(parts))
