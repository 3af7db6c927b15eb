"""What an incremental evaluation keeps, in flat arrays, and its handle for compiled code.

Scenelets live in slots: one keeps its slot for as long as nothing about it changes. What depends
on a frame has two rows, one that holds for the current state and one to write a proposal into; to
accept is to say of some frames that the other row holds.

A problem and a cache are some ninety arrays. To unpack them at every call takes longer than all
the arithmetic of a small move; an :class:`Evaluator` hands compiled code both by one address.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.experimental import structref
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled, inner, inner_inlined
from imapper_prob.models.kernels.frame import LIKELIHOODS, PARAMS, SCRATCH64
from imapper_prob.models.kernels.intersection import N_DISPLACED
from imapper_prob.models.kernels.visibility import LINE, OCCLUDER, SCRATCH32, VIEW, Singles
from imapper_prob.models.problem import TERMS, Problem

__all__ = [
    "ADDED",
    "EMISSION",
    "KEPT",
    "REMOVED",
    "RIGHT",
    "UNUSED",
    "WRONG",
    "Cache",
    "Evaluator",
    "open_evaluator",
]

UNUSED, KEPT, ADDED, REMOVED = range(4)
EMISSION = 5
"""Numbers of a frame's emission: the greater log-density of two, weighted, and both densities over
it; and, unweighted, its log-likelihood as it is and with sides flipped, nats."""
RIGHT, WRONG = 3, 4
"""Which of them are the latter."""
Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.uint8]


class Cache(NamedTuple):
    """What an evaluation keeps of the current state, and writes of a proposal.

    T frames, S slots of up to B boxes; box b of slot s is in row ``s * B + b``. Frame t is in
    row t or T + t of arrays of 2 T rows. Index 0 of ``slots``, ``cover`` and ``evidence`` is the
    current state and 1 the proposed one. From ``frames`` on all are workspaces.

    Parameters
    ----------
    slots : (2, S + 1) int
        Slot of each scenelet, in order of time.
    role : (S,) int
        What becomes of a slot in the proposal: UNUSED, KEPT, ADDED or REMOVED.
    cover : (2, T) int
        Slot whose scenelet poses the frame, -1 if none.
    evidence : (2, S + 1) float
        Of the path before each scenelet, and after the last.
    items : (S, 3) int
        Scenelet, start frame, frame after its end.
    placements : (S, 3) float
        x, y (m), yaw (rad).
    sizes : (S,) float
        Log size of each scenelet, on top of the body scale.
    bodies : (S,) float
        How large person and furniture are.
    pelvis : (S, 6) float
        Bearing and log depth in the first frame, and in the last two.
    placed : (S,) float
        Log density of placement and size given the pelvis, nats.
    pairs : (S, S) float
        What it costs that objects of two scenelets are in each other, nats.
    counts : (S,) int
        Boxes of each.
    boxes : (S B, 7) float
        In the world.
    turns : (S B, 3) float
        Cosine and sine of the yaw, half a diagonal.
    occluders : (S B, 15) single
        See `set_occluder`.
    footprints : (S B, 4) float
        See `set_footprint`.
    hulls : (S, 5) single
        Window of all boxes of a slot.
    floors : (S, 4) float
        Footprint of all boxes of a slot.
    labels : (S B,) int
        Category of the object.
    yaws : (S B,) float
        Of the object, radians.
    pose_at : (T,) uint8
        Which row of the frame holds, of the arrays up to ``depths``.
    moved : (T,) uint8
        Whether the proposal wrote the other.
    pose_row : (T,) int
        The row that holds in the proposal.
    path : (2 T, 2) float
        Bearing and log depth of a free frame.
    joints : (2 T, 3, 16) float
        In the world, metres.
    lines : (2 T, 48) single
        See `ray_endpoints`.
    views : (2 T, 5) single
        See `ray_bounds`.
    columns : (2 T, 5, 4) float
        See `set_body_columns`.
    ground : (2 T, 4) float
        See `set_body_columns`.
    sunk : (2 T,) float
        How deep the lowest joint is below the floor, metres.
    likelihoods : (2 T, 64) float
        Of covered frames, see `LIKELIHOODS`.
    gaps : (S, 2 T, 16) single
        Clearance of the joints from a slot's boxes, where near.
    near : (S, 2 T) uint8
        Whether any box of the slot can come near a line of sight.
    depths : (S, 2 T) float
        How deep the body stands in the slot's objects, metres.
    sum_at : (T,) uint8
        Which row of the frame holds, of ``clearance`` and ``emissions``.
    changed : (T,) uint8
        Whether the proposal wrote the other.
    sum_row : (T,) int
        The row that holds in the proposal.
    clearance : (2 T, 16) single
        Of the joints from all boxes, metres.
    emissions : (2 T, 5) float
        See `EMISSION`.
    poses : (T, 3, 16) float
        Of the problem, with the joints side by side.
    uv : (T, 2, 2, 16) float
        See `set_detections`.
    params : (T, 2, 7, 16) single
        See `set_detections`.
    told : (T,) uint8
        Whether ``uv`` and ``params`` of the frame are written.
    own : (T, 64) float
        The same of a free frame.
    own_told : (T,) uint8
        Whether ``own`` of the frame is written.
    bare : (T, 5) float
        Emissions of a free frame with nothing in sight; NaN where not worked out yet.
    watched : (T,) uint8
        Whether anything of the frame was detected.
    every : (T,) int
        All frames.
    frames : (T,) int
        Those that moved, then those to weigh.
    weighed : (T,) int
        Rows of those to weigh.
    seen : (T, 16) single
        See `visibility_probabilities`.
    logs : (4, T) float
        See `mix_likelihoods`.
    scratch32 : (SCRATCH32,) single
    scratch64 : (SCRATCH64,) float
    drawn : (T, 2) float
        Path of the free frames.
    displaced : (5,) float
        See `add_displaced_depth`.
    terms : (12,) float
        Of the proposal, nats, see `TERMS`.
    """

    slots: Ints
    role: Ints
    cover: Ints
    evidence: Array
    items: Ints
    placements: Array
    sizes: Array
    bodies: Array
    pelvis: Array
    placed: Array
    pairs: Array
    counts: Ints
    boxes: Array
    turns: Array
    occluders: Singles
    footprints: Array
    hulls: Singles
    floors: Array
    labels: Ints
    yaws: Array
    pose_at: Flags
    moved: Flags
    pose_row: Ints
    path: Array
    joints: Array
    lines: Singles
    views: Singles
    columns: Array
    ground: Array
    sunk: Array
    likelihoods: Array
    gaps: Singles
    near: Flags
    depths: Array
    sum_at: Flags
    changed: Flags
    sum_row: Ints
    clearance: Singles
    emissions: Array
    poses: Array
    uv: Array
    params: Singles
    told: Flags
    own: Array
    own_told: Flags
    bare: Array
    watched: Flags
    every: Ints
    frames: Ints
    weighed: Ints
    seen: Singles
    logs: Array
    scratch32: Singles
    scratch64: Array
    drawn: Array
    displaced: Array
    terms: Array


_CACHE_LINE = 64
"""Bytes. Sixteen numbers that begin elsewhere than a line of the cache does are in two."""
_PIECES = 15
"""Arrays that are parts of the pool."""


@inner_inlined
def _taken(pool: NDArray[np.uint8], at: Ints, size: int) -> NDArray[np.uint8]:
    """The next ``size`` bytes of the pool, from the beginning of a line of the cache on.

    ``at`` (1,) is how many are taken.
    """
    first = at[0]
    at[0] = first + (size + _CACHE_LINE - 1) // _CACHE_LINE * _CACHE_LINE
    if at[0] > len(pool):
        raise MemoryError("the pool is too small")
    return pool[first : first + size]


@inner_inlined
def _doubles(pool: NDArray[np.uint8], at: Ints, size: int) -> Array:
    return _taken(pool, at, 8 * size).view(np.float64)


@inner_inlined
def _singles(pool: NDArray[np.uint8], at: Ints, size: int) -> Singles:
    return _taken(pool, at, 4 * size).view(np.float32)


@inner
def _new_cache(problem: Problem, capacity: int) -> Cache:
    """An empty cache.

    What is read before it is written is set here. The larger arrays are parts of one: many pieces
    of that size would go back to the system, and come from it anew page by page, at every
    evaluation of a whole state.

    Parameters
    ----------
    problem : Problem
    capacity : int
        Scenelets of a state, and of a proposal, at most.

    Returns
    -------
    Cache
    """
    n, n_slots, n_boxes = len(problem.lift), 2 * capacity, 1
    for k in range(len(problem.box_first) - 1):
        n_boxes = max(n_boxes, problem.box_first[k + 1] - problem.box_first[k])
    rows, all_boxes = 2 * n, n_slots * n_boxes

    doubles = (
        rows * (48 + 20 + LIKELIHOODS + EMISSION + n_slots)
        + n * (48 + 64 + LIKELIHOODS)
        + SCRATCH64
    )
    singles = rows * (LINE + 16 + 16 * n_slots) + n * (2 * PARAMS * 16 + 16) + SCRATCH32
    pool = np.empty(8 * doubles + 4 * singles + (_PIECES + 1) * _CACHE_LINE, np.uint8)
    at = np.empty(1, np.int64)
    at[0] = (_CACHE_LINE - np.int64(pool.ctypes.data) % _CACHE_LINE) % _CACHE_LINE
    poses, watched = _doubles(pool, at, n * 48).reshape((n, 3, 16)), np.zeros(n, np.uint8)
    for t in range(n):
        for axis in range(3):
            for j in range(16):
                poses[t, axis, j] = problem.poses[t, j, axis]
        for j in range(16):
            watched[t] |= problem.used[t, j]

    return Cache(
        slots=np.zeros((2, n_slots + 1), np.int64),
        role=np.zeros(n_slots, np.int64),
        # At first every frame counts as covered by something else.
        cover=np.zeros((2, n), np.int64),
        evidence=np.zeros((2, n_slots + 1)),
        items=np.empty((n_slots, 3), np.int64),
        placements=np.empty((n_slots, 3)),
        sizes=np.empty(n_slots),
        bodies=np.empty(n_slots),
        pelvis=np.empty((n_slots, 6)),
        placed=np.empty(n_slots),
        pairs=np.empty((n_slots, n_slots)),
        counts=np.zeros(n_slots, np.int64),
        boxes=np.empty((all_boxes, 7)),
        turns=np.empty((all_boxes, 3)),
        occluders=np.empty((all_boxes, OCCLUDER), np.float32),
        footprints=np.empty((all_boxes, 4)),
        hulls=np.empty((n_slots, VIEW), np.float32),
        floors=np.empty((n_slots, 4)),
        labels=np.empty(all_boxes, np.int64),
        yaws=np.empty(all_boxes),
        pose_at=np.zeros(n, np.uint8),
        moved=np.zeros(n, np.uint8),
        pose_row=np.zeros(n, np.int64),
        path=np.empty((rows, 2)),
        joints=_doubles(pool, at, rows * 48).reshape((rows, 3, 16)),
        lines=_singles(pool, at, rows * LINE).reshape((rows, LINE)),
        views=np.empty((rows, VIEW), np.float32),
        columns=_doubles(pool, at, rows * 20).reshape((rows, 5, 4)),
        ground=np.empty((rows, 4)),
        sunk=np.empty(rows),
        likelihoods=_doubles(pool, at, rows * LIKELIHOODS).reshape((rows, LIKELIHOODS)),
        gaps=_singles(pool, at, n_slots * rows * 16).reshape((n_slots, rows, 16)),
        # A slot that goes is asked about rows in which it never was.
        near=np.zeros((n_slots, rows), np.uint8),
        depths=_doubles(pool, at, n_slots * rows).reshape((n_slots, rows)),
        sum_at=np.zeros(n, np.uint8),
        changed=np.zeros(n, np.uint8),
        sum_row=np.zeros(n, np.int64),
        clearance=_singles(pool, at, rows * 16).reshape((rows, 16)),
        emissions=_doubles(pool, at, rows * EMISSION).reshape((rows, EMISSION)),
        poses=poses,
        uv=_doubles(pool, at, n * 64).reshape((n, 2, 2, 16)),
        params=_singles(pool, at, n * 2 * PARAMS * 16).reshape((n, 2, PARAMS, 16)),
        told=np.zeros(n, np.uint8),
        own=_doubles(pool, at, n * LIKELIHOODS).reshape((n, LIKELIHOODS)),
        own_told=np.zeros(n, np.uint8),
        bare=np.full((n, EMISSION), np.nan),
        watched=watched,
        every=np.arange(n),
        frames=np.empty(n, np.int64),
        weighed=np.empty(n, np.int64),
        seen=_singles(pool, at, n * 16).reshape((n, 16)),
        logs=np.empty((4, n)),
        scratch32=_singles(pool, at, SCRATCH32),
        scratch64=_doubles(pool, at, SCRATCH64),
        drawn=np.empty((n, 2)),
        displaced=np.empty(N_DISPLACED),
        terms=np.zeros(len(TERMS)),
    )


_structref: Any = structref
"""numba's records by reference, published without types."""


class _EvaluatorType(types.StructRef):
    """The type that the compiler has for an evaluator."""


class Evaluator(structref.StructRefProxy):
    """A problem and the cache of its evaluation; made by :func:`open_evaluator`.

    Parameters
    ----------
    *args
        Problem and cache.
    """

    problem: Problem
    cache: Cache


_structref.register(_EvaluatorType)
_structref.define_boxing(_EvaluatorType, Evaluator)
_structref.define_constructor(Evaluator, _EvaluatorType, ["problem", "cache"])


@compiled
def open_evaluator(problem: Problem, capacity: int) -> Evaluator:
    """An evaluator of a problem with an empty cache.

    Parameters
    ----------
    problem : Problem
        Its arrays are kept, not copied.
    capacity : int
        Scenelets of a state at most.

    Returns
    -------
    Evaluator
    """
    return Evaluator(problem, _new_cache(problem, max(capacity, 1)))  # type: ignore[no-untyped-call]
