"""The term of each kind of statement (docs/explanation/model.md 25 to 34).

A statement is a person's answer or a measurement. Its term is the density of that answer given the
scene. It is normalised over all possible answers, so that evidence ratios are meaningful. What a
scene's objects are, and with which probabilities, is the work of
:mod:`imapper_prob.models.kernels.given`.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled, inner
from imapper_prob.models.kernels.axes import (
    camera_pose,
    corner_of,
    point_to_camera,
    rotated_back,
)
from imapper_prob.models.kernels.cache import Cache
from imapper_prob.models.kernels.measured import (
    ERRORS,
    LOG_2PI,
    detection_rate,
    log_normal,
    measure_box,
    measure_object,
    normal_cdf,
    project_outline,
    resize,
    set_errors,
)
from imapper_prob.models.problem import Problem
from imapper_prob.models.settings import TOUCH_REACH
from imapper_prob.models.skeleton import PELV, REFERENCE_STATURE, TOUCHING

__all__ = [
    "BEHIND",
    "CLUTTER",
    "CONTACT",
    "DEPTH",
    "DETECTIONS_OF_OBJECTS",
    "NUMBER",
    "OBJECT",
    "PICTURE_OF_BOXES",
    "PICTURE_OF_OBJECT",
    "PIECE",
    "POINT",
    "PRESENCE",
    "ROOM",
    "SAID",
    "SAME_OBJECT",
    "WRONG",
    "probability_right",
    "statement_term",
]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
(
    NUMBER, OBJECT, PRESENCE, ROOM, POINT, DEPTH, CONTACT, DETECTIONS_OF_OBJECTS, SAME_OBJECT,
    BEHIND,
) = range(10)  # fmt: skip
"""Kinds of statements: the first number in a row of ``Problem.given_kinds``."""
WRONG, SAID, PICTURE_OF_OBJECT = 1, 2, 14
"""Places in the numbers of an `ObjectAt`: log density of a wrong answer, first measured number, and
width of the image, which its height follows."""
CLUTTER, PICTURE_OF_BOXES = 2, 4
"""Places in the numbers of a `Seen`: log density of a false box, and width of the image."""
_SOFT: Final = 0.05
"""Width in metres of the transition from contact to none; chosen, a hand's thickness."""
_TOUCHING: Final = np.array(TOUCHING)
PIECE: Final = 7
"""Numbers of a piece: centre (m), half sides (m) and yaw of its bounding box."""


@compiled
def probability_right(doubt: float, shares: Array) -> float:
    """Probability that a measurement is of one of a scene's pieces, and not by chance.

    Parameters
    ----------
    doubt : float
    shares : (k, 1 + C) float
        See :func:`imapper_prob.models.kernels.given.set_shares`.

    Returns
    -------
    float
    """
    none = 1.0
    for k in range(len(shares)):
        none *= 1.0 - shares[k].sum()
    return (1.0 - doubt) * (1.0 - none)


@inner
def _inside(corners: Array, first: int, end: int, x: float, y: float) -> float:
    """Distance from a point to the nearest edge of a polygon, metres; negative outside."""
    nearest, odd = math.inf, False
    before = end - 1
    for k in range(first, end):
        ax, ay, bx, by = corners[before, 0], corners[before, 1], corners[k, 0], corners[k, 1]
        dx, dy = bx - ax, by - ay
        along = ((x - ax) * dx + (y - ay) * dy) / max(dx * dx + dy * dy, 1e-12)
        along = min(max(along, 0.0), 1.0)
        nearest = min(nearest, math.hypot(x - ax - along * dx, y - ay - along * dy))
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * dx:
            odd = not odd
        before = k
    return nearest if odd else -nearest


@inner
def _answered(probability: float, yes: bool, doubt: float) -> float:
    """Log probability of a yes-no answer, given the probability that yes is true."""
    true = probability if yes else 1.0 - probability
    return math.log((1.0 - doubt) * true + 0.5 * doubt)


@inner
def _spread_at(spread: Array, piece: Array, std: float) -> float:
    """Variance of an object's position plus that of the statement, averaged over directions;
    m^2."""
    aside = 2.0 * spread[0] * piece[3]
    return float(std * std + 0.5 * (aside * aside + spread[1] ** 2))


@inner
def _lens_of(problem: Problem, picture: Array) -> Array:
    """Principal point, focal lengths, and width and height of the image, pixels."""
    return np.array([problem.cx, problem.cy, problem.fx, problem.fy, picture[0], picture[1]])


@inner
def _spread_of(problem: Problem) -> Array:
    """Standard deviations of a piece's place (share of its width along it, m ahead) and yaw."""
    return np.array([problem.furniture_aside, problem.furniture_spread, problem.furniture_yaw])


@inner
def _as_case(sides: Array, own: Array, case: int, piece: Array) -> None:
    """A piece as its scenelet says (case 0), or with the sides of a kind of seat."""
    if case == 0:
        piece[:] = own
    else:
        resize(own, sides[case - 1], piece)


@inner
def _object(
    problem: Problem, camera: Array, s: int, pieces: Array, rotations: Array, shares: Array
) -> float:
    """Term of `ObjectAt`: measured position, size or image box of an object of some labels.

    Numbers: doubt, log density of a wrong answer, x, y, std (m), width, depth, height, std (m),
    left, top, right, bottom, std, image width and height (px). Parts with std 0 were not measured.
    """
    numbers, own = problem.given[s], shares[problem.given_kinds[s, 1]]
    lens, spread = _lens_of(problem, numbers[PICTURE_OF_OBJECT:]), _spread_of(problem)
    best, each = -math.inf, np.zeros(own.shape)
    mean, covariance, piece = np.empty(ERRORS), np.empty((ERRORS, ERRORS)), np.empty(PIECE)
    for k in range(len(own)):
        for case in range(own.shape[1]):
            if own[k, case] > 0.0:
                _as_case(problem.label_sides, pieces[k], case, piece)
                set_errors(piece, spread, mean, covariance)
                each[k, case] = measure_object(
                    numbers[SAID:], lens, camera, piece, rotations[k], mean, covariance
                )
                best = max(best, each[k, case])
    wrong = math.log(numbers[0]) + numbers[WRONG]
    if best == -math.inf:
        return float(wrong)
    total = 0.0
    for k in range(len(own)):
        for case in range(own.shape[1]):
            if own[k, case] > 0.0:
                total += own[k, case] * math.exp(each[k, case] - best)
    right = math.log(probability_right(numbers[0], own)) + best + math.log(total / own.sum())
    top = max(right, wrong)
    return float(top + math.log(math.exp(right - top) + math.exp(wrong - top)))


@inner
def _presence(problem: Problem, s: int, pieces: Array, shares: Array) -> float:
    """Term of `Presence`: whether an object of some labels is in a region, or anywhere.

    Numbers: doubt, 1 for yes, std of the region's edge (m).
    """
    numbers, kinds = problem.given[s], problem.given_kinds[s]
    none, own, spread = 1.0, shares[kinds[1]], _spread_of(problem)
    for k in range(len(own)):
        there = own[k].sum()
        if there > 0.0 and kinds[3] > kinds[2]:
            piece = pieces[k]
            far = _inside(problem.given_rows, kinds[2], kinds[3], piece[0], piece[1])
            there *= normal_cdf(far / math.sqrt(_spread_at(spread, piece, numbers[2])))
        none *= 1.0 - there
    return _answered(1.0 - none, numbers[1] > 0.0, numbers[0])


@inner
def _room(problem: Problem, cache: Cache, s: int, pieces: Array, rotations: Array) -> float:
    """Term of `Room`: whether furniture and pelvis are inside the walls; the answer is yes.

    Numbers: doubt, std of the walls (m).
    """
    numbers, first, end = problem.given[s], problem.given_kinds[s, 2], problem.given_kinds[s, 3]
    probability, nearest = 1.0, math.inf
    for t in range(len(cache.pose_row)):
        joints = cache.joints[cache.pose_row[t]]
        nearest = min(
            nearest, _inside(problem.given_rows, first, end, joints[0, PELV], joints[1, PELV])
        )
    probability, spread = normal_cdf(nearest / numbers[1]), _spread_of(problem)
    for k in range(len(pieces)):
        piece, turn, nearest = pieces[k], rotations[k], math.inf
        for corner in range(4):
            x, y = corner_of(piece, turn, corner, 0.0)
            nearest = min(nearest, _inside(problem.given_rows, first, end, x, y))
        probability *= normal_cdf(nearest / math.sqrt(_spread_at(spread, piece, numbers[1])))
    return _answered(probability, True, numbers[0])


@inner
def _point(problem: Problem, cache: Cache, camera: Array, s: int) -> float:
    """Term of `JointAt`: measured position of a joint in a frame; numbers: x, y, z, std (m)."""
    numbers, joint = problem.given[s], problem.given_kinds[s, 4]
    row = cache.pose_row[problem.given_kinds[s, 5]]
    pose = problem.pose_tolerance[joint] * math.exp(camera[3])
    total = 0.0
    for axis in range(3):
        off = numbers[axis] - cache.joints[row, axis, joint]
        total += log_normal(off, numbers[3] ** 2 + pose * pose)
    return total


@inner
def _depth(problem: Problem, cache: Cache, camera: Array, s: int) -> float:
    """Term of `DepthOf`: depths of a joint in frames; numbers: error and scale error (relative).

    Rows are frame and depth (m). Log depths have independent errors and one common error, so the
    covariance is diagonal plus rank one, whose determinant and inverse are known.
    """
    numbers, kinds = problem.given[s], problem.given_kinds[s]
    view, joint, count = camera_pose(camera), kinds[4], kinds[3] - kinds[2]
    pose = problem.pose_tolerance[joint] * math.exp(camera[3])
    a, b = numbers[0] ** 2, numbers[1] ** 2
    logs, squares, sums, weights = 0.0, 0.0, 0.0, 0.0
    for k in range(kinds[2], kinds[3]):
        joints = cache.joints[cache.pose_row[int(problem.given_rows[k, 0])]]
        depth = point_to_camera(view, joints[0, joint], joints[1, joint], joints[2, joint])[1]
        said = problem.given_rows[k, 1]
        off, variance = math.log(said / depth), a + (pose / depth) ** 2
        logs += math.log(variance) + 2.0 * math.log(said)
        squares += off * off / variance
        sums += off / variance
        weights += 1.0 / variance
    common = 1.0 + b * weights
    squares -= b * sums * sums / common
    return float(-0.5 * (count * LOG_2PI + logs + math.log(common) + squares))


@inner
def _far_from(
    cache: Cache, wanted: NDArray[np.bool_], sits: bool, x: float, y: float, z: float, n: int
) -> float:
    """Margin within reach of a joint to the nearest of some boxes, metres; negative beyond reach.

    For sitting, the joint must be close to a box's top; else any point of the box counts.
    """
    size, best = len(cache.boxes) // len(cache.counts), -math.inf
    for i in range(n):
        slot = cache.slots[1, i]
        for k in range(slot * size, slot * size + cache.counts[slot]):
            if not wanted[k]:
                continue
            box, turn = cache.boxes[k], cache.rotations[k]
            along, across = rotated_back(turn[0], turn[1], x - box[0], y - box[1])
            u, v = max(abs(along) - box[3], 0.0), max(abs(across) - box[4], 0.0)
            if sits:
                above = abs(z - box[2] - box[5])
                best = max(best, min(TOUCH_REACH - above, 0.5 * TOUCH_REACH - math.hypot(u, v)))
            else:
                w = max(abs(z - box[2]) - box[5], 0.0)
                best = max(best, TOUCH_REACH - math.sqrt(u * u + v * v + w * w))
    return best


@inner
def _margin(cache: Cache, wanted: NDArray[np.bool_], sits: bool, t: int, n: int) -> float:
    """Margin in a frame of the touching joint that is nearest to any of some boxes, metres."""
    joints, best = cache.joints[cache.pose_row[t]], -math.inf
    for joint in _TOUCHING[: 1 if sits else len(_TOUCHING)]:
        x, y, z = joints[0, joint], joints[1, joint], joints[2, joint]
        best = max(best, _far_from(cache, wanted, sits, x, y, z, n))
    return best


@inner
def _contact(problem: Problem, cache: Cache, s: int, owners: Ints, shares: Array, n: int) -> float:
    """Term of `Contact`: whether the person sits on, or touches, an object; the answer is yes.

    It may be another object in another frame. Numbers: doubt, 1 for sitting.
    """
    kinds, numbers, own = (
        problem.given_kinds[s],
        problem.given[s],
        shares[problem.given_kinds[s, 1]],
    )
    none = np.ones(kinds[6] - kinds[5])
    for piece in range(len(own)):
        share = own[piece].sum()
        if share == 0.0:
            continue
        wanted = owners == piece
        for t in range(len(none)):
            margin = _margin(cache, wanted, numbers[1] > 0.0, kinds[5] + t, n)
            none[t] *= 1.0 - share * normal_cdf(margin / _SOFT)
    return _answered(1.0 - none.max(), True, numbers[0])


@inner
def _same_object(
    problem: Problem, cache: Cache, s: int, owners: Ints, shares: Array, n: int
) -> float:
    """Term of `SameObject`: whether one object is in contact in all spans; the answer is yes.

    Numbers: doubt, 1 for sitting. Rows: first frame, and the frame after the last.
    """
    kinds, numbers, own = (
        problem.given_kinds[s],
        problem.given[s],
        shares[problem.given_kinds[s, 1]],
    )
    none = 1.0
    for piece in range(len(own)):
        share = own[piece].sum()
        if share == 0.0:
            continue
        wanted, least = owners == piece, math.inf
        for row in range(kinds[2], kinds[3]):
            for t in range(int(problem.given_rows[row, 0]), int(problem.given_rows[row, 1])):
                least = min(least, _margin(cache, wanted, numbers[1] > 0.0, t, n))
        none *= 1.0 - share * normal_cdf(least / _SOFT)
    return _answered(1.0 - none, True, numbers[0])


@inner
def _directions(piece: Array, turn: Array, angles: Array) -> None:
    """Least and greatest bearing of an object's corners from the camera, radians."""
    angles[0], angles[1] = math.inf, -math.inf
    for corner in range(4):
        x, y = corner_of(piece, turn, corner, 0.0)
        angle = math.atan2(x, y)
        angles[0], angles[1] = min(angles[0], angle), max(angles[1], angle)


@inner
def _behind(problem: Problem, s: int, pieces: Array, rotations: Array, shares: Array) -> float:
    """Term of `Behind`: whether an object is behind another from the camera; the answer is yes.

    Its centre is farther away, and the ranges of bearings overlap. Numbers: doubt. The second row
    of labels is that of the object in front.
    """
    numbers, row = problem.given[s], problem.given_kinds[s, 1]
    none, own, other, spread = 1.0, np.empty(2), np.empty(2), _spread_of(problem)
    for k in range(len(pieces)):
        if shares[row, k].sum() == 0.0:
            continue
        far = math.hypot(pieces[k, 0], pieces[k, 1])
        _directions(pieces[k], rotations[k], own)
        for j in range(len(pieces)):
            both = shares[row, k].sum() * shares[row + 1, j].sum()
            if j == k or both == 0.0:
                continue
            near = math.hypot(pieces[j, 0], pieces[j, 1])
            _directions(pieces[j], rotations[j], other)
            one = _spread_at(spread, pieces[k], 0.0)
            two = _spread_at(spread, pieces[j], 0.0)
            shared = min(own[1], other[1]) - max(own[0], other[0])
            aside = math.sqrt(one / (far * far) + two / (near * near))
            there = normal_cdf((far - near) / math.sqrt(one + two)) * normal_cdf(shared / aside)
            none *= 1.0 - both * there
    return _answered(1.0 - none, True, numbers[0])


@inner
def _person(problem: Problem, cache: Cache, camera: Array, t: int, edges: Array) -> None:
    """Left, top, right and bottom of the person in a frame, pixels, and the pelvis depth,
    metres."""
    pose, focal, joints = camera_pose(camera), math.exp(camera[2]), cache.joints[cache.pose_row[t]]
    edges[0], edges[1], edges[2], edges[3] = math.inf, math.inf, -math.inf, -math.inf
    for j in range(joints.shape[1]):
        right, depth, up = point_to_camera(pose, joints[0, j], joints[1, j], joints[2, j])
        u = problem.cx + focal * problem.fx * right / depth
        v = problem.cy - focal * problem.fy * up / depth
        edges[0], edges[2] = min(edges[0], u), max(edges[2], u)
        edges[1], edges[3] = min(edges[1], v), max(edges[3], v)
        if j == PELV:
            edges[4] = depth


@inner
def _pictured(
    problem: Problem,
    cache: Cache,
    camera: Array,
    s: int,
    pieces: Array,
    rotations: Array,
    shares: Array,
) -> float:
    """Term of `Seen`: output of an object detector, a Poisson process of labelled boxes.

    Numbers: detection rate of an object in full view, expected number of false boxes, log density
    of a false box, std (px), image width and height (px). Rows are boxes; the shares of a box are
    the probabilities of the detected label. The row of labels after those of the boxes has the
    probabilities of any label that the detector is listened to.
    """
    numbers, kinds = problem.given[s], problem.given_kinds[s]
    count, person = len(pieces), np.empty(5)
    lens, spread = _lens_of(problem, numbers[PICTURE_OF_BOXES:]), _spread_of(problem)
    outlines, rates = np.empty((count, 5)), np.empty(count)
    mean, covariance, piece = np.empty(ERRORS), np.empty((ERRORS, ERRORS)), np.empty(PIECE)
    edges, slopes = np.empty(5), np.empty((4, ERRORS))
    _person(problem, cache, camera, kinds[5], person)
    for k in range(count):
        project_outline(lens, camera, pieces[k], rotations[k], outlines[k], slopes)
    total = -numbers[1]
    for k in range(count):
        rates[k] = detection_rate(numbers[0], lens, outlines, k, person)
        total -= rates[k] * shares[kinds[1] + kinds[3] - kinds[2], k].sum()
    for d in range(kinds[3] - kinds[2]):
        density = numbers[1] * math.exp(numbers[CLUTTER])
        for k in range(count):
            own = shares[kinds[1] + d, k]
            for case in range(len(own)):
                if own[case] > 0.0 and rates[k] > 0.0:
                    _as_case(problem.label_sides, pieces[k], case, piece)
                    project_outline(lens, camera, piece, rotations[k], edges, slopes)
                    set_errors(piece, spread, mean, covariance)
                    box = problem.given_rows[kinds[2] + d]
                    near = measure_box(box, numbers[3], lens, edges, slopes, mean, covariance)
                    density += rates[k] * own[case] * math.exp(near)
        total += math.log(density)
    return float(total)


@inner
def _number(problem: Problem, camera: Array, s: int) -> float:
    """Term of `Measured`: camera or stature.

    Numbers: value and std in radians, metres or pixels, and the log of the stated unit in these
    (degrees for angles), so that the density is per stated unit. Quantities in order: pitch,
    elevation, focal length, stature.
    """
    which, numbers = problem.given_kinds[s, 4], problem.given[s]
    value = camera[0]
    if which == 1:
        value = camera[1]
    elif which == 2:
        value = problem.fx * math.exp(camera[2])
    elif which == 3:
        value = REFERENCE_STATURE * math.exp(camera[3])
    return float(log_normal(numbers[0] - value, numbers[1] ** 2) + numbers[2])


@inner
def statement_term(
    problem: Problem,
    cache: Cache,
    n: int,
    camera: Array,
    s: int,
    pieces: Array,
    rotations: Array,
    owners: Ints,
    shares: Array,
) -> float:
    """The log-likelihood of one statement, not yet raised to its power, nats.

    Parameters
    ----------
    problem : Problem
    cache : Cache
        With the proposal's furniture and joints.
    n : int
        Number of scenelets of the proposal.
    camera : (5,) float
    s : int
        Index of the statement.
    pieces : (k, 7) float
        Bounding boxes of the objects in the world frame, see :data:`PIECE`.
    rotations : (k, 2) float
        Cosine and sine of their yaws.
    owners : (B,) int
        Index of the object of each box in the cache; -1 for unused boxes.
    shares : (Q, k, 1 + C) float
        Probabilities of the cases of each object, for each row of labels
        (:func:`imapper_prob.models.kernels.given.set_shares`).

    Returns
    -------
    float
    """
    kind = problem.given_kinds[s, 0]
    if kind == NUMBER:
        value = _number(problem, camera, s)
    elif kind == OBJECT:
        value = _object(problem, camera, s, pieces, rotations, shares)
    elif kind == PRESENCE:
        value = _presence(problem, s, pieces, shares)
    elif kind == ROOM:
        value = _room(problem, cache, s, pieces, rotations)
    elif kind == POINT:
        value = _point(problem, cache, camera, s)
    elif kind == DEPTH:
        value = _depth(problem, cache, camera, s)
    elif kind == CONTACT:
        value = _contact(problem, cache, s, owners, shares, n)
    elif kind == SAME_OBJECT:
        value = _same_object(problem, cache, s, owners, shares, n)
    elif kind == BEHIND:
        value = _behind(problem, s, pieces, rotations, shares)
    else:
        value = _pictured(problem, cache, camera, s, pieces, rotations, shares)
    return float(value)
