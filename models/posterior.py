"""The log-posterior of a clip as a function of a state."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.brief import brief
from imapper_prob.models.camera import Camera
from imapper_prob.models.compiled import evaluate
from imapper_prob.models.compiled_paper import PAPER_TERMS, evaluate_paper
from imapper_prob.models.energy.swaps import swap_probabilities
from imapper_prob.models.problem import Problem
from imapper_prob.models.terms import TERMS

__all__ = [
    "State",
    "Target",
    "camera_at",
    "empty_state",
    "frame_log_likelihood",
    "log_posterior",
    "motion",
    "state_camera",
    "swapped",
    "target_of",
    "term_names",
    "terms",
]

Array = NDArray[np.float64]


_FIELDS = ("camera", "items", "placements", "sizes", "latent")


@dataclass(frozen=True, eq=False)
class State:
    """One hypothesis s = (phi, X, P, b, z).

    Parameters
    ----------
    camera : (5,) float
        phi: pitch (rad), elevation (m), log focal scale, log body scale, roll (rad).
    items : (k, 2) int
        X: scenelet index and start frame, sorted by start frame.
    placements : (k, 3) float
        P: x, y in metres and yaw in radians of each scenelet's local frame.
    sizes : (k,) float
        b: log size of each scenelet, its person and its furniture, on top of the body scale. The
        person's own body does not change; what a scenelet leaves open of how far away it is does.
    latent : (T, 2) float
        z: standard normal numbers from which the path of free frames is drawn.
    """

    camera: Array
    items: NDArray[np.int64]
    placements: Array
    sizes: Array
    latent: Array

    __repr__ = brief

    def __post_init__(self) -> None:
        # All states alike, wherever their arrays come from: the compiler makes a kernel for each
        # kind of array it meets.
        for name in _FIELDS:
            array = getattr(self, name)
            if not array.flags.c_contiguous:
                array = np.ascontiguousarray(array)
                object.__setattr__(self, name, array)
            array.setflags(write=False)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Another process's state is as read-only as it was there."""
        self.__dict__.update(state)
        self.__post_init__()

    @property
    def n_scenelets(self) -> int:
        """k, how many scenelets are assigned."""
        return len(self.items)

    def with_item(self, scenelet: int, start: int, placement: Array, size: float = 0.0) -> State:
        """The state with one more scenelet, kept in order of time."""
        at = int(np.searchsorted(self.items[:, 1], start))
        items, placements, sizes = self.items, self.placements, self.sizes
        # What numpy.insert does, at a fifth of its price; chains do little else.
        return State(
            self.camera,
            np.concatenate([items[:at], [(scenelet, start)], items[at:]]),
            np.concatenate([placements[:at], [placement], placements[at:]]),
            np.concatenate([sizes[:at], [size], sizes[at:]]),
            self.latent,
        )

    def without_item(self, index: int) -> State:
        """The state with one scenelet less."""
        others = [k for k in range(len(self.items)) if k != index]
        return State(
            self.camera,
            self.items[others],
            self.placements[others],
            self.sizes[others],
            self.latent,
        )

    def with_placement(self, index: int, placement: Array, size: float | None = None) -> State:
        """The state with one scenelet placed elsewhere, and its person of another log size."""
        placements, sizes = self.placements.copy(), self.sizes.copy()
        placements[index] = placement
        if size is not None:
            sizes[index] = size
        return State(self.camera, self.items, placements, sizes, self.latent)


def empty_state(problem: Problem) -> State:
    """No scenelet, the mean camera and the mean path."""
    return State(
        camera=np.array(problem.camera_mean),
        items=np.empty((0, 2), np.int64),
        placements=np.empty((0, 3)),
        sizes=np.empty(0),
        latent=np.zeros((problem.n_frames, 2)),
    )


def state_camera(nominal: Camera, state: State) -> Camera:
    """The camera of a state, where ``nominal`` is that of its clip."""
    return camera_at(nominal, state.camera)


def camera_at(nominal: Camera, phi: Array) -> Camera:
    """The camera by the numbers (5,) that a state has of it."""
    pitch, elevation, focal, _, roll = phi.tolist()
    return nominal.posed(
        pitch=pitch, roll=roll, elevation=elevation, focal_scale=float(np.exp(focal))
    )


def _evaluate(problem: Problem, state: State) -> tuple[Array, Array, Array]:
    joints = np.empty((problem.n_frames, 3, 16))
    by_frame = np.zeros((problem.n_frames, 2))
    return _evaluate_into(problem, state, joints, by_frame), joints, by_frame


def _evaluate_into(problem: Problem, state: State, joints: Array, by_frame: Array) -> Array:
    values: Array = evaluate(
        problem, state.camera, state.items, state.placements, state.sizes, state.latent,
        joints, by_frame,
    )  # fmt: skip
    return values


def _evaluate_terms(problem: Problem, state: State) -> Array:
    return _evaluate_into(problem, state, np.empty((0, 3, 16)), np.empty((0, 2)))


def _evaluate_published(problem: Problem, state: State) -> Array:
    joints, by_frame = np.empty((problem.n_frames, 3, 16)), np.empty((problem.n_frames, 4))
    values: Array = evaluate_paper(
        problem, state.camera, state.items, state.placements, state.sizes, state.latent,
        joints, by_frame,
    )  # fmt: skip
    return values


class Target(NamedTuple):
    """A log-posterior of the states of a problem.

    Parameters
    ----------
    names : tuple of str
        Of its summands.
    evaluate : callable
        Their values, nats, of a problem and a state.
    incremental : bool
        Whether :class:`imapper_prob.models.incremental.Incremental` evaluates changes of it.
    """

    names: tuple[str, ...]
    evaluate: Callable[[Problem, State], Array]
    incremental: bool


_DEFAULT: Final = Target(TERMS, _evaluate_terms, True)
_PUBLISHED: Final = Target(PAPER_TERMS, _evaluate_published, False)


def target_of(problem: Problem) -> Target:
    """The log-posterior that the problem was packed for: the default one, or the published energy.

    All that asks for a log-posterior asks here, and nowhere else, which it is.
    """
    return _PUBLISHED if problem.of_paper else _DEFAULT


def term_names(problem: Problem) -> tuple[str, ...]:
    """What the log-posterior is the sum of."""
    return target_of(problem).names


def log_posterior(problem: Problem, state: State) -> float:
    """log pi(phi, X, P | z) up to the constant of the clip, -inf outside the support.

    The normal density of the latent numbers is not included: it is their reference measure.
    """
    return float(target_of(problem).evaluate(problem, state).sum())


def terms(problem: Problem, state: State) -> dict[str, float]:
    """The log-posterior term by term, in nats."""
    target = target_of(problem)
    return dict(zip(target.names, target.evaluate(problem, state).tolist(), strict=True))


def swapped(problem: Problem, state: State) -> Array:
    """(T,) probability that the detector took left for right in a frame, given the state.

    By the default model of the detector, whichever energy the state was drawn by.
    """
    by_frame = _evaluate(problem, state)[2]
    return np.asarray(_swap_probabilities(problem, by_frame))


def frame_log_likelihood(problem: Problem, state: State) -> Array:
    """(T,) log-likelihood of each frame's detections, nats, before the frame weight.

    The mean over left and right being swapped or not, with their probabilities.
    """
    by_frame = _evaluate(problem, state)[2]
    wrong = _swap_probabilities(problem, by_frame)
    mean: Array = (1 - wrong) * by_frame[:, 0] + wrong * by_frame[:, 1]
    return mean


def _swap_probabilities(problem: Problem, by_frame: Array) -> Array:
    weight = problem.frame_weight * problem.likelihood
    return swap_probabilities(
        by_frame, problem.path_starts, weight, problem.swap_begins, problem.swap_ends
    )


def motion(problem: Problem, state: State) -> Array:
    """(T, 16, 3) joints of the state in its world, metres."""
    return np.ascontiguousarray(_evaluate(problem, state)[1].transpose(0, 2, 1))
