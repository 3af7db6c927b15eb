"""The cache of an incremental evaluation as flat arrays, and its handle for compiled code.

Each scenelet has a slot, which it keeps while it is unchanged. Values of a frame have two rows: one
is valid for the current state, and a proposal is written to the other. Accepting a proposal
switches the valid row of the changed frames.

A problem and a cache have some ninety arrays. Unpacking them at every call takes longer than the
arithmetic of a small move, so an :class:`Evaluator` passes both to compiled code by one address.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.experimental import structref
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled, inner
from imapper_prob.models.kernels.frame import LIKELIHOODS, PARAMS, SCRATCH64
from imapper_prob.models.kernels.intersection import N_DISPLACED
from imapper_prob.models.kernels.visibility import LINE, OCCLUDER, SCRATCH32, VIEW, Singles
from imapper_prob.models.problem import TERMS, Problem

__all__ = [
    "ADDED",
    "AS_DETECTED",
    "EMISSION",
    "FLIPPED",
    "KEPT",
    "REMOVED",
    "UNUSED",
    "Cache",
    "Evaluator",
    "open_evaluator",
]

UNUSED, KEPT, ADDED, REMOVED = range(4)
EMISSION = 5
"""Numbers of a frame's emission: the greater of the two weighted log-densities (sides as they are,
and flipped), both densities relative to it, and the two unweighted log-likelihoods, nats."""
AS_DETECTED, FLIPPED = 3, 4
"""Indices of the unweighted log-likelihoods: sides as they are, and flipped."""
Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.uint8]


class Cache(NamedTuple):
    """The cached values of the current state, and those of a proposal.

    T frames, S slots of up to B boxes; box b of slot s is in row ``s * B + b``. Frame t is in row t
    or T + t of arrays with 2 T rows. Index 0 of ``slots``, ``cover`` and ``evidence`` is the
    current state and 1 the proposal. The fields from ``frames`` on are workspaces.

    Parameters
    ----------
    slots : (2, S + 1) int
        Slot of each scenelet, in order of time.
    role : (S,) int
        What becomes of a slot in the proposal: UNUSED, KEPT, ADDED or REMOVED.
    cover : (2, T) int
        Slot whose scenelet poses the frame, -1 if none.
    evidence : (2, S + 1) float
        Log evidence of the path before each scenelet, and after the last, nats.
    items : (S, 3) int
        Scenelet, start frame, and frame after its end.
    placements : (S, 3) float
        x, y (m), yaw (rad).
    sizes : (S,) float
        Log size of each scenelet, on top of the body scale.
    bodies : (S,) float
        Size of person and furniture, a factor.
    pelvis : (S, 6) float
        Bearing and log depth of the pelvis in the first frame, and in the last two.
    placement_log_density : (S,) float
        Log density of placement and size given the pelvis, nats.
    collision_costs : (S, S) float
        Cost of collisions between the objects of two scenelets, nats.
    counts : (S,) int
        Number of boxes of each slot.
    boxes : (S B, 7) float
        World frame.
    rotations : (S B, 3) float
        Cosine and sine of the yaw, and half a diagonal.
    occluders : (S B, 15) single
        See `set_occluder`.
    footprints : (S B, 4) float
        See `set_footprint`.
    hulls : (S, 5) single
        Image bounds of all boxes of a slot.
    floors : (S, 4) float
        Bounds on the floor of all boxes of a slot.
    labels : (S B,) int
        Category of the object that each box belongs to.
    yaws : (S B,) float
        Yaw of that object, radians.
    pose_at : (T,) uint8
        Which of the frame's two rows is valid, for the arrays up to ``depths``.
    moved : (T,) uint8
        Whether the proposal wrote the other row.
    pose_row : (T,) int
        The row that is valid in the proposal.
    path : (2 T, 2) float
        Bearing and log depth of a free frame.
    joints : (2 T, 3, 16) float
        World frame, metres.
    lines : (2 T, 48) single
        See `ray_endpoints`.
    views : (2 T, 5) single
        See `ray_bounds`.
    columns : (2 T, 5, 4) float
        See `set_body_columns`.
    ground : (2 T, 4) float
        See `set_body_columns`.
    floor_depths : (2 T,) float
        Depth of the lowest joint below the floor, metres.
    likelihoods : (2 T, 64) float
        Likelihoods of covered frames, see `LIKELIHOODS`.
    slot_clearance : (S, 2 T, 16) single
        Clearance of the joints from a slot's boxes, metres, where ``near``.
    near : (S, 2 T) uint8
        Whether any box of the slot may come near a line of sight.
    depths : (S, 2 T) float
        Penetration of the body into the slot's objects, metres.
    sum_at : (T,) uint8
        Which of the frame's two rows is valid, for ``clearance`` and ``emissions``.
    changed : (T,) uint8
        Whether the proposal wrote the other row.
    sum_row : (T,) int
        The row that is valid in the proposal.
    clearance : (2 T, 16) single
        Clearance of the joints from all boxes, metres.
    emissions : (2 T, 5) float
        See `EMISSION`.
    poses : (T, 3, 16) float
        Poses of the problem, with the joints contiguous.
    uv : (T, 2, 2, 16) float
        See `set_detections`.
    params : (T, 2, 7, 16) single
        See `set_detections`.
    detections_set : (T,) uint8
        Whether ``uv`` and ``params`` of the frame are filled in.
    free_likelihoods : (T, 64) float
        Likelihoods of a free frame, see `LIKELIHOODS`.
    free_likelihoods_set : (T,) uint8
        Whether ``free_likelihoods`` of the frame is filled in.
    free_emissions : (T, 5) float
        Emissions of a free frame without any occlusion; NaN until computed.
    ceilings : (3 T, 5) float
        Emissions of covered frames if every joint is hidden or seen as explains its detection
        better, in the frame's row of poses; of free frames in row 2 T + t. NaN until computed.
    detected : (T,) uint8
        Whether the frame has any detection.
    every : (T,) int
        Indices of all frames.
    frames : (T,) int
        The frames that moved, then the frames whose emissions are to be computed.
    emission_rows : (T,) int
        Rows of the latter in ``clearance`` and ``emissions``.
    seen : (T, 16) single
        See `visibility_probabilities`.
    logs : (4, T) float
        See `mix_likelihoods`.
    scratch32 : (SCRATCH32,) single
    scratch64 : (SCRATCH64,) float
    free_path : (T, 2) float
        Path of the free frames.
    bounds : (T, 5) float
        Upper bounds of the proposal's emissions.
    displaced : (5,) float
        See `add_displaced_depth`.
    terms : (12,) float
        Terms of the proposal, nats, see `TERMS`.
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
    placement_log_density: Array
    collision_costs: Array
    counts: Ints
    boxes: Array
    rotations: Array
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
    floor_depths: Array
    likelihoods: Array
    slot_clearance: Singles
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
    detections_set: Flags
    free_likelihoods: Array
    free_likelihoods_set: Flags
    free_emissions: Array
    ceilings: Array
    detected: Flags
    every: Ints
    frames: Ints
    emission_rows: Ints
    seen: Singles
    logs: Array
    scratch32: Singles
    scratch64: Array
    free_path: Array
    bounds: Array
    displaced: Array
    terms: Array


_CACHE_LINE = 64
"""Bytes. Arrays are aligned to it, so that sixteen singles lie in one line of the CPU's cache."""
_PIECES = 15
"""Number of arrays that are parts of the pool."""


@inner
def _taken(pool: NDArray[np.uint8], at: Ints, size: int) -> NDArray[np.uint8]:
    """The next ``size`` bytes of the pool, aligned to a cache line.

    ``at`` (1,) is the number of bytes in use, which is updated.
    """
    first = at[0]
    at[0] = first + (size + _CACHE_LINE - 1) // _CACHE_LINE * _CACHE_LINE
    if at[0] > len(pool):
        raise MemoryError("the pool is too small")
    return pool[first : first + size]


@inner
def _doubles(pool: NDArray[np.uint8], at: Ints, size: int) -> Array:
    return _taken(pool, at, 8 * size).view(np.float64)


@inner
def _singles(pool: NDArray[np.uint8], at: Ints, size: int) -> Singles:
    return _taken(pool, at, 4 * size).view(np.float32)


@inner
def _new_cache(problem: Problem, capacity: int) -> Cache:
    """Make an empty cache.

    Arrays that are read before they are written are initialised. The larger arrays are parts of one
    block: separate blocks of that size would be returned to the operating system, and be allocated
    again page by page, at every evaluation of a whole state.

    Parameters
    ----------
    problem : Problem
    capacity : int
        Largest number of scenelets of a state and of a proposal.

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
    poses, detected = _doubles(pool, at, n * 48).reshape((n, 3, 16)), np.zeros(n, np.uint8)
    for t in range(n):
        for axis in range(3):
            for j in range(16):
                poses[t, axis, j] = problem.poses[t, j, axis]
        for j in range(16):
            detected[t] |= problem.used[t, j]

    return Cache(
        slots=np.zeros((2, n_slots + 1), np.int64),
        role=np.zeros(n_slots, np.int64),
        # At first every frame counts as covered by another slot.
        cover=np.zeros((2, n), np.int64),
        evidence=np.zeros((2, n_slots + 1)),
        items=np.empty((n_slots, 3), np.int64),
        placements=np.empty((n_slots, 3)),
        sizes=np.empty(n_slots),
        bodies=np.empty(n_slots),
        pelvis=np.empty((n_slots, 6)),
        placement_log_density=np.empty(n_slots),
        collision_costs=np.empty((n_slots, n_slots)),
        counts=np.zeros(n_slots, np.int64),
        boxes=np.empty((all_boxes, 7)),
        rotations=np.empty((all_boxes, 3)),
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
        floor_depths=np.empty(rows),
        likelihoods=_doubles(pool, at, rows * LIKELIHOODS).reshape((rows, LIKELIHOODS)),
        slot_clearance=_singles(pool, at, n_slots * rows * 16).reshape((n_slots, rows, 16)),
        # For a removed slot, rows are read in which the slot was never written.
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
        detections_set=np.zeros(n, np.uint8),
        free_likelihoods=_doubles(pool, at, n * LIKELIHOODS).reshape((n, LIKELIHOODS)),
        free_likelihoods_set=np.zeros(n, np.uint8),
        free_emissions=np.full((n, EMISSION), np.nan),
        ceilings=np.full((3 * n, EMISSION), np.nan),
        detected=detected,
        every=np.arange(n),
        frames=np.empty(n, np.int64),
        emission_rows=np.empty(n, np.int64),
        seen=_singles(pool, at, n * 16).reshape((n, 16)),
        logs=np.empty((4, n)),
        scratch32=_singles(pool, at, SCRATCH32),
        scratch64=_doubles(pool, at, SCRATCH64),
        free_path=np.empty((n, 2)),
        bounds=np.empty((n, EMISSION)),
        displaced=np.empty(N_DISPLACED),
        terms=np.zeros(len(TERMS)),
    )


_structref: Any = structref
"""numba's structref module, typed as Any because it is published without types."""


class _EvaluatorType(types.StructRef):
    """The numba type of an evaluator."""


class Evaluator(structref.StructRefProxy):
    """A problem with the cache of its evaluation; made by :func:`open_evaluator`.

    Parameters
    ----------
    *args
        The attributes, in this order.

    Attributes
    ----------
    problem : Problem
    cache : Cache
    """

    problem: Problem
    cache: Cache


_structref.register(_EvaluatorType)
_structref.define_boxing(_EvaluatorType, Evaluator)
_structref.define_constructor(Evaluator, _EvaluatorType, ["problem", "cache"])


@compiled
def open_evaluator(problem: Problem, capacity: int) -> Evaluator:
    """Make an evaluator of a problem with an empty cache.

    Parameters
    ----------
    problem : Problem
        Its arrays are referenced, not copied.
    capacity : int
        Largest number of scenelets of a state.

    Returns
    -------
    Evaluator
    """
    return Evaluator(problem, _new_cache(problem, max(capacity, 1)))  # type: ignore[no-untyped-call]
