"""The published energy written down once more: plain numpy, as slow and as obvious as can be.

Distances are searched on grids, integrals summed over points of the floor, objects asked one by
one: nothing here is how :mod:`imapper_prob.models.published_energy` computes it.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from imapper_prob.models.camera import Camera
from imapper_prob.models.log_posterior import State, motion
from imapper_prob.models.problem import Problem
from imapper_prob.models.scenelet import Library
from imapper_prob.models.skeleton import DETECTED, LKNE, PELV, RKNE

CAP = 1.0
"""Metres to an occlusion volume where there is none."""
SAME = 0.6
"""Radians within which two orientations are the same."""


@dataclass(frozen=True)
class Box:
    """A cuboid in the world: centre, half sides (metres), yaw (radians)."""

    centre: np.ndarray
    half: np.ndarray
    yaw: float

    def own_axes(self, vectors: np.ndarray) -> np.ndarray:
        """World vectors (..., 3) along the box's sides."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return vectors @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class Thing:
    """An object: its label, where it faces, its cuboids."""

    label: str
    yaw: float
    boxes: tuple[Box, ...]


def things_of(library: Library, state: State) -> list[Thing]:
    """The union of the objects of all scenelets that are assigned, in the world."""
    things = []
    for (scenelet, _), (x, y, yaw), size in zip(
        state.items.tolist(), state.placements, state.sizes, strict=True
    ):
        scale, c, s = np.exp(state.camera[3] + size), np.cos(yaw), np.sin(yaw)
        for thing in library[scenelet].objects:
            boxes = []
            for cuboid in thing.cuboids:
                px, py, pz = scale * thing.placement.apply(cuboid.centre)
                centre = np.array([x + c * px - s * py, y + s * px + c * py, pz])
                boxes.append(Box(centre, scale * cuboid.size / 2, yaw + thing.placement.yaw))
            things.append(Thing(thing.label, yaw + thing.placement.yaw, tuple(boxes)))
    return things


def reprojection(camera: Camera, problem: Problem, joints: np.ndarray) -> float:
    """L_r = sum_t sum_k |Pi q - u|^2 c."""
    total = 0.0
    for t in range(len(joints)):
        for k in DETECTED:
            if problem.used[t, k]:
                across, down = camera.project(joints[t, k]) - problem.keypoints[t, k]
                total += problem.confidences[t, k] * (
                    (across / problem.fx) ** 2 + (down / problem.fy) ** 2
                )
    return total


def visibility(eye: np.ndarray, point: np.ndarray, boxes: list[Box]) -> float:
    """v outside the occlusion volume: to the nearest point behind or in a box, on a grid of s."""
    least = CAP
    scale = np.geomspace(1.0, 50.0, 20_001)[:, None]
    for box in boxes:
        low = box.own_axes(box.centre - eye) - box.half
        high = box.own_axes(box.centre - eye) + box.half
        seen = box.own_axes(point - eye)
        apart = np.maximum(scale * low - seen, 0) + np.maximum(seen - scale * high, 0)
        least = min(least, float(np.sqrt((apart**2).sum(1).min())))
    return least


def cost_of_sight(v: float, c: float) -> float:
    """F(v, c)."""
    return (c - 0.5) ** 2 * v**2 if c - 0.5 < 0 and v > 0 else 0.0


def occlusion(problem: Problem, eye: np.ndarray, joints: np.ndarray, things: list[Thing]) -> float:
    """L_o = sum_t sum_k F(v, c), a joint that was not detected having c = 0."""
    boxes = [box for thing in things for box in thing.boxes]
    return sum(
        cost_of_sight(
            visibility(eye, joints[t, k], boxes),
            problem.confidences[t, k] if problem.used[t, k] else 0.0,
        )
        for t in range(len(joints))
        for k in DETECTED
    )


def smoothness(joints: np.ndarray) -> float:
    """L_s = sum_t |p_t - p_(t-1)|^2."""
    return sum(float((step**2).sum()) for step in np.diff(joints[:, PELV], axis=0))


def signed_distance(points: np.ndarray, thing: Thing) -> np.ndarray:
    """delta_o of points (n, 2) on the floor: negative inside."""
    each = []
    for box in thing.boxes:
        offset = np.pad(points - box.centre[:2], ((0, 0), (0, 1)))
        beyond = np.abs(box.own_axes(offset)[:, :2]) - box.half[:2]
        inside = np.minimum(beyond.max(1), 0.0)
        each.append(np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + inside)
    return np.min(each, axis=0)


def intersection(things: list[Thing], step: float = 0.01) -> float:
    """L_c, by a grid over the floor."""
    if not things:
        return 0.0
    centres = np.array([box.centre[:2] for thing in things for box in thing.boxes])
    reach = max(float(np.linalg.norm(box.half)) for thing in things for box in thing.boxes)
    low, high = centres.min(0) - reach, centres.max(0) + reach
    axes = [np.arange(a + step / 2, b, step) for a, b in zip(low, high, strict=True)]
    floor = np.stack(np.meshgrid(*axes), -1).reshape(-1, 2)
    total = 0.0
    for one, other in combinations(things, 2):
        if one.label == other.label and np.cos(one.yaw - other.yaw) > np.cos(SAME):
            continue
        to_one, to_other = signed_distance(floor, one), signed_distance(floor, other)
        total -= np.minimum(to_other, 0.0)[to_one <= 0].sum() * step**2
        total -= np.minimum(to_one, 0.0)[to_other <= 0].sum() * step**2
    return total


def motion_through(joints: np.ndarray, things: list[Thing]) -> float:
    """L_m, the negative part of the largest of three joints' distances to the nearest object."""
    total = 0.0
    for frame in joints:
        nearest = [
            min((float(signed_distance(frame[None, k, :2], o)[0]) for o in things), default=np.inf)
            for k in (PELV, LKNE, RKNE)
        ]
        total -= min(0.0, max(nearest))
    return total


def reference(problem: Problem, library: Library, camera: Camera, state: State) -> dict[str, float]:
    """All five terms, unweighted."""
    joints, things = motion(problem, state), things_of(library, state)
    eye = np.array([0.0, 0.0, state.camera[1]])
    return {
        "reprojection": reprojection(camera, problem, joints),
        "occlusion": occlusion(problem, eye, joints, things),
        "smoothness": smoothness(joints),
        "collision": intersection(things),
        "motion": motion_through(joints, things),
    }
