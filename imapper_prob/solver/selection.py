"""Select the objects of a scene that are reported, and problems with a part of the library.

A scenelet contains all furniture near the recorded person: the couch they sat on, and a shelf
beside it. The motion is evidence for the couch; the shelf is kept only if it explains occlusion.
With the published energy all objects stay, except that of two compatible objects that intersect,
the one that costs more is removed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from imapper_prob.layouts import placed_objects, representatives, same_objects
from imapper_prob.models.log_posterior import State, log_posterior
from imapper_prob.models.problem import Problem
from imapper_prob.models.published_terms import paper_energy
from imapper_prob.models.scene import SceneObject
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import TOUCH_REACH, PaperWeights
from imapper_prob.models.skeleton import TOUCHING

__all__ = [
    "of_scenelets", "published_objects", "selected_objects", "used_objects", "with_own_scenelets",
]  # fmt: skip

Ints = NDArray[np.int64]


def of_scenelets(problem: Problem, chosen: Sequence[int] | Ints) -> Problem:
    """The problem with a library of exactly the ``chosen`` scenelets, in their order.

    A scenelet may be chosen twice. Prior odds are unchanged: those of the other scenelets are
    dropped, not redistributed.

    Parameters
    ----------
    problem : Problem
    chosen : sequence of int

    Returns
    -------
    Problem
    """
    chosen = np.asarray(chosen, np.int64)
    frames = _ranges(problem.joint_first, chosen)
    boxes = _ranges(problem.box_first, chosen)
    return problem._replace(
        joints=problem.joints[frames],
        joint_facing=problem.joint_facing[frames],
        joint_first=_starts(problem.lengths[chosen]),
        boxes=problem.boxes[boxes],
        box_first=_starts(np.diff(problem.box_first)[chosen]),
        box_object=problem.box_object[boxes],
        box_label=problem.box_label[boxes],
        box_yaw=problem.box_yaw[boxes],
        lowered=problem.lowered[chosen],
        log_rate=problem.log_rate[chosen],
    )


def with_own_scenelets(problem: Problem, state: State) -> tuple[Problem, State]:
    """The problem with a library of the state's scenelets, and the state in it.

    A scenelet that the state has twice is twice in this library. So the furniture of each can be
    changed alone.

    Parameters
    ----------
    problem : Problem
    state : State

    Returns
    -------
    Problem, State
    """
    items = np.stack([np.arange(state.n_scenelets), state.items[:, 1]], -1)
    return of_scenelets(problem, state.items[:, 0]), replace(state, items=items)


def _ranges(first: Ints, chosen: Ints) -> Ints:
    """Rows of the chosen entries in a packed array."""
    rows = [np.arange(first[i], first[i + 1]) for i in chosen]
    return np.concatenate([np.empty(0, np.int64), *rows])


def _starts(counts: Ints) -> Ints:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


# ------------------------------------------------------------------------------------------------
# Selection of objects.

Array = NDArray[np.float64]
_NOWHERE, _DEEP = 1e6, 1e3
"""Metres: a horizontal distance, and a depth below the floor, at which boxes have no effect."""
_OFTEN = 0.25
"""Share of a scenelet's frames in which a joint must touch an object that is used."""
_EVIDENCE = 3.0
"""Least evidence in nats for an unused object: odds of twenty to one."""


def selected_objects(problem: Problem, library: Library, state: State) -> tuple[SceneObject, ...]:
    """The furniture of a state that a person uses, or that explains the detections.

    In the state's world frame, with objects that are one merged.

    Parameters
    ----------
    problem : Problem
    library : Library
    state : State

    Returns
    -------
    tuple of SceneObject
    """
    placed = placed_objects(state, library)
    own, own_state = with_own_scenelets(problem, state)
    used = [flag for scenelet in state.items[:, 0] for flag in used_objects(problem, scenelet)]
    value = log_posterior(own, own_state)
    kept = []
    for group in same_objects(placed, problem.merge_angle):
        worth = any(used[k] for k in group) or (
            value - log_posterior(_sunk(own, _boxes(own, own_state, placed, group)), own_state)
            > _EVIDENCE
        )
        if worth:
            kept += representatives(problem, state, placed, [group])
    return tuple(placed[k][1] for k in sorted(kept))


def published_objects(problem: Problem, library: Library, state: State) -> tuple[SceneObject, ...]:
    """Objects of all scenelets; of two compatible ones that intersect, one is removed.

    For every pair with the same label and orientation whose footprints intersect, the scene is
    evaluated without each of them, and the object without which the energy is lower is removed
    (Monszpart et al. 2019, section 6).

    Parameters
    ----------
    problem : Problem
        Problem with the published energy.
    library : Library
    state : State

    Returns
    -------
    tuple of SceneObject
    """
    placed = placed_objects(state, library)
    own, own_state = with_own_scenelets(problem, state)
    weights = PaperWeights(*problem.paper_nats.tolist())
    left = list(range(len(placed)))

    def energy(without: int) -> float:
        gone = [k for k in range(len(placed)) if k not in left or k == without]
        bare = _carried_away(own, _boxes(own, own_state, placed, gone))
        return paper_energy(bare, own_state, weights=weights).total

    for a, b in combinations(range(len(placed)), 2):
        if a in left and b in left and _compatible(placed[a][1], placed[b][1], problem.merge_angle):
            left.remove(a if energy(without=a) <= energy(without=b) else b)
    return tuple(placed[k][1] for k in left)


def _compatible(one: SceneObject, other: SceneObject, angle: float) -> bool:
    """Whether two objects have the same label and orientation, and their footprints intersect."""
    turned = np.cos(one.placement.yaw - other.placement.yaw) <= np.cos(angle)
    if one.label != other.label or turned:
        return False
    return bool(Polygon(one.footprint).intersects(Polygon(other.footprint)))


def used_objects(problem: Problem, scenelet: int) -> list[bool]:
    """For each object of a scenelet, whether its person sits on, leans on or touches it.

    Parameters
    ----------
    problem : Problem
    scenelet : int

    Returns
    -------
    list of bool
    """
    joints = problem.joints[slice(*problem.joint_first[scenelet : scenelet + 2])][:, TOUCHING]
    own = slice(*problem.box_first[scenelet : scenelet + 2])
    objects, boxes = problem.box_object[own], problem.boxes[own]
    return [
        bool((_distance(joints, boxes[objects == k]) < TOUCH_REACH).mean() >= _OFTEN)
        for k in range(int(objects.max(initial=-1)) + 1)
    ]


def _distance(joints: Array, boxes: Array) -> Array:
    """(n,) metres from the nearest of the joints (n, J, 3) to the nearest of the boxes (B, 7)."""
    offset = joints[:, :, None] - boxes[:, :3]
    c, s = np.cos(boxes[:, 6]), np.sin(boxes[:, 6])
    x, y, z = np.moveaxis(offset, -1, 0)
    own = np.stack([c * x + s * y, c * y - s * x, z], -1)
    outside = np.maximum(np.abs(own) - boxes[:, 3:6], 0.0)
    distance: Array = np.linalg.norm(outside, axis=-1).min((1, 2))
    return distance


def _boxes(
    problem: Problem, state: State, placed: list[tuple[int, SceneObject]], group: list[int]
) -> Ints:
    """Rows of the library's boxes that belong to some of the placed objects."""
    first = {index: k for k, (index, _) in reversed(list(enumerate(placed)))}
    rows = [np.empty(0, np.int64)]
    for k in group:
        index = placed[k][0]
        scenelet = state.items[index, 0]
        own = np.arange(*problem.box_first[scenelet : scenelet + 2])
        rows.append(own[problem.box_object[own] == k - first[index]])
    return np.concatenate(rows)


def _sunk(problem: Problem, rows: Ints) -> Problem:
    """The problem with some boxes moved far below the floor, where they have no effect."""
    boxes = problem.boxes.copy()
    boxes[rows, 2] = -_DEEP
    return problem._replace(boxes=boxes)


def _carried_away(problem: Problem, rows: Ints) -> Problem:
    """The problem with some boxes moved far away; the published energy uses only floor
    positions."""
    boxes = problem.boxes.copy()
    # Apart from each other, because boxes of one scenelet may collide.
    boxes[rows, :2] = _NOWHERE * (1.0 + np.arange(len(rows)))[:, None]
    return problem._replace(boxes=boxes)
