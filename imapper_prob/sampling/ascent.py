"""Improve the starting scene of a chain by exchanges of scenelets and by draws of several.

The solver judges each scenelet alone and combines those of highest value. But a scenelet of low
value alone may be the best continuation of the one before it. Here each scenelet of a scene is
exchanged for every other one of the library, placed where the reference expects it given its
neighbours (:mod:`imapper_prob.sampling.reference`), and judged by the whole log-posterior. Then the
scene is optimised locally. Scenelets are inserted in the same way.

Some scenes are improved only by several scenelets at once: a person's sitting, by shorter sitting
and sitting down before it. So one or two neighbouring scenelets are also replaced by the best of
many draws of two or three from the reference.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.kernels.cache import Evaluator, open_evaluator
from imapper_prob.models.kernels.incremental import NOWHERE, change, commit
from imapper_prob.models.log_posterior import State, log_posterior
from imapper_prob.models.problem import Problem
from imapper_prob.samplers.chains import Report
from imapper_prob.samplers.tempering import POSTERIOR, Rung
from imapper_prob.sampling.jit import compiled, inner, inner_inlined
from imapper_prob.sampling.redraws import set_placement, with_stretch
from imapper_prob.sampling.reference import NONE_BEFORE, Reference
from imapper_prob.sampling.reference_placement import end_pose, placement_centre
from imapper_prob.sampling.scene import StateArrays, arrays_of, state_of
from imapper_prob.sampling.steps import MOVES, Moves, SceneChain, log_posteriors

__all__ = ["climb"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_STRIDE: Final = 8
"""Frames between the starts that are tried for an insertion; chosen."""
_REACH: Final = 4
"""Frames by which the start of the most promising scenelets is varied; chosen."""
_PROMISING: Final = 100
"""Number of most promising scenelets; chosen: they take a tenth of the time of the library."""
_DRAWN: Final = 6000
"""Number of draws from which the best is taken; chosen: they take a fraction of a second."""
_EVALUATED: Final = 4
"""Number of draws that count as one evaluation, because only draws with the wanted number of
scenelets are evaluated; chosen."""
_DISPLACEMENT_SCALE: Final = 1e-3
"""Scale of the reference's displacements in these draws; so small that each scenelet lies at the
centre of its placement."""
_NEARLY: Final = 15.0
"""Nats by which a scene may be worse than the best one so far if it is to be optimised locally;
chosen."""
_SWEEPS: Final = 6
"""Largest number of sweeps over all scenelets; chosen."""
_WORTH: Final = 0.5
"""Least gain of a sweep in nats; a sweep that gains less is the last."""
_CHANGES: Final = ((0, 0), (1, 0), (1, 2), (2, 2), (2, 3))
"""Number of neighbouring scenelets that are replaced at once, and the number of draws in their
place; 0 for one scenelet of the whole library."""
_NEARBY: Final = (
    "shift",
    "placement",
    "camera",
    "camera-compensated",
    "depth-scale",
    "focal-scale",
    "path",
)
"""Moves of the local optimisation, which keep the scenelets."""
_BETA, _STEPS, _RECORDS = 12.0, 1200, 40
"""Inverse temperature of the local optimisation, number of its steps, and how often the best scene
is recorded; chosen: few steps go downhill, and placements converge."""


def climb(
    problem: Problem,
    moves: Moves,
    state: State,
    rng: np.random.Generator,
    *,
    most: int,
    report: Report,
) -> State:
    """Improve a scene by exchanges and insertions of scenelets, and by draws of the reference.

    Parameters
    ----------
    problem : Problem
    moves : Moves
        Their reference gives the expected placements of scenelets.
    state : State
    rng : numpy.random.Generator
    most : int
        Budget of evaluations; no change is tried that would exceed it.
    report : callable
        Called before each change; returns whether to continue.

    Returns
    -------
    State
        The best scene found. Under the published energy, ``state`` itself.
    """
    if problem.of_paper:
        return state
    best = log_posterior(problem, state)
    for _ in range(_SWEEPS):
        before, first = best, 0
        while first <= state.n_scenelets:
            for count, number in _CHANGES:
                last = first + count
                if last > state.n_scenelets:
                    break
                place = problem, moves, state, first, last
                if number > 0:
                    cost, changed = _DRAWN // _EVALUATED, partial(_redrawn, *place, number, rng)
                else:
                    pairs = _pairs(problem, state, first, last)
                    cost, changed = len(pairs), partial(_exchanged, *place, pairs)
                most -= cost + _STEPS
                if most < 0 or not report(0.0):
                    return state
                tried = changed()
                if log_posterior(problem, tried) > best - _NEARLY:
                    tried = _nearby(problem, moves, tried, rng)
                value = log_posterior(problem, tried)
                if value > best:
                    state, best = tried, value
            first += 1
        if best < before + _WORTH:
            break
    return state


def _pairs(problem: Problem, state: State, first: int, last: int) -> Ints:
    """(n, 2) scenelets and starts to try instead of the scenelets from ``first`` to ``last`` - 1.

    The whole library is tried, flush with the scenelet before and with the one after. For an
    exchange, it is also aligned with the start and with the end of the present scenelet; for an
    insertion (``first`` equals ``last``), tried at starts every few frames.
    """
    lengths = np.asarray(problem.lengths)
    library = np.arange(len(lengths))
    low, high = _free_frames(problem, state, first, last)
    if first < last:
        scenelet, begin = state.items[first].tolist()
        begins, ends = [begin, low], [begin + int(lengths[scenelet]), high]
    else:
        begins, ends = list(range(low, high, _STRIDE)), [high]
    columns = [np.full(len(library), begin) for begin in begins]
    columns += [end - lengths for end in ends]
    starts = np.stack(columns, -1)
    pairs = np.stack([np.repeat(library, starts.shape[1]), starts.ravel()], -1)
    return _inside(problem, state, first, last, pairs)


def _free_frames(problem: Problem, state: State, first: int, last: int) -> tuple[int, int]:
    """First free frame, and the frame after the last, between the neighbouring scenelets."""
    low, high = 0, problem.n_frames
    if first > 0:
        scenelet, start = state.items[first - 1].tolist()
        low = start + int(problem.lengths[scenelet])
    if last < state.n_scenelets:
        high = int(state.items[last, 1])
    return low, high


def _inside(problem: Problem, state: State, first: int, last: int, pairs: Ints) -> Ints:
    low, high = _free_frames(problem, state, first, last)
    fits = (pairs[:, 1] >= low) & (pairs[:, 1] + problem.lengths[pairs[:, 0]] <= high)
    found: Ints = np.unique(pairs[fits], axis=0)
    return found


def _exchanged(
    problem: Problem, moves: Moves, state: State, first: int, last: int, pairs: Ints
) -> State:
    """The best scene with another scenelet instead of those from ``first`` to ``last`` - 1.

    The most promising scenelets are also tried a few frames earlier and later.
    """
    if not len(pairs):
        return state
    reference = moves.reference
    scene = arrays_of(state)
    evaluator = _evaluator_at(problem, scene, state.n_scenelets + 2)
    values = _values(evaluator, scene, _scenes_with(reference, scene, first, last, pairs))
    promising = pairs[np.argsort(-values, kind="stable")[:_PROMISING]]
    near = np.stack([np.zeros(2 * _REACH + 1, int), np.arange(-_REACH, _REACH + 1)], -1)
    pairs = _inside(problem, state, first, last, (promising[:, None] + near).reshape(-1, 2))
    changed = _scenes_with(reference, scene, first, last, pairs)
    return _best(evaluator, scene, changed) or state


def _evaluator_at(problem: Problem, scene: StateArrays, capacity: int) -> Evaluator:
    """An evaluator for up to ``capacity`` scenelets whose current scene is this one."""
    evaluator = open_evaluator(problem, capacity)
    change(
        evaluator, NOWHERE, scene.camera, scene.latent,
        scene.camera, scene.items, scene.placements, scene.sizes, scene.latent,
    )  # fmt: skip
    commit(evaluator)
    return evaluator


def _redrawn(
    problem: Problem,
    moves: Moves,
    state: State,
    first: int,
    last: int,
    number: int,
    rng: np.random.Generator,
) -> State:
    """The best scene with ``number`` draws instead of the scenelets from ``first`` to ``last`` - 1.

    They are drawn at their expected placements, given the scenelet before.
    """
    scene = arrays_of(state)
    still = moves.reference._replace(factors=_DISPLACEMENT_SCALE * moves.reference.factors)
    drawn = _draws(still, rng, scene, first, last, number)
    evaluator = _evaluator_at(problem, scene, state.n_scenelets + number)
    return _best(evaluator, scene, drawn) or state


@compiled
def _draws(
    reference: Reference,
    rng: np.random.Generator,
    scene: StateArrays,
    first: int,
    last: int,
    number: int,
) -> tuple[Ints, Array, Array]:
    """Items, placements and sizes of those of many draws that have this number of new scenelets."""
    k, found = len(scene.items) - (last - first) + number, 0
    items = np.empty((_DRAWN, k, 2), np.int64)
    placements, sizes = np.empty((_DRAWN, k, 3)), np.empty((_DRAWN, k))
    for _ in range(_DRAWN):
        new, n = with_stretch(reference, rng, scene, first, last)
        if n != number:
            continue
        if first + n < k:
            end = new.items[first + n - 1, 1] + reference.lengths[new.items[first + n - 1, 0]]
            if end > new.items[first + n, 1]:
                continue
        _copy(new, items, placements, sizes, found)
        found += 1
    return items[:found], placements[:found], sizes[:found]


@inner_inlined
def _copy(scene: StateArrays, items: Ints, placements: Array, sizes: Array, n: int) -> None:
    # By numbers: numba takes seconds to compile the message of an assignment of arrays that fails.
    for i in range(len(scene.items)):
        items[n, i, 0], items[n, i, 1] = scene.items[i, 0], scene.items[i, 1]
        sizes[n, i] = scene.sizes[i]
        for j in range(3):
            placements[n, i, j] = scene.placements[i, j]


def _best(
    evaluator: Evaluator, scene: StateArrays, changed: tuple[Ints, Array, Array]
) -> State | None:
    """The most probable of n scenes; None if there is none inside the support."""
    values = _values(evaluator, scene, changed, rising=True)
    if not values.max(initial=-math.inf) > -math.inf:
        return None
    items, placements, sizes = (of[values.argmax()] for of in changed)
    return state_of(scene._replace(items=items, placements=placements, sizes=sizes))


def _values(
    evaluator: Evaluator,
    scene: StateArrays,
    changed: tuple[Ints, Array, Array],
    *,
    rising: bool = False,
) -> Array:
    """(n,) log-posteriors in nats of the evaluator's scene with other scenelets."""
    camera, latent = scene.camera[None], scene.latent[None]
    return log_posteriors(
        evaluator, None, len(scene.items), scene, camera, *changed, latent, rising
    )


def _nearby(problem: Problem, moves: Moves, state: State, rng: np.random.Generator) -> State:
    """The best scene of a cold chain whose moves keep the scenelets."""
    weights = moves.weights * [name in _NEARBY for name in MOVES]
    chain = SceneChain(problem, moves._replace(weights=weights), state)
    best = chain(state).at(POSTERIOR), state
    for _ in range(_RECORDS):
        there = chain.advance(rng, Rung(_BETA), _STEPS // _RECORDS)[0].state
        best = max(best, (chain(there).at(POSTERIOR), there), key=lambda found: found[0])
    return best[1]


@inner
def _with(
    reference: Reference, scene: StateArrays, first: int, last: int, scenelet: int, start: int
) -> StateArrays:
    """A scene with a scenelet instead of some consecutive ones, at its expected placement."""
    left, before, middle = NONE_BEFORE, np.empty((2, 4)), np.empty((2, 4))
    if first > 0:
        left = end_pose(
            reference, scene.camera, scene.items[first - 1, 0], scene.items[first - 1, 1],
            scene.placements[first - 1], scene.sizes[first - 1], before,
        )  # fmt: skip
    placement_centre(reference, scene.camera, scenelet, start, left, before, middle)
    item, placement, size = np.empty((1, 2), np.int64), np.empty((1, 3)), np.empty(1)
    item[0, 0], item[0, 1], size[0] = scenelet, start, middle[0, 3]
    set_placement(reference, scene.camera, scenelet, middle[0], placement[0])
    return StateArrays(
        scene.camera,
        np.concatenate((scene.items[:first], item, scene.items[last:])),
        np.concatenate((scene.placements[:first], placement, scene.placements[last:])),
        np.concatenate((scene.sizes[:first], size, scene.sizes[last:])),
        scene.latent,
    )


@compiled
def _scenes_with(
    reference: Reference, scene: StateArrays, first: int, last: int, tried: Ints
) -> tuple[Ints, Array, Array]:
    """Items, placements and sizes of a scene for each of n pairs of scenelet and start."""
    k = len(scene.items) - (last - first) + 1
    items = np.empty((len(tried), k, 2), np.int64)
    placements, sizes = np.empty((len(tried), k, 3)), np.empty((len(tried), k))
    for n in range(len(tried)):
        new = _with(reference, scene, first, last, tried[n, 0], tried[n, 1])
        _copy(new, items, placements, sizes, n)
    return items, placements, sizes
