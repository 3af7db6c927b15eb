"""Where to try a new scenelet: a normalised mixture with full support.

The components are the solver's fits, every scenelet in every window: a candidate names a
scenelet, a middle frame and a placement, and is blurred around it in time, along the viewing
ray, across it and in yaw. Chains wander from scenelet to scenelet, and what can be born must
be able to die: so all fits are there, bad ones with little weight. A small share of the mass
goes to every scenelet at every start frame anywhere, so that no part of the support is out of
reach and the density of any scenelet can be stated exactly. A larger person is tried further
away, and one for whom the static path is too far or too near for their look is taken to be
larger or smaller.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
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


def log_wrapped_normal(angle: float, spread: float) -> float:
    """Log density on the circle of a normal of standard deviation ``spread``, wrapped."""
    nearest = math.remainder(angle, 2 * math.pi) / spread
    turn = 2 * math.pi / spread
    total = sum(
        math.exp(-0.5 * ((nearest + n * turn) ** 2 - nearest**2)) for n in (-2, -1, 0, 1, 2)
    )
    return math.log(total / (spread * math.sqrt(2 * math.pi))) - 0.5 * nearest**2


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
    # In plain Python, whose arithmetic with single numbers is ten times as fast as numpy's.
    _lengths: list[int] = field(init=False, repr=False)
    _centres: list[int] = field(init=False, repr=False)
    _before: list[float] = field(init=False, repr=False)  # (W + 1,) weight of earlier windows
    _cumulative: Array = field(init=False, repr=False)  # (W, L) of a window's weights
    _sizes: Array = field(init=False, repr=False)  # (W, L) mean log size of a candidate's person
    _size_spreads: list[float] = field(init=False, repr=False)  # (W,) and its deviation

    def __post_init__(self) -> None:
        cumulative = self.candidates.weights.cumsum(1)
        gaps = np.diff(self.candidates.centres)
        before = np.concatenate([[0.0], cumulative[:, -1].cumsum()])
        object.__setattr__(self, "blur", int(gaps.max(initial=1) // 2 + 1))
        object.__setattr__(self, "_lengths", self.problem.lengths.tolist())
        object.__setattr__(self, "_centres", self.candidates.centres.tolist())
        object.__setattr__(self, "_before", before.tolist())
        object.__setattr__(self, "_cumulative", cumulative)
        # What two normal laws, of sizes and of the path's depth, make of a look together.
        problem, centres = self.problem, self.candidates.centres
        depth = problem.path_centre[centres, 1] + problem.camera_mean[2] + problem.camera_mean[3]
        known = self.candidates.weights > 0
        own = np.log(np.where(known, self.candidates.placements[..., 1], 1.0))
        doubt, spread = problem.path_scale[centres, 1] ** 2, problem.size_spread**2
        sizes = np.where(known, depth[:, None] - own, 0.0) * (spread / (spread + doubt))[:, None]
        deviation = np.sqrt(spread * doubt / (spread + doubt))
        object.__setattr__(self, "_sizes", sizes)
        object.__setattr__(self, "_size_spreads", deviation.tolist())

    def middle(self, scenelet: int, start: int) -> int:
        """Middle frame of a scenelet."""
        return start + self._lengths[scenelet] // 2

    def nearest_window(self, middle: int) -> int:
        """The window whose middle is nearest to a frame, the earlier of two."""
        centres, right = self._centres, bisect_left(self._centres, middle)
        if right == 0 or right == len(centres):
            return min(right, len(centres) - 1)
        return right - (middle - centres[right - 1] <= centres[right] - middle)

    def _seen_from(self, camera: Array, size: float) -> tuple[float, float]:
        """By how much bearing shrinks and log depth grows from the mean camera to this one."""
        change = camera - self.problem.camera_mean
        return math.exp(-change[2]), float(change[2] + change[3] + size)

    def _open(self, others: Ints, around: int | None, window: int) -> list[tuple[int, int]]:
        """Runs of windows, first and one past the last, that may be tried."""
        centres, first, end = self._centres, 0, len(self._centres)
        if around is not None:
            first = bisect_left(centres, around - window)
            end = bisect_right(centres, around + window)
        # Half of the shortest scenelet must be free at the least for any to fit.
        margin = min(self._lengths) // 2
        runs = []
        for scenelet, start in others.tolist():
            taken = bisect_right(centres, start - margin)
            if taken > first:
                runs.append((first, min(taken, end)))
            first = max(first, bisect_left(centres, start + self._lengths[scenelet] + margin))
            if first >= end:
                return runs
        runs.append((first, end))
        return runs

    def _weight(self, runs: list[tuple[int, int]]) -> float:
        """Of all windows of some runs."""
        return sum(self._before[end] - self._before[first] for first, end in runs)

    def _pick(self, runs: list[tuple[int, int]], weight: float) -> int:
        """The window in which the weights of some runs, summed from the first on, reach one."""
        for first, end in runs:
            own = self._before[end] - self._before[first]
            if weight < own:
                within = bisect_right(self._before, self._before[first] + weight) - 1
                return min(max(within, first), end - 1)
            weight -= own
        return runs[-1][1] - 1

    def _starts(self, scenelet: int, around: int | None, window: int) -> tuple[int, int]:
        """First and last start frame that the clip and the window leave to a scenelet."""
        length = self._lengths[scenelet]
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
        runs = self._open(others, around, window)
        total = self._weight(runs)
        if total > 0 and rng.random() > _ANYWHERE:
            which = self._pick(runs, rng.random() * total)
            own = self._cumulative[which]
            scenelet = int(np.searchsorted(own, rng.random() * own[-1], side="right"))
            shift = int(rng.integers(-self.blur, self.blur + 1))
            start = self._centres[which] - self._lengths[scenelet] // 2 + shift
            x, y, yaw = self.candidates.placements[which, scenelet].tolist()
            size = float(self._sizes[which, scenelet])
            size += self._size_spreads[which] * float(rng.standard_normal())
            shrunk, further = self._seen_from(camera, size)
            across, along, around_z = _SPREADS[int(rng.integers(len(_SPREADS)))]
            step = rng.standard_normal(3).tolist()
            bearing = shrunk * x / y + across * step[0]
            depth = y * math.exp(further + along * step[1])
            turn = yaw + around_z * step[2]
            return scenelet, start, np.array([bearing * depth, depth, turn]), size
        scenelet = int(rng.integers(len(self._lengths)))
        first, last = self._starts(scenelet, around, window)
        if last < first:
            return None
        start = int(rng.integers(first, last + 1))
        mean, spread = self.problem.start_mean, np.sqrt(self.problem.start_variance)
        bearing, log_depth = mean + spread * rng.standard_normal(2)
        depth = math.exp(log_depth)
        turn = rng.uniform(-math.pi, math.pi)
        size = self.problem.size_spread * float(rng.standard_normal())
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
        x, y, yaw = placement.tolist()
        if y <= 0:
            return -math.inf
        bearing, log_depth = x / y, math.log(y)
        runs = self._open(others, around, window)
        total = self._weight(runs)
        first, last = self._starts(scenelet, around, window)
        density = 0.0
        if first <= start <= last:
            log_anywhere = log_size_density(size, self.problem.size_spread)
            log_anywhere -= math.log(2 * math.pi)
            for value, mean, variance in zip(
                (bearing, log_depth), self.problem.start_mean, self.problem.start_variance,
                strict=True,
            ):  # fmt: skip
                log_anywhere -= 0.5 * (value - mean) ** 2 / variance
                log_anywhere -= 0.5 * math.log(2 * math.pi * variance)
            starts = len(self._lengths) * (last - first + 1)
            density += (_ANYWHERE if total > 0 else 1.0) / starts * math.exp(log_anywhere)
        middle = self.middle(scenelet, start)
        shrunk, further = self._seen_from(camera, size)
        near = range(
            bisect_left(self._centres, middle - self.blur),
            bisect_right(self._centres, middle + self.blur),
        )
        for which in near:
            weight = float(self.candidates.weights[which, scenelet])
            if weight == 0 or not any(first <= which < end for first, end in runs):
                continue
            cx, cy, turn = self.candidates.placements[which, scenelet].tolist()
            # A window's weight over all windows, times the scenelet's over the window's.
            share = weight / total * (1 - _ANYWHERE) / len(_SPREADS) / (2 * self.blur + 1)
            own = size - float(self._sizes[which, scenelet])
            share *= math.exp(log_size_density(own, self._size_spreads[which]))
            off, beyond = bearing - shrunk * cx / cy, log_depth - further - math.log(cy)
            for across, along, around_z in _SPREADS:
                exponent = -0.5 * ((off / across) ** 2 + (beyond / along) ** 2)
                exponent += log_wrapped_normal(yaw - turn, around_z)
                density += share * math.exp(exponent) / (2 * math.pi * across * along)
        if density == 0:
            return -math.inf
        to_floor = -2 * log_depth  # |d(bearing, log depth) / d(x, y)| = 1 / y^2
        return to_floor + math.log(density)
