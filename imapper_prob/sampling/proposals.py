"""Proposals of a new scenelet: a normalised mixture over scenelets, windows and placements.

A fit to detections knows nothing of what its furniture hides, nor of path and floor. Moved to
where the whole log-posterior is highest it is a better place to be born at.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from imapper_prob.layouts import furniture_kinds
from imapper_prob.models.kernels.placement import log_size_density
from imapper_prob.models.log_posterior import empty_state, log_posterior_near
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import read_only
from imapper_prob.models.text import brief
from imapper_prob.models.view import floor_point, log_area, seen_point, to_floor, to_view
from imapper_prob.sampling.camera_moves import CameraFrame, GroundPose, middle_heights
from imapper_prob.solver.candidates import Candidate, along_the_ray
from imapper_prob.solver.solver import Solution

__all__ = ["Candidates", "Proposals", "SingleScenelet", "log_wrapped_normal", "weighted_candidates"]

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


class SingleScenelet:
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


# ------------------------------------------------------------------------------------------------
# How often to try each scenelet in each window, and where exactly.
#
# The better a weight says what a scenelet would gain, the more often its proposal is accepted.
# What the solver knows of all fits is their reprojection; the best of each window by that, kind
# by kind, are judged by the full log-posterior, alone in an empty scene, and the best of these
# are moved to where it is highest: a fit knows nothing of what its furniture hides. In a chain
# others are there and the camera is another, so gains are known to some nats only: weights are a
# mixture of a sharp and a flat softmax of them.

_JUDGED = 200
"""Fits of a window that are judged: a sitting window has few that come within 20 nats."""
_MENDED = 32
"""Of these, how many are moved to where they are best, chosen: it takes seconds for a long clip."""
_UNJUDGED = 5.0
"""Nats by which all others are taken to be worse than the worst of these."""
_TEMPERATURES = (2.0, 6.0)
"""Nats by which a fit may be worse than another and be tried 1/e times as often. Replacing a
scenelet by these weights is accepted two to five times as often as by guesses alone at 5."""
_HOPELESS = 0.1
"""Weight of a window none of whose fits improves the scene."""


def weighted_candidates(solution: Solution) -> Candidates:
    """All fits of the solver, weighted by how much they may gain."""
    problem, fits = solution.problem, solution.fits
    weights = np.zeros(fits.cost.shape)
    placements, sizes = np.array(fits.placements), np.zeros(fits.cost.shape)
    alone, half = SingleScenelet(problem), problem.lengths // 2
    for window, guesses in _guessed(solution).items():
        centre = int(fits.centres[window])
        order = np.argsort(-guesses, kind="stable")[:_JUDGED]
        judged = {}
        for scenelet in order[np.isfinite(guesses[order])].tolist():
            start = centre - int(half[scenelet])
            where = to_view(*along_the_ray(problem, centre, placements[window, scenelet]))
            judged[scenelet] = start, where, alone.gain(scenelet, start, where)
        best = sorted(judged, key=lambda scenelet: -judged[scenelet][2])[:_MENDED]
        gains = np.full(len(guesses), -np.inf)
        for scenelet, (start, where, gain) in judged.items():
            if scenelet in best and np.isfinite(gain):
                where, gain = alone.mended(scenelet, start, where, gain)
            placements[window, scenelet], sizes[window, scenelet] = to_floor(where)
            gains[scenelet] = gain
        known = np.isfinite(gains)
        if not known.any():
            continue
        gains[np.isfinite(guesses) & ~known] = gains[known].min() - _UNJUDGED
        top = gains.max()
        parts = [np.exp((gains - top) / temperature) for temperature in _TEMPERATURES]
        mixed = np.mean([part / part.sum() for part in parts], axis=0)
        weights[window] = mixed * (1.0 if top > 0 else _HOPELESS)
    return Candidates(fits.centres, placements, sizes, weights)


def _guessed(solution: Solution) -> dict[int, Array]:
    """(L,) gains by window, -inf where a scenelet was not fitted.

    A few of each kind of furniture were judged by the solver. What another of the kind gains
    is guessed from the best of them and from how much worse its own fit is.
    """
    problem, fits = solution.problem, solution.fits
    seen = problem.used * problem.confidence_density.argmax(-1)
    half = int(np.median(problem.lengths)) // 2
    members: dict[tuple[int, ...], list[int]] = {}
    for scenelet, kind in enumerate(furniture_kinds(problem)):
        members.setdefault(kind, []).append(scenelet)
    judged: dict[int, dict[tuple[int, ...], Candidate]] = {}
    for candidate in solution.candidates:
        best = judged.setdefault(candidate.window, {})
        if candidate.kind not in best or candidate.gain > best[candidate.kind].gain:
            best[candidate.kind] = candidate
    guessed = {}
    for window, best in judged.items():
        centre = int(fits.centres[window])
        joints = seen[max(0, centre - half) : centre + half].sum()
        nats = np.full(len(fits.cost[window]), np.inf)
        fitted = np.isfinite(fits.cost[window])
        # Where no joint is surely seen there is no fit: infinite, not nothing times infinity.
        nats[fitted] = problem.frame_weight * problem.likelihood * joints
        nats[fitted] *= fits.cost[window][fitted]
        gains = np.full(len(nats), -np.inf)
        for kind, candidate in best.items():
            own = members[kind]
            gains[own] = candidate.gain - (nats[own] - nats[candidate.scenelet])
        gains[fits.placements[window, :, 1] <= 0] = -np.inf
        guessed[window] = gains
    return guessed


# ------------------------------------------------------------------------------------------------
# Where to try a new scenelet: a normalised mixture with full support.
#
# The components are the solver's fits, every scenelet in every window: a candidate names a
# scenelet, a middle frame and a placement, and is blurred around it in time, along the viewing
# ray, across it and in yaw. Chains wander from scenelet to scenelet, and what can be born must
# be able to die: so all fits are there, bad ones with little weight. A small share of the mass
# goes to every scenelet at every start frame anywhere, so that no part of the support is out of
# reach and the density of any scenelet can be stated exactly.
#
# Candidates were fitted with one camera; with that of the chain the same look is elsewhere, and
# the person of another size (:mod:`~imapper_prob.sampling.camera_moves`). Sizes are tried between
# the two, for the static path and what is usual hold them back.

Ints = NDArray[np.int64]
_ANYWHERE = 0.05
"""Share of the mixture that knows nothing; small, for it is nearly always refused."""
_SPREADS = ((0.003, 0.03, 0.1), (0.015, 0.06, 0.3))
"""Blurs of a candidate in bearing (tangent), log depth and yaw (radians), tried equally often:
the width of a placement's posterior, and one that reaches placements other objects displace."""
_FLUSH = 0.5
"""Share of the starts that leave no gap to a neighbour, where one is within reach: between two
scenelets that follow one another the person jumps once, with a gap twice."""
_AFLOAT = 0.04
"""Standard deviation of the log size about that at which the look of a fit stands on the floor:
chosen, wider than the .025 by which chains of one simulated clip spread about it."""


@dataclass(frozen=True)
class Candidates:
    """Every scenelet fitted to every window.

    Parameters
    ----------
    centres : (W,) int
        Middle frame of each window, ascending.
    placements : (W, L, 3) float
        x, y in metres (y > 0), yaw in radians, at the mean of the camera prior.
    sizes : (W, L) float
        Log size of the person there.
    weights : (W, L) float
        How often to try each; zero where a scenelet was not fitted.
    """

    centres: Ints
    placements: Array
    sizes: Array
    weights: Array

    __repr__ = brief

    def __post_init__(self) -> None:
        centres = np.array(self.centres, dtype=np.int64)
        centres.setflags(write=False)
        object.__setattr__(self, "centres", centres)
        shape = (len(centres), np.shape(self.weights)[-1])
        for name, size in (("placements", (*shape, 3)), ("sizes", shape), ("weights", shape)):
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

    It depends on two things that the moves which use it leave alone: the ``camera`` (5,), with
    which a look is elsewhere; and ``others`` (k, 2), the scenelets that stay: only windows are
    tried of which they leave the middle free, and often such starts that leave no gap to them.
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
    _heights: list[float] = field(init=False, repr=False)  # (L,) of the pelvis, reference body
    _follows: list[tuple[float, float]] = field(init=False, repr=False)  # (W,) share, deviation
    _fitted_with: CameraFrame = field(init=False, repr=False)

    def __post_init__(self) -> None:
        cumulative = self.candidates.weights.cumsum(1)
        gaps = np.diff(self.candidates.centres)
        before = np.concatenate([[0.0], cumulative[:, -1].cumsum()])
        object.__setattr__(self, "blur", int(gaps.max(initial=1) // 2 + 1))
        object.__setattr__(self, "_lengths", self.problem.lengths.tolist())
        object.__setattr__(self, "_centres", self.candidates.centres.tolist())
        object.__setattr__(self, "_before", before.tolist())
        object.__setattr__(self, "_cumulative", cumulative)
        # How far a size follows the floor: path and usual sizes hold it back.
        doubt = self.problem.path_scale[self.candidates.centres, 1] ** 2
        precision = 1 / doubt + self.problem.size_spread**-2 + _AFLOAT**-2
        follows = zip((_AFLOAT**-2 / precision).tolist(), (precision**-0.5).tolist(), strict=True)
        object.__setattr__(self, "_heights", middle_heights(self.problem).tolist())
        object.__setattr__(self, "_follows", list(follows))
        object.__setattr__(self, "_fitted_with", CameraFrame(self.problem.camera_mean))

    def middle(self, scenelet: int, start: int) -> int:
        """Middle frame of a scenelet."""
        return start + self._lengths[scenelet] // 2

    def nearest_window(self, middle: int) -> int:
        """The window whose middle is nearest to a frame, the earlier of two."""
        centres, right = self._centres, bisect_left(self._centres, middle)
        if right == 0 or right == len(centres):
            return min(right, len(centres) - 1)
        return right - (middle - centres[right - 1] <= centres[right] - middle)

    def carried(
        self, view: CameraFrame, which: int, scenelet: int
    ) -> tuple[GroundPose, float, float] | None:
        """Where the look of a candidate in window ``which`` stands for another camera.

        With mean and deviation of the log sizes that are tried. None if that is nowhere.
        """
        x, y, _ = self.candidates.placements[which, scenelet].tolist()
        size, height = float(self.candidates.sizes[which, scenelet]), self._heights[scenelet]
        look = self._fitted_with.look(x, y, size, height)
        stand = None if look is None else view.stand(look, height)
        if stand is None:
            return None
        share, spread = self._follows[which]
        return stand, size + share * (stand.size - size), spread

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

    def _flush(self, which: int, scenelet: int, others: Ints) -> list[int]:
        """Frames off the middle of a window at which a scenelet has no gap to one of others."""
        length = self._lengths[scenelet]
        first = self._centres[which] - length // 2
        shifts = set()
        for other, start in others.tolist():
            shifts |= {start + self._lengths[other] - first, start - length - first}
        return sorted(shift for shift in shifts if abs(shift) <= self.blur)

    def draw_shift(self, rng: np.random.Generator, which: int, scenelet: int, others: Ints) -> int:
        """By how many frames to try a scenelet off the middle of a window."""
        flush = self._flush(which, scenelet, others)
        if flush and rng.random() < _FLUSH:
            return flush[int(rng.integers(len(flush)))]
        return int(rng.integers(-self.blur, self.blur + 1))

    def shift_probability(self, which: int, scenelet: int, shift: int, others: Ints) -> float:
        """Of what :meth:`draw_shift` draws."""
        if abs(shift) > self.blur:
            return 0.0
        flush = self._flush(which, scenelet, others)
        even = 1 / (2 * self.blur + 1)
        if not flush:
            return even
        return (1 - _FLUSH) * even + _FLUSH * (shift in flush) / len(flush)

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
            shift = self.draw_shift(rng, which, scenelet, others)
            start = self._centres[which] - self._lengths[scenelet] // 2 + shift
            found = self.carried(CameraFrame(camera), which, scenelet)
            if found is None:
                return None
            stand, mean, spread = found
            across, along, around_z = _SPREADS[int(rng.integers(len(_SPREADS)))]
            sized, aside, further, turned = rng.standard_normal(4).tolist()
            size = mean + spread * sized
            bearing, log_depth = seen_point(stand.x, stand.y)
            x, y = floor_point(
                bearing + across * aside, log_depth + size - stand.size + along * further
            )
            yaw = float(self.candidates.placements[which, scenelet, 2]) + around_z * turned
            return scenelet, start, np.array([x, y, yaw]), size
        scenelet = int(rng.integers(len(self._lengths)))
        first, last = self._starts(scenelet, around, window)
        if last < first:
            return None
        start = int(rng.integers(first, last + 1))
        spreads = np.sqrt(self.problem.start_variance)
        bearing, log_depth = self.problem.start_mean + spreads * rng.standard_normal(2)
        x, y = floor_point(bearing, log_depth)
        turn = rng.uniform(-math.pi, math.pi)
        size = self.problem.size_spread * float(rng.standard_normal())
        return scenelet, start, np.array([x, y, turn]), size

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
        bearing, log_depth = seen_point(x, y)
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
        view = CameraFrame(camera)
        near = range(
            bisect_left(self._centres, middle - self.blur),
            bisect_right(self._centres, middle + self.blur),
        )
        for which in near:
            weight = float(self.candidates.weights[which, scenelet])
            if weight == 0 or not any(first <= which < end for first, end in runs):
                continue
            found = self.carried(view, which, scenelet)
            if found is None:
                continue
            stand, mean, spread = found
            turned = yaw - float(self.candidates.placements[which, scenelet, 2])
            # A window's weight over all windows, times the scenelet's over the window's.
            share = weight / total * (1 - _ANYWHERE) / len(_SPREADS)
            share *= self.shift_probability(which, scenelet, middle - self._centres[which], others)
            share *= math.exp(log_size_density(size - mean, spread))
            middle_bearing, middle_depth = seen_point(stand.x, stand.y)
            aside = bearing - middle_bearing
            further = log_depth - middle_depth - (size - stand.size)
            for across, along, around_z in _SPREADS:
                exponent = -0.5 * ((aside / across) ** 2 + (further / along) ** 2)
                exponent += log_wrapped_normal(turned, around_z)
                density += share * math.exp(exponent) / (2 * math.pi * across * along)
        if density == 0:
            return -math.inf
        return math.log(density) - log_area(log_depth)
