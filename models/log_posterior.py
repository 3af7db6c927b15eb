"""The log-posterior of a clip as a function of a state.

A :class:`State` is one hypothesis. :func:`log_posterior` evaluates a whole one;
:class:`Incremental` evaluates what a proposal changes in a current state, to the same value.
A `Target` says which log-posterior a problem has: the default one
(:mod:`imapper_prob.models.kernels.incremental`) or the published energy
(:mod:`imapper_prob.models.published_energy`).
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

    def copies(self) -> tuple[Array, NDArray[np.int64], Array, Array, Array]:
        """The arrays, in order, of one's own: kernels are compiled for arrays that can be written.

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
        """k, how many scenelets are assigned."""
        return len(self.items)

    def with_item(self, scenelet: int, start: int, placement: Array, size: float = 0.0) -> State:
        """The state with one more scenelet, kept in order of time.

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
        # What numpy.insert does, at a fifth of its price; chains do little else.
        return State(
            self.camera,
            np.concatenate([items[:at], [(scenelet, start)], items[at:]]),
            np.concatenate([placements[:at], [placement], placements[at:]]),
            np.concatenate([sizes[:at], [size], sizes[at:]]),
            self.latent,
        )

    def without_item(self, index: int) -> State:
        """The state with one scenelet less.

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
        """The state with one scenelet placed elsewhere, and its person of another log size.

        Parameters
        ----------
        index : int
            Row of ``items``.
        placement : (3,) float
            x, y (m), yaw (rad).
        size : float, optional
            Log size; as it is if not given.

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
    """No scenelet, the mean camera and the mean path.

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
    """The camera of a state.

    Parameters
    ----------
    nominal : Camera
        That of the clip.
    state : State

    Returns
    -------
    Camera
    """
    return camera_at(nominal, state.camera)


def camera_at(nominal: Camera, phi: Array) -> Camera:
    """The camera that the numbers of a state describe.

    Parameters
    ----------
    nominal : Camera
        That of the clip.
    phi : (5,) float
        See :class:`State`.

    Returns
    -------
    Camera
    """
    pitch, elevation, focal, _, roll = phi.tolist()
    return nominal.posed(
        pitch=pitch, roll=roll, elevation=elevation, focal_scale=float(np.exp(focal))
    )


def change_from(evaluator: Evaluator, n_before: int, now: State, new: State) -> tuple[float, float]:
    """What a state is worth beside the one that an evaluator stands at.

    Parameters
    ----------
    evaluator : Evaluator
    n_before : int
        Scenelets of the one it stands at; ``NOWHERE`` where there is none.
    now : State
        The one it stands at.
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
    """All that there is to say of one state under the default log-posterior.

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
        Log-likelihood of each frame's detections, as they are and with left and right flipped,
        nats, unweighted; 0 outside the support, and where the likelihood is switched off.
    """
    joints = np.full((problem.n_frames, 3, 16), np.nan)
    by_frame = np.zeros((problem.n_frames, 2))
    return _evaluate_into(problem, state, joints, by_frame), joints, by_frame


def _evaluate_into(problem: Problem, state: State, joints: Array, by_frame: Array) -> Array:
    """The terms; and the rest where there is room for it."""
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
    """A log-posterior of the states of a problem.

    Parameters
    ----------
    names : tuple of str
        Of its summands.
    evaluate : callable
        Their values, nats, of a problem and a state.
    incremental : bool
        Whether :class:`imapper_prob.models.log_posterior.Incremental` evaluates changes of it.
    """

    names: tuple[str, ...]
    evaluate: Callable[[Problem, State], Array]
    incremental: bool


_DEFAULT: Final = Target(TERMS, _evaluate_terms, True)
_PUBLISHED: Final = Target(PAPER_TERMS, _evaluate_published, False)


def _target_of(problem: Problem) -> Target:
    """The log-posterior that a problem was packed for: the default one, or the published energy.

    Parameters
    ----------
    problem : Problem

    Returns
    -------
    Target
    """
    return _PUBLISHED if problem.of_paper else _DEFAULT


def _term_names(problem: Problem) -> tuple[str, ...]:
    """Names of what the log-posterior is the sum of.

    Parameters
    ----------
    problem : Problem

    Returns
    -------
    tuple of str
    """
    return _target_of(problem).names


def log_posterior(problem: Problem, state: State) -> float:
    """log pi(phi, X, P | z) up to the constant of the clip, -inf outside the support.

    The normal density of the latent numbers is not included: it is their reference measure.

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
    """The log-posterior term by term.

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


def side_flips(problem: Problem, state: State) -> Array:
    """Probability that the detector took left for right in each frame, given the state.

    By the default model of the detector, whichever energy the state was drawn by.

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
    """Log-likelihood of each frame's detections, before the frame weight.

    The mean over left and right being flipped or not, with their probabilities.

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
    """Joints of the state in its world.

    Parameters
    ----------
    problem : Problem
    state : State

    Returns
    -------
    (T, 16, 3) float
        Metres.
    """
    return np.ascontiguousarray(evaluate(problem, state)[1].transpose(0, 2, 1))


_CAPACITY = 8
"""Scenelets there is room for at first; it is doubled when it runs out."""


class Incremental:
    """Evaluates proposals from a current state, and moves on when one is accepted.

    A walk of one scenelet among five moves the frames it covers, the path up to its neighbours,
    and its boxes in the view of the rest; everything else keeps the value it had.

    Parameters
    ----------
    problem : Problem
    state : State
        Where to start.

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
    def evaluator(self) -> Evaluator:
        """What compiled code is handed to evaluate proposals by itself."""
        return self._evaluator

    @property
    def parts(self) -> tuple[float, float]:
        """What :meth:`propose` said of the current state."""
        return self._parts

    def propose(self, state: State) -> tuple[float, float]:
        """Evaluate a proposal; the current state stays.

        Parameters
        ----------
        state : State

        Returns
        -------
        log_prior, log_likelihood : float
            Nats; the prior is -inf outside the support. Their sum is log pi; the likelihood
            includes the costs of free poses, jumps, collisions, motion and ground.
        """
        if state.n_scenelets > self._capacity:
            self._start(2 * state.n_scenelets)
        parts = change_from(self._evaluator, self._state.n_scenelets, self._state, state)
        self._proposal = state, parts
        return parts

    def accept(self) -> None:
        """Make the state last proposed the current one.

        Raises
        ------
        ValueError
            Nothing was proposed since the last time, or it is outside the support.
        """
        if self._proposal is None or self._proposal[1][0] == -math.inf:
            raise ValueError("there is no proposal inside the support to accept")
        self._state, self._parts = self._proposal
        self._proposal = None
        commit(self._evaluator)

    def _start(self, room: int) -> None:
        """Remember nothing but the current state, with room for so many scenelets."""
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
    """The log-posterior for states that have most in common with one.

    Its values are those of :func:`log_posterior` to some 1e-6 nats, and exactly those where nothing
    is incremental: with the published energy, and about states outside the support.

    Parameters
    ----------
    problem : Problem
    state : State

    Returns
    -------
    callable
        From a state to nats.
    """
    whole = partial(log_posterior, problem)
    if not _target_of(problem).incremental or whole(state) == -math.inf:
        return whole
    incremental = Incremental(problem, state)
    return lambda other: sum(incremental.propose(other))
