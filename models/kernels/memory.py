"""What an incremental evaluation remembers, in flat arrays.

Scenelets live in slots: one keeps its slot for as long as nothing about it changes. What
depends on a frame has two rows, one that holds for the current state and one to write a
proposal into; to accept is to say of some frames that the other row now holds.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.energy.intersection import N_DISPLACED
from imapper_prob.models.kernels.frame import CHANCES, DESK, FACTS
from imapper_prob.models.kernels.sight import BENCH, LINE, OUTLOOK, VIEW, Singles
from imapper_prob.models.problem import Problem

__all__ = ["ADDED", "KEPT", "REMOVED", "UNUSED", "Memory", "new_memory"]

_Number = TypeVar("_Number", np.float32, np.float64)

UNUSED, KEPT, ADDED, REMOVED = range(4)

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.uint8]


class Memory(NamedTuple):
    """T frames, S slots of up to B boxes; box b of slot s is in row ``s * B + b``.

    Frame t is in row t or T + t of arrays of 2 T rows. Index 0 of ``slots``, ``cover`` and
    ``evidence`` is the current state and 1 the proposed one.
    """

    slots: Ints  # (2, S + 1) slot of each scenelet, in order of time
    role: Ints  # (S,) what becomes of a slot in the proposal: UNUSED, KEPT, ADDED or REMOVED
    cover: Ints  # (2, T) slot whose scenelet poses the frame, -1 if none
    evidence: Array  # (2, S + 1) of the path before each scenelet, and after the last

    items: Ints  # (S, 3) scenelet, start frame, frame after its end
    placements: Array  # (S, 3) x, y (m), yaw (rad)
    sizes: Array  # (S,) log size of each scenelet, on top of the body scale
    bodies: Array  # (S,) how large person and furniture are
    pelvis: Array  # (S, 6) bearing and log depth in the first frame, and in the last two
    placed: Array  # (S,) log density of placement and size given the pelvis, nats
    pairs: Array  # (S, S) what it costs that objects of two scenelets are in each other, nats
    counts: Ints  # (S,) boxes of each
    boxes: Array  # (S B, 7) in the world
    turns: Array  # (S B, 3) cosine and sine of the yaw, half a diagonal
    outlooks: Singles  # (S B, 15) see set_outlook
    footprints: Array  # (S B, 4) see set_footprint
    hulls: Singles  # (S, 5) window of all boxes of a slot
    floors: Array  # (S, 4) footprint of all boxes of a slot
    labels: Ints  # (S B,) category of the object
    yaws: Array  # (S B,) of the object, radians

    pose_at: Flags  # (T,) which row of the frame holds, of what follows
    moved: Flags  # (T,) whether the proposal wrote the other
    pose_row: Ints  # (T,) the row that holds in the proposal
    path: Array  # (2 T, 2) bearing and log depth of a free frame
    joints: Array  # (2 T, 3, 16) in the world, metres
    lines: Singles  # (2 T, 48) see aim
    views: Singles  # (2 T, 5) see look
    columns: Array  # (2 T, 5, 4) see set_columns
    ground: Array  # (2 T, 4) see set_columns
    sunk: Array  # (2 T,) how deep the lowest joint is below the floor, metres
    chances: Array  # (2 T, 64) see CHANCES, of covered frames
    gaps: Singles  # (S, 2 T, 16) clearance of the joints from a slot's boxes, where near
    near: Flags  # (S, 2 T) whether any box of the slot can come near a line of sight
    depths: Array  # (S, 2 T) how deep the body stands in the slot's objects, metres

    sum_at: Flags  # (T,) which row of the frame holds, of what follows
    changed: Flags  # (T,) whether the proposal wrote the other
    sum_row: Ints  # (T,) the row that holds in the proposal
    clearance: Singles  # (2 T, 16) of the joints from all boxes, metres
    votes: Array  # (2 T, 3) see vote

    poses: Array  # (T, 3, 16) of the problem, with the joints side by side
    places: Array  # (T, 2, 2, 16) see set_detections
    facts: Singles  # (T, 2, 7, 16) see set_detections
    own: Array  # (T, 64) CHANCES of a free frame
    bare: Array  # (T, 3) votes of a free frame with nothing in sight
    watched: Flags  # (T,) whether anything of the frame was detected
    every: Ints  # (T,) all frames
    frames: Ints  # (T,) those that moved, then those to weigh: workspace, as is what follows
    weighed: Ints  # (T,) rows of the latter
    seen: Singles  # (T, 16) of theirs, see find_seen
    logs: Array  # (4, T) see weigh
    bench: Singles  # (BENCH,)
    desk: Array  # (DESK,)
    drawn: Array  # (T, 2)
    displaced: Array  # (5,) see give_way


_CACHE_LINE = 64
"""Bytes. Sixteen numbers that begin elsewhere than a line of the cache does are in two."""


def _zeros(shape: tuple[int, ...], dtype: type[_Number]) -> NDArray[_Number]:
    """Zeros that begin where a line of the cache does."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    room = np.zeros(size + _CACHE_LINE, np.uint8)
    first = -room.ctypes.data % _CACHE_LINE
    return room[first : first + size].view(dtype).reshape(shape)


def new_memory(problem: Problem, capacity: int) -> Memory:
    """Memory for states of up to ``capacity`` scenelets and proposals of as many."""
    n_frames, n_slots = problem.n_frames, 2 * capacity
    n_boxes = max(1, int(np.diff(problem.box_first).max()))
    rows, all_boxes = 2 * n_frames, n_slots * n_boxes

    poses = _zeros((n_frames, 3, 16), np.float64)
    poses[:] = problem.poses.transpose(0, 2, 1)

    def zeros(*shape: int) -> Array:
        return _zeros(shape, np.float64)

    def singles(*shape: int) -> Singles:
        return _zeros(shape, np.float32)

    def ints(*shape: int) -> Ints:
        return np.zeros(shape, np.int64)

    def flags(*shape: int) -> Flags:
        return np.zeros(shape, np.uint8)

    return Memory(
        slots=ints(2, n_slots + 1),
        role=ints(n_slots),
        cover=ints(2, n_frames),
        evidence=zeros(2, n_slots + 1),
        items=ints(n_slots, 3),
        placements=zeros(n_slots, 3),
        sizes=zeros(n_slots),
        bodies=zeros(n_slots),
        pelvis=zeros(n_slots, 6),
        placed=zeros(n_slots),
        pairs=zeros(n_slots, n_slots),
        counts=ints(n_slots),
        boxes=zeros(all_boxes, 7),
        turns=zeros(all_boxes, 3),
        outlooks=singles(all_boxes, OUTLOOK),
        footprints=zeros(all_boxes, 4),
        hulls=singles(n_slots, VIEW),
        floors=zeros(n_slots, 4),
        labels=ints(all_boxes),
        yaws=zeros(all_boxes),
        pose_at=flags(n_frames),
        moved=flags(n_frames),
        pose_row=ints(n_frames),
        path=zeros(rows, 2),
        joints=zeros(rows, 3, 16),
        lines=singles(rows, LINE),
        views=singles(rows, VIEW),
        columns=zeros(rows, 5, 4),
        ground=zeros(rows, 4),
        sunk=zeros(rows),
        chances=zeros(rows, CHANCES),
        gaps=singles(n_slots, rows, 16),
        near=flags(n_slots, rows),
        depths=zeros(n_slots, rows),
        sum_at=flags(n_frames),
        changed=flags(n_frames),
        sum_row=ints(n_frames),
        clearance=singles(rows, 16),
        votes=zeros(rows, 3),
        poses=poses,
        places=zeros(n_frames, 2, 2, 16),
        facts=singles(n_frames, 2, FACTS, 16),
        own=zeros(n_frames, CHANCES),
        bare=zeros(n_frames, 3),
        watched=np.asarray(problem.used.any(axis=1), np.uint8),
        every=np.arange(n_frames),
        frames=ints(n_frames),
        weighed=ints(n_frames),
        seen=singles(n_frames, 16),
        logs=zeros(4, n_frames),
        bench=singles(BENCH),
        desk=zeros(DESK),
        drawn=zeros(n_frames, 2),
        displaced=zeros(N_DISPLACED),
    )
