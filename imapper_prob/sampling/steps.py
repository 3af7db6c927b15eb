"""Compiled Metropolis-Hastings-Green steps of a chain over scenes.

They do the same as :func:`imapper_prob.samplers.reversible_jump.step` with the moves of
:func:`scene_moves`, for many steps in one call.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numba import types
from numba.experimental import structref
from numpy.typing import NDArray

from imapper_prob.models.kernels.cache import Evaluator, open_evaluator
from imapper_prob.models.kernels.incremental import (
    EVERYTHING,
    NOWHERE,
    change,
    commit,
    place_scene,
    weigh_placed,
)
from imapper_prob.models.log_posterior import State, log_posterior
from imapper_prob.models.problem import Problem
from imapper_prob.models.published_energy import evaluate_paper
from imapper_prob.samplers.reversible_jump import ChainState, StepInfo
from imapper_prob.samplers.tempering import PRIOR, LogDensityParts, Rung
from imapper_prob.sampling import camera_moves, moves, redraws
from imapper_prob.sampling.image_pelvis import middle_heights
from imapper_prob.sampling.jit import compiled, inner
from imapper_prob.sampling.reference import Reference
from imapper_prob.sampling.reference_density import log_reference
from imapper_prob.sampling.scene import StateArrays, arrays_of, state_of

__all__ = ["MOVES", "Moves", "SceneChain", "log_posteriors", "parts_of", "propose", "scene_moves"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

MOVES: Final = {
    "replace": 0.4,
    "shift": 0.06,
    "placement": 0.3,
    "camera": 0.015,
    "camera-compensated": 0.035,
    "depth-scale": 0.03,
    "focal-scale": 0.02,
    "path": 0.05,
    "camera-adapted": 0.075,
    "scene-redraw": 0.1,
    "redraw": 0.6,
}
"""Moves and their weights. Chosen: replacing a scenelet by one of similar motion reaches scenes
that were never visited, a few nats at a time; redraws from the reference reach all others. Moves of
the camera and of whole scenes are seldom tried, because every frame has to be evaluated again; the
camera converges faster than the layouts."""
(
    _REPLACE, _SHIFT, _PLACEMENT, _CAMERA, _CAMERA_COMPENSATED, _DEPTH_SCALE, _FOCAL_SCALE, _PATH,
    _CAMERA_ADAPTED, _SCENE_REDRAW, _REDRAW,
) = range(len(MOVES))  # fmt: skip
_NAMES: Final = tuple(MOVES)
_structref: Any = structref
"""numba's structref module, typed as Any because it is published without types."""
_CAPACITY: Final = 8
"""Initial capacity in scenelets, which is increased when needed."""


class Moves(NamedTuple):
    """Data of the moves of a problem, and their weights.

    Parameters
    ----------
    lengths : (L,) int
        Frames of each scenelet.
    heights : (L,) float
        Height of the pelvis in each scenelet's middle frame, metres of the reference body.
    factor : (5, 5) float
        Lower Cholesky factor of the prior covariance of camera and body.
    shape : (5, 5) float
        Lower Cholesky factor of the estimated posterior covariance.
    focal_spread : float
        Prior standard deviation of the log focal length.
    reference : Reference
    weights : (M,) float
        Weight of each of ``MOVES``, not normalised.
    """

    lengths: Ints
    heights: Array
    factor: Array
    shape: Array
    focal_spread: float
    reference: Reference
    weights: Array


def scene_moves(problem: Problem, reference: Reference, shape: Array | None) -> Moves:
    """Collect the moves of a problem.

    Parameters
    ----------
    problem : Problem
    reference : Reference
    shape : (5, 5) float or None
        See :func:`imapper_prob.sampling.visits.camera_shape`; None if unknown.

    Returns
    -------
    Moves
    """
    factor = np.linalg.cholesky(np.linalg.inv(problem.camera_precision)).astype(np.float64)
    weights = np.array([*MOVES.values()])
    if shape is None:
        weights[_CAMERA_ADAPTED] = 0.0
    return Moves(
        lengths=np.array(problem.lengths),
        heights=np.array(middle_heights(problem)),
        factor=factor,
        shape=factor if shape is None else shape,
        focal_spread=float(np.linalg.norm(factor[2])),
        reference=reference,
        weights=weights,
    )


class _SharedMovesType(types.StructRef):
    """The numba type of shared data of moves."""


class SharedMoves(structref.StructRefProxy):
    """Data of the moves, which are passed to compiled code by one address; see :func:`share_moves`.

    Some fifty arrays would otherwise be unpacked at every call.

    Parameters
    ----------
    *args
        The attribute.

    Attributes
    ----------
    moves : Moves
    """

    moves: Moves


_structref.register(_SharedMovesType)
_structref.define_boxing(_SharedMovesType, SharedMoves)
_structref.define_constructor(SharedMoves, _SharedMovesType, ["moves"])


@compiled
def share_moves(moves: Moves) -> SharedMoves:
    """Share the data of moves with compiled code.

    Parameters
    ----------
    moves : Moves
        Its arrays are referenced, not copied.

    Returns
    -------
    SharedMoves
    """
    return SharedMoves(moves)  # type: ignore[no-untyped-call]


@compiled
def propose(
    move_data: Moves, move: int, rng: np.random.Generator, scene: StateArrays
) -> tuple[StateArrays, float]:
    """Propose a scene by one of the moves.

    Parameters
    ----------
    move_data : Moves
    move : int
        Index in ``MOVES``.
    rng : numpy.random.Generator
    scene : StateArrays

    Returns
    -------
    StateArrays
    float
        Log of reverse over forward proposal density, nats; -inf if the move is impossible.
    """
    if move == _REPLACE:
        return moves.replace_similar(move_data.reference, rng, scene)
    if move == _SHIFT:
        return moves.shift(move_data.lengths, rng, scene)
    if move == _PLACEMENT:
        return moves.walk_placement(rng, scene)
    if move == _CAMERA:
        return camera_moves.walk_camera(move_data.factor, rng, scene)
    if move == _CAMERA_COMPENSATED:
        return camera_moves.walk_compensated(move_data.factor, move_data.heights, rng, scene)
    if move == _DEPTH_SCALE:
        return camera_moves.scale_depth(rng, scene)
    if move == _FOCAL_SCALE:
        return camera_moves.scale_focal(move_data.focal_spread, rng, scene)
    if move == _PATH:
        return moves.refresh_path(rng, scene)
    if move == _CAMERA_ADAPTED:
        return camera_moves.walk_adapted(move_data.shape, move_data.heights, rng, scene)
    if move == _SCENE_REDRAW:
        return redraws.redraw_scene(move_data.reference, rng, scene)
    return redraws.redraw_stretch(move_data.reference, rng, scene)


# ------------------------------------------------------------------------------------------------
# Evaluation.


@compiled
def log_posteriors(
    evaluator: Evaluator,
    published: Array | None,
    n_before: int,
    now: StateArrays,
    cameras: Array,
    items: Ints,
    placements: Array,
    sizes: Array,
    latents: Array,
    rising: bool,
) -> Array:
    """Evaluate the log-posteriors of W scenes with k scenelets each.

    Parameters
    ----------
    evaluator : Evaluator
    published : array, optional
        Weights of the published energy; None for the default log-posterior. numba compiles only
        one.
    n_before : int
        Number of scenelets of the evaluator's current scene; ``NOWHERE`` if it has none, or shares
        nothing with the others.
    now : StateArrays
        Current scene of the evaluator.
    cameras : (W, 5) float
    items : (W, k, 2) int
    placements : (W, k, 3) float
    sizes : (W, k) float
    latents : (W, T, 2) float
        One per scene, or a single one for all, likewise the cameras.
    rising : bool
        Whether only the largest is wanted. Others may be -inf then, which takes less time.

    Returns
    -------
    (W,) float
        Nats.
    """
    values, largest = np.empty(len(items)), -math.inf
    for w in range(len(items)):
        camera, latent = cameras[min(w, len(cameras) - 1)], latents[min(w, len(latents) - 1)]
        if published is not None:
            values[w] = _log_published(
                evaluator.problem, camera, items[w], placements[w], sizes[w], latent
            )
        else:
            values[w] = place_scene(
                evaluator, n_before, now.camera, now.latent,
                camera, items[w], placements[w], sizes[w], latent,
            )  # fmt: skip
            if values[w] > -math.inf:
                least = largest - values[w] if rising else EVERYTHING
                values[w] += weigh_placed(evaluator, n_before, camera, items[w], least)
            largest = max(largest, values[w])
    return values


@inner
def _log_published(
    problem: Problem, camera: Array, items: Ints, placements: Array, sizes: Array, latent: Array
) -> float:
    joints, by_frame = np.empty((len(latent), 3, 16)), np.empty((len(latent), 4))
    terms = evaluate_paper(problem, camera, items, placements, sizes, latent, joints, by_frame)
    return float(terms.sum())


@inner
def _log_tilt(kinds: Ints, tilts: Array, items: Ints) -> float:
    """Sum of the tilts of the kinds of scenelets; 0 without tilts."""
    tilt = 0.0
    if len(tilts):
        for i in range(len(items)):
            tilt += tilts[kinds[items[i, 0]]]
    return tilt


@compiled
def _log_density_parts(
    shared_moves: SharedMoves,
    evaluator: Evaluator,
    published: Array | None,
    n_before: int,
    now: StateArrays,
    new: StateArrays,
    beta: float,
    tilts: Array,
    least: float,
) -> tuple[float, float]:
    """Log density of the reference, and log ratio of posterior to reference, of a scene.

    Both are evaluated as a change from the evaluator's scene ``now``. The first is -inf outside the
    support, and may be if the log density on a rung is below ``least``.
    """
    prior = -math.inf
    if published is not None:
        density = _log_published(
            evaluator.problem, new.camera, new.items, new.placements, new.sizes, new.latent
        )
    else:
        density = place_scene(
            evaluator, n_before, now.camera, now.latent,
            new.camera, new.items, new.placements, new.sizes, new.latent,
        )  # fmt: skip
    if density > -math.inf:
        prior = log_reference(
            shared_moves.moves.reference, new.camera, new.items, new.placements, new.sizes
        )  # fmt: skip
        if published is None:
            wanted = EVERYTHING
            if beta > 0.0 and prior > -math.inf:
                tilt = _log_tilt(shared_moves.moves.reference.kinds, tilts, new.items)
                wanted = prior - density + (least - prior - tilt) / beta
            density += weigh_placed(evaluator, n_before, new.camera, new.items, wanted)
    if math.isnan(density):
        return density, density
    if density == -math.inf or prior == -math.inf:
        return -math.inf, 0.0
    return prior, density - prior


@compiled
def _advance(
    shared_moves: SharedMoves,
    evaluator: Evaluator,
    published: Array | None,
    capacity: int,
    rng: np.random.Generator,
    beta: float,
    tilts: Array,
    scene: StateArrays,
    log_prior: float,
    log_likelihood: float,
    chosen: Ints,
    log_acceptance: Array,
    accepted: NDArray[np.bool_],
) -> tuple[StateArrays, float, float, Evaluator, int, int]:
    """Make some steps; the last value is the move that gave an invalid density, or -1.

    The number at random that decides is drawn before the proposal is evaluated; then the evaluation
    can end as soon as it is certain that the proposal is rejected.

    With ``published`` None, numba compiles the default log-posterior only.
    """
    move_data = shared_moves.moves
    weights = move_data.weights.cumsum()
    for n in range(len(chosen)):
        move = min(np.searchsorted(weights, rng.random() * weights[-1], "right"), len(weights) - 1)
        chosen[n], log_acceptance[n], accepted[n] = move, -math.inf, False
        new, ratio = propose(move_data, move, rng, scene)
        if ratio == -math.inf:
            continue
        # P(Exponential > -log a) = a. This avoids the logarithm of a uniform number that may be 0.
        lowest = -rng.standard_exponential()
        if published is not None:
            density = _log_published(
                evaluator.problem, new.camera, new.items, new.placements, new.sizes, new.latent
            )
        else:
            if len(new.items) > capacity:
                # An evaluator with more capacity, at the chain's current scene.
                capacity = 2 * len(new.items)
                evaluator = open_evaluator(evaluator.problem, capacity)
                change(
                    evaluator, NOWHERE, scene.camera, scene.latent,
                    scene.camera, scene.items, scene.placements, scene.sizes, scene.latent,
                )  # fmt: skip
                commit(evaluator)
            density = place_scene(
                evaluator, len(scene.items), scene.camera, scene.latent,
                new.camera, new.items, new.placements, new.sizes, new.latent,
            )  # fmt: skip
        prior, likelihood, gain = -math.inf, 0.0, -math.inf
        if density > -math.inf:
            prior = log_reference(
                move_data.reference, new.camera, new.items, new.placements, new.sizes
            )  # fmt: skip
            of_reference = prior - log_prior + ratio
            of_reference += _log_tilt(move_data.reference.kinds, tilts, new.items)
            of_reference -= _log_tilt(move_data.reference.kinds, tilts, scene.items)
            if published is None:
                least = EVERYTHING
                if beta > 0.0:
                    least = log_likelihood + prior - density + (lowest - of_reference) / beta
                density += weigh_placed(evaluator, len(scene.items), new.camera, new.items, least)
        if math.isnan(density):
            gain = density
        elif density > -math.inf and prior > -math.inf:
            likelihood = density - prior
            gain = of_reference + beta * (likelihood - log_likelihood)
        if not gain < math.inf:
            return scene, log_prior, log_likelihood, evaluator, capacity, move
        log_acceptance[n] = min(0.0, gain)
        if log_acceptance[n] > lowest:
            accepted[n] = True
            if published is None:
                commit(evaluator)
            scene, log_prior, log_likelihood = new, prior, likelihood
    return scene, log_prior, log_likelihood, evaluator, capacity, -1


# ------------------------------------------------------------------------------------------------
# Interface for Python.


def parts_of(problem: Problem, reference: Reference, state: State) -> LogDensityParts:
    """The log reference density of a state, and the log ratio of posterior to reference.

    Parameters
    ----------
    problem : Problem
    reference : Reference
    state : State

    Returns
    -------
    LogDensityParts
    """
    return _in_parts(reference, log_posterior(problem, state), state)


def _counts(reference: Reference, items: Ints) -> tuple[float, ...]:
    """Number of scenelets with each kind of furniture, after a 0."""
    kinds = reference.kinds[items[:, 0]]
    counts = np.bincount(kinds, minlength=reference.fitting_kinds.shape[1])
    return tuple(counts.astype(np.float64).tolist())


def _in_parts(reference: Reference, log_density: float, state: State) -> LogDensityParts:
    if log_density == -math.inf:
        return LogDensityParts(-math.inf, 0.0, _counts(reference, state.items))
    scene = arrays_of(state)
    log_prior = float(
        log_reference(reference, scene.camera, scene.items, scene.placements, scene.sizes)
    )
    log_ratio = log_density - log_prior if log_prior > -math.inf else 0.0
    return LogDensityParts(log_prior, log_ratio, _counts(reference, state.items))


class SceneChain:
    """A chain at one temperature, with its state and cached log densities.

    Cached values depend by about 1e-6 nats on the chain's history, because moves of nanometres are
    not re-evaluated. For exact repetition from some point, a chain must begin there with a new
    object of this class.

    Parameters
    ----------
    problem : Problem
    moves : Moves
    state : State
        State of the chain, inside the support.
    """

    def __init__(self, problem: Problem, moves: Moves, state: State) -> None:
        self._problem, self._reference = problem, moves.reference
        self._shared_moves = share_moves(moves)
        self._published = problem.paper_nats if problem.of_paper else None
        self._state = self._last = state
        self._scene = self._last_scene = arrays_of(state)
        self._parts = self._last_parts = LogDensityParts(0.0, 0.0)
        self._capacity: int = max(_CAPACITY, state.n_scenelets)
        self._evaluator: Evaluator = open_evaluator(problem, self._capacity)
        self._restart()

    def __call__(
        self, state: State, rung: Rung = PRIOR, least: float = -math.inf
    ) -> LogDensityParts:
        """Evaluate ``state`` without moving the chain.

        Parameters
        ----------
        state : State
        rung : Rung
        least : float
            The result may be -inf if the log density on this rung is less.

        Returns
        -------
        LogDensityParts
        """
        if state is self._state:
            return self._parts
        self._last, self._last_scene = state, arrays_of(state)
        self._last_parts = self._log_density_parts(
            self._last_scene, len(self._scene.items), rung, least
        )
        return self._last_parts

    def move(self, state: State) -> None:
        """Set the state of the chain.

        Parameters
        ----------
        state : State
        """
        if state is self._state:
            return
        if state is not self._last:
            self(state)
        self._state, self._scene, self._parts = state, self._last_scene, self._last_parts
        self._accept()

    def advance(
        self, rng: np.random.Generator, rung: Rung, steps: int
    ) -> tuple[ChainState[State], tuple[StepInfo, ...]]:
        """Make steps on a rung.

        Parameters
        ----------
        rng : numpy.random.Generator
        rung : Rung
        steps : int

        Returns
        -------
        ChainState
            The chain afterwards.
        tuple of StepInfo

        Raises
        ------
        FloatingPointError
            A log density or ratio is NaN or +inf; the message names the move.
        """
        chosen, log_acceptance = np.empty(steps, np.int64), np.empty(steps)
        accepted = np.empty(steps, np.bool_)
        scene, log_prior, log_likelihood, self._evaluator, self._capacity, fault = _advance(
            self._shared_moves, self._evaluator, self._published, self._capacity, rng,
            rung.beta, np.array(rung.tilts),
            self._scene, self._parts.log_prior, self._parts.log_likelihood,
            chosen, log_acceptance, accepted,
        )  # fmt: skip
        if fault >= 0:
            raise FloatingPointError(
                f"move '{_NAMES[fault]}': the log density or log ratio of a proposal is no number"
            )
        if accepted.any():
            self._scene, self._state = scene, state_of(scene)
            self._parts = LogDensityParts(
                log_prior, log_likelihood, _counts(self._reference, scene.items)
            )
        self._last, self._last_parts = self._state, self._parts
        steps_made = zip(chosen.tolist(), accepted.tolist(), log_acceptance.tolist(), strict=True)
        return ChainState(self._state, self._parts.at(rung)), tuple(
            StepInfo(_NAMES[move], taken, log_a) for move, taken, log_a in steps_made
        )

    def _log_density_parts(
        self, scene: StateArrays, n_before: int, rung: Rung, least: float
    ) -> LogDensityParts:
        """Evaluate a scene as a change from the evaluator's scene with ``n_before`` scenelets."""
        if len(scene.items) > self._capacity:
            self._capacity = 2 * len(scene.items)
            self._evaluator = open_evaluator(self._problem, self._capacity)
            self._restart()
        return LogDensityParts(
            *_log_density_parts(
                self._shared_moves, self._evaluator, self._published, n_before, self._scene, scene,
                rung.beta, np.array(rung.tilts), least,
            ),
            _counts(self._reference, scene.items),
        )  # fmt: skip

    def _restart(self) -> None:
        """Initialise a new evaluator at the chain's state."""
        self._parts = self._last_parts = self._log_density_parts(self._scene, -1, PRIOR, -math.inf)
        self._accept()

    def _accept(self) -> None:
        if self._published is None:
            commit(self._evaluator)
