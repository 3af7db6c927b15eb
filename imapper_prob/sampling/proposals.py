"""Where to try a new scenelet: a normalised mixture with full support.

The components are the solver's fits, every scenelet in every window: a candidate names a
scenelet, a middle frame and a placement, and is blurred around it in time, along the viewing
ray, across it and in yaw. Chains wander from scenelet to scenelet, and what can be born must
be able to die: so all fits are there, bad ones with little weight. A small share of the mass
goes to every scenelet at every start frame anywhere, so that no part of the support is out of
reach and the density of any scenelet can be stated exactly. The size of its person comes from
the prior, and a larger one is tried further away.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

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
    """Every scenelet fitted to every window.

    Parameters
    ----------
    centres : (W,) int
        Middle frame of each window, ascending.
    placements : (W, L, 3) float
        x, y in metres (y > 0), yaw in radians.
    weights : (W, L) float
        How often to try each; zero where a scenelet was not fitted.
    """

    centres: Ints
    placements: Array
    weights: Array

    def __post_init__(self) -> None:
        centres = np.array(self.centres, dtype=np.int64)
        centres.setflags(write=False)
        object.__setattr__(self, "centres", centres)
        shape = (len(centres), np.shape(self.weights)[-1])
        for name, size in (("placements", (*shape, 3)), ("weights", shape)):
            object.__setattr__(
                self, name, read_only(getattr(self, name), shape=size, name=f"candidate {name}")
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

    It depends on two things that the moves which use it leave alone. Candidates were fitted
    at the mean of the camera prior; under another focal length or body size the same pixels
    lie on another bearing and depth, and so do the proposals: hence ``camera`` (5,). And only
    windows are tried of which ``others`` (k, 2), the scenelets that stay, leave the middle free.
    """

    problem: Problem
    candidates: Candidates
    blur: int = field(init=False)
    """Frames by which a scenelet may be tried off the middle of its window: so many that
    every frame is within reach of a window."""
    _lengths: Ints = field(init=False, repr=False)
    _cumulative: Array = field(init=False, repr=False)  # (W, L) of a window's weights
    _totals: Array = field(init=False, repr=False)  # (W,)

    def __post_init__(self) -> None:
        cumulative = self.candidates.weights.cumsum(1)
        gaps = np.diff(self.candidates.centres)
        object.__setattr__(self, "blur", int(gaps.max(initial=1) // 2 + 1))
        object.__setattr__(self, "_lengths", self.problem.lengths)
        object.__setattr__(self, "_cumulative", cumulative)
        object.__setattr__(self, "_totals", np.array(cumulative[:, -1]))

    def middle(self, scenelet: int, start: int) -> int:
        """Middle frame of a scenelet."""
        return start + int(self._lengths[scenelet]) // 2

    def nearest_window(self, middle: int) -> int:
        """The window whose middle is nearest to a frame."""
        return int(np.abs(self.candidates.centres - middle).argmin())

    def _seen_from(self, camera: Array, size: float) -> tuple[float, float]:
        """By how much bearing shrinks and log depth grows from the mean camera to this one."""
        change = camera - self.problem.camera_mean
        return math.exp(-change[2]), float(change[2] + change[3] + size)

    def _open(self, others: Ints, around: int | None, window: int) -> Array:
        """(W,) weights of the windows that may be tried."""
        centres = self.candidates.centres
        # Half of the shortest scenelet must be free at the least for any to fit.
        margin = int(self._lengths.min()) // 2
        taken = np.zeros(len(centres), bool)
        for scenelet, start in others.tolist():
            end = start + int(self._lengths[scenelet])
            taken |= (centres > start - margin) & (centres < end + margin)
        if around is not None:
            taken |= np.abs(centres - around) > window
        return np.where(taken, 0.0, self._totals)

    def _starts(self, scenelet: int, around: int | None, window: int) -> tuple[int, int]:
        """First and last start frame that the clip and the window leave to a scenelet."""
        length = int(self._lengths[scenelet])
        last = self.problem.n_frames - length
        if around is None:
            return 0, last
        return max(0, around - length // 2 - window), min(last, around - length // 2 + window)

    def draw(
        self,
        rng: np.random.Generator,
        camera: Array,
        others: Ints,
        *,
        around: int | None = None,
        window: int = 0,
    ) -> tuple[int, int, Array, float] | None:
        """A scenelet, its start frame, placement (3,) and log size; None where none fits.

        With ``around`` only windows whose middle lies within ``window`` frames of it.
        """
        weights = self._open(others, around, window).cumsum()
        size = self.problem.size_spread * float(rng.standard_normal())
        if weights[-1] > 0 and rng.random() > _ANYWHERE:
            which = int(np.searchsorted(weights, rng.random() * weights[-1], side="right"))
            own = self._cumulative[which]
            scenelet = int(np.searchsorted(own, rng.random() * own[-1], side="right"))
            shift = int(rng.integers(-self.blur, self.blur + 1))
            start = int(self.candidates.centres[which]) - int(self._lengths[scenelet]) // 2 + shift
            x, y, yaw = self.candidates.placements[which, scenelet]
            shrunk, further = self._seen_from(camera, size)
            spread = np.array(_SPREADS[int(rng.integers(len(_SPREADS)))])
            across, along, around_z = spread * rng.standard_normal(3)
            bearing = shrunk * x / y + across
            depth = y * math.exp(further + along)
            return scenelet, start, np.array([bearing * depth, depth, yaw + around_z]), size
        scenelet = int(rng.integers(len(self._lengths)))
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
        others: Ints,
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
        weights = self._open(others, around, window)
        total = float(weights.sum())
        first, last = self._starts(scenelet, around, window)
        parts = []
        if first <= start <= last:
            mean, variance = self.problem.start_mean, self.problem.start_variance
            offset = np.array([bearing, log_depth]) - mean
            parts.append(
                math.log(_ANYWHERE if total > 0 else 1.0)
                - math.log(len(self._lengths) * (last - first + 1))
                - 0.5 * float((offset**2 / variance + np.log(2 * math.pi * variance)).sum())
                - math.log(2 * math.pi)
            )
        near = np.abs(self.candidates.centres - self.middle(scenelet, start)) <= self.blur
        own = self.candidates.weights[:, scenelet]
        which = np.flatnonzero(near & (weights > 0) & (own > 0))
        if len(which):
            cx, cy, turn = self.candidates.placements[which, scenelet].T
            shrunk, further = self._seen_from(camera, size)
            # A window's weight over all windows, times the scenelet's over the window's.
            even = (1 - _ANYWHERE) / len(_SPREADS) / (2 * self.blur + 1)
            shares = np.log(own[which] / total * even)
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
