"""What scenelets are worth alone in the scene, to second order around their best place."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.incremental import Incremental
from imapper_prob.models.kernels.alone import expand_alone, judge_alone
from imapper_prob.models.posterior import State, empty_state
from imapper_prob.models.problem import Problem

__all__ = ["REACH", "STEPS", "Expansions", "expand", "judge"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

STEPS = np.array(
    [[0.004, 0.0, 0.0, 0.0], [0.0, 0.03, 0.0, 0.0], [0.0, 0.0, 0.08, 0.0], [0.0, 0.025, 0.0, 0.025]]
)
"""(4, 4) unit steps, in bearing, log depth, yaw, and in log size with the depth along: about the
standard deviations of placements in chains of one simulated clip."""


REACH = 40
"""Frames before and after a scenelet that are looked at: two of the longest at 10 a second."""


class Expansions(NamedTuple):
    """Scenelets alone in the scene without any other, in the mean camera.

    What a stay is worth is left out, for one scenelet holds a whole one.

    Parameters
    ----------
    where : (n, 4) float
        Bearing (tangent), log depth (log m), yaw (radians), log size.
    values : (n, 2) float
        Log density of these four over that of the scene without it, nats: what tempering keeps
        (path and placement), and what it flattens (odds, detections and costs).
    gradients, hessians : (n, 2, 4), (n, 2, 4, 4) float
        Derivatives of both, a unit step (:data:`STEPS`) each.
    beside : (n, 2, REACH) float
        Nats of the second value that frames outside are worth, backwards from the first frame and
        onwards from the last, because its furniture hides the person there.
    """

    where: Array
    values: Array
    gradients: Array
    hessians: Array
    beside: Array


def judge(problem: Problem, items: Ints, where: Array) -> tuple[Array, Array]:
    """Values (n, 2) and ``beside`` of scenelets (n, 2) with their starts where they stand (n, 4).

    As :class:`Expansions` has them; the first value is -inf outside the support.
    """
    scene, alone, nothing = _nothing(problem)
    values, beside = np.empty((len(items), 2)), np.empty((len(items), 2, REACH))
    judge_alone(alone.session, scene.camera, scene.latent, items, where, values, beside)
    return values - nothing, beside


def expand(problem: Problem, items: Ints, where: Array, *, rounds: int = 1) -> Expansions:
    """Move scenelets (n, 2) from where they stand (n, 4) to where they are worth most, and expand.

    ``rounds`` is how often each direction is followed. The first value of what is outside the
    support, or a step from there, is -inf.
    """
    scene, alone, nothing = _nothing(problem)
    n, where = len(items), np.array(where)
    values, gradients, hessians = np.empty((n, 2)), np.empty((n, 2, 4)), np.empty((n, 2, 4, 4))
    beside = np.zeros((n, 2, REACH))
    expand_alone(
        alone.session, scene.camera, scene.latent, items, STEPS, rounds,
        where, values, gradients, hessians, beside,
    )  # fmt: skip
    return Expansions(where, values - nothing, gradients, hessians, beside)


def _nothing(problem: Problem) -> tuple[State, Incremental, Array]:
    """The scene without scenelets, what evaluates changes of it, and its own values."""
    bare = problem._replace(stays=problem.stays[:0].copy())
    scene = empty_state(bare)
    alone = Incremental(bare, scene)
    return scene, alone, np.array(alone.parts)
