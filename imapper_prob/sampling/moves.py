"""Moves between scenes: births, deaths, walks, and stretches of time exchanged between chains.

Each proposes a new state and the log ratio of the reverse to the forward proposal density,
Jacobians included (Green 1995). Which move is tried, with what probability, and whether it
is accepted is the sampler's business. ``explain`` gives the log density of a move from one
state to another, so that the ratio can be checked independently.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.log_posterior import State
from imapper_prob.models.problem import Problem
from imapper_prob.models.view import floor_point, log_area, seen_point
from imapper_prob.samplers.reversible_jump import Proposal
from imapper_prob.sampling.camera_moves import CameraFrame, middle_heights, reproject
from imapper_prob.sampling.proposals import Proposals

__all__ = [
    "Birth",
    "Death",
    "PathRefresh",
    "PlacementWalk",
    "ReplaceNearby",
    "ReplaceSimilar",
    "Shift",
    "TimeCrossover",
    "flush_run",
    "in_order",
]

Array = NDArray[np.float64]


def in_order(problem: Problem, state: State) -> bool:
    """Whether scenelets lie in the clip, one after the other."""
    end = 0
    for scenelet, start in state.items.tolist():
        if start < end:
            return False
        end = start + int(problem.lengths[scenelet])
    return end <= problem.n_frames


def flush_run(problem: Problem, state: State, index: int) -> slice:
    """The scenelets around one that follow one another without a gap."""
    starts = state.items[:, 1]
    gaps = starts[1:] - starts[:-1] - problem.lengths[state.items[:-1, 0]]
    breaks = np.flatnonzero(gaps) + 1
    first = int(breaks[breaks <= index].max(initial=0))
    last = int(breaks[breaks > index].min(initial=len(starts)))
    return slice(first, last)


def _difference(before: State, after: State) -> int | None:
    """Index in ``after`` of the one scenelet that ``before`` lacks."""
    for index in range(after.n_scenelets):
        rest = after.without_item(index)
        if all(
            np.array_equal(getattr(rest, name), getattr(before, name))
            for name in ("items", "placements", "sizes")
        ):
            return index
    return None


def _item(state: State, index: int) -> tuple[int, int, Array, float]:
    """Scenelet, start frame, placement and log size of one item."""
    scenelet, start = state.items[index].tolist()
    return scenelet, start, state.placements[index], float(state.sizes[index])


@dataclass(frozen=True)
class Birth:
    """One scenelet more, drawn from the proposals."""

    proposals: Proposals
    name: str = "birth"
    reverse: str = "death"

    def propose(self, rng: np.random.Generator, state: State) -> Proposal[State] | None:
        """Draw a scenelet; impossible where it would overlap another."""
        drawn = self.proposals.draw(rng, state.camera, state.items)
        if drawn is None:
            return None
        new = state.with_item(*drawn)
        if not in_order(self.proposals.problem, new):
            return None
        log_forward = self.proposals.log_density(*drawn, state.camera, state.items)
        return Proposal(new, -math.log(new.n_scenelets) - log_forward)

    def explain(self, before: State, after: State) -> float:
        """Log density of proposing ``after`` from ``before``."""
        index = _difference(before, after)
        if index is None:
            return -math.inf
        return self.proposals.log_density(*_item(after, index), after.camera, before.items)


@dataclass(frozen=True)
class Death:
    """One scenelet less, any of those there."""

    proposals: Proposals
    name: str = "death"
    reverse: str = "birth"

    def propose(self, rng: np.random.Generator, state: State) -> Proposal[State] | None:
        """Drop a scenelet; impossible where there is none."""
        if state.n_scenelets == 0:
            return None
        index = int(rng.integers(state.n_scenelets))
        rest = state.without_item(index)
        log_reverse = self.proposals.log_density(*_item(state, index), state.camera, rest.items)
        return Proposal(rest, log_reverse + math.log(state.n_scenelets))

    def explain(self, before: State, after: State) -> float:
        """Log density of proposing ``after`` from ``before``."""
        if _difference(after, before) is None:
            return -math.inf
        return -math.log(before.n_scenelets)


@dataclass(frozen=True)
class ReplaceNearby:
    """Another scenelet in place of one, from a window at most ``window`` frames away."""

    proposals: Proposals
    window: int = 10
    name: str = "swap"
    reverse: str = "swap"

    def propose(self, rng: np.random.Generator, state: State) -> Proposal[State] | None:
        """Replace a scenelet by a draw from the proposals nearby in time."""
        if state.n_scenelets == 0:
            return None
        index = int(rng.integers(state.n_scenelets))
        rest = state.without_item(index)
        forward = self._middle(state, index)
        drawn = self.proposals.draw(
            rng, state.camera, rest.items, around=forward, window=self.window
        )
        if drawn is None:
            return None
        new = rest.with_item(*drawn)
        if not in_order(self.proposals.problem, new):
            return None
        backward = self.proposals.middle(drawn[0], drawn[1])
        return Proposal(
            new,
            self._log_density(state, index, rest, backward)
            - self.proposals.log_density(
                *drawn, state.camera, rest.items, around=forward, window=self.window
            ),
        )

    def explain(self, before: State, after: State) -> float:
        """Log density of proposing ``after`` from ``before``."""
        for index in range(before.n_scenelets):
            rest = before.without_item(index)
            other = _difference(rest, after)
            if other is not None:
                density = self._log_density(after, other, rest, self._middle(before, index))
                return density - math.log(before.n_scenelets)
        return -math.inf

    def _middle(self, state: State, index: int) -> int:
        scenelet, start = state.items[index].tolist()
        return self.proposals.middle(scenelet, start)

    def _log_density(self, state: State, index: int, rest: State, around: int) -> float:
        """Of drawing one scenelet of a state around a frame, the rest being there."""
        return self.proposals.log_density(
            *_item(state, index), state.camera, rest.items, around=around, window=self.window
        )


@dataclass(frozen=True)
class ReplaceSimilar:
    """A scenelet of similar motion at the same place and time.

    ``similarity`` (L, L) holds, in row l, the probability of trying each other scenelet.
    """

    problem: Problem
    similarity: Array
    name: str = "exchange"
    reverse: str = "exchange"

    def propose(self, rng: np.random.Generator, state: State) -> Proposal[State] | None:
        """Replace a scenelet, its centre frame and placement kept."""
        if state.n_scenelets == 0:
            return None
        index = int(rng.integers(state.n_scenelets))
        old = int(state.items[index, 0])
        new = int(rng.choice(len(self.similarity), p=self.similarity[old]))
        half = self.problem.lengths // 2
        items = state.items.copy()
        items[index] = (new, items[index, 1] + half[old] - half[new])
        changed = replace(state, items=items)
        if new == old or not in_order(self.problem, changed):
            return None
        ratio = math.log(self.similarity[new, old]) - math.log(self.similarity[old, new])
        return Proposal(changed, ratio)


@dataclass(frozen=True)
class Shift:
    """The same scenelet a few frames earlier or later, alone or with those it is flush with.

    Where one scenelet ends as the next begins the person jumps once, not twice: what follows
    without a gap stays together or pays for it.
    """

    problem: Problem
    reach: int = 4
    name: str = "shift"
    reverse: str = "shift"

    def propose(self, rng: np.random.Generator, state: State) -> Proposal[State] | None:
        """Move start frames; symmetric."""
        if state.n_scenelets == 0:
            return None
        index = int(rng.integers(state.n_scenelets))
        step = int(rng.integers(1, self.reach + 1)) * (1 if rng.random() < 0.5 else -1)
        run, together = flush_run(self.problem, state, index), rng.random() < 0.5
        moved = run if together else slice(index, index + 1)
        items = state.items.copy()
        items[moved, 1] += step
        changed = replace(state, items=items)
        # Flush with others now, they would all be moved on the way back.
        alike = not together or flush_run(self.problem, changed, index) == run
        return Proposal(changed, 0.0) if alike and in_order(self.problem, changed) else None


@dataclass(frozen=True)
class PlacementWalk:
    """One scenelet along and across the viewing ray, and turned.

    Steps are normal in (bearing, log depth, yaw), at one of several scales, now and then
    with half a turn; going to the floor's (x, y) brings the Jacobian (y' / y)^2. Half of the
    steps take the size of the person along with the depth, which then looks the same.
    """

    scales: tuple[float, ...] = (0.2, 1.0, 4.0)
    bearing: float = 0.006
    log_depth: float = 0.03
    yaw: float = 0.08
    turn_about: float = 0.05
    name: str = "placement"
    reverse: str = "placement"

    def propose(self, rng: np.random.Generator, state: State) -> Proposal[State] | None:
        """Walk one placement."""
        if state.n_scenelets == 0:
            return None
        index = int(rng.integers(state.n_scenelets))
        x, y, yaw = state.placements[index]
        if y <= 0:
            return None
        scale = self.scales[int(rng.integers(len(self.scales)))]
        along, across, turn = scale * rng.standard_normal(3)
        bearing, log_depth = seen_point(x, y)
        further = self.log_depth * along
        new_x, new_y = floor_point(bearing + self.bearing * across, log_depth + further)
        about = math.pi if rng.random() < self.turn_about else 0.0
        placement = np.array([new_x, new_y, yaw + self.yaw * turn + about])
        size = float(state.sizes[index])
        if rng.random() < 0.5:
            size += further
        return Proposal(state.with_placement(index, placement, size), log_area(further))


@dataclass(frozen=True)
class PathRefresh:
    """The latent numbers of a stretch of the path, by preconditioned Crank-Nicolson.

    Reversible with respect to the normal law of the numbers, which the log-posterior leaves
    out as their reference measure, so the ratio is one (Cotter et al. 2013).
    """

    stretch: int = 60
    strengths: tuple[float, ...] = (0.2, 1.0)
    name: str = "path"
    reverse: str = "path"

    def propose(self, rng: np.random.Generator, state: State) -> Proposal[State]:
        """Redraw a stretch of frames, partly or whole."""
        n = len(state.latent)
        first = int(rng.integers(-self.stretch + 1, n))
        part = slice(max(first, 0), min(first + self.stretch, n))
        strength = self.strengths[int(rng.integers(len(self.strengths)))]
        latent = state.latent.copy()
        fresh = rng.standard_normal(latent[part].shape)
        latent[part] = math.sqrt(1 - strength**2) * latent[part] + strength * fresh
        return Proposal(replace(state, latent=latent), 0.0)


# ------------------------------------------------------------------------------------------------
# Two scenes exchange what happens in a stretch of time.
#
# What somebody does at the beginning of a clip and at its end hardly know of each other. A hot
# scene has found a better seat for the one, and a cold scene for the other: exchanged as wholes
# neither gets anywhere. So scenes of neighbouring temperatures exchange all scenelets of a
# stretch, and the latent numbers of the path with them.

Flags = NDArray[np.bool_]
_ONE_MORE = 0.4
"""Probability that the stretch takes in one block more."""


@dataclass(frozen=True)
class TimeCrossover:
    """Exchange the scenelets of one or several blocks of time.

    A block is a run of frames that are under a scenelet in either scene, without a gap. Both
    scenes together have the same blocks afterwards, so that the way back is as likely as
    the way there. Scenelets are taken to where they look the same through the other camera
    (:mod:`~imapper_prob.sampling.camera_moves`).
    """

    problem: Problem
    _heights: list[float] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_heights", middle_heights(self.problem).tolist())

    def __call__(
        self, rng: np.random.Generator, hot: State, cold: State
    ) -> tuple[State, State, float] | None:
        """Both scenes afterwards and the log Jacobian.

        None where both are empty, or a scenelet would have nowhere to stand.
        """
        cuts = self._cuts(hot, cold)
        n_blocks = len(cuts) - 1
        if n_blocks < 1:
            return None
        first = int(rng.integers(n_blocks))
        last = min(n_blocks, first + int(rng.geometric(1 - _ONE_MORE)))
        begin, end = int(cuts[first]), int(cuts[last])
        one, other = _inside(hot, begin, end), _inside(cold, begin, end)
        if not one.any() and not other.any():
            return None
        warm, cool = CameraFrame(hot.camera), CameraFrame(cold.camera)
        to_cold = self._carried(hot, one, warm, cool)
        to_hot = self._carried(cold, other, cool, warm)
        if to_cold is None or to_hot is None:
            return None
        new_hot = _exchanged(hot, one, cold, other, begin, end, to_hot)
        new_cold = _exchanged(cold, other, hot, one, begin, end, to_cold)
        return new_hot, new_cold, to_hot[2] + to_cold[2]

    def _carried(
        self, state: State, which: Flags, own: CameraFrame, others: CameraFrame
    ) -> tuple[Array, Array, float] | None:
        """Where some scenelets of a state stand for another one's camera."""
        return reproject(
            own, others,
            self._heights, state.items[which], state.placements[which], state.sizes[which],
        )  # fmt: skip

    def _cuts(self, hot: State, cold: State) -> NDArray[np.int64]:
        """Frames between blocks, in the middle of their gaps, and both ends of the clip."""
        items = np.concatenate([hot.items, cold.items])
        items = items[np.argsort(items[:, 1], kind="stable")]
        ends = np.maximum.accumulate(items[:, 1] + self.problem.lengths[items[:, 0]])
        gaps = [
            (int(end) + int(start)) // 2
            for end, start in zip(ends[:-1], items[1:, 1], strict=True)
            if end <= start
        ]
        if len(items) == 0:
            return np.zeros(0, np.int64)
        return np.array([0, *gaps, self.problem.n_frames], dtype=np.int64)


def _inside(state: State, begin: int, end: int) -> Flags:
    starts = state.items[:, 1]
    inside: Flags = (starts >= begin) & (starts < end)
    return inside


def _exchanged(
    own: State,
    given: Flags,
    others: State,
    taken: Flags,
    begin: int,
    end: int,
    carried: tuple[Array, Array, float],
) -> State:
    """One scene with the other's scenelets in a stretch, where its own camera sees them."""
    placements, sizes, _ = carried
    items = np.concatenate([own.items[~given], others.items[taken]])
    order = np.argsort(items[:, 1], kind="stable")
    latent = own.latent.copy()
    latent[begin:end] = others.latent[begin:end]
    return replace(
        own,
        items=items[order],
        placements=np.concatenate([own.placements[~given], placements])[order],
        sizes=np.concatenate([own.sizes[~given], sizes])[order],
        latent=latent,
    )
