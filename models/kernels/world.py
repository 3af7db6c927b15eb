"""Where furniture stands in the world, compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled, inner_inlined
from imapper_prob.models.problem import Problem

__all__ = ["place_box", "place_boxes"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@inner_inlined
def place_box(
    boxes: Array, b: int, body: float, x: float, y: float, yaw: float, box: Array, turn: Array
) -> None:
    """Box ``b`` of the library in the world.

    Parameters
    ----------
    boxes : (B, 7) float
        In the frames of their scenelets.
    b : int
    body : float
        How large person and furniture are.
    x, y, yaw : float
        Where the scenelet is placed, metres and radians.
    box : (7,) float
        Out.
    turn : (3,) float
        Out: cosine and sine of its yaw, and half a diagonal (m).
    """
    local = boxes[b]
    c, s = body * math.cos(yaw), body * math.sin(yaw)
    box[0] = c * local[0] - s * local[1] + x
    box[1] = s * local[0] + c * local[1] + y
    for axis in range(2, 6):
        box[axis] = body * local[axis]
    box[6] = local[6] + yaw
    turn[0], turn[1] = math.cos(box[6]), math.sin(box[6])
    turn[2] = body * math.sqrt(local[3] ** 2 + local[4] ** 2 + local[5] ** 2)


@compiled
def place_boxes(
    problem: Problem, camera: Array, items: Ints, placements: Array, sizes: Array
) -> tuple[Array, Array, Ints, Array]:
    """Boxes in the world (K, 7); cosine, sine, radius (K, 3); item, object, label; object yaw.

    Furniture is as much larger than the library's as the person who uses it.
    """
    n = 0
    for i in range(len(items)):
        n += problem.box_first[items[i, 0] + 1] - problem.box_first[items[i, 0]]
    boxes = np.empty((n, 7))
    turns = np.empty((n, 3))
    owner = np.empty((n, 3), dtype=np.int64)
    yaws = np.empty(n)
    k = 0
    for i in range(len(items)):
        yaw = placements[i, 2]
        body = math.exp(camera[3] + sizes[i])
        for b in range(problem.box_first[items[i, 0]], problem.box_first[items[i, 0] + 1]):
            x, y = placements[i, 0], placements[i, 1]
            place_box(problem.boxes, b, body, x, y, yaw, boxes[k], turns[k])
            owner[k, 0], owner[k, 1] = i, problem.box_object[b]
            owner[k, 2] = problem.box_label[b]
            yaws[k] = problem.box_yaw[b] + yaw
            k += 1
    return boxes, turns, owner, yaws
