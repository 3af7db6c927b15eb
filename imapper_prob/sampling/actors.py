"""All people of a clip in one log-posterior: their frames are joined, one actor after the other.

Actors share camera and furniture, so the furniture of one actor may hide the joints of another, and
nobody may walk through it. Windows, paths and smoothness belong to one actor: the chains of the
model restart at the first frame of each actor, and no scenelet extends into the next actor's frames
(`path_starts` of a problem). It does not matter that actors are seen at the same time, because
furniture does not move.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.errors import InputError
from imapper_prob.models.log_posterior import State
from imapper_prob.models.path_prior import CameraPrior
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import Clip
from imapper_prob.models.scenelet import Library
from imapper_prob.models.text import shortened
from imapper_prob.solver.candidates import refine
from imapper_prob.solver.solver import Solution

__all__ = ["JointProblem", "join_actors"]

Array = NDArray[np.float64]

_BY_FRAME = (
    "keypoints", "used", "confidences", "confidence_density", "error_scale", "error_dof",
    "path_centre", "path_scale", "path_starts", "path_stay", "lift", "poses", "path_facing",
    "free_cost",
)  # fmt: skip
"""Fields of a problem whose first axis is frames; it is the second axis of ``static_density``."""
_SHARED, _BODY = [0, 1, 2, 4], 3
"""Indices in a camera prior: the camera's parameters, and the log body scale."""


@dataclass(frozen=True)
class JointProblem:
    """The sampling problem of all actors of a clip in one world frame.

    Parameters
    ----------
    clip : Clip
        With the tracks of these actors, T frames each.
    library : Library
    problem : Problem
        Frames of all actors in the order of their tracks, K T in total for K actors.
    distances : (L, L) float
        Distances between the motions of scenelets, metres.
    states : tuple of State
        Scenes at which chains may start, the best one first.
    best_fits : (K T,) float
        Fit of the best scenelet over each frame, see `imapper_prob.solver.fits`.
    """

    clip: Clip
    library: Library
    problem: Problem
    distances: Array
    states: tuple[State, ...]
    best_fits: Array


def join_actors(solutions: Sequence[Solution]) -> JointProblem:
    """Join the solutions of all actors of a clip; a single solution is unchanged.

    Parameters
    ----------
    solutions : sequence of Solution
        One per actor.

    Returns
    -------
    JointProblem

    Raises
    ------
    InputError
        The actors were solved with different cameras, libraries or settings.
    """
    first = solutions[0]
    clip, problem, states = first.clip, first.problem, first.states
    if len(solutions) > 1:
        camera = _common_camera(solutions)
        stature = [float(s.camera.mean[_BODY] - camera.mean[_BODY]) for s in solutions]
        problem = _one_after_the_other(solutions, camera, stature)
        states = _together(problem, solutions)
        clip = replace(first.clip, tracks=tuple(s.clip.tracks[0] for s in solutions))
    return JointProblem(
        clip,
        first.library,
        problem,
        first.distances,
        states,
        np.concatenate([s.best_fits for s in solutions]),
    )


def _common_camera(solutions: Sequence[Solution]) -> CameraPrior:
    """The camera prior that all actors share; its body is their mean stature.

    The difference of each actor from the mean stature is taken as known
    (:func:`_one_after_the_other`). So the remaining variance is that of one actor, not that of a
    mean.
    """
    first = solutions[0]
    for other in solutions[1:]:
        same = np.allclose(other.camera.mean[_SHARED], first.camera.mean[_SHARED])
        if not same or other.library.digest != first.library.digest:
            raise InputError(
                f"clip {first.clip.name}: its actors were solved with different cameras or "
                "libraries; solve them together"
            )
        names = first.settings.differences(other.settings)
        if names:
            raise InputError(
                f"clip {first.clip.name}: its actors were solved with different settings "
                f"({shortened(names, most=5)}); solve them together"
            )
    agreed = first.camera.covariance[np.ix_(_SHARED, _SHARED)]
    rows = [s.camera.covariance[_BODY] for s in solutions]
    gains = [np.linalg.solve(agreed, row[_SHARED]) for row in rows]
    alone = [row[_BODY] - g @ agreed @ g for row, g in zip(rows, gains, strict=True)]
    gain = np.mean(gains, axis=0)
    mean, covariance = np.array(first.camera.mean), np.array(first.camera.covariance)
    mean[_BODY] = np.mean([s.camera.mean[_BODY] for s in solutions])
    covariance[_BODY, _SHARED] = covariance[_SHARED, _BODY] = agreed @ gain
    covariance[_BODY, _BODY] = np.mean(alone) + gain @ agreed @ gain
    return CameraPrior(mean, covariance)


def _one_after_the_other(
    solutions: Sequence[Solution], camera: CameraPrior, stature: Sequence[float]
) -> Problem:
    """Join the problems; ``stature`` are the actors' log body scales relative to the camera's.

    Poses and depths of taller actors are scaled up, because paths depend on stature only in this
    way. Scenelets have their own sizes, whose prior is wide enough for different people.
    """
    earlier = np.cumsum([0, *(len(s.problem.stays) for s in solutions)])[:-1].tolist()
    problems = [
        s.problem._replace(
            path_centre=s.problem.path_centre + np.array([0.0, by]),
            path_stay=np.where(s.problem.path_stay < 0, -1, s.problem.path_stay + stays),
            poses=s.problem.poses * math.exp(by),
        )
        for s, by, stays in zip(solutions, stature, earlier, strict=True)
    ]
    frames: dict[str, Any] = {
        name: np.concatenate([getattr(p, name) for p in problems]) for name in _BY_FRAME
    }
    starts = np.cumsum([0, *(p.n_frames for p in problems)])
    stays = [
        p.stays + np.array([first, first, 0.0])
        for p, first in zip(problems, starts[:-1], strict=True)
    ]
    return problems[0]._replace(
        **frames,
        stays=np.concatenate(stays),
        static_density=np.concatenate([p.static_density for p in problems], axis=1),
        camera_mean=np.array(camera.mean),
        camera_precision=np.linalg.inv(camera.covariance).astype(np.float64),
        camera_constant=-0.5 * float(np.linalg.slogdet(2 * np.pi * camera.covariance)[1]),
    )


def _together(problem: Problem, solutions: Sequence[Solution]) -> tuple[State, ...]:
    """Starting scenes of all actors: the best ones joined, then the alternatives by rank."""
    ranks = range(max(len(s.states) for s in solutions))
    return tuple(
        refine(
            problem, _joined(problem, [s.states[min(rank, len(s.states) - 1)] for s in solutions])
        )
        for rank in ranks
    )


def _joined(problem: Problem, states: Sequence[State]) -> State:
    """Join states with the mean camera; people keep their sizes and their appearance."""
    camera = np.array(problem.camera_mean)
    items, placements, first = [], [], 0
    for state in states:
        items.append(state.items + np.array([0, first]))
        further = math.exp(camera[2] - state.camera[2])
        placements.append(state.placements * np.array([1.0, further, 1.0]))
        first += len(state.latent)
    return State(
        camera,
        np.concatenate(items),
        np.concatenate(placements),
        np.concatenate([s.sizes + s.camera[_BODY] - camera[_BODY] for s in states]),
        np.concatenate([s.latent for s in states]),
    )
