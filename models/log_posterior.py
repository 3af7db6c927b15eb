"""The log-posterior of a clip as a function of a state (a scene hypothesis).

:func:`log_posterior` evaluates a whole :class:`State`. :class:`Incremental` evaluates only what a
proposal changes in a current state, with the same result. A `Target` tells which log-posterior a
problem has: the default one (:mod:`imapper_prob.models.kernels.incremental`) or the published
energy (:mod:`imapper_prob.models.published_energy`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.kernels.cache import Evaluator, open_evaluator
from imapper_prob.models.kernels.detection import flip_probabilities
from imapper_prob.models.kernels.given import weigh_labels
from imapper_prob.models.kernels.incremental import NOWHERE, change, commit, read_proposed
from imapper_prob.models.problem import CAMERA, TERMS, Problem
from imapper_prob.models.published_energy import PAPER_TERMS, evaluate_paper
from imapper_prob.models.text import brief

__all__ = [
    "Incremental",
    "State",
    "Target",
    "camera_at",
    "change_from",
    "empty_state",
    "evaluate",
    "frame_log_likelihood",
    "label_probabilities",
    "log_posterior",
    "log_posterior_near",
    "motion",
    "side_flips",
    "state_camera",
    "terms",
]

Array = NDArray[np.float64]


_FIELDS = ("camera", "items", "placements", "sizes", "latent")


@dataclass(frozen=True, eq=False)
class State:
    """One hypothesis about a scene, s = (phi, X, P, b, z).

    Parameters
    ----------
    camera : (5,) float
        phi: pitch (rad), elevation (m), log focal scale, log body scale, roll (rad).
    items : (k, 2) int
        X: scenelet index and start frame, sorted by start frame.
    placements : (k, 3) float
        P: x, y in metres and yaw in radians of each scenelet's local frame.
    sizes : (k,) float
        b: log size of each scenelet (person and furniture), in addition to the body scale. It
        accounts for the unknown distance of a scenelet; the size of the actual person does not
        change.
    latent : (T, 2) float
        z: standard normal variables that determine the path of frames outside scenelets.
    """

    camera: Array
    items: NDArray[np.int64]
    placements: Array
    sizes: Array
    latent: Array

    __repr__ = brief

    def __post_init__(self) -> None:
        # Make all arrays contiguous and read-only: numba compiles a kernel for each kind of array.
        for name in _FIELDS:
            array = getattr(self, name)
            if not array.flags.c_contiguous:
                array = np.ascontiguousarray(array)
                object.__setattr__(self, name, array)
            array.setflags(write=False)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a state from a pickle, with read-only arrays."""
        self.__dict__.update(state)
        self.__post_init__()

    def copies(self) -> tuple[Array, NDArray[np.int64], Array, Array, Array]:
        """Writable copies of the arrays, in order, as the compiled kernels require.

        Returns
        -------
        tuple of array
        """
        return (
            self.camera.copy(), self.items.copy(), self.placements.copy(), self.sizes.copy(),
            self.latent.copy(),
        )  # fmt: skip

    @property
    def n_scenelets(self) -> int:
        """k, the number of scenelets."""
        return len(self.items)

    def with_item(self, scenelet: int, start: int, placement: Array, size: float = 0.0) -> State:
        """The state with one more scenelet, in order of start frames.

        Parameters
        ----------
        scenelet : int
            Index in the library.
        start : int
            Its first frame.
        placement : (3,) float
            x, y (m), yaw (rad).
        size : float
            Log size.

        Returns
        -------
        State
        """
        at = int(np.searchsorted(self.items[:, 1], start))
        items, placements, sizes = self.items, self.placements, self.sizes
        # Like numpy.insert but five times faster; chains call this very often.
        return State(
            self.camera,
            np.concatenate([items[:at], [(scenelet, start)], items[at:]]),
            np.concatenate([placements[:at], [placement], placements[at:]]),
            np.concatenate([sizes[:at], [size], sizes[at:]]),
            self.latent,
        )

    def without_item(self, index: int) -> State:
        """The state without one scenelet.

        Parameters
        ----------
        index : int
            Row of ``items``.

        Returns
        -------
        State
        """
        others = [k for k in range(len(self.items)) if k != index]
        return State(
            self.camera,
            self.items[others],
            self.placements[others],
            self.sizes[others],
            self.latent,
        )

    def with_placement(self, index: int, placement: Array, size: float | None = None) -> State:
        """The state with another placement of one scenelet, and optionally another log size.

        Parameters
        ----------
        index : int
            Row of ``items``.
        placement : (3,) float
            x, y (m), yaw (rad).
        size : float, optional
            Log size; unchanged if not given.

        Returns
        -------
        State
        """
        placements, sizes = self.placements.copy(), self.sizes.copy()
        placements[index] = placement
        if size is not None:
            sizes[index] = size
        return State(self.camera, self.items, placements, sizes, self.latent)


def empty_state(problem: Problem) -> State:
    """The state without scenelets, with the mean camera and the mean path.

    Parameters
    ----------
    problem : Problem

    Returns
    -------
    State
    """
    return State(
        camera=np.array(problem.camera_mean),
        items=np.empty((0, 2), np.int64),
        placements=np.empty((0, 3)),
        sizes=np.empty(0),
        latent=np.zeros((problem.n_frames, 2)),
    )


def state_camera(nominal: Camera, state: State) -> Camera:
    """The camera that a state describes.

    Parameters
    ----------
    nominal : Camera
        The camera of the clip.
    state : State

    Returns
    -------
    Camera
    """
    return camera_at(nominal, state.camera)


def camera_at(nominal: Camera, phi: Array) -> Camera:
    """The camera that given camera parameters describe.

    Parameters
    ----------
    nominal : Camera
        The camera of the clip.
    phi : (5,) float
        Camera parameters, see :class:`State`.

    Returns
    -------
    Camera
    """
    pitch, elevation, focal, _, roll = phi.tolist()
    return nominal.posed(
        pitch=pitch, roll=roll, elevation=elevation, focal_scale=float(np.exp(focal))
    )


def change_from(evaluator: Evaluator, n_before: int, now: State, new: State) -> tuple[float, float]:
    """Log prior and log likelihood of a state, evaluated as a change from an evaluator's state.

    Parameters
    ----------
    evaluator : Evaluator
    n_before : int
        Number of scenelets of the evaluator's current state; ``NOWHERE`` if it has none.
    now : State
        Current state of the evaluator.
    new : State

    Returns
    -------
    log_prior, log_likelihood : float
        See :func:`imapper_prob.models.kernels.incremental.change`.
    """
    parts: tuple[float, float] = change(
        evaluator, n_before, now.camera.copy(), now.latent.copy(), *new.copies()
    )
    return parts


def evaluate(problem: Problem, state: State) -> tuple[Array, Array, Array]:
    """Evaluate terms, motion and per-frame likelihood under the default log-posterior.

    Parameters
    ----------
    problem : Problem
    state : State

    Returns
    -------
    terms : (12,) float
        Values of ``TERMS``, nats; the first is -inf outside the support.
    joints : (T, 3, 16) float
        The motion in the world, metres; NaN outside the support.
    by_frame : (T, 2) float
        Log-likelihood of each frame's detections, as they are and with left and right flipped, in
        nats, before the frame weight. 0 outside the support, and if the likelihood is switched off.
    """
    joints = np.full((problem.n_frames, 3, 16), np.nan)
    by_frame = np.zeros((problem.n_frames, 2))
    return _evaluate_into(problem, state, joints, by_frame), joints, by_frame


def _evaluate_into(problem: Problem, state: State, joints: Array, by_frame: Array) -> Array:
    """Return the terms, and write ``joints`` and ``by_frame`` if these are not empty."""
    evaluator: Evaluator = open_evaluator(problem, state.n_scenelets)
    prior, _ = change_from(evaluator, NOWHERE, state, state)
    if prior == -math.inf:
        values = np.zeros(len(TERMS))
        values[CAMERA] = -math.inf
        return values
    return np.asarray(read_proposed(evaluator, joints, by_frame))


def _evaluate_terms(problem: Problem, state: State) -> Array:
    return _evaluate_into(problem, state, np.empty((0, 3, 16)), np.empty((0, 2)))


def _evaluate_published(problem: Problem, state: State) -> Array:
    joints, by_frame = np.empty((problem.n_frames, 3, 16)), np.empty((problem.n_frames, 4))
    values: Array = evaluate_paper(problem, *state.copies(), joints, by_frame)
    return values


class Target(NamedTuple):
    """A log-posterior on the states of a problem.

    Parameters
    ----------
    names : tuple of str
        Names of its terms.
    evaluate : callable
        Computes the values of the terms, nats, from a problem and a state.
    incremental : bool
        Whether :class:`imapper_prob.models.log_posterior.Incremental` supports it.
    """

    names: tuple[str, ...]
    evaluate: Callable[[Problem, State], Array]
    incremental: bool


_DEFAULT: Final = Target(TERMS, _evaluate_terms, True)
_PUBLISHED: Final = Target(PAPER_TERMS, _evaluate_published, False)


def _target_of(problem: Problem) -> Target:
    """The log-posterior of a problem: the default one or the published energy.

    Parameters
    ----------
    problem : Problem

    Returns
    -------
    Target
    """
    return _PUBLISHED if problem.of_paper else _DEFAULT


def log_posterior(problem: Problem, state: State) -> float:
    """log pi(phi, X, P | z) up to a constant of the clip; -inf outside the support.

    The normal density of the latent variables is not included; it is the reference measure.

    Parameters
    ----------
    problem : Problem
    state : State

    Returns
    -------
    float
        Nats.
    """
    return float(_target_of(problem).evaluate(problem, state).sum())


def terms(problem: Problem, state: State) -> dict[str, float]:
    """The terms of the log-posterior.

    Parameters
    ----------
    problem : Problem
    state : State

    Returns
    -------
    dict of str to float
        Nats; their sum is :func:`log_posterior`.
    """
    target = _target_of(problem)
    return dict(zip(target.names, target.evaluate(problem, state).tolist(), strict=True))


def label_probabilities(problem: Problem, state: State) -> tuple[Array, NDArray[np.int64], Array]:
    """Probabilities of the true labels of a state's objects, given all statements.

    Parameters
    ----------
    problem : Problem
    state : State
        Inside the support.

    Returns
    -------
    centres : (k, 3) float
        Centres of the bounding boxes of the state's objects, metres. Objects of one label that are
        one object are listed once, as in the likelihood of statements.
    labels : (k,) int
        Their categories in the scenelets.
    probabilities : (k, C) float
        By true category; the rows sum to 1. The labels of the other objects are summed out.
    """
    evaluator: Evaluator = open_evaluator(problem._replace(likelihood=0.0), state.n_scenelets)
    change_from(evaluator, NOWHERE, state, state)
    pieces, labels, values = weigh_labels(evaluator, state.n_scenelets, state.camera.copy())
    weights = np.exp(values - values.max(1, keepdims=True))
    return pieces[:, :3], labels, weights / weights.sum(1, keepdims=True)


def side_flips(problem: Problem, state: State) -> Array:
    """Probability that left and right are flipped in each frame, given the state.

    Always computed with the default detector model, even for the published energy.

    Parameters
    ----------
    problem : Problem
    state : State

    Returns
    -------
    (T,) float
    """
    by_frame = evaluate(problem, state)[2]
    return np.asarray(_flip_probabilities(problem, by_frame))


def frame_log_likelihood(problem: Problem, state: State) -> Array:
    """Expected log-likelihood of each frame's detections, before the frame weight.

    The mean over both cases, flipped and not, weighted by their probabilities.

    Parameters
    ----------
    problem : Problem
    state : State

    Returns
    -------
    (T,) float
        Nats.
    """
    by_frame = evaluate(problem, state)[2]
    wrong = _flip_probabilities(problem, by_frame)
    mean: Array = (1 - wrong) * by_frame[:, 0] + wrong * by_frame[:, 1]
    return mean


def _flip_probabilities(problem: Problem, by_frame: Array) -> Array:
    weight = problem.frame_weight * problem.likelihood
    return flip_probabilities(
        by_frame, problem.path_starts, weight, problem.flip_begins, problem.flip_ends
    )


def motion(problem: Problem, state: State) -> Array:
    """Joint positions of a state in the world frame.

    Parameters
    ----------
    problem : Problem
    state : State

    Returns
    -------
    (T, 16, 3) float
        Metres.
    """
    # It does not depend on the detections, whose likelihood takes most of an evaluation.
    joints = evaluate(problem._replace(likelihood=0.0), state)[1]
    return np.ascontiguousarray(joints.transpose(0, 2, 1))


_CAPACITY = 8
"""Initial capacity in scenelets; `Incremental` doubles what is needed when it runs out."""


class Incremental:
    """Evaluates proposals incrementally, and updates the current state when one is accepted.

    Moving one of several scenelets changes the frames it covers, the path up to the neighbouring
    scenelets, and occlusion by its boxes in other frames. All other values are reused.

    Parameters
    ----------
    problem : Problem
    state : State
        Initial state.

    Raises
    ------
    ValueError
        ``state`` is outside the support.
    """

    def __init__(self, problem: Problem, state: State) -> None:
        self._problem = problem
        self._state, self._parts = state, (-math.inf, 0.0)
        self._proposal: tuple[State, tuple[float, float]] | None = None
        self._start(_CAPACITY)

    @property
    def state(self) -> State:
        """The current state."""
        return self._state

    @property
    def parts(self) -> tuple[float, float]:
        """Log prior and log likelihood of the current state, see :meth:`propose`."""
        return self._parts

    def propose(self, state: State) -> tuple[float, float]:
        """Evaluate a proposal without changing the current state.

        Parameters
        ----------
        state : State

        Returns
        -------
        log_prior, log_likelihood : float
            Nats; the prior is -inf outside the support. Their sum is log pi. The likelihood
            includes the terms of free poses, jumps, collisions, motion and ground.
        """
        if state.n_scenelets > self._capacity:
            self._start(2 * state.n_scenelets)
        parts = change_from(self._evaluator, self._state.n_scenelets, self._state, state)
        self._proposal = state, parts
        return parts

    def accept(self) -> None:
        """Make the last proposal the current state.

        Raises
        ------
        ValueError
            Nothing was proposed since the last call, or the proposal is outside the support.
        """
        if self._proposal is None or self._proposal[1][0] == -math.inf:
            raise ValueError("there is no proposal inside the support to accept")
        self._state, self._parts = self._proposal
        self._proposal = None
        commit(self._evaluator)

    def _start(self, room: int) -> None:
        """Open an evaluator with a capacity of ``room`` scenelets, at the current state."""
        if not _target_of(self._problem).incremental:
            raise ValueError("the published energy has no incremental evaluation")
        state = self._state
        self._capacity = max(room, state.n_scenelets)
        self._evaluator: Evaluator = open_evaluator(self._problem, self._capacity)
        parts = change_from(self._evaluator, NOWHERE, state, state)
        if parts[0] == -math.inf:
            raise ValueError("an evaluation cannot start from a state outside the support")
        self._proposal = state, parts
        self.accept()


def log_posterior_near(problem: Problem, state: State) -> Callable[[State], float]:
    """A log-posterior function that is fast for states similar to a given one.

    It agrees with :func:`log_posterior` to about 1e-6 nats, and exactly if there is no incremental
    evaluation: for the published energy, and if ``state`` is outside the support.

    Parameters
    ----------
    problem : Problem
    state : State

    Returns
    -------
    callable
        Maps a state to its log-posterior in nats.
    """
    whole = partial(log_posterior, problem)
    if not _target_of(problem).incremental:
        return whole
    try:
        incremental = Incremental(problem, state)
    except ValueError:  # outside the support
        return whole
    return lambda other: sum(incremental.propose(other))
