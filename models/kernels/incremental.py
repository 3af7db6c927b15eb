"""The log-posterior of a state, evaluated as a change from another state (model.md 1 to 17).

    log pi(s) = log p(phi) + log p(X) + log p(P, G | X) + log p(u, c | s)
                - free poses - E_s - E_c - E_m - E_g - E_u + log p(statements | s)

of a state s = (phi, X, P, b, z): camera and body scale phi, the assignment X of scenelets to start
frames, their placements P and sizes b, and standard normal variables z, which determine the path G
outside scenelets (:mod:`imapper_prob.models.kernels.path`). The density is with respect to d phi dP
db and the normal distribution of z, so z has the same dimension for any number of scenelets.

A proposal is evaluated from the cached values of the current state; when it is accepted, its values
become the cached ones. :func:`change` computes only what differs, in this order: scenelets and path
(:func:`place_scene`), then joints, costs of furniture, lines of sight, likelihood of frames, and
their sum (:func:`weigh_placed`). A whole state is evaluated as a change from nothing.

Most proposals of a chain are much worse than the current state. The detections of every frame have
an upper bound that needs no line of sight: each joint is hidden or seen, whichever explains its
detection better. If the log-posterior is below what the caller needs even then, the rest is left
out.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled, inner, inner_inlined
from imapper_prob.models.kernels.cache import (
    ADDED,
    AS_DETECTED,
    FLIPPED,
    KEPT,
    REMOVED,
    UNUSED,
    Cache,
    Evaluator,
)
from imapper_prob.models.kernels.detection import (
    bound_emissions,
    forward_log_likelihood,
    sum_emissions,
    sum_free_poses,
    update_emissions,
)
from imapper_prob.models.kernels.given import sum_given
from imapper_prob.models.kernels.path import update_path
from imapper_prob.models.kernels.placement import fill_slot, in_support, sum_pairs
from imapper_prob.models.kernels.posing import (
    copy_joints,
    list_moved,
    mark_changed,
    mark_near,
    pose_joints,
    sum_jumps,
    sum_penetrations,
    trace_lines,
    update_likelihoods,
    update_penetrations,
)
from imapper_prob.models.kernels.stays import unsupported
from imapper_prob.models.problem import (
    ASSIGNMENT,
    CAMERA,
    COLLISION,
    GIVEN,
    MOTION,
    PATH,
    PLACEMENT,
    SMOOTHNESS,
    SUPPORT,
    Problem,
)

__all__ = [
    "EVERYTHING",
    "NOWHERE",
    "change",
    "commit",
    "place_scene",
    "read_proposed",
    "weigh_placed",
]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
NOWHERE: Final[Any] = np.int64(-1)
"""Number of scenelets of an evaluator's current state if it has none. It is an int64, because numba
would compile callers once more for a literal."""
EVERYTHING: Final = -math.inf
"""Least log-posterior of interest if every value is wanted."""
_ROUNDING = 1e-3
"""Nats by which a bound has to be below; sums in another order differ by less than 1e-6."""


@compiled
def change(
    evaluator: Evaluator,
    n_before: int,
    camera_before: Array,
    latent_before: Array,
    camera: Array,
    items: Ints,
    placements: Array,
    sizes: Array,
    latent: Array,
) -> tuple[float, float]:
    """Evaluate the log-posterior of a proposed state, reusing cached values of the current state.

    It is compiled for writable arrays, so states from Python are passed as copies. It makes both
    steps, :func:`place_scene` and :func:`weigh_placed`.

    Parameters
    ----------
    evaluator : Evaluator
        Only cache rows that are not valid for the current state are written.
    n_before : int
        Number of scenelets of the current state; ``NOWHERE`` if there is none.
    camera_before, latent_before : (5,), (T, 2) float
        Camera and latent variables of the current state.
    camera, items, placements, sizes, latent
        The proposed state, see :class:`imapper_prob.models.log_posterior.State`.

    Returns
    -------
    log_prior, log_likelihood : float
        Nats; -inf and 0 outside the support. The likelihood includes the terms of free poses,
        jumps, collisions, motion, ground, missing support and statements.
    """
    prior = place_scene(
        evaluator, n_before, camera_before, latent_before,
        camera, items, placements, sizes, latent,
    )  # fmt: skip
    if prior == -math.inf:
        return prior, 0.0
    return prior, weigh_placed(evaluator, n_before, camera, items, EVERYTHING)


@inner
def weigh_placed(
    evaluator: Evaluator, n_before: int, camera: Array, items: Ints, least: float
) -> float:
    """The second step of :func:`change`: evaluate the log likelihood of the placed proposal.

    Parameters
    ----------
    evaluator : Evaluator
        With a proposal inside the support, see :func:`place_scene`.
    n_before, camera, items
        As there.
    least : float
        Least log likelihood of interest, nats.

    Returns
    -------
    float
        Nats; -inf if it is less than ``least``, or its value. A proposal of -inf must not be
        committed, nor read.
    """
    problem, cache = evaluator.problem, evaluator.cache
    n, n_old, terms = len(items), max(n_before, 0), cache.terms
    n_moved = list_moved(cache)
    pose_joints(problem, cache, n, n_moved, camera)
    if len(problem.given) > 0:
        terms[GIVEN] = sum_given(problem, cache, n, camera)
    if problem.likelihood == 0.0:
        return terms[GIVEN]  # type: ignore[no-any-return]
    terms[SMOOTHNESS] = sum_jumps(problem, cache, n, camera)
    terms[COLLISION] = sum_pairs(problem, cache, n)
    terms[SUPPORT] = -problem.likelihood * unsupported(problem.stays, problem.lowered, items)
    update_likelihoods(problem, cache, n, camera)
    if least > -math.inf:
        mark_near(cache, n)
        mark_changed(cache, n, n_old)
        bound_emissions(problem, cache)
        costs = terms[SMOOTHNESS] + terms[COLLISION] + terms[SUPPORT] + terms[GIVEN]
        bound = sum_emissions(problem, cache.bounds, cache.every)
        if costs + bound - sum_free_poses(problem, cache) < least - _ROUNDING:
            return -math.inf
    trace_lines(cache, n_moved, camera)
    update_penetrations(cache, n, n_moved)
    mark_changed(cache, n, n_old)
    update_emissions(problem, cache, n)
    terms[MOTION] = sum_penetrations(problem, cache, n)
    costs = terms[SMOOTHNESS] + terms[COLLISION] + terms[MOTION] + terms[SUPPORT] + terms[GIVEN]
    return costs + forward_log_likelihood(problem, cache)  # type: ignore[no-any-return]


@inner
def place_scene(
    evaluator: Evaluator,
    n_before: int,
    camera_before: Array,
    latent_before: Array,
    camera: Array,
    items: Ints,
    placements: Array,
    sizes: Array,
    latent: Array,
) -> float:
    """The first step of :func:`change`: place the scenelets, draw the path, evaluate the prior.

    The prior terms are written to the cache; all other terms are set to 0.

    Parameters
    ----------
    evaluator, n_before, camera_before, latent_before, camera, items, placements, sizes, latent
        See :func:`change`.

    Returns
    -------
    float
        Log prior, nats; -inf outside the support.
    """
    return _place_scene(
        evaluator.problem, evaluator.cache, n_before, camera_before, latent_before,
        camera, items, placements, sizes, latent,
    )  # fmt: skip


@inner_inlined
def _place_scene(
    problem: Problem,
    cache: Cache,
    n_before: int,
    camera_before: Array,
    latent_before: Array,
    camera: Array,
    items: Ints,
    placements: Array,
    sizes: Array,
    latent: Array,
) -> float:
    """The body of :func:`place_scene`, inlined so that it does not count references."""
    if not in_support(camera) or not _in_order(problem, items):
        return -math.inf
    n, n_old, terms = len(items), max(n_before, 0), cache.terms
    for k in range(len(terms)):
        terms[k] = 0.0
    anew = n_before < 0
    for a in range(5):
        anew = anew or camera[a] != camera_before[a]
    _assign_slots(cache, n_old, items, placements, sizes, anew)
    prior = problem.camera_constant
    for a in range(5):
        for b in range(5):
            offset = camera[b] - problem.camera_mean[b]
            prior -= (
                0.5 * (camera[a] - problem.camera_mean[a]) * problem.camera_precision[a, b] * offset
            )
    terms[CAMERA] = prior
    for i in range(n):
        slot = cache.slots[1, i]
        if cache.role[slot] == ADDED:
            cache.items[slot, 2] = items[i, 1] + _length(problem, items[i, 0])
            fill_slot(problem, cache, camera, slot)
        terms[ASSIGNMENT] += problem.log_rate[items[i, 0]]
        terms[PLACEMENT] += cache.placement_log_density[slot]
        prior += problem.log_rate[items[i, 0]] + cache.placement_log_density[slot]
    terms[PATH] = update_path(problem, cache, n, n_old, camera, latent, latent_before, anew)
    return prior + terms[PATH]  # type: ignore[no-any-return]


@inner_inlined
def _length(problem: Problem, scenelet: int) -> int:
    length: int = problem.joint_first[scenelet + 1] - problem.joint_first[scenelet]
    return length


@inner_inlined
def _in_order(problem: Problem, items: Ints) -> bool:
    """Whether scenelets are inside the clip, in order, disjoint, and each within one person's
    frames."""
    end = 0
    for i in range(len(items)):
        if items[i, 1] < end:
            return False
        end = items[i, 1] + _length(problem, items[i, 0])
        if end > len(problem.lift):
            return False
        for t in range(items[i, 1] + 1, end):
            if problem.path_starts[t]:
                return False
    return True


@inner_inlined
def _assign_slots(
    cache: Cache, n_old: int, items: Ints, placements: Array, sizes: Array, anew: bool
) -> None:
    """Assign every unchanged scenelet its old slot, and every other one a free slot."""
    before, after, role = cache.slots[0], cache.slots[1], cache.role
    role[:] = UNUSED
    for k in range(n_old):
        role[before[k]] = REMOVED
    for i in range(len(items)):
        after[i] = -1
        for k in range(n_old):
            slot = before[k]
            same = (
                not anew
                and role[slot] == REMOVED
                and cache.items[slot, 0] == items[i, 0]
                and cache.items[slot, 1] == items[i, 1]
                and cache.placements[slot, 0] == placements[i, 0]
                and cache.placements[slot, 1] == placements[i, 1]
                and cache.placements[slot, 2] == placements[i, 2]
                and cache.sizes[slot] == sizes[i]
            )
            if same:
                after[i] = slot
                role[slot] = KEPT
                break
    fresh = 0
    for i in range(len(items)):
        if after[i] < 0:
            while role[fresh] != UNUSED:
                fresh += 1
            after[i] = fresh
            role[fresh] = ADDED
            for c in range(2):
                cache.items[fresh, c] = items[i, c]
            for c in range(3):
                cache.placements[fresh, c] = placements[i, c]
            cache.sizes[fresh] = sizes[i]


@compiled
def commit(evaluator: Evaluator) -> None:
    """Make the last proposal the current state.

    Parameters
    ----------
    evaluator : Evaluator
    """
    _commit(evaluator.cache)


@inner_inlined
def _commit(cache: Cache) -> None:
    """The body of :func:`commit`, inlined so that it does not count references."""
    for i in range(cache.slots.shape[1]):
        cache.slots[0, i] = cache.slots[1, i]
    for t in range(cache.cover.shape[1]):
        cache.cover[0, t] = cache.cover[1, t]
    for i in range(cache.evidence.shape[1]):
        cache.evidence[0, i] = cache.evidence[1, i]
    for t in range(len(cache.moved)):
        cache.pose_at[t] ^= cache.moved[t]
        cache.sum_at[t] ^= cache.changed[t]


@compiled
def read_proposed(evaluator: Evaluator, joints: Array, by_frame: Array) -> Array:
    """Read the values computed for the last proposal, which is inside the support.

    Parameters
    ----------
    evaluator : Evaluator
    joints : (T, 3, 16) float
        Output: the motion in the world, metres. Empty if not wanted, like ``by_frame``.
    by_frame : (T, 2) float
        Output: log-likelihood of each frame's detections, as they are and with left and right
        flipped, nats, unweighted; unchanged if the likelihood is switched off.

    Returns
    -------
    (12,) float
        Values of ``TERMS``, nats.
    """
    cache = evaluator.cache
    if evaluator.problem.likelihood != 0.0:
        for t in range(len(by_frame)):
            row = cache.sum_row[t]
            by_frame[t, 0] = cache.emissions[row, AS_DETECTED]
            by_frame[t, 1] = cache.emissions[row, FLIPPED]
    copy_joints(cache, joints)
    return cache.terms.copy()
