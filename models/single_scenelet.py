"""One scenelet alone in the scene: its gain, and a second-order expansion around its best place.

A place is four numbers: bearing (tangent), log depth (log m), yaw (radians) and log size, see
:mod:`imapper_prob.models.view`. The sampler's proposals are made from these expansions.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled, inlined
from imapper_prob.models.kernels.cache import Evaluator
from imapper_prob.models.kernels.incremental import change
from imapper_prob.models.log_posterior import Incremental, State, empty_state
from imapper_prob.models.problem import Problem
from imapper_prob.models.view import floor_point, log_area

__all__ = ["REACH", "STEPS", "Expansions", "expand", "judge"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
_FURTHEST = 2.0
"""Steps at once; beyond, a parabola is not trusted."""


@inlined
def _judge(
    evaluator: Evaluator, camera: Array, latent: Array, item: Ints, where: Array, placed: Array
) -> tuple[float, float]:
    """Nats kept and flattened by tempering, the first by bearing and log depth; -inf outside."""
    placed[0, 0], placed[0, 1] = floor_point(where[0], where[1])
    placed[0, 2] = where[2]
    prior, rest = change(
        evaluator, 0, camera, latent, camera, item, placed[:, :3], where[3:4], latent
    )
    odds = evaluator.problem.log_rate[item[0, 0]]
    return prior - odds + log_area(where[1]), rest + odds


@compiled
def _judge_single(
    evaluator: Evaluator,
    camera: Array,
    latent: Array,
    items: Ints,
    where: Array,
    values: Array,
    beside: Array,
) -> None:
    """What scenelets are worth where they stand.

    Parameters
    ----------
    evaluator : Evaluator
        Of a scene without scenelets.
    camera, latent : (5,), (T, 2) float
        Of that scene.
    items : (n, 2) int
        Scenelets and their starts.
    where : (n, 4) float
    values : (n, 2) float
        Out, see :func:`_expand_single`.
    beside : (n, 2, R) float
        Out: nats of what is in ``values`` that frames outside are worth, backwards from the first
        frame and onwards from the last: what is behind the scenelet's furniture there.
    """
    placed = np.empty((1, 3))
    for i in range(len(items)):
        values[i, 0], values[i, 1] = _judge(
            evaluator, camera, latent, items[i : i + 1], where[i], placed
        )
        _look_beside(evaluator, items[i, 0], items[i, 1], beside[i])


@inlined
def _look_beside(evaluator: Evaluator, scenelet: int, start: int, beside: Array) -> None:
    """What the scene last judged is worth in the frames before and after its scenelet."""
    problem, cache = evaluator.problem, evaluator.cache
    end = start + problem.joint_first[scenelet + 1] - problem.joint_first[scenelet]
    rows, emissions, bare = cache.sum_row, cache.emissions, cache.bare
    beside[:] = 0.0
    if problem.likelihood == 0.0:  # no frame has emissions
        return
    for r in range(beside.shape[1]):
        if start - 1 - r >= 0:
            beside[0, r] = emissions[rows[start - 1 - r], 0] - bare[start - 1 - r, 0]
        if end + r < len(bare):
            beside[1, r] = emissions[rows[end + r], 0] - bare[end + r, 0]


@compiled
def _expand_single(
    evaluator: Evaluator,
    camera: Array,
    latent: Array,
    items: Ints,
    steps: Array,
    rounds: int,
    where: Array,
    values: Array,
    gradients: Array,
    hessians: Array,
    beside: Array,
) -> None:
    """Move scenelets to where they are worth most, and expand what they are worth from there.

    Parameters
    ----------
    evaluator, camera, latent, items
        See :func:`_judge_single`.
    steps : (4, 4) float
        Rows are the unit steps of the expansion.
    rounds : int
        Times that each direction is followed by a parabola.
    where : (n, 4) float
        In and out.
    values : (n, 2) float
        Out: log density of bearing, log depth, yaw and log size, nats; first what tempering
        keeps, camera, path and placement, and then what it flattens. The first is -inf where the
        scenelet, or one step from it, is outside the support.
    gradients, hessians : (n, 2, 4), (n, 2, 4, 4) float
        Out: derivatives of both, a unit step each.
    beside : (n, 2, R) float
        Out, see :func:`_judge_single`.
    """
    placed, there = np.empty((1, 3)), np.empty(4)
    near = np.empty((2, 4, 2))
    for i in range(len(items)):
        item = items[i : i + 1]
        kept, rest = _judge(evaluator, camera, latent, item, where[i], placed)
        for n in range(4 * rounds):
            step = steps[n % 4]
            for side in range(2):
                there[:] = where[i] + (2 * side - 1) * step
                a, b = _judge(evaluator, camera, latent, item, there, placed)
                near[side, 0, 0] = a + b
            less, more = near[0, 0, 0], near[1, 0, 0]
            bend = 2.0 * (kept + rest) - less - more
            if not math.isfinite(bend):
                continue
            by = 0.5 * (more - less) / bend if bend > 0.0 else math.copysign(1.0, more - less)
            there[:] = where[i] + min(max(by, -_FURTHEST), _FURTHEST) * step
            a, b = _judge(evaluator, camera, latent, item, there, placed)
            if a + b > kept + rest:
                where[i] = there
                kept, rest = a, b
        for k in range(4):
            for side in range(2):
                there[:] = where[i] + (2 * side - 1) * steps[k]
                a, b = _judge(evaluator, camera, latent, item, there, placed)
                near[side, k, 0], near[side, k, 1] = a, b
        for k in range(4):
            gradients[i, 0, k] = 0.5 * (near[1, k, 0] - near[0, k, 0])
            gradients[i, 1, k] = 0.5 * (near[1, k, 1] - near[0, k, 1])
            hessians[i, 0, k, k] = near[1, k, 0] + near[0, k, 0] - 2.0 * kept
            hessians[i, 1, k, k] = near[1, k, 1] + near[0, k, 1] - 2.0 * rest
            for m in range(k):
                there[:] = where[i] + steps[k] + steps[m]
                a, b = _judge(evaluator, camera, latent, item, there, placed)
                there[:] = where[i] - steps[k] - steps[m]
                c, d = _judge(evaluator, camera, latent, item, there, placed)
                for of in range(2):
                    both = a + c + 2.0 * kept if of == 0 else b + d + 2.0 * rest
                    one = near[0, k, of] + near[1, k, of] + near[0, m, of] + near[1, m, of]
                    hessians[i, of, k, m] = hessians[i, of, m, k] = 0.5 * (both - one)
        sound = math.isfinite(kept) and math.isfinite(rest)
        for k in range(4):
            for m in range(4):
                sound = sound and math.isfinite(hessians[i, 0, k, m] + hessians[i, 1, k, m])
        values[i, 0], values[i, 1] = (kept if sound else -math.inf), rest
        if sound:
            _judge(evaluator, camera, latent, item, where[i], placed)
            _look_beside(evaluator, items[i, 0], items[i, 1], beside[i])


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
    """What scenelets gain alone where they stand.

    Parameters
    ----------
    problem : Problem
    items : (n, 2) int
        Scenelets and their start frames.
    where : (n, 4) float
        Bearing (tangent), log depth (log m), yaw (radians), log size.

    Returns
    -------
    values : (n, 2) float
        As :class:`Expansions` has them; the first is -inf outside the support.
    beside : (n, 2, REACH) float
        As :class:`Expansions` has it.
    """
    scene, alone, nothing = _nothing(problem)
    values, beside = np.empty((len(items), 2)), np.empty((len(items), 2, REACH))
    _judge_single(alone.evaluator, scene.camera, scene.latent, items, where, values, beside)
    return values - nothing, beside


def expand(problem: Problem, items: Ints, where: Array, *, rounds: int = 1) -> Expansions:
    """Move scenelets to where they gain most alone, and expand the gain around it.

    Parameters
    ----------
    problem : Problem
    items : (n, 2) int
        Scenelets and their start frames.
    where : (n, 4) float
        Bearing (tangent), log depth (log m), yaw (radians), log size: where to begin.
    rounds : int
        How often each direction is followed by a parabola.

    Returns
    -------
    Expansions
        The first value of what is outside the support, or a step from there, is -inf.
    """
    scene, alone, nothing = _nothing(problem)
    n, where = len(items), np.array(where)
    values, gradients, hessians = np.empty((n, 2)), np.empty((n, 2, 4)), np.empty((n, 2, 4, 4))
    beside = np.zeros((n, 2, REACH))
    _expand_single(
        alone.evaluator, scene.camera, scene.latent, items, STEPS, rounds,
        where, values, gradients, hessians, beside,
    )  # fmt: skip
    return Expansions(where, values - nothing, gradients, hessians, beside)


def _nothing(problem: Problem) -> tuple[State, Incremental, Array]:
    """The scene without scenelets, what evaluates changes of it, and its own values."""
    bare = problem._replace(stays=problem.stays[:0].copy())
    scene = empty_state(bare)
    alone = Incremental(bare, scene)
    return scene, alone, np.array(alone.parts)
